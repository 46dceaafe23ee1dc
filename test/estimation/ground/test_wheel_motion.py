# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tests of the smoothing of wheel angles."""

import numpy as np
import pytest
from smart_tire.estimation.ground.wheel_motion import rate_weights, smoothed

PERIOD, JITTER, STEP = 0.0625, 0.001, 2.0 * np.pi / 2000.0 / np.sqrt(12.0)
TIMES = PERIOD * np.arange(60.0)


def angles(speed, times=TIMES):
    """Return the angles of four wheels of which the right ones are 20 % faster."""
    return np.outer(np.cumsum(speed) * PERIOD, [1.0, 1.2, 1.0, 1.2])


def test_the_rates_of_a_cubic_are_exact_between_uneven_samples_and_at_the_end():
    rng = np.random.default_rng(1)
    times = np.sort(rng.uniform(0.0, 2.0, 30))
    at = np.linspace(times[0], times[-1], 50)
    value, rate = np.polyval([0.3, -1.0, 2.0, 0.5], times), np.polyval([0.9, -2.0, 2.0], at)
    assert rate_weights(times, at) @ value == pytest.approx(rate, abs=1e-9)
    assert rate_weights(times, times[-1:] + 5.0) @ value == pytest.approx(rate[-1:], abs=1e-9)


def test_stamp_jitter_is_averaged_at_steady_speed_as_the_covariance_says():
    rng, errors, expected = np.random.default_rng(2), [], []
    for _ in range(10):
        true = angles(np.full(60, 9.0))
        stamps = TIMES + JITTER * rng.standard_normal(60)
        motion = smoothed(stamps, true, JITTER, STEP)
        weights = rate_weights(stamps, TIMES[20:40])
        errors.append(weights @ motion.angles.mean(axis=1) - 9.9)
        expected.append(np.sqrt(np.diag(motion.errors(weights)[0])))
    raw = np.sqrt(2.0) * JITTER * 9.9 / PERIOD
    assert np.std(errors) < 0.2 * raw
    assert 0.6 < np.std(errors) / np.mean(expected) < 1.6


def test_the_difference_of_the_sides_is_not_smoothed_by_the_jitter_of_their_common_stamps():
    stamps = TIMES + JITTER * np.random.default_rng(3).standard_normal(60)
    turn = np.where(TIMES < 2.0, 1.0, -1.0)  # the sides exchange their speeds
    true = np.cumsum(9.0 + np.outer(turn, [-2.0, 2.0, -2.0, 2.0]), axis=0) * PERIOD
    motion = smoothed(stamps, true, JITTER, STEP)
    rate = rate_weights(stamps, TIMES) @ motion.angles
    difference = rate[:, 1] - rate[:, 0]
    assert difference[26:30] == pytest.approx(4.0, abs=0.5)
    assert difference[36:40] == pytest.approx(-4.0, abs=0.5)


def test_a_step_of_the_speed_is_followed_within_two_samples_while_the_rest_stays_smooth():
    speed = np.where(TIMES < 2.0, 0.0, 9.0)
    motion = smoothed(TIMES, angles(speed), JITTER, STEP)
    rate = rate_weights(TIMES, TIMES) @ motion.angles
    assert np.abs(rate[:29, 0]).max() < 0.3
    assert rate[35:, 0] == pytest.approx(9.0, abs=0.3)
    variance = np.diag(motion.errors(np.eye(len(TIMES)))[0])
    assert variance[32] > 2.0 * variance[15]  # where the speed changed
