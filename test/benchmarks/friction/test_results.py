"""A short run by all methods: parts of every wheel, slip and method, and their figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.friction.figures import (
    adhesion_figure, bound_figure, friction_figure, stretch_figure, waveform_figure)
from benchmarks.friction.grid import Case
from benchmarks.friction.methods import AIDED, COMPARED, ESTIMATED, SOURCES, TRUE, WAVEFORM
from benchmarks.friction.monte_carlo import run_case
from benchmarks.friction.reference_results import PUBLISHED
from benchmarks.friction.results import by_run, run_all, slips_by_run
from benchmarks.friction.scenarios import FRICTION_SCENARIOS, INSTRUMENTED


@pytest.fixture(scope='module')
def result():
    """Return what all methods make of the start of a turn."""
    scenario = replace(FRICTION_SCENARIOS['concrete'], duration=9.0)
    return run_all('concrete', 1, scenario.events(1), scenario.robot)


def test_every_wheel_is_told_with_either_slip(result):
    assert set(result.parts) == {(wheel, source, method) for wheel in INSTRUMENTED
                                 for source, methods in COMPARED.items() for method in methods}
    assert COMPARED.keys() == SOURCES.keys()
    for part in result.parts.values():
        assert part.rows.found.all()
        assert part.rows.false == 0
        assert part.ms > 0.0


def test_the_true_slip_is_what_the_estimator_was_fed(result):
    true = result.parts['front_left', TRUE, WAVEFORM].rows
    estimated = result.parts['front_left', ESTIMATED, WAVEFORM].rows
    error = np.abs(true.value['slip'] - true.true['slip'])
    assert error.max() < 1e-3
    assert np.abs(estimated.value['slip'] - true.true['slip']).max() > error.max()


def test_the_estimated_slip_is_scored_with_and_without_the_films(result):
    scores = slips_by_run([result, result])['concrete']
    assert scores.keys() == {ESTIMATED, AIDED}
    for source, score in scores.items():
        assert score.count == 2 * len(result.slips[source][0]) > 1000
        assert 0.0 < score.rms < 0.03
    assert scores[AIDED].rms != scores[ESTIMATED].rms


def test_seeds_are_pooled_by_their_passages(result):
    once = by_run([result])['concrete']['front_left', TRUE, WAVEFORM]
    twice = by_run([result, replace(result, seed=2)])['concrete']['front_left', TRUE, WAVEFORM]
    assert twice['passages'] == 2.0 * once['passages']
    assert twice['starts'] == 2.0 * once['starts']
    assert twice['single_median'] == pytest.approx(once['single_median'], rel=0.3)


def test_two_peaks_have_figures_of_their_readings_and_the_waveform_has_none(result):
    figures = by_run([result])['concrete']
    for (_, _, method), values in figures.items():
        assert ('read_ratio' in values) == (method != WAVEFORM)


def test_published_errors_are_of_runs_that_there_are():
    assert PUBLISHED.keys() <= FRICTION_SCENARIOS.keys()
    for one in PUBLISHED.values():
        assert one.fused <= one.fused_90


def test_friction_is_drawn_with_bands_truth_and_units(result):
    figure = friction_figure('turn', result)
    assert len(figure.axes) == 4
    for ax in figure.axes:
        assert 'turn: front' in ax.get_title()
        assert len(ax.collections) >= 2  # with and without the sigmas of C_x and load
        assert ax.get_ylim()[0] == 0.0
    assert '[-]' in figure.axes[0].get_ylabel()
    assert [text.get_text() for text in figure.legends[0].get_texts()].count('truth') == 1


def test_a_waveform_is_drawn_with_its_fit_and_what_it_leaves_in_mv():
    figure = waveform_figure()
    titles = [ax.get_title() for ax in figure.axes]
    assert any('driving' in title for title in titles)
    assert any('braking' in title for title in titles)
    left = [line.get_ydata() for ax in figure.axes if '[mV]' in ax.get_ylabel()
            for line in ax.lines]
    assert left
    assert all(4.0 < np.std(one) < 6.5 for one in left)  # noise of 5 mV, and codes


def test_deviations_are_drawn_over_the_bound():
    figure = bound_figure([run_case('slip', Case(slip=slip), 8) for slip in (0.1, -0.1)])
    assert any('deviation over bound' in ax.get_ylabel() for ax in figure.axes)


def test_the_points_of_the_paper_lie_on_the_exact_curves_and_the_raw_ones_beside():
    stretch = stretch_figure().axes[0]
    exact = next(line for line in stretch.lines if line.get_label() == 'exact')
    fitted = [bars.lines[0] for bars in stretch.containers]
    raw = [line for line in stretch.lines if 'raw' in line.get_label()]
    assert len(fitted) == len(raw) == 2

    def off(line):
        x, y = line.get_data()
        told = np.isfinite(y) & (x > 0.05)
        return np.median(np.abs(y[told] - np.interp(x[told], *exact.get_data())))
    assert max(map(off, fitted)) < 0.2 * min(map(off, raw))
    assert len(adhesion_figure().axes) == 2
