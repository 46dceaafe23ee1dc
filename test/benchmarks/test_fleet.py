# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Benchmark of many bags: links, measured commands, rows."""

from benchmarks.fleet import ALL, link_bags, measured, rows
import pytest
from smart_tire.errors import SmartTireError


def test_bags_are_links_to_one(tmp_path):
    (tmp_path / 'drive').mkdir()
    (tmp_path / 'drive' / 'drive_0.mcap').write_text('messages')
    link_bags(tmp_path / 'drive', tmp_path / 'bags', 3)
    assert [path.read_text() for path in sorted(tmp_path.glob('bags/*/*'))] == ['messages'] * 3
    assert (tmp_path / 'drive' / 'drive_0.mcap').stat().st_nlink == 4


def test_a_row_has_times_and_sizes(tmp_path):
    pytest.importorskip('pyarrow', reason='needs pyarrow')
    (mode, count, *numbers), = rows(tmp_path, [ALL], [2])
    assert (mode, count) == (ALL, '2')
    wall, each, cpu, client, worker = map(float, numbers[:5])
    assert wall / 2 == pytest.approx(each, abs=0.1) and cpu > 0.0
    assert client > 50.0 and worker > 50.0 and numbers[5] == '-' and float(numbers[6]) > 10.0


def test_a_command_that_fails_is_reported(tmp_path):
    with pytest.raises(SmartTireError, match='(?s)has failed.*no such file'):
        measured(['analyze', tmp_path / 'none'])
