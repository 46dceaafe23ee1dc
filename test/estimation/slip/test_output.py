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

"""Outputs describe the grid instant, not the last sample before it."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.estimation.slip.ekf import SlipFilter
from smart_tire.estimation.slip.output import OutputContext, SlipOutputBuilder
from smart_tire.estimation.slip.state import ImuReading, ImuStep, N, State
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import build, RobotParams, SlipEstimatorParams
from smart_tire.samples import Icr

CONTEXT = OutputContext(0, 0.008, ImuReading(0.8, 1.4, 0.9), 0.0, (0.0,) * 4, 1.0, 0.95)
OUTPUT = SlipOutputBuilder(SlipEstimatorParams())


def filter_at(seed=1):
    """Return a filter after two seconds of motion."""
    moved = SlipFilter(build(SlipEstimatorParams, {}))
    rng = np.random.default_rng(seed)
    for _ in range(200):
        moved.predict(0.01, ImuStep(
            ImuReading(0.5 + 0.1 * rng.normal(), 0.4, 0.2), 1e-6, 2.5e-5, 1e-3))
    return moved


def test_extrapolated_pose_and_twist_equal_a_prediction_of_the_filter():
    moved = filter_at()
    odometry = OUTPUT.build(CONTEXT, moved.x, moved.P)[0]
    moved.predict(CONTEXT.extrapolation, ImuStep(CONTEXT.imu, 1e-6, 2.5e-5, 1e-3))
    expected = OUTPUT.build(replace(CONTEXT, extrapolation=0.0), moved.x, moved.P)[0]
    assert odometry.position == pytest.approx(expected.position, abs=1e-6)
    assert odometry.linear == pytest.approx(expected.linear, abs=1e-4)
    assert odometry.orientation == pytest.approx(expected.orientation, abs=1e-4)


def test_vibration_reduces_extrapolation_by_one_imu_sample():
    moved = filter_at()
    calm, vibrating = (OUTPUT.build(replace(CONTEXT, vibration=vibration), moved.x, moved.P)[0]
                       for vibration in (0.0, 10.0))
    change = [odometry.linear[0] - OUTPUT.build(
        replace(CONTEXT, extrapolation=0.0), moved.x, moved.P)[0].linear[0]
        for odometry in (calm, vibrating)]
    assert abs(change[1]) < 0.02 * abs(change[0])


def test_gravity_and_accelerometer_bias_are_removed():
    x = [0.0] * N
    x[State.V_X], x[State.ACCEL_BIAS_X], x[State.PITCH] = 0.5, 0.05, 0.02
    context = replace(CONTEXT, imu=ImuReading(0.0, 0.05 - GRAVITY * 0.02, 0.0))
    odometry, slip = OUTPUT.build(context, x, 1e-4 * np.eye(N))
    assert odometry.linear[0] == pytest.approx(0.5)
    assert slip.ratio == pytest.approx((0.0,) * 4)


def test_the_icr_is_published_only_while_the_robot_yaws():
    x = [0.0] * N
    x[State.V_X], x[State.ICR_X] = 0.5, 0.03
    for rate, shown in ((0.5, True), (0.01, False)):
        context = replace(CONTEXT, imu=ImuReading(rate, 0.0, 0.0), extrapolation=0.0)
        estimates = OUTPUT.build(context, x, 1e-4 * np.eye(N))
        centers = [estimate for estimate in estimates if isinstance(estimate, Icr)]
        assert bool(centers) == shown
        assert all(math.isclose(center.x, 0.03) for center in centers)


def test_unobserved_slip_change_increases_sigma_up_to_one():
    x = [0.0] * N
    x[State.V_X] = 0.5
    sigmas = [OUTPUT.build(CONTEXT, x, 1e-6 * np.eye(N), slip_change_sigma)[1].sigma
              for slip_change_sigma in ((0.0, 0.0), (0.05, 0.0), (9.0, 0.0))]
    assert sigmas[1][1] == sigmas[0][1]
    speed = (0.5 + CONTEXT.imu.yaw_rate * (RobotParams().imu.position[1] - 0.19)
             + CONTEXT.imu.force_x * 0.008)
    assert sigmas[1][0] == pytest.approx(math.hypot(sigmas[0][0], 0.05 / speed), rel=0.02)
    assert sigmas[2][0] == 1.0


def test_the_slip_of_a_wheel_that_is_not_measured_is_unknown():
    robot = {'joints.rear_left': '', 'film.wheels': ['front_right']}
    output, moved = SlipOutputBuilder(build(SlipEstimatorParams, robot)), filter_at()
    slip, whole = (builder.build(CONTEXT, moved.x, moved.P)[1] for builder in (output, OUTPUT))
    assert [math.isnan(one) for one in slip.ratio] == [False, False, True, False]
    assert math.isnan(slip.slip_velocity[2]) and slip.sigma[2] == 1.0
    for i in (0, 1, 3):
        assert (slip.ratio[i], slip.slip_velocity[i], slip.sigma[i]) == (
            whole.ratio[i], whole.slip_velocity[i], whole.sigma[i])
