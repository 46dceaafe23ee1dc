# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Changes of the ground that the slip filter finds, and what it does about them."""

import numpy as np
import pytest

from smart_tire.estimation.slip import ground
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.ground import GroundChange, MotorTorques
from smart_tire.estimation.slip.kalman import KalmanFilter
from smart_tire.estimation.slip.state import GROUND, LEARNING_TIME, N, State, SUDDEN
from smart_tire.parameters import RobotParams, SlipEstimatorParams
from smart_tire.samples import ImuSample, NS_PER_S, Odometry, WheelSample
from support.compiled import load_source
from support.torques import required_torque

ROBOT = RobotParams()
PERIOD = 0.0625  # s, of the wheels
SPREAD = np.square([0.4, 0.6, 0.04])  # of ln C_x, ln mu and rolling resistance


def correlated():
    """Return a filter in which the speed has followed the errors of the ground."""
    rng = np.random.default_rng(1)
    own = np.diag(np.square([0.05, 0.06, 0.003, 0.1, 0.1, 0.003, 0.003]))
    effect = 0.2 * rng.standard_normal((N, len(own)))
    effect[GROUND] = np.eye(len(own))
    rest = np.zeros((N, N))
    rest[:GROUND.start, :GROUND.start] = 1e-4 * np.eye(GROUND.start)
    return KalmanFilter([0.0] * N, rest + effect @ own @ effect.T), effect


def found(rise, samples=40, seed=3, sign=1.0):
    """Return what is found in forces [m/s2] after a rise of the rolling resistance."""
    kalman, _ = correlated()
    change, rng = GroundChange(kalman, SPREAD), np.random.default_rng(seed)
    effect = np.array([0.3, 0.1, -9.81])
    for i in range(samples):
        y = effect[2] * rise + 0.3 * rng.standard_normal()
        change.add_innovation(kalman.P[SUDDEN, SUDDEN] @ effect, sign * y, 0.09)
        if i % 8 == 7:
            result = change.find(True, PERIOD)
            if result is not None:
                return result
    return None


def test_a_change_is_found_with_its_size():
    change = found(0.08, seed=3)
    assert change is not None
    assert change[2] == pytest.approx(0.08, abs=0.04)
    opposite = found(0.08, seed=3, sign=-1.0)
    assert opposite == pytest.approx(-change)


@pytest.mark.parametrize('module', [ground, load_source(ground)])
def test_a_change_is_the_least_squares_fit_to_the_innovations(module):
    kalman, _ = correlated()
    change, rng = module.GroundChange(kalman, SPREAD), np.random.default_rng(7)
    own, vector, matrix = kalman.P[SUDDEN, SUDDEN], np.zeros(3), np.zeros((3, 3))
    for _ in range(40):
        effect, y = np.array([0.3, 0.1, -9.81]) + rng.standard_normal(3), -0.6 * rng.random()
        change.add_innovation(own @ effect, y, 0.09)
        vector += own @ effect * y / 0.09
        matrix += np.outer(own @ effect, own @ effect) / 0.09
    inverse = np.linalg.inv(own + 1e-10 * np.eye(3))
    ratio = np.eye(3) + SPREAD[:, np.newaxis] * (inverse @ matrix @ inverse)
    assert change.find(True, PERIOD) == pytest.approx(
        np.linalg.solve(ratio, SPREAD * (inverse @ vector)), rel=1e-6)


def test_noise_is_no_change():
    assert not any(found(0.0, samples=400, seed=seed) for seed in range(8))


def test_innovations_without_weight_and_old_ones_are_no_evidence():
    kalman, _ = correlated()
    change = GroundChange(kalman, SPREAD)

    def add():
        for _ in range(20):
            change.add_innovation(kalman.P[SUDDEN, SUDDEN] @ [0.0, 0.0, -9.81], -0.5, 0.09)

    add()
    assert change.find(False, PERIOD) is None
    assert change.find(True, PERIOD) is None  # they are not kept for the next interval
    add()
    assert change.find(False, PERIOD) is None
    assert change.find(True, PERIOD) is None
    add()
    assert change.find(True, PERIOD) is not None
    assert change.find(True, PERIOD) is None  # found once


def test_the_state_moves_with_a_new_ground_and_has_its_errors():
    kalman, effect = correlated()
    before = kalman.P.copy()
    move, errors = np.array([0.3, -0.2, 0.05, 0.0, 0.1, 0.0, 0.001]), np.diag(
        np.square([0.5, 0.7, 0.04, 0.2, 0.1, 0.003, 0.003]))
    GroundChange(kalman, SPREAD).replace(move, errors)
    assert kalman.x[:GROUND.start] == pytest.approx(
        (effect @ move)[:GROUND.start], rel=0.01, abs=1e-4)
    assert list(kalman.x[GROUND]) == [0.0] * 7
    assert kalman.P[GROUND, GROUND] == pytest.approx(errors, abs=1e-6)
    assert kalman.P[State.V_X, State.V_X] > 2.0 * before[State.V_X, State.V_X]
    assert np.abs(kalman.P - kalman.P.T).max() < 1e-12
    assert np.linalg.eigvalsh(kalman.P).min() > -1e-12


def test_the_effect_of_the_ground_fades_but_not_its_error():
    kalman, _ = correlated()
    before = kalman.P.copy()
    GroundChange(kalman, SPREAD).age(0.6, 0.3)
    assert kalman.P[State.V_X, SUDDEN] == pytest.approx(
        np.exp(-2.0) * before[State.V_X, SUDDEN])
    assert kalman.P[SUDDEN, State.V_X] == pytest.approx(kalman.P[State.V_X, SUDDEN])
    assert kalman.P[GROUND, GROUND] == pytest.approx(before[GROUND, GROUND])


def torques_of(forces, speeds, loads):
    """Return the motor torques [N m] for traction forces [N]."""
    return tuple(required_torque(
        forces, np.array(speeds) / ROBOT.wheel_radius, 0.0, loads, ROBOT).tolist())


def test_traction_forces_follow_from_motor_torques_that_are_measured():
    motors, speeds, loads = MotorTorques(ROBOT), (0.8, 0.7, 0.8, 0.7), [26.0, 27.0, 28.0, 25.0]
    torques = torques_of((2.0, -1.0, 3.0, 0.5), speeds, loads)
    assert motors.forces(torques, speeds, loads) == pytest.approx([2.0, -1.0, 3.0, 0.5])
    assert motors.forces((np.nan, *torques[1:]), speeds, loads) is None
    for shift in (0.01, 0.02):  # the first value repeats, once it does by chance
        again = motors.forces((torques[0], *(t + shift for t in torques[1:])), speeds, loads)
        assert again is not None
    stuck = (torques[0], *(t + 0.03 for t in torques[1:]))
    assert motors.forces(stuck, speeds, loads) is None


def test_the_noise_of_torques_is_learned_while_speeds_are_steady():
    calm, steady, turning = (MotorTorques(ROBOT) for _ in range(3))
    for i in range(round(4.0 * LEARNING_TIME / PERIOD)):
        y = 5.0 * (-1.0) ** i
        least = calm.variance(0, 5.0, 4.0, 0.0, PERIOD)
        learned = steady.variance(0, y, 4.0, 0.0, PERIOD)
        other = steady.variance(1, 0.0, 4.0, 0.0, PERIOD)
        kept = turning.variance(0, y, 4.0, 0.1, PERIOD)
    assert learned - least == pytest.approx(50.0, rel=0.1)  # half the squared difference
    assert least == pytest.approx(other) == pytest.approx(kept)
    assert calm.variance(0, 5.0, 40.0, 0.0, PERIOD) > 5.0 * least


def test_a_robot_that_slides_with_locked_wheels_does_not_stand():
    estimator, deceleration, lock, rows = SlipEstimator(SlipEstimatorParams()), 0.7, 4.0, []
    rng, radius = np.random.default_rng(2), ROBOT.wheel_radius
    for tick in range(700):
        time, rolled = 0.01 * tick, 0.0
        speed = min(max(time - 3.0, 0.0), 0.8)
        force = 1.0 * (3.0 < time <= 3.8)
        rolled = speed
        if time > lock:
            speed, rolled = max(0.8 - deceleration * (time - lock), 0.0), 0.0
            force = -deceleration * (speed > 0.0)
        stamp_ns = NS_PER_S + tick * 10_000_000
        noise = 0.01 * rng.standard_normal(3)
        out = estimator.update(ImuSample(
            stamp_ns, (force + noise[0], noise[1], 9.81 + noise[2]), (0.0, 0.0, 0.0)))
        if tick % 6 == 0:
            out += estimator.update(WheelSample(stamp_ns, (rolled / radius,) * 4))
        rows += [(speed, one.linear[0]) for one in out if isinstance(one, Odometry)]
    speeds = np.array(rows)
    sliding = (speeds[:, 0] > 0.1) & (np.arange(len(speeds)) * 700 / len(speeds) > 410)
    error = speeds[:, 1] - speeds[:, 0]
    assert np.abs(error[sliding]).max() < 0.15
    assert abs(speeds[-1, 1]) < 0.01
