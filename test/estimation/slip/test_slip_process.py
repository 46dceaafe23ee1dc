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

"""Slip change detection, and the prior of the slip velocities."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.slip_process import SlipChange, SlipChangeDetector, SlipPrior
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import build, SlipEstimatorParams

T = 0.0625  # s, 16 Hz


QUIET = 1e-5  # (m/s2)^2 s, noise density of an accelerometer at standstill


def settled(wheel=1.0, ground=0.9, innovation=0.0):
    change = SlipChangeDetector(SlipEstimatorParams())
    for _ in range(100):
        change.update(T, wheel, ground, innovation, 0.02, QUIET)
    return change


def test_slip_is_unknown_at_the_first_measurement():
    change = SlipChangeDetector(SlipEstimatorParams()).update(T, 1.0, 0.9, 0.0, 0.02, QUIET)
    assert change.variance == np.inf


def test_constant_speeds_are_not_a_change():
    assert settled().update(T, 1.0, 0.9, 0.01, 0.02, QUIET).variance == 0.0


def test_timestamp_jitter_is_not_a_change():
    rng, change = np.random.default_rng(1), settled()
    jitter = np.sqrt(2.0) * 0.001 / T
    variances = [
        change.update(T, 1.0 + jitter * rng.standard_normal(), 0.9, 0.0, 0.02, QUIET).variance
        for _ in range(500)]
    assert np.mean(np.array(variances) > 0.0) < 0.05


def test_vibration_is_not_a_change_of_ground_speed():
    assert settled().update(T, 1.0, 0.94, 0.0, 0.02, QUIET).variance > 0.0
    assert settled().update(T, 1.0, 0.94, 0.0, 0.02, 0.3 ** 2 * 0.05).variance == 0.0


@pytest.mark.parametrize('wheel, ground', [(1.4, 0.9), (1.0, 0.6)])
def test_a_change_of_wheel_or_ground_speed_changes_the_slip_velocity(wheel, ground):
    change = settled().update(T, wheel, ground, 0.0, 0.02, QUIET)
    assert 0.05 < np.sqrt(change.variance) < 0.5
    assert change.unexplained_variance > 0.25 ** 2
    assert change.acceleration == pytest.approx((ground - 0.9) / 0.3)


def test_one_large_innovation_is_an_outlier_and_two_are_a_change():
    change = settled()
    assert change.update(T, 1.0, 0.9, 0.3, 0.02, QUIET).variance == 0.0
    assert change.update(T, 1.0, 0.9, 0.3, 0.02, QUIET).variance == pytest.approx(0.3 ** 2)
    change = settled()
    change.update(T, 1.0, 0.9, 0.3, 0.02, QUIET)
    assert change.update(T, 1.0, 0.9, -0.3, 0.02, QUIET).variance == 0.0


def sigmas(covariance):
    """Return the sigma of mean and of half the difference of the two slip velocities."""
    return [np.sqrt(np.array([0.5, sign]) @ covariance @ np.array([0.5, sign]))
            for sign in (0.5, -0.5)]


def test_differential_slip_has_a_wider_prior_than_common_slip():
    common, differential = sigmas(
        SlipPrior(SlipEstimatorParams()).covariance([SlipChange(0.0, 1.0, 0.0, 0.0)] * 2))
    assert common == pytest.approx(0.07, rel=0.05)
    assert differential == pytest.approx(0.15, rel=0.05)


def test_acceleration_widens_the_prior_of_common_slip():
    prior = SlipPrior(SlipEstimatorParams())
    fast = sigmas(prior.covariance([SlipChange(0.0, 1.0, 3.0, 0.0)] * 2))
    slow = sigmas(prior.covariance([SlipChange(0.0, 1.0, 0.0, 0.0)] * 2))
    # 10.9 kg over four tires of 52.7 N: 0.052 per m/s2
    assert fast[0] == pytest.approx(np.hypot(slow[0], 3.0 * 10.9 / (4.0 * 52.7)), rel=1e-6)
    assert fast[1] == pytest.approx(slow[1])


@pytest.mark.parametrize('speeds', [(1.0, 1.0), (0.0, 1.0), (0.7, 0.7), (0.0, 0.0)])
def test_the_prior_is_positive_definite(speeds):
    changes = [SlipChange(0.0, abs(speed), 1.0, 0.0) for speed in speeds]
    assert np.linalg.eigvalsh(SlipPrior(SlipEstimatorParams()).covariance(changes)).min() > 0.0


def test_information_of_firm_ground_is_high_for_small_or_unknown_slip_only():
    prior, firm, common = SlipPrior(SlipEstimatorParams()), 0.015 ** -2, 0.07 ** -2
    assert prior.free_rolling(0.0, 0.12 ** 2, 0.0).information > 0.5 * firm
    assert prior.free_rolling(0.15, 0.02 ** 2, 0.0).information < 0.05 * common
    assert prior.free_rolling(0.15, 0.15 ** 2, 0.0).information > 0.3 * firm  # poorly known
    assert prior.free_rolling(0.0, 0.01 ** 2, 0.0).information < 0.01 * firm  # well known


def test_lost_slip_is_that_of_any_ground_in_a_turn():
    prior = SlipPrior(SlipEstimatorParams())
    lost, known = (prior.free_rolling(0.0, sigma ** 2, 0.5) for sigma in (0.15, 0.01))
    assert lost.firm_probability < 1e-3
    assert lost.information == pytest.approx(0.07 ** -2, rel=0.02)
    assert known.information < 0.01 * lost.information


def test_a_slope_makes_the_prior_apply_to_slip_that_seems_well_known():
    prior = SlipPrior(SlipEstimatorParams())
    level, hills = (prior.free_rolling(0.0, 0.015 ** 2, 0.0, slope_sigma=sigma).information
                    for sigma in (2e-4, 0.04))
    assert hills > 10.0 * level


def test_the_slip_of_an_acceleration_is_limited_for_a_robot_with_the_tire_of_another():
    heavy = SlipPrior(build(SlipEstimatorParams, {'mass': 470.0}))
    change = SlipChange(0.0, 1.0, 1.0, 0.0)
    assert sigmas(heavy.covariance([change] * 2))[0] == pytest.approx(
        np.hypot(0.07, 1.0 / GRAVITY), rel=0.05)


def test_soft_ground_widens_the_prior_for_some_seconds():
    prior = SlipPrior(SlipEstimatorParams())
    firm = sigmas(prior.covariance([SlipChange(0.0, 1.0, 0.0, 0.0)] * 2))[0]
    for _ in range(100):
        prior.update_soft_ground(0.2, 0.01 ** 2, 0.0625)
    assert sigmas(prior.covariance([SlipChange(0.0, 1.0, 0.0, 0.0)] * 2))[0] > 2.0 * firm
    for _ in range(400):
        prior.update_soft_ground(0.0, 0.01 ** 2, 0.0625)
    unchanged = [SlipChange(0.0, 1.0, 0.0, 0.0)] * 2
    assert sigmas(prior.covariance(unchanged))[0] == pytest.approx(firm, rel=0.01)
