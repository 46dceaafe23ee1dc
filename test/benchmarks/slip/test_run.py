# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The slip benchmark on a short run: tables, figure and results."""

from __future__ import annotations

from dataclasses import replace
import json

from benchmarks.scenarios import SCENARIOS
from benchmarks.slip import run
from benchmarks.slip.methods import LIVE, METHODS


def test_a_run_gives_tables_and_results(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(SCENARIOS, 'concrete', replace(SCENARIOS['concrete'], duration=6.0))
    out = tmp_path / 'slip'
    assert run.SLIP.main(['--seeds', '1', '--runs', 'concrete', '--out', str(out)]) == 0
    output = capsys.readouterr().out
    for words in (SCENARIOS['concrete'].title, *METHODS.values(), 'NEES', '[mm/s]', '[%]'):
        assert words in output
    assert '…' not in output and 'Recordings' not in output.partition('Errors')[2]
    assert {path.name for path in out.iterdir()} == {'slip.md', 'results.json'}
    found = json.loads((out / 'results.json').read_text())['rows']['concrete']
    assert found['seeds']['1'] == found['over_seeds']
    figures = found['over_seeds']
    assert figures[f'{LIVE}.slip_left.rms'] < figures['wheels.slip_left.rms']
    assert figures['wheels.heading.nees'] is None
