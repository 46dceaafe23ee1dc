# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire recover`` on the command line."""

from __future__ import annotations

import pytest
from smart_tire.bags import Bag
from smart_tire.cli.main import main
from support.recordings import stream, write_bag


@pytest.fixture
def cut(tmp_path):
    """Return a bag with a truncated file."""
    path = write_bag(tmp_path / 'cut', stream(1.0))
    file = path / 'cut_0.mcap'
    file.write_bytes(file.read_bytes()[:-30_000])
    return path


def test_message_counts_and_losses_are_printed(cut, tmp_path, capsys):
    assert main(['recover', str(cut)]) == 3
    output, error = capsys.readouterr()
    with Bag(tmp_path / 'cut_recovered') as bag:
        assert not bag.warnings
        for name, topic in bag.topics.items():
            assert f'{topic.messages} {name}' in output
        missing = len(stream(1.0)) - sum(topic.messages for topic in bag.topics.values())
    assert 'no damage' not in output
    assert error.startswith(f'smart_tire recover: {cut}: {missing} messages or more are missing: '
                            'cut_0.mcap: file is truncated')
    assert error.count('\n') == 1


def test_a_single_file_is_recovered_into_a_folder(cut, tmp_path, capsys):
    assert main(['recover', str(cut / 'cut_0.mcap'), '--out', str(tmp_path / 'whole')]) == 3
    assert (tmp_path / 'whole' / 'metadata.yaml').exists()
    assert str(tmp_path / 'whole') in capsys.readouterr().out


def test_an_intact_bag_is_reported(tmp_path, capsys):
    bag = write_bag(tmp_path / 'bag', stream(0.2))
    assert main(['recover', str(bag)]) == 0
    assert 'no damage found' in capsys.readouterr().out


def test_the_input_bag_is_not_replaced_even_with_force(cut, capsys):
    content = (cut / 'cut_0.mcap').read_bytes()
    assert main(['recover', str(cut), '--out', str(cut), '--force']) == 2
    assert 'is in the folder of the bag' in capsys.readouterr().err
    assert (cut / 'cut_0.mcap').read_bytes() == content
