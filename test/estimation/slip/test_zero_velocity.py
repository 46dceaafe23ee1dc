# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Standstill detection: wheels stationary, IMU quiet, yaw rate settled."""

import numpy as np
import pytest

from smart_tire.estimation.slip.inputs import ZeroVelocityDetector
from smart_tire.estimation.slip.state import IMU_WINDOW, ImuReading, QUIET_TIME

GYRO, ACCEL = 0.01, 0.05


@pytest.fixture
def detector():
    return ZeroVelocityDetector(GYRO, ACCEL)


def feed(detector, duration, *, rate=lambda t: 0.0, force=lambda t: 0.0, seed=0, start=0.0):
    rng = np.random.default_rng(seed)
    for time in np.arange(start, start + duration, 0.01):
        detector.add_reading(time, ImuReading(rate(time) + GYRO * rng.standard_normal(),
                                              force(time) + ACCEL * rng.standard_normal(),
                                              ACCEL * rng.standard_normal()))
    return start + duration


@pytest.mark.parametrize('seed', range(3))
def test_a_quiet_robot_is_stationary_and_its_mean_rate_is_the_gyro_bias(detector, seed):
    time = feed(detector, QUIET_TIME + 0.1, rate=lambda t: 0.02, seed=seed)
    assert detector.detect(time, 0.0) is not None
    time = feed(detector, IMU_WINDOW, rate=lambda t: 0.02, seed=seed + 100, start=time)
    standstill = detector.detect(time, 0.0)
    assert standstill.duration == pytest.approx(IMU_WINDOW)
    assert abs(standstill.rate - 0.02) < 4.0 * standstill.sigma
    assert standstill.sigma == pytest.approx(GYRO / 10.0, rel=0.05)


def test_rolling_wheels_or_a_moving_imu_are_not_standstill(detector):
    time = feed(detector, 2.0)
    assert detector.detect(time, 0.05) is None
    time = feed(detector, 0.5, force=lambda t: 2.0 * (t - 2.0), start=time)
    assert detector.detect(time, 0.0) is None


def test_too_few_samples_are_not_standstill(detector):
    assert detector.detect(0.0, 0.0) is None
    assert detector.detect(feed(detector, 0.1), 0.0) is None


def test_duration_restarts_after_a_movement(detector):
    time = feed(detector, 3.0)
    detector.detect(time, 0.0)
    time = feed(detector, 1.0, start=time)
    assert detector.detect(time, 0.0).duration == pytest.approx(1.0)
    detector.detect(time, 0.5)
    assert detector.detect(time, 0.0).duration == 0.0


def test_unwinding_sigma_decays_after_a_turn_and_is_zero_before_it(detector):
    time = feed(detector, 2.0)
    assert detector.detect(time, 0.0).unwinding_sigma == 0.0
    time = feed(detector, 1.0, rate=lambda t: 0.6, start=time)
    detector.detect(time, 0.5)
    time = feed(detector, 1.5, start=time)
    first = detector.detect(time, 0.0).unwinding_sigma
    assert 0.01 < first < 0.06
    time = feed(detector, 6.0, start=time)
    assert detector.detect(time, 0.0).unwinding_sigma < 0.05 * first


def test_slow_rolling_before_a_stop_keeps_the_unwinding_sigma(detector):
    time = feed(detector, 1.0, rate=lambda t: 0.6)
    detector.detect(time, 0.5)
    time = feed(detector, 0.2, start=time)
    detector.detect(time, 0.02)
    time = feed(detector, 1.0, start=time)
    assert detector.detect(time, 0.0).unwinding_sigma > 0.01


def test_the_peak_yaw_rate_does_not_grow_while_wheels_roll_without_imu(detector):
    begin = feed(detector, 2.0, rate=lambda t: 0.5)
    for k in range(1, 2000):  # 2 min without IMU samples
        assert detector.detect(begin + k / 16.0, 1.0) is None
    time = feed(detector, 2.0, start=begin + 2000 / 16.0)
    assert detector.detect(time, 0.0).unwinding_sigma < 0.06
