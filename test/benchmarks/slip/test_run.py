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

"""The slip benchmark on a short run: tables, figures and results."""

from __future__ import annotations

from dataclasses import replace
import json

from benchmarks.scenarios import SCENARIOS
from benchmarks.slip import run
from benchmarks.slip.comparison import LIVE, METHODS, SMOOTHED
from benchmarks.slip.reference_results import REFERENCE_RESULTS
from benchmarks.slip.tables import reference_table
import pytest
from rich.console import Console


@pytest.fixture
def tiny(monkeypatch):
    """Shorten the first scenario to seconds."""
    monkeypatch.setitem(run.RUNS, 'concrete',
                        replace(SCENARIOS['concrete'], duration=6.0))


def test_a_run_gives_tables_figures_and_results(tiny, tmp_path, capsys):
    out = tmp_path / 'slip'
    assert run.main(['--seeds', '1', '--runs', 'concrete', '--out', str(out),
                     '--data', str(tmp_path)]) == 0
    output = capsys.readouterr().out
    for title in (SCENARIOS['concrete'].title, *METHODS.values(), 'reference', 'NEES'):
        assert title in output
    assert '[mm/s]' in output and '…' not in output  # units are shown, no cell is truncated
    assert {path.name for path in out.iterdir()} == {
        'concrete_slip.png', 'concrete_path.png', 'results.json'}
    concrete = json.loads((out / 'results.json').read_text())['runs']['concrete']
    assert concrete['over_seeds'].keys() == METHODS.keys()
    assert concrete['seeds']['1'][LIVE] == concrete['over_seeds'][LIVE]
    assert concrete['reference']['plain']['left'] == 0.007
    wheels = concrete['over_seeds']['wheels']
    assert concrete['over_seeds'][LIVE]['slip_left'] < wheels['slip_left']
    assert wheels['nees_slip_left'] is None


def test_missing_recordings_are_skipped_with_a_message(tiny, tmp_path, capsys):
    assert run.main(['--quick', '--runs', 'concrete', 'warthog_120',
                     '--out', str(tmp_path / 'out'), '--data', str(tmp_path)]) == 0
    assert f'warthog_120: not in {tmp_path}, skipped (--data DIR)' in capsys.readouterr().out
    results = json.loads((tmp_path / 'out' / 'results.json').read_text())
    assert results['skipped'] == ['warthog_120']


def test_an_unknown_run_is_a_usage_error_that_names_the_known_ones(tmp_path, capsys):
    assert run.main(['--runs', 'moon', '--out', str(tmp_path)]) == 2
    output = capsys.readouterr().err
    assert 'moon: no such run' in output and 'figure_eight' in output


def test_an_output_folder_that_cannot_be_created_is_an_error_in_one_line(tiny, tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert run.main(['--quick', '--runs', 'concrete', '--data', str(tmp_path),
                     '--out', str(tmp_path / 'file')]) == 2
    assert 'cannot be written' in capsys.readouterr().err


@pytest.mark.parametrize('seeds', ['0', '-1', 'two'])
def test_the_number_of_seeds_is_a_positive_integer(seeds, capsys):
    with pytest.raises(SystemExit):
        run.main(['--seeds', seeds])
    assert '--seeds' in capsys.readouterr().err


@pytest.mark.parametrize(('share', 'marks'), [(0.9, 0), (1.2, 2), (1.6, 4)])
def test_ratios_above_the_limits_are_marked(share, marks):
    target = REFERENCE_RESULTS['concrete'].plain
    figures = {'slip_left': share * target.left, 'slip_right': 0.5 * target.right,
               'speed': share * target.speed}
    console = Console(width=160, record=True, file=None)
    with console.capture() as capture:
        console.print(reference_table({'concrete': {LIVE: figures, SMOOTHED: figures}},
                                      {'concrete': 'concrete'}, REFERENCE_RESULTS))
    rows = [line for line in capture.get().splitlines() if line.strip().startswith('concrete')]
    assert rows[0].count('!') == marks
