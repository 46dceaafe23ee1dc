# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Equations of the slip filter: compiled, as Python and with numpy; their derivatives."""

from array import array
from functools import partial

import numpy as np
import pytest

from smart_tire.estimation.slip import kalman, motion, tire_forces
from smart_tire.estimation.slip.kalman import GYRO_HELD, SENSORS_HELD
from smart_tire.estimation.slip.motion import MotionModel, wheel_slip_ratio
from smart_tire.estimation.slip.state import ImuReading, ImuStep, initial_state, N, State
from smart_tire.estimation.slip.tire_forces import TireForces
from smart_tire.models.vehicle.skid_steer import slip_ratio
from smart_tire.parameters import SlipEstimatorParams
from support.compiled import load_source
from support.derivatives import derivative

PARAMS = SlipEstimatorParams()
ROBOT = PARAMS.robot
GROUND = (52.7, 0.47, 0.015, 0.5, 0.9, 0.005, -0.003)  # in the order of State, mu and C_x as such
NOISE = motion.Noise((0.01, 0.02), 0.02, 0.01, 0.002)
RESIDUAL = (0.01, -0.01, 0.02, 0.0)
MOVING = {State.YAW: 0.7, State.ROLL: 0.01, State.PITCH: -0.02, State.V_X: 0.6, State.V_Y: -0.05,
          State.GYRO_BIAS_Z: 0.01, State.ACCEL_BIAS_X: 0.05, State.SLIP_VEL_L: 0.04,
          State.SLIP_VEL_R: 0.08, State.IMU_X: 0.01, State.IMU_Y: -0.03}


def state(kind='driving'):
    """Return a state and a covariance, which relates all states."""
    x, P = initial_state(PARAMS)
    for row, value in MOVING.items():
        x[row] = value
    if kind == 'sliding':
        x[State.SLIP_VEL_L], x[State.V_Y] = 0.9, 0.5
    elif kind == 'reverse':
        x[State.V_X] = -0.6
    elif kind == 'standstill':
        x[State.V_X] = x[State.SLIP_VEL_L] = x[State.SLIP_VEL_R] = 0.0
    P[State.LN_STIFFNESS:, State.LN_STIFFNESS:] += 0.01 * np.eye(7)
    mix = np.eye(N) + 0.1 * np.random.default_rng(3).standard_normal((N, N))
    return array('d', x), mix @ P @ mix.T


MODULES = (kalman, motion, tire_forces)


def run(modules, kind, loops):
    """Return all numbers of a step: prediction, forces, wheels and outputs."""
    kalman, motion, tire_forces = modules
    kalman.LOOPS = loops
    x, P = state(kind)
    numbers = []
    model, forces, correction = (motion.MotionModel(ROBOT), tire_forces.TireForces(ROBOT, P),
                                 kalman.KalmanFilter(x, P))
    x = correction.x
    step = ImuStep(0.01, ImuReading(0.5, 0.3, -0.2), 1e-6, 1e-4, 0.4, 0.6)
    correction.predict(model.predict(x, step, NOISE), model.F, model.Q)
    numbers += forces.roll(x, 0.5, RESIDUAL)
    forces.set_ground(GROUND)
    loads = forces.loads(x, 0.3, -0.2)
    numbers += [*loads, *forces.tractions(x, 0.5, loads), *np.ravel(forces.H)]
    expected = forces.balance(x, 0.5, 0.1, 0.3, -0.2)
    for error, h, row in zip(expected, np.array(forces.H), (State.V_X, State.V_Y)):
        numbers.append(correction.correct(-error, h, 0.01, SENSORS_HELD, row, -1e-5))
        numbers += correction.ground
    H = np.zeros((2, N))
    H[0, State.TRAVEL_L] = H[1, State.TRAVEL_R] = 1.0
    H[:, State.RADIUS] = 0.03, 0.02
    numbers.append(correction.correct_jointly(
        np.array([0.1, -0.3]), H, 1e-6 * np.array([[2.0, 1.0], [1.0, 3.0]]), GYRO_HELD))
    pose, twist = array('d', bytes(288)), array('d', bytes(288))
    motion.fill_covariances(P, 0.5, 0.1, 0.02, pose, twist)
    slips = model.wheel_slips(x, P, 0.5, RESIDUAL, (0.0,) * 4, 0.05)
    numbers.append(correction.is_sound())
    return np.array([*numbers, *expected, *x, *P.ravel(), *pose, *twist, *np.ravel(slips)])


KINDS = ('driving', 'sliding', 'reverse', 'standstill')


@pytest.fixture(autouse=True)
def restored(monkeypatch):
    monkeypatch.setattr(kalman, 'LOOPS', kalman.LOOPS)


@pytest.mark.skipif(not kalman.COMPILED, reason='not compiled')
@pytest.mark.parametrize('kind', KINDS)
def test_the_extension_computes_what_its_source_does(kind):
    np.testing.assert_array_equal(run(MODULES, kind, True),
                                  run(map(load_source, MODULES), kind, True))


@pytest.mark.parametrize('kind', KINDS)
def test_numpy_computes_the_same_as_loops(kind):
    np.testing.assert_allclose(run(map(load_source, MODULES), kind, False),
                               run(MODULES, kind, True), rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize('loops', [True, False])
def test_a_correction_does_not_move_the_position_by_what_it_shares_with_held_states(
        loops, monkeypatch):
    monkeypatch.setattr(kalman, 'LOOPS', loops)
    x, P = state()
    # errors of the position that those of heading and gyro bias have caused, and no others
    effect = np.eye(N)
    effect[State.X] = effect[State.Y] = 0.0
    effect[State.X, State.YAW], effect[State.Y, State.GYRO_BIAS_Z] = 2.0, -30.0
    P = effect @ P @ effect.T
    correction = kalman.KalmanFilter(x, P.copy())
    H = np.zeros((2, N))
    H[0, [State.TRAVEL_L, State.GYRO_BIAS_Z]] = 1.0, 0.2
    H[1, [State.TRAVEL_R, State.GYRO_BIAS_Z]] = 1.0, -0.2
    correction.correct_jointly(np.array([0.1, -0.3]), H, 1e-4 * np.eye(2), GYRO_HELD)
    assert np.array(correction.x)[:2] == pytest.approx(x[:2], abs=1e-9)
    assert abs(correction.x[State.V_X] - x[State.V_X]) > 1e-3
    assert correction.P[0, 0] == pytest.approx(P[0, 0])


@pytest.mark.parametrize('row', [State.GYRO_BIAS_Z, State.YAW])
def test_a_position_that_shares_nothing_with_held_states_that_are_known_is_corrected(row):
    x, P = state()
    P[row] = P[:, row] = 0.0
    correction = kalman.KalmanFilter(x, P)
    h = np.zeros(N)
    h[State.X] = 1.0
    correction.correct(0.1, h, 1e-12, GYRO_HELD)
    assert np.isfinite(correction.x).all() and np.isfinite(correction.P).all()
    assert correction.x[0] > x[0]


@pytest.mark.parametrize('held', [GYRO_HELD, SENSORS_HELD])
def test_the_part_of_the_position_beyond_held_states_is_corrected_optimally(held):
    x, P = state()
    given = [State.YAW, State.GYRO_BIAS_Z]
    h = np.zeros(N)
    h[[State.V_X, State.SLIP_VEL_L]] = 1.0, 0.5
    gain = P @ h / (h @ P @ h + 0.01)
    share = np.linalg.solve(P[np.ix_(given, given)], P[np.ix_(given, [0, 1])])
    correction = kalman.KalmanFilter(x, P.copy())
    correction.correct(0.2, h, 0.01, held)
    assert np.subtract(correction.x, x)[:2] == pytest.approx(
        0.2 * (gain[:2] - gain[given] @ share))


def test_the_jacobian_of_the_motion_is_its_derivative():
    x, _ = state()
    step = ImuStep(1e-4, ImuReading(0.5, 0.3, -0.2), 1e-6, 1e-4, 0.5, 0.5)
    model = MotionModel(ROBOT)
    model.predict(x, step, NOISE)
    F = np.array(model.F)

    def predicted(row, delta):
        moved = x[:]
        moved[row] += delta
        return np.array(model.predict(moved, step, NOISE))
    for row in State:
        # neglected: terms of second order in dt, the change of a slope by speed and yaw rate
        np.testing.assert_allclose(
            F[:, row], derivative(partial(predicted, row), 0.0, 1e-6), atol=3e-6)


def test_covariances_of_the_outputs_are_those_of_their_derivatives():
    x, P = state()
    model, W = MotionModel(ROBOT), 0.5 - x[State.GYRO_BIAS_Z]

    def twist(row, delta):
        moved = x[:]
        moved[row] += delta
        rate = 0.5 - moved[State.GYRO_BIAS_Z]
        return np.array([moved[State.V_X] + (0.02 + moved[State.IMU_Y]) * rate,
                         moved[State.V_Y] - (0.1 + moved[State.IMU_X]) * rate, rate])

    def ratios(row, delta):
        moved = x[:]
        moved[row] += delta
        return np.array(model.wheel_slips(moved, P, W, (0.0,) * 4, (0.0,) * 4, 0.05)[0])

    pose, found = array('d', bytes(288)), array('d', bytes(288))
    motion.fill_covariances(P, W, 0.1 + x[State.IMU_X], 0.02 + x[State.IMU_Y], pose, found)
    T = np.column_stack([derivative(partial(twist, row), 0.0, 1e-6) for row in State])
    np.testing.assert_allclose(np.reshape(found, (6, 6))[np.ix_((0, 1, 5), (0, 1, 5))],
                               T @ P @ T.T, rtol=1e-6)
    small = 1e-4 * P  # a standard deviation of a slip ratio is at most 1
    small[State.GYRO_BIAS_Z] = small[:, State.GYRO_BIAS_Z] = 0.0
    T = np.column_stack([derivative(partial(ratios, row), 0.0, 1e-6) for row in State])
    *_, sigmas = model.wheel_slips(x, small, W, (0.0,) * 4, (0.0,) * 4, 0.05)
    np.testing.assert_allclose(sigmas, np.sqrt(np.diag(T @ small @ T.T)), rtol=1e-4)


def balance(model, x):
    return model.balance(x, 0.5, 0.1, 0.3, -0.2)


def tractions(model, x):
    return model.tractions(x, 0.5, [25.0, 20.0, 30.0, 28.0])


SPEEDS = State.V_X, State.V_Y, State.SLIP_VEL_L, State.SLIP_VEL_R, State.IMU_X, State.IMU_Y
RATIOS = State.LN_STIFFNESS, State.LN_FRICTION, State.LN_LATERAL


@pytest.mark.parametrize('kind', ['driving', 'sliding', 'reverse'])
@pytest.mark.parametrize('output, rows, resistance', [
    # of the rolling resistance along the heading the change by the speed is neglected
    (balance, SPEEDS, 0.0), (balance, (*RATIOS, State.RESISTANCE, State.LATERAL_SHARE), 0.015),
    (tractions, (*SPEEDS, *RATIOS), 0.015)])
def test_the_jacobian_of_the_forces_is_their_derivative(kind, output, rows, resistance):
    x, _ = state(kind)
    model = TireForces(ROBOT, np.zeros((N, N)))  # without error of the slip

    def forces(row, delta):
        moved, given, i = x[:], list(GROUND), row - State.LN_STIFFNESS
        given[2] = resistance
        moved[row] += delta
        if i >= 0:
            given[i] = given[i] * np.exp(delta) if row in RATIOS else given[i] + delta
        model.set_ground(given)
        model.roll(moved, 0.5, RESIDUAL)
        return np.array(output(model, moved))
    forces(rows[0], 0.0)
    H = np.array(model.H)
    for row in rows:
        slope = derivative(partial(forces, row), 0.0, 1e-6)
        np.testing.assert_allclose(H[:2, row], slope, rtol=1e-5, atol=1e-6, err_msg=str(row))


def test_the_scalar_slip_ratio_agrees_with_the_vectorized_one():
    rng = np.random.default_rng(4)
    rolling = np.concatenate([rng.normal(0.0, 0.5, 500), rng.normal(0.0, 0.04, 500), [0.0, 0.0]])
    ground = np.concatenate([rng.normal(0.0, 0.5, 500), rng.normal(0.0, 0.1, 500), [0.0, 1.0]])
    one_by_one = [wheel_slip_ratio(r, v, 0.05) for r, v in zip(rolling, ground)]
    np.testing.assert_array_equal(one_by_one, slip_ratio(rolling, ground, 0.05))
