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
    for time in start + 0.01 * np.arange(round(duration / 0.01)):
        detector.add_reading(time, ImuReading(rate(time) + GYRO * rng.standard_normal(),
                                              force(time) + ACCEL * rng.standard_normal(),
                                              ACCEL * rng.standard_normal()))
    return start + duration


@pytest.mark.parametrize('seed', range(3))
def test_mean_rates_of_standstill_are_the_gyro_bias_each_reading_once(detector, seed):
    bias, means = 0.02, []
    time = feed(detector, QUIET_TIME + 0.1, rate=lambda t: bias, seed=1000 * seed)
    for k in range(40):
        standstill = detector.detect(time, 0.0)
        means.append(standstill.rate)
        time = feed(detector, 0.06, rate=lambda t: bias, seed=1000 * seed + k + 1, start=time)
    assert standstill.duration == pytest.approx(39 * 0.06)
    first, *others = means
    assert first is None
    assert [one.sigma for one in others] == pytest.approx([GYRO / np.sqrt(6)] * 39, rel=0.1)
    weights = np.array([one.sigma for one in others]) ** -2
    mean = np.average([one.value for one in others], weights=weights)
    assert abs(mean - bias) < 3.0 * weights.sum() ** -0.5


def test_a_start_before_the_wheels_show_it_is_no_gyro_bias(detector):
    time = feed(detector, 2.0)
    detector.detect(time, 0.0)
    time = feed(detector, 0.06, rate=lambda t: 0.04, start=time)
    standstill = detector.detect(time, 0.0)
    assert standstill is not None and abs(standstill.rate.value) < 4.0 * standstill.rate.sigma
    time = feed(detector, 0.06, rate=lambda t: 0.08, start=time)
    assert detector.detect(time, 0.0) is None


def test_rates_begin_after_the_tires_have_settled(detector):
    time = feed(detector, 1.0, rate=lambda t: 0.5)
    detector.detect(time, 0.5)
    counts = []
    for _ in range(40):
        time = feed(detector, 0.06, start=time)
        standstill = detector.detect(time, 0.0)
        counts.append(0.0 if standstill is None or standstill.rate is None
                      else (GYRO / standstill.rate.sigma) ** 2)
    assert sum(counts) == pytest.approx((2.4 - IMU_WINDOW - QUIET_TIME) / 0.01, abs=2.0)


def test_rolling_wheels_or_a_moving_imu_are_not_standstill(detector):
    time = feed(detector, 2.0)
    assert detector.detect(time, 0.05) is None
    time = feed(detector, 0.5, force=lambda t: 4.0 * (t - 2.0), start=time)
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
