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

"""Prior of C_x: kept without evidence, given up when contradicted, moments of a mixture."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.state import N, State
from smart_tire.estimation.slip.stiffness_prior import CALIBRATED_PROBABILITY, StiffnessPrior
from smart_tire.parameters import build, SlipEstimatorParams

WIDE = 0.5        # of the prior of ln C_x on any ground
CALIBRATED = 0.02  # of that on the calibrated ground
ROW = State.LN_STIFFNESS


def new_prior(calibrated=CALIBRATED):
    return StiffnessPrior(build(SlipEstimatorParams, {
        'ground_stiffness_sigma': WIDE, 'tire.longitudinal_stiffness_sigma': calibrated}))


def state(mean, sigma, seed=0):
    """Return state and covariance with this ln C_x, correlated with the slip of the left side."""
    x, P = np.zeros(N), 1e-2 * np.eye(N)
    x[ROW], x[State.SLIP_VEL_L] = mean, 0.05
    P[ROW, ROW], P[State.SLIP_VEL_L, State.SLIP_VEL_L] = sigma ** 2, 0.02 ** 2
    P[ROW, State.SLIP_VEL_L] = P[State.SLIP_VEL_L, ROW] = -0.8 * sigma * 0.02
    return x, P


def density(mean, sigma, calibrated=CALIBRATED):
    """Return mean and variance of ln C_x by numerical integration over the mixture."""
    grid = np.linspace(-4.0, 4.0, 800_001)
    near = np.exp(-0.5 * (grid / calibrated) ** 2) / calibrated
    wide = np.exp(-0.5 * (grid / WIDE) ** 2) / WIDE
    prior = CALIBRATED_PROBABILITY * near + (1.0 - CALIBRATED_PROBABILITY) * wide
    # the filter's Gaussian contains the wide prior already
    weight = prior / wide * np.exp(-0.5 * ((grid - mean) / sigma) ** 2)
    weight /= weight.sum()
    center = float(weight @ grid)
    return center, float(weight @ (grid - center) ** 2)


@pytest.mark.parametrize(('mean', 'sigma'), [
    (0.0, WIDE), (0.0, 0.1), (0.05, 0.1), (0.3, 0.15), (-0.7, 0.1), (-0.3, 0.3), (0.02, 0.01)])
def test_mean_and_variance_are_those_of_the_mixture(mean, sigma):
    x, P = new_prior().condition(*state(mean, sigma))
    center, variance = density(mean, sigma)
    assert x[ROW] == pytest.approx(center, abs=1e-4)
    assert P[ROW, ROW] == pytest.approx(variance, rel=1e-3)


def test_the_calibrated_value_holds_without_evidence():
    x, P = new_prior().condition(*state(0.0, WIDE))
    assert x[ROW] == 0.0
    # 70 % on the calibrated ground
    assert np.sqrt(P[ROW, ROW]) == pytest.approx(
        WIDE * np.sqrt(1.0 - CALIBRATED_PROBABILITY), rel=0.02)


def test_evidence_near_the_calibrated_value_is_confirmed_and_narrowed():
    x, P = new_prior().condition(*state(0.04, 0.1))
    assert abs(x[ROW]) < 0.02 and np.sqrt(P[ROW, ROW]) < 0.5 * 0.1


def test_evidence_against_the_calibrated_value_is_kept():
    for mean in -0.7, 0.7:
        before, covariance = state(mean, 0.1)
        x, P = new_prior().condition(before, covariance)
        assert x[ROW] == pytest.approx(mean, abs=0.01)
        assert P[ROW, ROW] == pytest.approx(0.01, rel=0.05)


def test_ambiguous_evidence_increases_sigma():
    variances = [new_prior().condition(*state(mean, 0.1))[1][ROW, ROW]
                 for mean in (0.0, 0.28, 0.7)]
    assert variances[0] < 0.5 * 0.1 ** 2 and variances[1] > 1.5 * 0.1 ** 2
    assert variances[2] == pytest.approx(0.1 ** 2, rel=0.05)


@pytest.mark.parametrize('seed', range(10))
def test_the_covariance_stays_symmetric_and_positive(seed):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((N, N))
    x, P = rng.normal(0.0, 0.3, N), root @ root.T / N
    P *= 10.0 ** rng.uniform(-3.0, 0.0)
    _, conditioned = new_prior().condition(x, P)
    assert np.allclose(conditioned, conditioned.T)
    assert np.linalg.eigvalsh(conditioned).min() > -1e-12


def test_other_states_follow_by_their_correlation():
    x, P = state(0.04, 0.1)
    after, conditioned = new_prior().condition(x, P)
    # less C_x than estimated needs more slip
    moved = after[State.SLIP_VEL_L] - x[State.SLIP_VEL_L]
    assert moved == pytest.approx(-0.8 * 0.02 / 0.1 * (after[ROW] - 0.04))
    assert moved > 0.0
    assert conditioned[State.SLIP_VEL_L, State.SLIP_VEL_L] < P[State.SLIP_VEL_L, State.SLIP_VEL_L]
    others = [row for row in range(N) if row not in (ROW, State.SLIP_VEL_L)]
    assert [after[row] for row in others] == [x[row] for row in others]


def test_a_calibration_that_is_not_narrower_than_any_ground_changes_nothing():
    x, P = state(0.3, 0.2)
    after, conditioned = new_prior(2.0 * WIDE).condition(x, P)
    assert after == x.tolist() and conditioned is P
