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

import math

import numpy as np
import pytest

from smart_tire.estimation.slip import output
from smart_tire.estimation.slip.output import (
    ContinuousPose, OutputContext, SlipOutputBuilder)
from smart_tire.estimation.slip.state import ESTIMATED, ImuReading, initial_state, State
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.rotation import euler
from smart_tire.samples import Icr, WheelSlip
from support.compiled import load_source

PARAMS = SlipEstimatorParams()
CONTEXT = OutputContext(0, 0.008, ImuReading(0.8, 1.4, 0.9), 1e-4, (0.0,) * 4)


def moving():
    """Return state and covariance at 1 m/s."""
    x, P = initial_state(PARAMS)
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
