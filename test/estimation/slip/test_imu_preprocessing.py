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

"""IMU preprocessing: mean over a step, rotation into base axes, spikes and vibration."""

from __future__ import annotations

import math

import pytest

from smart_tire.estimation.slip.imu_preprocessing import ImuPreprocessor, TrapezoidalMean
from smart_tire.estimation.slip.state import ImuReading
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.samples import ImuSample


def sample(force_x=0.0, rate_z=0.0):
    return ImuSample(0, (force_x, 0.0, 9.81), (0.0, 0.0, rate_z))


def new_preprocessor(**values):
    return ImuPreprocessor(build(SlipEstimatorParams, values))


def test_the_mean_of_a_linear_signal_is_its_value_at_the_center():
    mean = TrapezoidalMean(1.0)
    for k in range(4):
        mean.add(1.0 + 0.1 * (k + 1), ImuReading(k, 2.0 * k, 0.0),
                 ImuReading(k + 1, 2.0 * (k + 1), 0.0))
    step = mean.step(0.01, 0.05, 1e-3)
    assert step.mean == pytest.approx((2.0, 4.0, 0.0, 0.0, 0.0))
    assert step.gyro_variance == pytest.approx(0.01 ** 2 * 0.1)
    # each step of 2 m/s2 at an unknown time within 0.1 s
    assert step.accel_variance == pytest.approx(0.05 ** 2 * 0.1 + 2.0 ** 2 * 0.1 / 12.0)


def test_an_empty_interval_has_no_mean():
    mean = TrapezoidalMean(1.0)
    mean.add(0.9, ImuReading(0.0, 0.0, 0.0), ImuReading(1.0, 0.0, 0.0))
    assert mean.step(0.01, 0.05, 1e-3) is None and mean.end == 1.0


def test_readings_are_in_base_axes():
    imu = new_preprocessor(**{'imu.rotation': [0.0, 0.0, math.pi]})
    assert imu.add(0.0, sample(1.0, 0.5)) == pytest.approx((0.5, -1.0, 0.0, 0.0, 0.0))
    tilting = ImuSample(0, (0.0, 0.0, 9.81), (0.1, 0.2, 0.0))
    assert imu.add(0.01, tilting)[3:] == pytest.approx((-0.1, -0.2))


def test_a_single_spike_is_replaced_and_a_second_one_in_a_row_accepted():
    imu = new_preprocessor()
    imu.add(0.0, sample(1.0))
    assert imu.add(0.01, sample(50.0)).force_x == 1.0
    assert imu.add(0.02, sample(50.0)).force_x == 50.0
    assert imu.spikes == 1


def test_samples_that_are_not_newer_are_refused():
    imu = new_preprocessor()
    assert imu.add(1.0, sample()) is not None
    assert imu.add(1.0, sample()) is None and imu.add(0.5, sample()) is None


def test_vibration_increases_accelerometer_noise_and_slope():
    quiet, rough = new_preprocessor(), new_preprocessor()
    for k in range(300):
        quiet.add(0.01 * k, sample())
        rough.add(0.01 * k, ImuSample(0, (0.0, 0.0, 9.81 + 2.0 * (-1) ** k), (0.0,) * 3))
    assert quiet.vibration == 0.0 and rough.vibration == pytest.approx(2.0, rel=0.1)
    assert rough.slope_sigma > quiet.slope_sigma
    steps = []
    for imu in (quiet, rough):
        mean = TrapezoidalMean(0.0)
        mean.add(0.01, imu.reading, imu.reading)
        steps.append(imu.step(mean))
    assert steps[1].accel_variance > 100.0 * steps[0].accel_variance
