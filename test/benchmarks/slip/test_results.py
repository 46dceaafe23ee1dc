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

"""Figures combined over seeds: errors by rms, statistics by mean."""

from __future__ import annotations

import math

from benchmarks.scenarios import SCENARIOS
from benchmarks.slip.reference_results import REFERENCE_RESULTS
from benchmarks.slip.results import by_run, combined, ERRORS, figures_of, path_figures, RunResult
from benchmarks.slip.scoring import Parts, PathScore, RunScore
import pytest
from smart_tire.analysis.metrics import Score

UNKNOWN = Score(10, 0.0, 0.3, math.nan, 0.0, 0.0)


def a_score(slip=0.02, normalized=1.5):
    """Return a score with the given slip errors."""
    part = Parts(Score(10, 0.0, slip, normalized, 0.6, 0.9), UNKNOWN)
    return RunScore(part, part, part, PathScore(50.0, 0.1, 0.2, 1.2, 0.94, part.selected, -0.03),
                    0.01, 1.1, 90.0)


def test_a_score_gives_all_figures():
    figures = figures_of(a_score())
    assert figures.keys() >= set(ERRORS)
    assert figures.keys() > path_figures(a_score().path).keys()
    assert figures['slip_left'] == 0.02
    assert figures['slip_left_all_times'] == 0.3
    assert figures['nees_slip_right'] == pytest.approx(2.25)
    assert figures['within_two_heading'] == 0.9
    assert figures['position_rms_percent'] == pytest.approx(0.2)
    assert figures['position_end_percent'] == pytest.approx(0.4)
    assert figures['heading_end'] == 0.03


def test_a_method_without_sigmas_has_no_share_within_them():
    figures = figures_of(a_score(normalized=math.nan))
    assert math.isnan(figures['nees_slip_left']) and math.isnan(figures['within_two_slip_left'])


def test_seeds_are_combined_by_rms_of_errors_and_mean_of_statistics():
    figures = combined([figures_of(a_score(slip=0.03)), figures_of(a_score(slip=0.04))])
    assert figures['slip_left'] == pytest.approx(math.sqrt(0.00125))
    assert figures['nees_slip_left'] == pytest.approx(2.25)
    assert figures['distance'] == 50.0


def test_runs_keep_their_order_and_methods():
    figures = figures_of(a_score())
    results = [RunResult('b', 1, {'x': figures, 'y': figures}), RunResult('a', 1, {'x': figures}),
               RunResult('b', 2, {'x': figures, 'y': figures})]
    runs = by_run(results)
    assert {run: list(methods) for run, methods in runs.items()} == {'b': ['x', 'y'], 'a': ['x']}
    assert list(runs) == ['b', 'a']


def test_every_reference_result_has_a_scenario():
    assert REFERENCE_RESULTS.keys() <= SCENARIOS.keys()
    for target in REFERENCE_RESULTS.values():
        assert target.balance.left < target.plain.left < target.no_slip.left
