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

"""A short run by all methods: results per wheel and method, and figures."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.friction.figures import (
    adhesion_figure, bound_figure, friction_figure, stretch_figure, waveform_figure)
from benchmarks.friction.grid import Case
from benchmarks.friction.methods import METHODS, WAVEFORM
from benchmarks.friction.monte_carlo import run_case
from benchmarks.friction.reference_results import REFERENCE_RESULTS
from benchmarks.friction.results import by_run, run_all
from benchmarks.friction.scenarios import FRICTION_SCENARIOS, INSTRUMENTED
import numpy as np
import pytest


@pytest.fixture(scope='module')
def result():
    """Return the results of all methods for the start of a turn."""
    scenario = replace(FRICTION_SCENARIOS['concrete'], duration=9.0)
    return run_all('concrete', 1, scenario.events(1), scenario.robot)


def test_every_wheel_has_results_of_all_methods(result):
    assert set(result.parts) == {(wheel, method) for wheel in INSTRUMENTED for method in METHODS}
    for part in result.parts.values():
        assert part.rows.found.all()
        assert part.rows.false == 0
        assert part.ms > 0.0


def test_seeds_are_pooled_by_crossings(result):
    once = by_run([result])['concrete']['front_left', WAVEFORM]
    twice = by_run([result, replace(result, seed=2)])['concrete']['front_left', WAVEFORM]
    assert twice['crossings'] == 2.0 * once['crossings']
    assert twice['starts'] == 2.0 * once['starts']
    assert twice['single_median'] == pytest.approx(once['single_median'], rel=0.3)


def test_only_two_peaks_have_figures_of_the_paper_method(result):
    figures = by_run([result])['concrete']
    for (_, method), values in figures.items():
        assert ('peaks_ratio' in values) == (method != WAVEFORM)


def test_reference_results_belong_to_existing_scenarios():
    assert REFERENCE_RESULTS.keys() <= FRICTION_SCENARIOS.keys()
    for one in REFERENCE_RESULTS.values():
        assert one.fused <= one.fused_90


def test_friction_is_drawn_with_bands_truth_and_units(result):
    figure = friction_figure('turn', result)
    assert len(figure.axes) == 2
    for ax in figure.axes:
        assert 'turn: front' in ax.get_title()
        assert len(ax.collections) >= 2  # with and without the sigmas of C_x and load
        assert ax.get_ylim()[0] == 0.0
    assert '[-]' in figure.axes[0].get_ylabel()
    assert [text.get_text() for text in figure.legends[0].get_texts()].count('truth') == 1


def test_a_waveform_is_drawn_with_fit_and_residual_in_mv():
    figure = waveform_figure()
    titles = [ax.get_title() for ax in figure.axes]
    assert any('driving' in title for title in titles)
    assert any('braking' in title for title in titles)
    residuals = [line.get_ydata() for ax in figure.axes if '[mV]' in ax.get_ylabel()
                 for line in ax.lines]
    assert residuals
    assert all(4.0 < np.std(one) < 6.5 for one in residuals)  # noise of 5 mV, and quantization


def test_standard_deviations_are_drawn_over_the_bound():
    figure = bound_figure([run_case('slip', Case(slip=slip), 8) for slip in (0.1, -0.1)])
    assert any('standard deviation over bound' in ax.get_ylabel() for ax in figure.axes)


def test_fitted_points_are_on_the_exact_curves_and_raw_ones_are_not():
    stretch = stretch_figure().axes[0]
    exact = next(line for line in stretch.lines if line.get_label() == 'exact')
    fitted = [bars.lines[0] for bars in stretch.containers]
    raw = [line for line in stretch.lines if 'raw' in line.get_label()]
    assert len(fitted) == len(raw) == 2

    def error(line):
        x, y = line.get_data()
        finite = np.isfinite(y) & (x > 0.05)
        return np.median(np.abs(y[finite] - np.interp(x[finite], *exact.get_data())))
    assert max(map(error, fitted)) < 0.2 * min(map(error, raw))
    assert len(adhesion_figure().axes) == 2
