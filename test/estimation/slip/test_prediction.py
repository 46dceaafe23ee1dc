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

"""Prediction through IMU samples and without them."""

from __future__ import annotations

import pytest

from smart_tire.estimation.slip.ekf import SlipFilter
from smart_tire.estimation.slip.kinematics import SlipKinematics
from smart_tire.estimation.slip.prediction import (
    IMU_DROPOUT, SlipPredictor, UNOBSERVED_DEAD_BAND, UNOBSERVED_SLIP_SHARE, UnobservedSlip)
from smart_tire.estimation.slip.state import N, State
from smart_tire.parameters import build, RobotParams, SlipEstimatorParams
from smart_tire.samples import ImuSample


def new_predictor():
    params = build(SlipEstimatorParams, {'imu.position': [0.0, 0.0, 0.0]})
    slip_filter = SlipFilter(params)
    return SlipPredictor(params, slip_filter, None), slip_filter


def accelerate(predictor, duration=1.0, force=0.5):
    samples = [(0.01 * k, ImuSample(0, (force, 0.0, 9.81), (0.0,) * 3))
               for k in range(round(100 * duration) + 1)]
    return predictor.predict(samples)


def test_acceleration_is_integrated_to_speed():
    predictor, slip_filter = new_predictor()
    assert len(accelerate(predictor)) == 101
    assert predictor.time == pytest.approx(1.0)
    assert slip_filter.x[State.V_X] == pytest.approx(0.5)
    mean = predictor.odometry.mean(0.0, 1.0)
    assert mean == pytest.approx((0.25, 0.0, 0.25, 0.25), abs=1e-9)


def test_without_imu_samples_the_speed_is_constant_and_the_wheels_give_the_yaw_rate():
    predictor, slip_filter = new_predictor()
    accelerate(predictor)
    speed, yaw = slip_filter.x[State.V_X], slip_filter.x[State.YAW]
    predictor.bridge_dropout(1.0 + 0.9 * IMU_DROPOUT, (0.4, 0.6))
    assert predictor.time == pytest.approx(1.0) and not predictor.blind.active
    predictor.bridge_dropout(1.5, (0.4, 0.6))
    assert predictor.time == 1.5 and predictor.blind.active
    assert slip_filter.x[State.V_X] == pytest.approx(speed)
    expected = 0.5 * 0.2 / RobotParams().track_width  # prior: steering efficiency of one
    assert slip_filter.x[State.YAW] - yaw == pytest.approx(expected)
    accelerate(predictor, 2.0)
    assert not predictor.blind.active and predictor.time == pytest.approx(2.0)


def test_slip_change_sigma_is_a_share_of_the_ground_speed_change():
    unobserved, x = UnobservedSlip(SlipKinematics(RobotParams())), [0.0] * N
    unobserved.ground_speeds = 0.5, 0.8
    x[State.V_X] = 0.8
    left, right = unobserved.sigma(x, 0.0)
    assert left == pytest.approx(UNOBSERVED_SLIP_SHARE * (0.3 - UNOBSERVED_DEAD_BAND))
    assert right == 0.0
