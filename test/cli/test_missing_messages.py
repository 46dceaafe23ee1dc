# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Exit status and the line about missing messages of the verbs that read bags."""

from __future__ import annotations

import json

import pytest
from smart_tire.bags import Bag
from smart_tire.cli.main import main
from smart_tire.parameters import build, SimulatorParams
from smart_tire.simulation.offline import simulate
from support.recordings import write_bag


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Return a whole bag and a copy with a damaged chunk in the middle."""
    folder = tmp_path_factory.mktemp('bags')
    whole = write_bag(folder / 'whole', simulate(
        build(SimulatorParams, {'film.wheels': [], 'seed': 2}), [(0.5, 100.0, 60.0)], 4.0))
    damaged = folder / 'damaged'
    damaged.mkdir()
    data = bytearray((whole / 'whole_0.mcap').read_bytes())
    data[len(data) // 3] ^= 1
    (damaged / 'damaged_0.mcap').write_bytes(data)
    (damaged / 'metadata.yaml').write_text((whole / 'metadata.yaml').read_text().replace(
        'whole_0', 'damaged_0'))
    return whole, damaged


WORDS = {
    'analyze': ['{bag}', '--no-figures', '--out', '{out}'], 'report': ['{bag}', '--out', '{out}'],
    'recover': ['{bag}', '--out', '{out}'], 'doctor': ['{bag}', '--json'],
    'identify': ['geometry', '{bag}', '--out', '{out}.yaml'],
    'calibrate': ['--bags', '{bag}', '--out', '{out}']}


@pytest.mark.parametrize('verb', WORDS)
def test_missing_messages_are_one_line_and_an_exit_status(verb, bags, tmp_path, capsys):
    whole, damaged = bags
    expected = main([verb, *(word.format(bag=whole, out=tmp_path / 'a') for word in WORDS[verb])])
    assert 'missing' not in capsys.readouterr().err
    status = main([verb, *(word.format(bag=damaged, out=tmp_path / 'b') for word in WORDS[verb])])
    output, error = capsys.readouterr()
    assert status == (expected or 3)
    line, = (line for line in error.splitlines() if 'missing' in line)
    assert line.startswith(f'smart_tire {verb}: {damaged}: ')
    assert 'messages or more are missing: damaged_0.mcap: damaged at byte' in line
    if verb == 'analyze':
        left_out = json.loads((tmp_path / 'b' / 'summary.json').read_text())['left_out']
        assert [one for one in left_out if 'are missing' in one] == [
            line.split(f'{damaged}: ')[1]]
    if verb == 'doctor':
        found = [one['found'] for one in json.loads(output)['findings']]
        assert [one for one in found if 'missing' in one] == [line.split(f'{damaged}: ')[1]]


def test_losses_are_also_reported_when_a_verb_fails(bags, tmp_path, capsys):
    damaged = tmp_path / 'short.mcap'
    with Bag(bags[0]) as bag:
        damaged.write_bytes((bag.path / 'whole_0.mcap').read_bytes()[:3000])
    assert main(['identify', 'geometry', str(damaged), '--out', str(tmp_path / 'a.yaml')]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert sum('file is truncated' in line for line in lines) == 1
