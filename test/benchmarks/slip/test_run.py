"""The benchmark of slip and localization on a tiny run: tables, figures and results are there."""

from __future__ import annotations

from dataclasses import replace
import json

import pytest
from rich.console import Console

from benchmarks.scenarios import SCENARIOS
from benchmarks.slip import run
from benchmarks.slip.comparison import LIVE, METHODS, SMOOTHED
from benchmarks.slip.reference_results import TARGETS
from benchmarks.slip.tables import targets_table


@pytest.fixture
def tiny(monkeypatch):
    """Make a run of seconds out of the first scenario."""
    monkeypatch.setitem(run.SCENARIOS, 'concrete',
                        replace(SCENARIOS['concrete'], duration=6.0))


def test_a_run_is_told_in_tables_figures_and_numbers(tiny, tmp_path, capsys):
    out = tmp_path / 'slip'
    assert run.main(['--seeds', '1', '--runs', 'concrete', '--out', str(out),
                 '--data', str(tmp_path)]) == 0
    said = capsys.readouterr().out
    for title in (SCENARIOS['concrete'].title, *METHODS.values(), 'published', 'NEES'):
        assert title in said
    assert '[mm/s]' in said and '…' not in said  # units are shown, nothing is cut off
    assert {path.name for path in out.iterdir()} == {
        'concrete_slip.png', 'concrete_path.png', 'results.json'}
    concrete = json.loads((out / 'results.json').read_text())['runs']['concrete']
    assert concrete['over_seeds'].keys() == METHODS.keys()
    assert concrete['seeds']['1'][LIVE] == concrete['over_seeds'][LIVE]
    assert concrete['published']['plain']['left'] == 0.007
    wheels = concrete['over_seeds']['wheels']
    assert concrete['over_seeds'][LIVE]['slip_left'] < wheels['slip_left']
    assert wheels['nees_slip_left'] is None


def test_absent_recordings_are_left_out_with_a_word(tiny, tmp_path, capsys):
    assert run.main(['--quick', '--runs', 'concrete', 'warthog_120',
                 '--out', str(tmp_path / 'out'), '--data', str(tmp_path)]) == 0
    assert f'warthog_120: not in {tmp_path}, left out (--data DIR)' in capsys.readouterr().out
    results = json.loads((tmp_path / 'out' / 'results.json').read_text())
    assert results['left_out'] == ['warthog_120']


def test_an_unknown_run_is_a_usage_error_that_names_the_known_ones(tmp_path, capsys):
    assert run.main(['--runs', 'moon', '--out', str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert 'moon: no such run' in said and 'figure_eight' in said


def test_results_that_can_not_be_written_are_said_in_one_line(tiny, tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert run.main(['--quick', '--runs', 'concrete', '--data', str(tmp_path),
                 '--out', str(tmp_path / 'file')]) == 2
    assert 'cannot be written' in capsys.readouterr().err


@pytest.mark.parametrize('seeds', ['0', '-1', 'two'])
def test_seeds_are_a_whole_number_above_zero(seeds, capsys):
    with pytest.raises(SystemExit):
        run.main(['--seeds', seeds])
    assert '--seeds' in capsys.readouterr().err


@pytest.mark.parametrize(('share', 'marks'), [(0.9, 0), (1.2, 2), (1.6, 4)])
def test_what_misses_a_published_target_is_marked(share, marks):
    target = TARGETS['concrete'].plain
    figures = {'slip_left': share * target.left, 'slip_right': 0.5 * target.right,
               'speed': share * target.speed}
    console = Console(width=160, record=True, file=None)
    with console.capture() as capture:
        console.print(targets_table({'concrete': {LIVE: figures, SMOOTHED: figures}},
                                    {'concrete': 'concrete'}, TARGETS))
    rows = [line for line in capture.get().splitlines() if line.strip().startswith('concrete')]
    assert rows[0].count('!') == marks
