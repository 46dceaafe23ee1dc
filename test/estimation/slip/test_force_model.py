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

"""Force model: Jacobians by differences, balance and torques of the simulated robot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.slip import force_model
from smart_tire.estimation.slip.force_model import ForceModel
from smart_tire.estimation.slip.robust_ekf import Measurement
from smart_tire.estimation.slip.state import DelayedSpeed, N, State
from smart_tire.parameters import build, RobotParams
from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.simulation.plant import Plant
from smart_tire.simulation.surfaces import SurfaceMap
from smart_tire.uncertain import Uncertain
from support.slip_state import random_state

ROBOT = build(RobotParams, {'center_of_mass': [0.015, -0.01, 0.023],
                            'imu.position': [0.03, 0.02, 0.05]})
MODEL = ForceModel(ROBOT)
LEVEL = (0.0, 0.0, 0.0, 0.0)
RESIDUAL = (0.02, -0.01, -0.02, 0.01)
TORQUES = (0.4, 0.6, 0.3, 0.5)
FORCE_STATES = [State.V_X, State.V_Y, State.SLIP_VEL_L, State.SLIP_VEL_R, State.YAW_RATE]


def rolling_state(seed, direction=1.0):
    """Return a state of a robot that rolls at half a meter per second or more."""
    x = random_state(seed)
    x[State.V_X] = direction * (1.0 + 0.2 * np.tanh(x[State.V_X]))
    x[State.YAW_RATE] *= 0.3
    x[State.SLIP_VEL_L] += 0.1
    x[State.SLIP_VEL_R] -= 0.1
    return x


def motion(wheel, speed, lateral_change=0.0, gyro_z=0.0):
    """Return the motion at the time of a film measurement."""
    return DelayedSpeed(wheel % 2, speed, 1e-6, 0.5, 0.0, 0.0, gyro_z, lateral_change)


def differences(predict, x, step=1e-6):
    """Return the derivative (m, N) of ``predict`` by central differences."""
    columns = []
    for column in range(N):
        more, less = x.copy(), x.copy()
        more[column] += step
        less[column] -= step
        columns.append((predict(more) - predict(less)) / (2.0 * step))
    return np.array(columns).T


def balance(x, residual, model=MODEL):
    """Return both balances of forces."""
    speed = float(x[State.V_Y] - ROBOT.imu.position[0] * x[State.YAW_RATE])
    both = (model.longitudinal_balance(x.tolist(), residual),
            model.lateral_balance(x.tolist(), residual, speed))
    return Measurement(*(np.concatenate(parts) for parts in list(zip(*both))[:3]), np.eye(2))


@pytest.fixture
def significant(monkeypatch):
    """Count every force as signal, so that the Jacobian by ln C_x is the true one."""
    monkeypatch.setattr(force_model, 'SIGNIFICANT_SIGMAS', 0.0)


@pytest.mark.parametrize('direction', [1.0, -1.0])
@pytest.mark.parametrize('seed', range(4))
def test_jacobian_of_the_balance_equals_finite_differences(seed, direction, significant):
    x = rolling_state(seed, direction)
    x[State.DRAG] = 0.0  # otherwise its direction changes with the velocity, which H omits
    H = balance(x, RESIDUAL).H
    numeric = differences(lambda x: balance(x, RESIDUAL).expected, x)
    numeric[1, State.LN_STIFFNESS] = H[1, State.LN_STIFFNESS]  # see the next test
    for column in range(N):
        # H omits the transfer of load
        loose = column in (State.FORCE_X, State.FORCE_Y)
        scale = 0.3 * ROBOT.mass if loose else 1e-4 * np.abs(H[:, FORCE_STATES]).max()
        assert H[:, column] == pytest.approx(numeric[:, column], abs=scale), State(column)


@pytest.mark.parametrize('direction', [1.0, -1.0])
@pytest.mark.parametrize('seed', range(4))
def test_jacobian_of_the_torques_equals_finite_differences(seed, direction, significant):
    x = rolling_state(seed, direction)
    H = MODEL.torques(x.tolist(), TORQUES, RESIDUAL, np.zeros(4)).H
    numeric = differences(
        lambda x: MODEL.torques(x.tolist(), TORQUES, RESIDUAL, np.zeros(4)).expected, x)
    for column in range(N):
        # H omits the lateral slip by the yaw rate, its acceleration and the transfer of load
        if column == State.YAW_RATE:
            continue
        share = 0.03 * np.abs(H[:, FORCE_STATES]).max()
        assert H[:, column] == pytest.approx(numeric[:, column], abs=share), State(column)


@pytest.mark.parametrize('slip', [0.03, -0.08, 0.15])
@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_jacobian_of_the_adhesion_ratio_equals_finite_differences(slip, direction):
    x = rolling_state(0, direction)
    film = Uncertain(0.6, 0.02), Uncertain(slip, 0.003)
    then = motion(1, direction * 0.9, lateral_change=0.02, gyro_z=0.4)
    H = MODEL.adhesion(x.tolist(), 1, *film, then).H
    numeric = differences(lambda x: MODEL.adhesion(x.tolist(), 1, *film, then).expected, x)
    rows = [State.LN_RATIO, State.V_Y, State.GYRO_BIAS_Z, State.LN_STIFFNESS]
    assert H[0, rows] == pytest.approx(numeric[0, rows], rel=1e-4, abs=1e-7)


# ---- against the simulated robot, which has its own implementation of the physics ----

def driven(duty, seconds, start=(0.0, 0.0, 0.0)):
    """Return plant and parameters after driving with the duties of both sides."""
    params = build(SimulatorParams, {
        'ground.friction': [0.25, 0.25], 'ground.stiffness': [25.0, 25.0],
        'ground.drag': [0.11, 0.11], 'center_of_mass': [0.015, -0.01, 0.023],
        'imu.position': [0.03, 0.02, 0.05]})
    plant = Plant(params.robot, params.drive, SurfaceMap(params.ground), start)
    for _ in range(round(1000 * seconds)):
        plant.step((duty[0], duty[1]) * 2)
    return plant, params


def true_state(plant, params):
    """Return the exact state of the filter, and the residuals of the wheels."""
    robot, surface, x = params.robot, plant.surface[0], np.zeros(N)
    com, imu = np.array(robot.center_of_mass[:2]), np.array(robot.imu.position[:2])
    W, W_dot = plant.yaw_rate, plant.yaw_acceleration
    x[State.V_X], x[State.V_Y] = plant.v_x - imu[1] * W, plant.v_y + imu[0] * W
    arm = imu - com
    x[State.FORCE_X] = plant.acceleration[0] - W_dot * arm[1] - W * W * arm[0]
    x[State.FORCE_Y] = plant.acceleration[1] + W_dot * arm[0] - W * W * arm[1]
    x[State.YAW_RATE], x[State.YAW_ACCEL] = W, W_dot
    rolling = robot.wheel_radius * np.array(plant.wheel_speed)
    sides = 0.5 * (rolling[:2] + rolling[2:])
    x[State.SLIP_VEL_L], x[State.SLIP_VEL_R] = sides - np.array(plant.wheel_v_x)[:2]
    x[State.LN_STIFFNESS] = math.log(surface.stiffness / robot.tire.longitudinal_stiffness)
    x[State.LN_RATIO] = math.log(surface.friction / surface.stiffness / (
        force_model.PRIOR_FRICTION / robot.tire.longitudinal_stiffness))
    x[State.DRAG] = surface.drag
    return x, tuple((rolling - np.concatenate([sides, sides])).tolist())


@pytest.mark.parametrize('duty', [(0.4, 0.4), (0.5, 0.3), (-0.4, -0.4), (-0.3, -0.5)])
@pytest.mark.parametrize('seconds', [0.4, 3.0])
def test_forces_of_the_simulated_robot_are_balanced(duty, seconds):
    plant, params = driven(duty, seconds)
    x, residual = true_state(plant, params)
    expected = balance(x, residual, ForceModel(params.robot)).expected
    total = params.robot.mass * 9.81
    assert np.abs(expected).max() < 0.02 * total * 0.25
    wrong = x.copy()
    wrong[State.FORCE_X] += 1.0
    assert abs(balance(wrong, residual, ForceModel(params.robot)).expected[0]) > 5.0


@pytest.mark.parametrize('duty', [(0.4, 0.4), (0.5, 0.3), (-0.4, -0.4), (-0.3, -0.5)])
def test_torques_of_the_simulated_motors_are_predicted(duty):
    plant, params = driven(duty, 3.0)
    x, residual = true_state(plant, params)
    found = ForceModel(params.robot).torques(
        x.tolist(), tuple(plant.motor_torque), residual, np.zeros(4))
    assert found.expected == pytest.approx(plant.motor_torque, abs=0.02)
    assert np.abs(plant.motor_torque).min() > 0.05
    assert np.all(np.sign(found.expected) == np.sign(duty[0]))


def test_a_torque_scale_lowers_and_an_offset_raises_the_measured_torque():
    x = rolling_state(0)
    x[State.TORQUE_SCALE:] = 0.0
    before = MODEL.torques(x.tolist(), TORQUES, LEVEL, np.zeros(4)).expected
    x[State.TORQUE_SCALE], x[State.TORQUE_OFFSET_RL] = math.log(1.1), 0.03
    after = MODEL.torques(x.tolist(), TORQUES, LEVEL, np.zeros(4)).expected
    assert after - [0.0, 0.0, 0.03, 0.0] == pytest.approx(before / 1.1)


def test_the_own_acceleration_of_a_wheel_takes_torque():
    x = rolling_state(0).tolist()
    steady = MODEL.torques(x, TORQUES, LEVEL, np.zeros(4)).R
    unsteady = MODEL.torques(x, TORQUES, LEVEL, np.array([0.0, 1.0, 0.0, 4.0])).R
    torque = ROBOT.motor.inertia / ROBOT.wheel_radius  # N m per m/s2
    assert np.diag(unsteady - steady) == pytest.approx(torque ** 2 * np.array([0, 1.0, 0, 4.0]))


def test_the_adhesion_ratio_belongs_to_the_lateral_speed_of_its_time():
    x = np.zeros(N)
    x[State.V_X], x[State.V_Y] = 0.8, 0.03
    film = Uncertain(0.6, 0.02), Uncertain(0.05, 0.003)
    same = MODEL.adhesion(x.tolist(), 0, *film, motion(0, 0.76)).expected
    x[State.V_Y] = 0.01
    later = MODEL.adhesion(x.tolist(), 0, *film, motion(0, 0.76, lateral_change=-0.02)).expected
    assert later == pytest.approx(same)
    assert MODEL.adhesion(x.tolist(), 0, *film, motion(0, 0.76)).expected < same
    turning = MODEL.adhesion(x.tolist(), 0, *film, motion(0, 0.76, gyro_z=0.5)).expected
    arm = 0.5 * ROBOT.wheelbase - ROBOT.imu.position[0]
    x[State.V_Y] += 0.5 * arm
    assert turning == pytest.approx(
        MODEL.adhesion(x.tolist(), 0, *film, motion(0, 0.76)).expected)


def test_the_lateral_force_determines_the_product_of_c_x_and_the_lateral_speed_only():
    x = rolling_state(0)
    speed = 0.04
    H = MODEL.lateral_balance(x.tolist(), RESIDUAL, speed).H[0]
    stiffer = np.zeros(N)
    stiffer[State.LN_STIFFNESS], stiffer[State.V_Y] = 0.1, -0.1 * speed
    assert H @ stiffer == pytest.approx(0.0, abs=1e-9) and abs(H[State.V_Y]) > 50.0
    # with the true speed it is the force, but for the saturation
    x[State.SLIP_VEL_L] = x[State.SLIP_VEL_R] = 0.01
    x[State.YAW_RATE], x[State.V_Y], x[State.DRAG] = 0.0, 0.002, 0.0
    H = MODEL.lateral_balance(x.tolist(), LEVEL, 0.002).H[0]
    still = x.copy()
    still[State.V_Y] = 0.0
    force = (MODEL.lateral_balance(x.tolist(), LEVEL, 0.0).expected
             - MODEL.lateral_balance(still.tolist(), LEVEL, 0.0).expected)[0]
    assert H[State.LN_STIFFNESS] == pytest.approx(force, rel=0.05)


def test_without_slip_force_and_significance_of_c_x_vanish():
    x = np.zeros(N)
    x[State.V_X] = 1.0
    assert balance(x, LEVEL).H[:, State.LN_STIFFNESS] == pytest.approx([0.0, 0.0])
    shares = []
    for slip in 0.001, 0.15:
        x[State.SLIP_VEL_L] = x[State.SLIP_VEL_R] = slip
        _, expected, H, _ = MODEL.longitudinal_balance(x.tolist(), LEVEL)
        shares.append(H[0, State.LN_STIFFNESS] / expected[0])
    assert shares[0] < 0.1 < 0.8 < shares[1] <= 1.0


def test_the_adhesion_ratio_of_the_true_ratio_is_that_of_the_brush_model():
    x = np.zeros(N)
    x[State.V_X] = 0.8
    robot = RobotParams()
    load = 0.25 * robot.mass * 9.80665
    critical = 3.0 * force_model.PRIOR_FRICTION / robot.tire.longitudinal_stiffness * load
    slip = 0.5 * critical
    found = ForceModel(robot).adhesion(x.tolist(), 0, Uncertain(0.5, 0.02), Uncertain(slip, .003),
                                       motion(0, 0.8))
    assert found.z == pytest.approx([0.5]) and found.expected == pytest.approx([0.5], rel=0.01)


@pytest.mark.parametrize(('ratio', 'sigma', 'slip', 'speed'), [
    (math.nan, math.inf, 0.1, 0.8), (0.5, 0.5, 0.1, 0.8), (0.5, 0.02, 1.0, 0.8),
    (0.5, 0.02, math.nan, 0.8), (0.01, 0.02, 0.1, 0.8), (0.5, 0.02, 0.1, 0.05)])
def test_adhesion_without_information_is_no_measurement(ratio, sigma, slip, speed):
    x = [0.0] * N
    assert MODEL.adhesion(
        x, 0, Uncertain(ratio, sigma), Uncertain(slip, 0.003), motion(0, speed)) is None
