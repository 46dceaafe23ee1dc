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

"""Spread of the slope: learned from residuals, kept without evidence, robust to outliers."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.slope_spread import (
    change_sensitivity, mean_sensitivity, SlopeResidual, SlopeSpread)
from smart_tire.models.constants import GRAVITY

PRIOR = 2e-4   # rad
NOISE = 0.01   # m/s2
SEEDS = range(5)


def residuals(spread, count, seed):
    values = np.random.default_rng(seed).normal(0.0, np.hypot(NOISE, GRAVITY * spread), count)
    return [SlopeResidual(value, NOISE ** 2, 1.0) for value in values.tolist()]


def fed(residuals, prior=PRIOR):
    slope = SlopeSpread(prior)
    for residual in residuals:
        slope.update(residual)
    return slope


def learned(spread, count, seed, prior=PRIOR):
    return fed(residuals(spread, count, seed), prior).sigma


@pytest.mark.parametrize('true', [0.005, 0.02, 0.05])
@pytest.mark.parametrize('prior', [PRIOR, 0.02])
def test_a_large_spread_is_learned_from_any_prior(true, prior):
    ratios = [learned(true, 60, seed, prior) / true for seed in SEEDS]
    assert np.exp(np.mean(np.log(ratios))) == pytest.approx(1.0, abs=0.2)


def test_a_few_residuals_of_hills_suffice():
    assert np.median([learned(0.02, 4, seed) for seed in range(20)]) > 0.005


@pytest.mark.parametrize('seed', SEEDS)
def test_level_ground_keeps_the_prior_within_its_sigma(seed):
    assert 0.5 * PRIOR < learned(0.0, 200, seed) < 1.5 * PRIOR


def test_a_single_outlier_does_not_make_hills():
    outlier = SlopeResidual(0.4, NOISE ** 2, 1.0)
    assert fed([*residuals(0.0, 10, 1), outlier, *residuals(0.0, 10, 2)]).sigma < 1e-3


def test_an_imprecise_residual_is_no_evidence():
    assert fed([SlopeResidual(0.3, 0.3 ** 2, 1.0)] * 5).sigma < 2.0 * PRIOR


def test_residuals_of_the_imu_alone_raise_the_spread_and_never_lower_it():
    slope = SlopeSpread(PRIOR)
    slope.update_at_least(residuals(0.02, 10, 1))
    raised = slope.sigma
    assert 0.01 < raised < 0.05
    slope.update_at_least([SlopeResidual(0.0, NOISE ** 2, 1.0)] * 100)
    assert slope.sigma == raised


def test_level_ground_after_hills_is_learned_again():
    slope = fed(residuals(0.02, 20, 1))
    slope.elapse(100.0)
    for residual in residuals(0.0, 60, 2):
        slope.update(residual)
    assert slope.sigma < 1e-3


def test_sensitivities_have_their_limits():
    assert mean_sensitivity(1e-9) == 1.0
    assert mean_sensitivity(1e4) == pytest.approx(2.0 * 5.0 / 1e4, rel=1e-3)
    assert change_sensitivity(0.0, 0.0) == 0.0
    assert change_sensitivity(1e4) == change_sensitivity(0.0, 1e4) == 2.0
