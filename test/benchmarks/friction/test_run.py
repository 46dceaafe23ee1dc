# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The friction benchmark on a short run: tables, figures and results."""

from __future__ import annotations

from dataclasses import replace
import json
import math

from benchmarks.friction import run
from benchmarks.friction.grid import Case
from benchmarks.friction.methods import METHODS, WAVEFORM
from benchmarks.friction.monte_carlo import CaseResult, Trial
from benchmarks.friction.scenarios import FRICTION_SCENARIOS, INSTRUMENTED
from benchmarks.friction.tables import cases_table
import pytest
from rich.console import Console


@pytest.fixture
def tiny(monkeypatch):
    """Shorten the first scenario to seconds, and use one case of a few crossings."""
    monkeypatch.setitem(run.FRICTION_SCENARIOS, 'concrete',
                        replace(FRICTION_SCENARIOS['concrete'], duration=8.0))
    monkeypatch.setattr(run, 'QUICK_COUNT', 4)
    monkeypatch.setattr(run, 'quick_cases', lambda: {'slip': [Case(slip=0.1)]})


@pytest.mark.long
def test_a_run_gives_tables_a_figure_and_results(tiny, tmp_path, capsys):
    out = tmp_path / 'friction'
    assert run.main(['--seeds', '1', '--runs', 'concrete',
                     '--out', str(out)]) == 0
    output = capsys.readouterr().out
    for words in (FRICTION_SCENARIOS['concrete'].title, 'reference', 'NEES', 'exact map',
                  'printed map', 'true slip', 'front left'):
        assert words in output
    assert '[%]' in output and '…' not in output  # units are shown, no cell is truncated
    assert {path.name for path in out.iterdir()} == {
        'concrete.png', 'concrete_forces.png', 'forces.md', 'results.json'}
    concrete = json.loads((out / 'results.json').read_text())['runs']['concrete']
    assert concrete['seeds'] == [1]
    assert concrete['reference']['single'] == 0.017
    assert concrete['wheels'].keys() == set(INSTRUMENTED)
    for methods in concrete['wheels'].values():
        assert methods.keys() == METHODS.keys()
        assert methods[WAVEFORM]['found'] == 1.0


def test_synthesized_crossings_are_compared_with_the_bound(tiny, tmp_path, capsys):
    assert run.main(['--quick', '--runs', 'crossings',
                     '--out', str(tmp_path)]) == 0
    assert '4 synthesized crossings each' in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {
        'waveform.png', 'bound.png', 'fig_12.png', 'fig_13.png', 'results.json'}
    (case,) = json.loads((tmp_path / 'results.json').read_text())['crossings']
    assert case['case']['slip'] == 0.1
    assert 0.01 < case['bound'] < 0.03
    assert case['trials'].keys() == METHODS.keys()


def test_an_unknown_run_is_a_usage_error_that_names_the_known_ones(tmp_path, capsys):
    assert run.main(['--runs', 'moon', '--out', str(tmp_path)]) == 2
    output = capsys.readouterr().err
    assert 'moon: no such run' in output and 'crossings' in output and 'figure_eight' in output


def test_an_output_folder_that_cannot_be_created_is_an_error_in_one_line(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert run.main(['--out', str(tmp_path / 'file')]) == 2
    assert 'cannot be written' in capsys.readouterr().err


@pytest.mark.parametrize('existing', ['results.json', 'bound.png'])
def test_results_of_an_earlier_run_are_kept_unless_forced(existing, tmp_path, capsys):
    (tmp_path / existing).write_text('kept')
    assert run.main(['--out', str(tmp_path)]) == 2
    assert f'{existing} exists' in capsys.readouterr().err
    assert (tmp_path / existing).read_text() == 'kept'


@pytest.mark.parametrize(('bound', 'trial', 'marks'), [
    (0.02, Trial(1.0, 0.01, 0.02, 0.03, 1.0, 3.0), 0),
    (0.02, Trial(1.0, -0.03, 0.03, 0.05, 1.5, 6.0), 4),
    (0.2, Trial(1.0, 0.1, 0.3, 0.5, 0.2, 3.0), 0), (0.2, Trial(0.0, *(math.nan,) * 4, 6.0), 1)])
def test_figures_outside_the_requirements_are_marked_if_informative(bound, trial, marks):
    one = CaseResult('slip', Case(slip=0.1), bound, 100, 1.0, {WAVEFORM: trial})
    console = Console(width=160)
    with console.capture() as capture:
        console.print(cases_table([one]))
    rows = [line for line in capture.get().splitlines() if '+0.10' in line]
    assert rows[0].count('!') == marks
