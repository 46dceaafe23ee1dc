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

"""Motion model: Jacobian against finite differences, gravity and centripetal force."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.slip.motion_model import (
    DRAG_MEAN, GROUND_LENGTH, IDLE_SIGMAS, MotionModel)
from smart_tire.estimation.slip.state import ImuReading, ImuStep, N, State
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import build, SlipEstimatorParams
from support.slip_state import random_state

IMU = ImuReading(0.8, 0.4, 0.9)
STEP = ImuStep(IMU, 1e-6, 2.5e-5, 1e-3)
STILL = ImuStep(ImuReading(0.0, 0.0, 0.0), 1e-6, 2.5e-5, 1e-3)


def new_model(**values):
    return MotionModel(build(SlipEstimatorParams, values))


def predict(model, x, imu, dt):
    """Return the predicted state alone."""
    return model.predict(x, ImuStep(imu, 1e-6, 2.5e-5, 1e-3), dt)[0]


@pytest.mark.parametrize('by_forces', [False, True])
@pytest.mark.parametrize('seed', range(3))
def test_jacobian_equals_finite_differences(seed, by_forces):
    state, model, dt, step = random_state(seed), new_model(), 0.01, 1e-6
    model.by_forces = by_forces
    _, F, _ = model.predict(state.tolist(), STEP, dt)
    for column in range(N):
        if column in IDLE_SIGMAS and not by_forces:
            continue
        ends = []
        for sign in (1.0, -1.0):
            moved = state.copy()
            moved[column] += sign * step
            ends.append(np.array(predict(model, moved.tolist(), IMU, dt)))
        derivative = (ends[0] - ends[1]) / (2.0 * step)
        # the Jacobian omits terms of second order in dt
        assert derivative == pytest.approx(F[:, column], abs=10.0 * dt ** 2), State(column)


def test_states_of_the_forces_are_independent_of_the_past_while_the_imu_drives():
    _, F, Q = new_model().predict(random_state(0).tolist(), STEP, 0.01)
    rows = list(IDLE_SIGMAS)
    assert not F[rows, :].any() and not F[:, rows].any()
    assert np.sqrt(np.diag(Q)[rows]) == pytest.approx(list(IDLE_SIGMAS.values()))


def test_driven_by_forces_the_imu_does_not_accelerate():
    model, state = new_model(), random_state(0).tolist()
    model.by_forces = True
    calm, pushed = (predict(model, state, IMU._replace(force_x=force), 0.01)
                    for force in (0.0, 5.0))
    assert calm == pushed
    state[State.FORCE_X] += 1.0
    assert predict(model, state, IMU, 0.01)[State.V_X] - calm[State.V_X] == pytest.approx(0.01)


def test_travel_is_the_integral_of_the_wheel_speeds():
    model, x = new_model(), [0.0] * N
    x[State.V_X], x[State.SLIP_VEL_L], x[State.SLIP_VEL_R] = 0.8, 0.1, -0.05
    robot, W = SlipEstimatorParams().robot, 0.4
    arm = robot.imu.position[1]
    imu = ImuReading(W, *model.steady_force(x, W))
    moved = predict(model, x, imu, 0.01)
    for row, slip, side in ((State.TRAVEL_L, 0.1, -1.0), (State.TRAVEL_R, -0.05, 1.0)):
        ground = 0.8 + (arm + side * 0.5 * robot.track_width) * W
        assert moved[row] == pytest.approx(0.01 * (ground + slip), abs=2e-6)


@pytest.mark.parametrize('by_forces', [False, True])
def test_properties_of_the_ground_return_to_their_priors_over_distance_only(by_forces):
    model, x = new_model(), [0.0] * N
    model.by_forces = by_forces
    x[State.LN_STIFFNESS], x[State.LN_RATIO], x[State.DRAG] = -0.8, 0.5, 0.1
    rows = [State.LN_STIFFNESS, State.LN_RATIO, State.DRAG]
    stationary, _, Q = model.predict(x, STILL, 1e-3)
    assert [stationary[row] for row in rows] == pytest.approx([x[row] for row in rows], abs=1e-6)
    assert np.diag(Q)[rows] == pytest.approx([0.0] * 3, abs=1e-6)
    x[State.V_X] = 1.0
    for _ in range(300):
        x = model.predict(x, STILL, 1.0)[0]
        x[State.V_X] = 1.0
    share = math.exp(-300.0 / GROUND_LENGTH)
    assert [x[row] for row in rows] == pytest.approx(
        [-0.8 * share, 0.5 * share, DRAG_MEAN + (0.1 - DRAG_MEAN) * share], rel=0.01)


def test_gravity_on_a_slope_does_not_accelerate_a_stationary_robot():
    x = [0.0] * N
    x[State.PITCH] = 0.02  # nose down: specific force has a backward part
    predicted = predict(new_model(), x, ImuReading(0.0, -GRAVITY * 0.02, 0.0), 0.1)
    assert predicted[State.V_X] == pytest.approx(0.0, abs=1e-12)


def test_centripetal_force_keeps_a_steady_turn_on_a_circle():
    model, x = new_model(**{'imu.position': [0.0, 0.0, 0.0]}), [0.0] * N
    x[State.V_X] = 0.8
    for _ in range(100):
        x = predict(model, x, ImuReading(0.5, 0.0, 0.4), 0.01)
    assert x[State.V_X] == pytest.approx(0.8, abs=1e-3)
    assert x[State.YAW] == pytest.approx(0.5)
    assert np.hypot(x[State.X], x[State.Y] - 1.6) == pytest.approx(1.6, rel=1e-3)


@pytest.mark.parametrize('seed', range(3))
def test_steady_force_keeps_the_velocity(seed):
    model, x = new_model(), random_state(seed).tolist()
    imu = ImuReading(0.3 + x[State.GYRO_BIAS_Z], *model.steady_force(x, 0.3))
    predicted = predict(model, x, imu, 0.1)
    assert predicted[State.V_X] == pytest.approx(x[State.V_X], abs=1e-12)
    assert predicted[State.V_Y] == pytest.approx(x[State.V_Y], abs=1e-12)


def test_extrapolation_equals_prediction_of_pose_and_velocity():
    model, x = new_model(), random_state(1).tolist()
    predicted, extrapolated = predict(model, x, IMU, 0.01), model.extrapolate(x, IMU, 0.01)
    changed = [row for row in State if predicted[row] != extrapolated[row]]
    assert changed == [State.ROLL, State.PITCH, State.SLIP_VEL_L, State.SLIP_VEL_R,
                       State.TRAVEL_L, State.TRAVEL_R, State.LN_STIFFNESS, State.LN_RATIO,
                       State.DRAG]
    assert [extrapolated[row] for row in changed] == [x[row] for row in changed]


def test_extrapolation_uses_a_share_of_the_acceleration():
    model, x = new_model(), random_state(1).tolist()
    assert model.extrapolate(x, IMU, 0.1, 0.0)[State.V_X] == x[State.V_X]
    change = model.extrapolate(x, IMU, 0.1)[State.V_X] - x[State.V_X]
    half = model.extrapolate(x, IMU, 0.1, 0.5)[State.V_X] - x[State.V_X]
    assert half == pytest.approx(0.5 * change)


def test_process_noise_grows_with_time_and_imu_noise():
    model, x = new_model(), random_state(2).tolist()
    noise, longer, noisier = (np.diag(model.predict(x, step, dt)[2]) for step, dt in (
        (STEP, 0.01), (STEP, 0.02), (ImuStep(IMU, 1e-6, 1.0, 1e-3), 0.01)))
    assert np.all(noise >= 0.0)
    assert longer[State.YAW] == pytest.approx(2.0 * noise[State.YAW])
    assert noisier[State.V_X] > 100.0 * noise[State.V_X]
