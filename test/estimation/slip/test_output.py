# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Output records of the slip filter."""

from array import array
import math

import numpy as np
import pytest

from smart_tire.estimation.slip import output
from smart_tire.estimation.slip.output import (
    ContinuousPose, OutputContext, ScaleEffect, SlipOutputBuilder)
from smart_tire.estimation.slip.state import ESTIMATED, ImuReading, initial_state, State
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.rotation import euler
from smart_tire.samples import Icr, WheelSlip
from support.compiled import load_source

PARAMS = SlipEstimatorParams()
CONTEXT = OutputContext(0, 0.008, ImuReading(0.8, 1.4, 0.9), 1e-4, (0.0,) * 4)


def moving():
    """Return state and covariance at 1 m/s."""
    start, P = initial_state(PARAMS)
    x = array('d', start)
    x[State.V_X], x[State.SLIP_VEL_L], x[State.GYRO_BIAS_Z] = 1.0, 0.1, 0.01
    return x, P


def records(context, params=PARAMS):
    return SlipOutputBuilder(params).build(context, *moving())


@pytest.mark.skipif(not output.COMPILED, reason='not compiled')
def test_the_extension_computes_what_its_source_does():
    def built(module):
        builder = module.SlipOutputBuilder(PARAMS, module.ContinuousPose())
        x, P = moving()
        x[State.X], x[State.YAW] = 0.0, 3.0
        found = []
        for k in range(3):
            x[State.X] += 0.01
            x[State.YAW] += 0.1
            found += builder.build(CONTEXT._replace(
                instant_ns=8_000_000 * k, hidden=(0.09, 0.04)), x, P)
        return found
    assert built(output) == built(load_source(output))


def test_the_icr_is_published_only_while_the_robot_yaws():
    def icr(rate):
        context = CONTEXT._replace(imu=CONTEXT.imu._replace(yaw_rate=rate))
        return [one for one in records(context) if isinstance(one, Icr)]
    assert icr(0.03) == []
    (found,) = icr(0.51)
    x_imu, y_imu = PARAMS.robot.imu.position[:2]
    assert found.y == pytest.approx((1.0 + 0.5 * y_imu) / 0.5, rel=0.02)


def test_the_pose_is_extrapolated_at_the_present_acceleration():
    late, early = (records(CONTEXT._replace(extrapolation=dt))[0] for dt in (0.008, 0.0))
    assert late.position[0] - early.position[0] == pytest.approx(0.008, rel=0.05)
    assert late.linear[0] - early.linear[0] == pytest.approx(0.008 * 1.4, rel=0.05)


def test_the_continuous_pose_has_the_slope_of_the_estimate():
    x, P = moving()
    builder = SlipOutputBuilder(PARAMS, ContinuousPose())
    first = builder.build(CONTEXT, x, P)[0]
    x[State.X], x[State.ROLL], x[State.PITCH] = 1.0, 0.02, -0.01
    found = builder.build(CONTEXT._replace(instant_ns=8_000_000), x, P)[0]
    assert euler(found.orientation)[:2] == pytest.approx((0.02, -0.01))
    assert found.position[0] - first.position[0] < 0.02  # the step of 1 m is not made
    assert found.pose_covariance[0] > 0.95


def spiral(scale, count=400):
    """Return the poses (n, 3) of a robot that takes its yaw rate, up to 1 rad/s, for larger."""
    pose, found = np.array([1.0, -2.0, 3.0]), []
    for k in range(count):
        found.append(pose.copy())
        turn = scale * 0.01 * min(1.0, k / 100)
        middle = pose[2] + 0.5 * turn
        pose += 0.006 * math.cos(middle), 0.006 * math.sin(middle), turn
    return np.array(found)


@pytest.mark.parametrize('first', [0, 150])
def test_an_error_of_the_gyro_scale_is_one_of_the_pose_since_its_begin(first):
    effect, sigma = ScaleEffect(0.01), 0.01
    for k, pose in enumerate(spiral(1.0)):
        if k == first:
            effect.reset()
        covariance = array('d', [0.5] * 36)
        effect.add(pose[0], pose[1], math.remainder(pose[2], math.tau), covariance)
    moved = [relative(spiral(scale)[first:])[-1] for scale in (1.0 + 1e-5, 1.0 - 1e-5)]
    by_scale = (moved[0] - moved[1]) / 2e-5
    turn = spiral(1.0)[first, 2]  # the errors are in the axes of odom
    by_scale[:2] = rotated(by_scale[:2], turn)
    assert by_scale[2] > 2.0
    found = np.reshape(covariance, (6, 6)) - 0.5
    assert found[np.ix_((0, 1, 5), (0, 1, 5))] == pytest.approx(
        sigma ** 2 * np.outer(by_scale, by_scale), rel=0.02, abs=1e-7)
    assert not found[2:5].any() and not found[:, 2:5].any()


def relative(poses):
    """Return ``poses`` (n, 3) in the axes of the first one."""
    moved = poses - poses[0]
    return np.column_stack([*rotated(moved[:, :2].T, -poses[0, 2]), moved[:, 2]])


def rotated(vector, angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def test_an_error_of_the_gyro_scale_is_one_of_the_yaw_rate():
    exact, uncertain = (records(CONTEXT, build(SlipEstimatorParams, {
        'imu.gyro_scale_sigma': sigma}))[0] for sigma in (0.0, 0.02))
    assert uncertain.twist_covariance[35] - exact.twist_covariance[35] == pytest.approx(
        (0.02 * 0.79) ** 2)  # 0.8 rad/s less the bias


def test_the_slip_of_a_wheel_that_is_not_measured_is_unknown():
    params = build(SlipEstimatorParams, {'joints.rear_left': ''})
    slip = next(one for one in records(CONTEXT, params) if isinstance(one, WheelSlip))
    assert [math.isnan(ratio) for ratio in slip.ratio] == [False, False, True, False]
    assert slip.sigma[2] == 1.0


def test_the_estimated_states_of_the_smoother_are_enough():
    x, P = moving()
    whole = SlipOutputBuilder(PARAMS).build(CONTEXT, x, P)
    part = SlipOutputBuilder(PARAMS).build(CONTEXT, x[:ESTIMATED], P[:ESTIMATED, :ESTIMATED])
    assert whole[0].position == part[0].position
    assert np.allclose(whole[0].twist_covariance, part[0].twist_covariance)
