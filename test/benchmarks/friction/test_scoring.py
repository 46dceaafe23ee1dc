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

"""Scores of constructed crossings with known errors."""

from __future__ import annotations

import math

from benchmarks.friction.records import FUSED, QUANTITIES, Rows, SINGLE
from benchmarks.friction.scoring import (
    changes, figures_of, on_one_surface, own_sigma, peak_figures, single_squares, spread)
import numpy as np
import pytest

LOAD, STIFFNESS = 26.7, 52.7


def rows(mu, single=None, fused=None, *, slip=0.15, relative=0.02, stiffness=0.1, bound=0.02,
         estimated_stiffness=STIFFNESS):
    """Return crossings with true ``mu``, and estimates with ``relative`` sigma."""
    mu = np.asarray(mu, float)
    n = len(mu)
    single = mu if single is None else np.asarray(single, float)
    fused = single if fused is None else np.asarray(fused, float)
    true = {name: np.zeros(n) for name in QUANTITIES}
    true |= {SINGLE: mu, FUSED: mu, 'slip': np.full(n, slip), 'normal_load': np.full(n, LOAD),
             'stiffness': np.full(n, STIFFNESS), 'critical_slip': 3.0 * mu * LOAD / STIFFNESS}
    value = {name: column.copy() for name, column in true.items()}
    value |= {SINGLE: single, FUSED: fused, 'stiffness': np.full(n, estimated_stiffness),
              'critical_slip': 3.0 * fused * LOAD / estimated_stiffness}
    sigma = {name: np.full(n, 1e-3) for name in QUANTITIES}
    whole = math.hypot(relative, stiffness)
    sigma |= {SINGLE: whole * single, FUSED: whole * fused, 'normal_load': np.zeros(n),
              'stiffness': stiffness * value['stiffness'],
              'critical_slip': relative * value['critical_slip']}
    return Rows(np.arange(n), np.full(n, 0.5), np.full(n, bound), np.isfinite(single), true,
                value, sigma, 0)


def test_the_spread_from_quartiles_is_robust_against_outliers():
    errors = 0.1 * np.random.default_rng(1).standard_normal(20_000)
    assert spread(errors) == pytest.approx(0.1, rel=0.03)
    errors[:100] = 1e6
    assert spread(errors) == pytest.approx(0.1, rel=0.05)
    assert math.isnan(spread(np.empty(0)))


def test_errors_are_relative_and_missing_estimates_are_excluded():
    figures = figures_of(rows([0.5] * 5, [0.55, 0.45, 0.5, 0.55, math.nan]), [], 3.0)
    assert figures['single_finite'] == pytest.approx(0.8)
    assert figures['found'] == pytest.approx(0.8)
    assert figures['single_median'] == pytest.approx(0.1)
    assert figures['single_bias'] == pytest.approx(0.05)
    assert figures['ms'] == 3.0


def test_nees_excludes_the_sigma_of_the_stiffness_and_shares_include_it():
    crossings = rows([0.5] * 4, [0.52] * 4, relative=0.02, stiffness=0.1)
    assert own_sigma(crossings) == pytest.approx([0.02 * 0.52] * 4)
    assert single_squares(crossings) == pytest.approx([(0.02 / 0.52 / 0.02)**2] * 4)
    figures = figures_of(crossings, [], 1.0)
    assert figures['nees_single'] == pytest.approx(3.7, rel=0.01)
    assert figures['nees_fused'] == pytest.approx(3.7, rel=0.01)
    assert figures['single_within_one'] == 1.0


def test_a_wrong_stiffness_does_not_increase_the_nees():
    wrong = 1.75
    crossings = rows([0.35] * 3, [0.35 * wrong] * 3, estimated_stiffness=STIFFNESS * wrong)
    figures = figures_of(crossings, [], 1.0)
    assert figures['single_bias'] == pytest.approx(0.75)
    assert figures['nees_single'] == pytest.approx(0.0, abs=1e-20)
    assert figures['single_within_two'] == 0.0


def test_crossings_on_two_surfaces_are_counted_but_not_scored():
    crossings = rows([0.47, 0.47, 0.30, 0.2, 0.2], [0.47, 0.47, 0.2, 0.2, 0.2])
    assert on_one_surface(crossings).tolist() == [True, True, False, True, True]
    figures = figures_of(crossings, [], 1.0)
    assert figures['mixed'] == 1.0
    assert figures['mixed_within_two'] == 0.0
    assert figures['single_90'] == pytest.approx(0.0)


def test_the_ratio_to_the_bound_is_scored_for_informative_crossings_only():
    crossings = rows([0.5] * 40, 0.5 * (1.0 + np.tile([-0.02, 0.02], 20)), bound=0.02)
    figures = figures_of(crossings, [], 1.0)
    assert figures['bounded'] == 40.0
    assert figures['bounded_over_bound'] == pytest.approx(2.0 / 1.349)
    uninformative = figures_of(rows([0.5] * 4, bound=0.2), [], 1.0)
    assert uninformative['bounded'] == 0.0
    assert math.isnan(uninformative['bounded_over_bound'])


def test_revolutions_are_counted_until_convergence_on_a_new_surface():
    mu = [0.47] * 4 + [0.2] * 5 + [0.6] * 3
    fused = [0.9, 0.47, 0.47, 0.47] + [0.47, 0.3, 0.21, 0.2, 0.2] + [0.2, 0.2, 0.3]
    found = changes(rows(mu, fused=fused))
    assert [one.first for one in found] == [True, False, False]
    assert [one.revolutions for one in found] == [2.0, 3.0, math.inf]
    assert [one.fast for one in found] == [2, 3, 4]  # one more than there are if not converged
    figures = figures_of(rows(mu, fused=fused), found, 1.0)
    assert figures['start_revolutions'] == 2.0
    assert figures['jumps_found'] == 0.5
    assert figures['jump_worst'] == math.inf
    assert figures['jump_fast_worst'] == 4.0


def test_slow_revolutions_and_short_surfaces_are_not_penalized():
    mu = [0.47] * 3 + [0.3] + [0.2] * 4
    found = changes(rows(mu, fused=[0.47] * 4 + [0.47, 0.47, 0.2, 0.2], slip=0.05))
    assert [one.revolutions for one in found] == [1.0, 3.0]
    assert [one.fast for one in found] == [0, 0]


def test_without_jumps_their_figures_are_nan():
    figures = figures_of(rows([0.5] * 4), changes(rows([0.5] * 4)), 1.0)
    assert figures['jumps'] == 0.0
    assert math.isnan(figures['jump_worst'])
    assert math.isnan(figures['jump_fast_worst'])


def test_figures_of_the_paper_method_are_relative_to_the_truth():
    figures = peak_figures([np.array([1.0, 0.9, math.nan])], [rows([0.5] * 3)])
    assert figures['peaks_finite'] == pytest.approx(2.0 / 3.0)
    assert figures['peaks_ratio'] == pytest.approx(1.9)
    assert figures['peaks_median'] == pytest.approx(0.9)
