# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Plausibility: samples and changes that are physically possible, and those that are not."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.estimation.plausibility import (
    is_imu_spike, is_position_jump, is_possible, is_speed_contradicted, MAX_FORCE_CHANGE,
    MAX_RATE_CHANGE, speed_spikes)
from smart_tire.samples import (
    GroundState, ImuSample, Odometry, TireSample, WheelSample, WheelSlip)
from smart_tire.uncertain import Uncertain, UNKNOWN

IMU = ImuSample(0, (0.0, 0.0, 9.81), (0.0, 0.0, 1.0))
WHEELS = WheelSample(0, (10.0, 10.0, -10.0, 10.0))
TIRE = TireSample(0, 'front_left', (1.0, 2.0))
ODOMETRY = Odometry(0, (0.0,) * 3, (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.5),
                    (0.0,) * 36, (0.0,) * 36)
SLIP = WheelSlip(0, (math.nan, 0.1, -1.0, 1.0), (0.0,) * 4, (math.inf, 0.01, 1.0, 1.0))

GROUND = GroundState(0, Uncertain(25.0, 1.5), *(UNKNOWN,) * 6, -1.0)


@pytest.mark.parametrize('sample', [IMU, WHEELS, TIRE, ODOMETRY, SLIP, GROUND])
def test_regular_samples_are_possible(sample):
    assert is_possible(sample)


@pytest.mark.parametrize('impossible', [math.nan, math.inf, -math.inf, 1e6])
def test_samples_that_no_robot_produces_are_not_possible(impossible):
    assert not is_possible(replace(IMU, acceleration=(0.0, impossible, 9.81)))
    assert not is_possible(replace(IMU, rate=(impossible, 0.0, 0.0)))
    assert not is_possible(replace(WHEELS, velocity=(impossible, 0.0, impossible, 0.0)))


@pytest.mark.parametrize('impossible', [math.nan, math.inf])
def test_samples_that_are_not_finite_are_not_possible(impossible):
    assert not is_possible(replace(TIRE, volts=(1.0, impossible)))
    assert not is_possible(replace(ODOMETRY, linear=(impossible, 0.0, 0.0)))
    assert not is_possible(replace(ODOMETRY, angular=(0.0, 0.0, impossible)))


def test_slip_beyond_one_or_with_an_invalid_sigma_is_not_possible():
    assert not is_possible(replace(SLIP, ratio=(1.1, 0.0, 0.0, 0.0)))
    assert not is_possible(replace(SLIP, sigma=(-0.1, 0.0, 0.0, 0.0)))
    assert not is_possible(replace(SLIP, sigma=(math.nan, 0.0, 0.0, 0.0)))


@pytest.mark.parametrize('change', [
    {'stiffness': UNKNOWN}, {'stiffness': Uncertain(0.0, 1.0)},
    {'stiffness': Uncertain(25.0, math.inf)}, {'stiffness': Uncertain(25.0, -1.0)},
    {'stiffness_friction_correlation': 1.1}, {'stiffness_friction_correlation': math.nan}])
def test_a_ground_without_stiffness_or_with_an_invalid_correlation_is_not_possible(change):
    assert not is_possible(replace(GROUND, **change))


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_imu_spikes_are_large_changes_beyond_vibration(sign):
    assert is_imu_spike(sign * 1.1 * MAX_RATE_CHANGE, 0.0, 0.0, 0.0)
    assert is_imu_spike(0.0, sign * 1.1 * MAX_FORCE_CHANGE, 0.0, 0.0)
    assert is_imu_spike(0.0, 0.0, sign * 1.1 * MAX_FORCE_CHANGE, 0.0)
    assert not is_imu_spike(0.0, 0.0, sign * 1.1 * MAX_FORCE_CHANGE, 1.0)
    assert not is_imu_spike(0.9 * MAX_RATE_CHANGE, 0.9 * MAX_FORCE_CHANGE, 0.0, 0.0)


def test_a_reset_encoder_contradicts_the_speed_and_a_lost_period_does_not():
    assert is_speed_contradicted(-1000.0 / 0.1, 10.0)
    assert not is_speed_contradicted(5.0, 10.0)
    assert not is_speed_contradicted(2.0, 0.0) and is_speed_contradicted(4.0, 0.0)


def test_a_position_jump_is_an_angle_step_that_the_speed_does_not_explain():
    assert is_position_jump(-1000.0, 1.0)
    assert not is_position_jump(1.9, 0.5)
    assert not is_position_jump(0.2, 0.02)  # 20 rad/s over 10 ms, with timestamps 1 ms apart


def test_only_isolated_speeds_are_spikes():
    speed = np.zeros((50, 4)) + np.linspace(0.0, 20.0, 50)[:, None]
    assert not speed_spikes(speed).any()
    speed[20, 1] += 30.0
    assert np.argwhere(speed_spikes(speed)).tolist() == [[20, 1]]
    step = np.where(np.arange(50) < 25, 0.0, 30.0)[:, None]
    assert not speed_spikes(step).any()
    speed[[0, -1]] = 500.0
    assert not speed_spikes(speed)[[0, -1]].any()


def test_a_wheel_may_be_unmeasured_but_not_a_side():
    nan = math.nan
    assert is_possible(replace(WHEELS, velocity=(nan, 1.0, 1.0, nan)))
    assert not is_possible(replace(WHEELS, velocity=(1.0, nan, 1.0, nan)))
    assert not is_possible(replace(WHEELS, velocity=(nan, 1.0, math.inf, 1.0)))
