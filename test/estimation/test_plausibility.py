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

from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.estimation.plausibility import (
    is_imu_spike, is_position_jump, is_possible, is_speed_contradicted, MAX_FORCE_CHANGE,
    MAX_RATE_CHANGE, speed_spikes)
from smart_tire.samples import GroundState, ImuSample, TireSample, WheelSample, WheelSlip
from smart_tire.uncertain import Uncertain, UNKNOWN
from support.ideal_robot import odometry

IMU = ImuSample(0, (0.0, 0.0, 9.81), (0.0, 0.0, 1.0))
WHEELS = WheelSample(0, (10.0, 10.0, -10.0, 10.0))
TIRE = TireSample(0, 'front_left', (1.0, 2.0))
ODOMETRY = odometry(0, v_x=1.0, yaw_rate=0.5)
SLIP = WheelSlip(0, (math.nan, 0.1, -1.0, 1.0), (0.0,) * 4, (math.inf, 0.01, 1.0, 1.0))

GROUND = GroundState(0, Uncertain(25.0, 1.5), *(UNKNOWN,) * 10, -1.0)


NAN = math.nan
REGULAR = [IMU, WHEELS, TIRE, ODOMETRY, SLIP, GROUND,
           replace(WHEELS, velocity=(NAN, 1.0, 1.0, NAN))]  # one wheel of a side is enough
IMPOSSIBLE = [
    *(replace(sample, **{field: value}) for bad in (NAN, math.inf, -math.inf, 1e6)
      for sample, field, value in (
          (IMU, 'acceleration', (0.0, bad, 9.81)), (IMU, 'rate', (bad, 0.0, 0.0)),
          (WHEELS, 'velocity', (bad, 0.0, bad, 0.0)))),
    *(replace(sample, **{field: value}) for bad in (NAN, math.inf) for sample, field, value in (
        (TIRE, 'volts', (1.0, bad)), (ODOMETRY, 'linear', (bad, 0.0, 0.0)),
        (ODOMETRY, 'angular', (0.0, 0.0, bad)))),
    *(replace(WHEELS, velocity=speeds) for speeds in (
        (1.0, NAN, 1.0, NAN), (NAN, 1.0, math.inf, 1.0))),
    replace(SLIP, ratio=(1.1, 0.0, 0.0, 0.0)),
    *(replace(SLIP, sigma=(bad, 0.0, 0.0, 0.0)) for bad in (-0.1, NAN)),
    *(replace(GROUND, stiffness=Uncertain(*bad)) for bad in (
        UNKNOWN, (0.0, 1.0), (25.0, math.inf), (25.0, -1.0))),
    *(replace(GROUND, stiffness_friction_correlation=bad) for bad in (1.1, NAN))]


@pytest.mark.parametrize(('possible', 'sample'), [
    *((True, sample) for sample in REGULAR), *((False, sample) for sample in IMPOSSIBLE)])
def test_only_samples_that_a_robot_may_produce_are_possible(possible, sample):
    assert is_possible(sample) == possible


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
