# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The friction benchmark on a short run: tables, figures and results."""

from __future__ import annotations

from dataclasses import replace
import json

from benchmarks.friction import run
from benchmarks.friction.grid import Case
from benchmarks.friction.scenarios import FILM, FRICTION_SCENARIOS
import pytest


def results(folder):
    return {row: found['over_seeds'] for row, found in json.loads(
        (folder / 'results.json').read_text())['rows'].items()}


@pytest.mark.long
def test_a_run_gives_tables_and_results(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(
        FRICTION_SCENARIOS, 'concrete', replace(FRICTION_SCENARIOS['concrete'], duration=8.0))
    assert run.FRICTION.main(['--quick', '--runs', 'concrete', '--out', str(tmp_path)]) == 0
    output = capsys.readouterr().out
    for words in (FRICTION_SCENARIOS['concrete'].title, 'NEES', 'exact map', 'printed map',
                  'front left', '[%]'):
        assert words in output
    assert '…' not in output  # no cell is truncated
    assert {path.name for path in tmp_path.iterdir()} == {
        'friction.md', 'results.json'}
    rows = results(tmp_path)
    assert rows.keys() == {f'concrete/{wheel}' for wheel in FILM.wheels}
    assert all(rows[f'concrete/{wheel}']['found'] == 1.0 for wheel in FILM.wheels)


def test_synthesized_crossings_are_compared_with_the_bound(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(run, 'QUICK_COUNT', 4)
    monkeypatch.setattr(run, 'quick_cases', lambda: {'slip': [Case(slip=0.1)]})
    assert run.FRICTION.main(['--quick', '--runs', 'crossings', '--out', str(tmp_path)]) == 0
    assert 'Synthesized crossings' in capsys.readouterr().out
    ((row, figures),) = results(tmp_path).items()
    assert row == 'crossings/slip: slip +0.10, mu 0.47, 60 rpm, 5 mV'
    assert 0.01 < figures['bound'] < 0.03 and 'printed.bias' in figures
