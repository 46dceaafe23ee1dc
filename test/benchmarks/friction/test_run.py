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
import math

from benchmarks.friction import run
from benchmarks.friction.grid import Case
from benchmarks.friction.scenarios import FILM, GROUND_SCENARIOS, SURFACE_SCENARIOS
from benchmarks.grounds import CONCRETE, ground, SAND
import pytest
from smart_tire.samples import WheelSample

SHORT_TOUR = replace(
    GROUND_SCENARIOS['tour'], duration=15.0, ground=ground(CONCRETE, fields=[(SAND, 3.0, 90.0)]))


def results(folder):
    return {row: found['over_seeds'] for row, found in json.loads(
        (folder / 'results.json').read_text())['rows'].items()}


@pytest.mark.long
def test_a_run_gives_tables_and_results(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(run.SCENARIOS, 'concrete',
                        replace(SURFACE_SCENARIOS['concrete'], duration=8.0))
    assert run.FRICTION.main(['--quick', '--runs', 'concrete', '--out', str(tmp_path)]) == 0
    output = capsys.readouterr().out
    for words in (SURFACE_SCENARIOS['concrete'].title, 'NEES', 'exact map', 'printed map',
                  'front left', 'no torque', '[%]'):
        assert words in output
    assert '…' not in output  # no cell is truncated
    assert {path.name for path in tmp_path.iterdir()} == {
        'friction.md', 'results.json'}
    rows = results(tmp_path)
    assert rows.keys() == {'concrete/', *(f'concrete/{wheel}' for wheel in FILM.wheels)}
    assert all(rows[f'concrete/{wheel}']['found'] == 1.0 for wheel in FILM.wheels)


def test_synthesized_crossings_are_compared_with_the_bound(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(run, 'QUICK_COUNT', 4)
    monkeypatch.setattr(run, 'quick_cases', lambda: {'slip': [Case(slip=0.1)]})
    assert run.FRICTION.main(['--quick', '--runs', 'crossings', '--out', str(tmp_path)]) == 0
    assert 'Synthesized crossings' in capsys.readouterr().out
    ((row, figures),) = results(tmp_path).items()
    assert row == 'crossings/slip: slip +0.10, mu 0.47, 60 rpm, 5 mV'
    assert 0.01 < figures['bound'] < 0.03 and 'printed.bias' in figures


def test_several_grounds_are_scored_apart_without_and_with_torque(monkeypatch):
    monkeypatch.setitem(run.SCENARIOS, 'tour', SHORT_TOUR)
    runs = run.run_scenario('tour', 2, compare=False)
    assert [one.row for one in runs] == ['tour/', f'tour/{CONCRETE}', f'tour/{SAND}'] * 2
    for variant, (whole, *parts) in zip(run.VARIANTS, (runs[:3], runs[3:])):
        count = [len(one.errors[f'{variant}.mu'].error) for one in (whole, *parts)]
        assert count[0] == count[1] + count[2] > count[2] > 0
        assert 0.0 < whole.figures[f'{variant}.v_y']['rms'] < 0.03
        assert math.isnan(whole.figures[f'{variant}.straight']['rms'])  # nothing but turns
        assert len(whole.errors[f'{variant}.jump'].error) == len(FILM.wheels)


def test_only_the_variant_with_torque_receives_efforts(monkeypatch):
    seen = []

    class Pipeline:

        def __init__(self, params):
            seen.append(set())

        def update(self, sample):
            if isinstance(sample, WheelSample):
                seen[-1].add(sample.effort is not None)
            return []

        def finish(self):
            return []
    monkeypatch.setattr(run, 'Pipeline', Pipeline)
    monkeypatch.setattr(run, 'motion_errors', lambda *_: {})
    monkeypatch.setitem(run.SCENARIOS, 'tour', replace(SHORT_TOUR, duration=4.0))
    run.run_scenario('tour', 2, compare=False)
    assert seen == [{False}, {True}]
