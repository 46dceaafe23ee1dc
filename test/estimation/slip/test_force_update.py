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

"""Corrections by forces: what they change, when they apply, and changes of the ground."""

from __future__ import annotations

from functools import cache
import math

import numpy as np
import pytest

from smart_tire.estimation.slip.ekf import SlipFilter
from smart_tire.estimation.slip.force_model import ForceModel
from smart_tire.estimation.slip.force_update import (
    GROUND_CHANGE_SIGMAS, GROUND_ROWS, LATERAL_CHANGE_TIME, LATERAL_CORRELATION_TIME,
    LATERAL_SPEED_CHANGE, LateralSpeed, MAX_TORQUE_REPEATS, SAME_FORCES_SIGMA)
from smart_tire.estimation.slip.motion_model import SOFT_GROUND_CORRELATION
from smart_tire.estimation.slip.robust_ekf import Measurement
from smart_tire.estimation.slip.state import (
    DelayedSpeed, ImuReading, ImuStep, N, State, TRAVELS)
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.uncertain import Uncertain

LEVEL = (0.0, 0.0, 0.0, 0.0)
NO_TORQUE = (math.nan,) * 4
STEADY = ImuReading(0.0, 0.0, 0.0)
THEN = DelayedSpeed(0, 0.76, 1e-6, 0.5, 0.0, 0.0, 0.0)  # of a film measurement
KNOWN = 1e-4  # sigma of a state that is known
SIGMAS = {State.LN_STIFFNESS: 0.2, State.LN_RATIO: 0.3, State.DRAG: 0.01}


def new_filter(speed=0.8, slip=0.05, sigmas=None, **values):
    """Return a filter with a given forward speed and slip velocity of both sides [m/s]."""
    slip_filter = SlipFilter(build(SlipEstimatorParams, {'force_balance': 'on', **values}))
    ekf = slip_filter._ekf
    for row, value, sigma in ((State.V_X, speed, 0.05), (State.V_Y, 0.0, 0.02),
                              (State.SLIP_VEL_L, slip, 0.05), (State.SLIP_VEL_R, slip, 0.05),
                              (State.FORCE_X, 0.0, 1.0), (State.FORCE_Y, 0.0, 1.0),
                              (State.YAW_RATE, 0.0, 0.1), (State.YAW_ACCEL, 0.0, 0.1),
                              (State.ACCEL_BIAS_X, 0.0, KNOWN), (State.DRAG, 0.015, 0.01)):
        ekf.set_states([row], value, sigma)
    for row, sigma in {**SIGMAS, **(sigmas or {})}.items():
        ekf.set_states([row], ekf.x[row], sigma)
    return slip_filter


def sigma(slip_filter, row):
    return math.sqrt(slip_filter.P[row, row])


def predict(slip_filter, dt=0.01):
    slip_filter.predict(dt, ImuStep(STEADY, 1e-6, 2.5e-5, 1e-3))


def test_without_acceleration_the_common_slip_is_that_of_the_rolling_resistance():
    slip_filter = new_filter(sigmas={State.DRAG: KNOWN, State.LN_STIFFNESS: KNOWN})
    for _ in range(100):
        predict(slip_filter)
        slip_filter.forces.correct_balance(0.01, STEADY, 0.0, LEVEL)
    slip = slip_filter.x[State.SLIP_VEL_L] / (0.8 + slip_filter.x[State.SLIP_VEL_L])
    robot = SlipEstimatorParams().robot
    level = 0.015 * robot.mass * 9.81 / (4.0 * robot.tire.longitudinal_stiffness)
    assert slip == pytest.approx(level, abs=0.01)
    rows = [State.SLIP_VEL_L, State.SLIP_VEL_R]
    common = 0.5 * math.sqrt(slip_filter.P[np.ix_(rows, rows)].sum())
    assert common < 0.005 and abs(slip - level) * 0.8 < 3.0 * common
    assert sigma(slip_filter, State.SLIP_VEL_L) > 0.02  # the balance is one of all wheels


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_a_driving_force_is_explained_by_slip_in_the_direction_of_motion(direction):
    slip_filter = new_filter(direction * 0.8, 0.0)
    for _ in range(50):
        slip_filter.forces.correct_balance(0.01, ImuReading(0.0, direction * 1.0, 0.0), 0.0, LEVEL)
    for row in State.SLIP_VEL_L, State.SLIP_VEL_R:
        assert direction * slip_filter.x[row] > 0.02


def test_in_straight_driving_the_balance_considers_the_ground_but_does_not_correct_it():
    slip_filter = new_filter()
    before = slip_filter.x, slip_filter.P.copy()
    slip_filter.forces.correct_balance(0.01, ImuReading(0.0, 0.8, 0.0), 0.0, LEVEL)
    rows = list(GROUND_ROWS)
    assert np.array(slip_filter.x)[rows] == pytest.approx(np.array(before[0])[rows], abs=1e-12)
    assert np.diag(slip_filter.P)[rows] == pytest.approx(np.diag(before[1])[rows])
    # but an error of C_x now is an error of the slips, and a firmer ground needs less slip
    assert slip_filter.P[State.LN_STIFFNESS, State.SLIP_VEL_L] < -1e-5
    assert not before[1][State.LN_STIFFNESS, State.SLIP_VEL_L]


@cache
def steady_turn(rate, share):
    """Return v_y and the common slip velocity [m/s] at a yaw rate [rad/s], by the force model."""
    x = np.array(new_filter().x)
    x[State.LN_STIFFNESS], x[State.YAW_RATE] = math.log(share), rate
    model = ForceModel(SlipEstimatorParams().robot)
    slips = [State.SLIP_VEL_L, State.SLIP_VEL_R]
    for _ in range(10):  # Newton
        x[State.FORCE_X], x[State.FORCE_Y] = -rate * x[State.V_Y], 0.8 * rate
        _, expected, H, _ = model.longitudinal_balance(x.tolist(), LEVEL)
        x[slips] -= expected[0] / H[0, slips].sum()
        _, expected, H, _ = model.lateral_balance(x.tolist(), LEVEL, 0.0)
        x[State.V_Y] -= expected[0] / H[0, State.V_Y]
    return float(x[State.V_Y]), float(x[State.SLIP_VEL_L])


def turn(rates, share, noise):
    """
    Return the filter after turning with the yaw ``rates`` [rad/s] of steps of 10 ms.

    The true C_x is ``share`` of the nominal one; ``noise`` [m/s2] is added to the accelerometer.
    """
    sigmas = dict.fromkeys((
        State.DRAG, State.LN_RATIO, State.PITCH, State.ROLL, State.GYRO_BIAS_Z, State.ACCEL_BIAS_X,
        State.ACCEL_BIAS_Y), KNOWN)
    slip_filter = new_filter(sigmas={**sigmas, State.LN_STIFFNESS: 0.3, State.V_Y: 0.1})
    truth = [steady_turn(rate, share) for rate in rates]
    v_y, slip = np.array(truth).T
    reading = None
    for rate, speed, slip_vel, change, error in zip(
            rates, v_y, slip, np.diff(v_y, prepend=v_y[0]), noise * np.ones(len(rates))):
        last = reading
        reading = ImuReading(rate, -rate * speed, change / 0.01 + 0.8 * rate + error)
        mean = ImuReading(*(0.5 * (np.array((last or reading)[:3]) + reading[:3])))
        slip_filter.predict(0.01, ImuStep(mean, 1e-6, 2.5e-5, 1e-3))
        slip_filter.forces.correct_balance(0.01, reading, 0.0, LEVEL)
        # measured by wheels and films
        slip_filter._ekf.correct_states(
            [State.V_X, State.SLIP_VEL_L, State.SLIP_VEL_R],
            np.array([0.8, slip_vel, slip_vel]), np.full(3, 0.1 ** 2))
    return slip_filter


def test_a_changing_lateral_speed_determines_c_x():
    rates, found = np.sin(2.0 * np.arange(0.0, 6.0, 0.01)), []
    for share in 0.7, 1.3:
        slip_filter = turn(rates, share, 0.0)
        error = slip_filter.x[State.LN_STIFFNESS] - math.log(share)
        assert abs(error) < 2.0 * sigma(slip_filter, State.LN_STIFFNESS)
        assert sigma(slip_filter, State.LN_STIFFNESS) < 0.1
        found.append(slip_filter.x[State.LN_STIFFNESS])
    assert found[1] - found[0] == pytest.approx(math.log(1.3 / 0.7), abs=0.1)


def test_in_a_steady_turn_the_noise_of_the_accelerometer_does_not_bias_c_x():
    found, sigmas = [], []
    for seed in range(4):
        noise = np.random.default_rng(seed).normal(0.0, 0.05, 1500)
        slip_filter = turn(np.full(1500, 0.8), 1.0, noise)
        found.append(slip_filter.x[State.LN_STIFFNESS])
        sigmas.append(sigma(slip_filter, State.LN_STIFFNESS))
    assert np.abs(found).max() < 0.1, found
    assert min(sigmas) > 0.1, sigmas  # it is hardly observable


def test_an_unknown_ground_leaves_the_slip_less_certain():
    found = []
    for stiffness in KNOWN, 0.5:
        slip_filter = new_filter(sigmas={State.LN_STIFFNESS: stiffness, State.LN_RATIO: KNOWN})
        for _ in range(50):
            slip_filter.forces.correct_balance(0.01, ImuReading(0.0, 1.0, 0.0), 0.0, LEVEL)
        found.append(sigma(slip_filter, State.SLIP_VEL_L))
    assert found[1] > 1.1 * found[0]


@pytest.mark.parametrize('seed', range(3))
def test_the_covariance_stays_positive(seed):
    rng, slip_filter = np.random.default_rng(seed), new_filter(sigmas={State.LN_STIFFNESS: 0.5})
    for _ in range(300):
        predict(slip_filter)
        slip_filter.forces.correct_balance(
            0.01, ImuReading(*rng.normal(0.0, [0.3, 1.5, 1.0])), 0.1, LEVEL)
        slip_filter.forces.correct_torques(tuple(rng.normal(0.5, 0.5, 4)), LEVEL, LEVEL)
    assert np.isfinite(slip_filter.x).all()
    assert np.linalg.eigvalsh(slip_filter.P).min() > -1e-9


def test_torques_correct_the_slips_but_not_c_x_itself():
    slip_filter = new_filter()
    slip_filter.forces.correct_balance(0.01, STEADY, 0.0, LEVEL)
    before, sigmas = slip_filter.x, np.sqrt(np.diag(slip_filter.P))
    slip_filter.forces.correct_torques((0.7,) * 4, LEVEL, LEVEL)
    assert slip_filter.x[State.SLIP_VEL_L] > before[State.SLIP_VEL_L]
    assert sigma(slip_filter, State.SLIP_VEL_L) < sigmas[State.SLIP_VEL_L]
    for row in State.LN_STIFFNESS, State.LN_RATIO:
        assert slip_filter.x[row] == pytest.approx(before[row], abs=1e-12)


def test_torques_determine_an_unknown_c_x():
    slip_filter = new_filter(sigmas={
        State.LN_STIFFNESS: 0.5, State.LN_RATIO: 0.05, State.SLIP_VEL_L: 0.002,
        State.SLIP_VEL_R: 0.002})
    slip_filter.forces.correct_balance(0.01, STEADY, 0.0, LEVEL)
    slip_filter.forces.correct_torques((0.7,) * 4, LEVEL, LEVEL)
    assert slip_filter.x[State.LN_STIFFNESS] > 0.1
    assert sigma(slip_filter, State.LN_STIFFNESS) < 0.3


def test_unknown_torques_are_no_correction():
    slip_filter = new_filter()
    slip_filter.forces.correct_balance(0.01, STEADY, 0.0, LEVEL)
    before, P = slip_filter.x, slip_filter.P.copy()
    slip_filter.forces.correct_torques(NO_TORQUE, LEVEL, LEVEL)
    assert slip_filter.x == before and np.array_equal(slip_filter.P, P)
    slip_filter.forces.correct_torques((0.5, math.nan, 0.5, math.nan), LEVEL, LEVEL)
    assert np.isfinite(slip_filter.x).all() and np.isfinite(slip_filter.P).all()
    assert slip_filter.x[State.TORQUE_OFFSET_FL] != before[State.TORQUE_OFFSET_FL]


def test_ground_estimated_with_a_failed_torque_becomes_uncertain_once():
    slip_filter = new_filter()
    slip_filter.forces.correct_balance(0.01, STEADY, 0.0, LEVEL)
    noise, row = np.random.default_rng(3), State.LN_STIFFNESS
    sigmas = []
    for _ in range(MAX_TORQUE_REPEATS + 4):
        others = 0.3 + 0.05 * noise.standard_normal(3)
        slip_filter.forces.correct_torques((0.3, *others), LEVEL, LEVEL)
        sigmas.append(sigma(slip_filter, row))
    steps = np.flatnonzero(np.diff(sigmas) > 0.05)
    assert steps.tolist() == [MAX_TORQUE_REPEATS - 1]
    assert sigmas[MAX_TORQUE_REPEATS] == pytest.approx(
        SlipEstimatorParams().ground_stiffness_sigma, rel=0.1)
    assert slip_filter.forces.ground_changes == 0


def test_no_correction_changes_the_scale_of_the_torques():
    slip_filter = new_filter(sigmas={State.TORQUE_SCALE: 0.05})
    slip_filter.forces.correct_balance(0.01, STEADY, 0.0, LEVEL)
    for _ in range(5):
        slip_filter.forces.correct_torques((1.5,) * 4, LEVEL, LEVEL)
    assert slip_filter.P[State.TORQUE_SCALE, State.SLIP_VEL_L] != 0.0
    slip_filter.correct_zero_velocity()
    assert slip_filter.x[State.TORQUE_SCALE] == 0.0
    assert sigma(slip_filter, State.TORQUE_SCALE) == pytest.approx(0.05)


def test_torques_of_wheels_that_follow_commands_count_less():
    sigmas = []
    for acceleration in 0.0, 2.0:  # m/s2, of the wheels beyond that of the robot
        slip_filter = new_filter()
        slip_filter.forces.correct_balance(0.01, STEADY, 0.0, LEVEL)
        slip_filter.forces.correct_torques((0.7,) * 4, LEVEL, (acceleration, 0.0, 0.0, 0.0))
        sigmas.append(sigma(slip_filter, State.SLIP_VEL_L))
    assert sigmas[0] < sigmas[1]


@pytest.mark.parametrize(('speed', 'enabled', 'active'), [
    (0.8, True, True), (-0.8, True, True), (0.05, True, False), (0.8, False, False)])
def test_forces_are_used_while_enabled_and_rolling_only(speed, enabled, active):
    slip_filter = new_filter(speed, 0.0, force_balance='on' if enabled else 'off')
    slip_filter.forces.correct_balance(0.01, STEADY, 0.0, LEVEL)
    assert slip_filter.forces.active == active
    before = slip_filter.x
    slip_filter.forces.correct_torques((0.9,) * 4, LEVEL, LEVEL)
    assert (slip_filter.x != before) == active


def travels(innovations):
    """Return measured distances [m] of both sides with the given innovations over sigma."""
    H = np.zeros((2, N))
    H[0, State.TRAVEL_L] = H[1, State.TRAVEL_R] = 1.0
    R = 1e-6 * np.eye(2)
    return Measurement(np.array(innovations) * 1e-3, np.zeros(2), H, R)


def active_filter():
    slip_filter = new_filter()
    slip_filter._ekf.set_states(TRAVELS, 0.0, 1e-6)
    slip_filter.forces.correct_balance(0.01, STEADY, 0.0, LEVEL)
    return slip_filter


LARGE = 1.2 * GROUND_CHANGE_SIGMAS


@pytest.mark.parametrize(('samples', 'changes'), [
    ([LARGE], 0), ([LARGE, LARGE], 1), ([-LARGE, -LARGE], 1), ([LARGE, -LARGE], 0),
    ([LARGE, -LARGE, LARGE], 0), ([0.5 * LARGE, 0.5 * LARGE], 0), ([LARGE, 0.0, LARGE], 0),
    ([LARGE] * 4, 2)])
def test_two_contradicting_samples_of_one_sign_are_a_change_of_the_ground(samples, changes):
    slip_filter = active_filter()
    for score in samples:
        # both sides alike: their common innovation counts
        slip_filter.forces.detect_ground_change(travels([score / math.sqrt(2.0)] * 2))
    assert slip_filter.forces.ground_changes == changes
    known = sigma(slip_filter, State.LN_STIFFNESS) < 0.3
    assert known == (changes == 0)


def test_opposite_innovations_of_the_sides_are_no_change_of_the_ground():
    slip_filter = active_filter()
    for _ in range(3):
        slip_filter.forces.detect_ground_change(travels([5.0 * LARGE, -5.0 * LARGE]))
    assert slip_filter.forces.ground_changes == 0


def test_on_new_ground_its_properties_are_as_uncertain_as_their_priors_and_kept_in_mean():
    slip_filter = active_filter()
    before = slip_filter.x
    for _ in range(2):
        slip_filter.forces.detect_ground_change(travels([LARGE] * 2))
    params = SlipEstimatorParams()
    assert slip_filter.x == before
    assert sigma(slip_filter, State.LN_STIFFNESS) == pytest.approx(params.ground_stiffness_sigma)
    assert sigma(slip_filter, State.LN_RATIO) == pytest.approx(params.ground_friction_sigma)


def test_at_standstill_wheel_samples_change_no_ground():
    slip_filter = new_filter(0.0, 0.0)
    slip_filter.forces.correct_balance(0.01, STEADY, 0.0, LEVEL)
    for _ in range(3):
        slip_filter.forces.detect_ground_change(travels([LARGE] * 2))
    assert slip_filter.forces.ground_changes == 0


def adhesion(slip_filter, share=1.0):
    """Return L_a / L on ground whose mu / C_x is ``share`` of the present estimate."""
    load = 0.25 * SlipEstimatorParams().robot.mass * 9.80665
    kappa = slip_filter.forces._model._ratio(slip_filter.x)
    return 1.0 - 0.05 / (3.0 * kappa * share * load)


def test_an_adhesion_ratio_corrects_mu_over_c_x():
    slip_filter = new_filter()
    ratio = Uncertain(adhesion(slip_filter, 0.8), 0.02)
    before = sigma(slip_filter, State.LN_RATIO)
    slip_filter.forces.correct_adhesion(0, ratio, Uncertain(0.05, 0.003), THEN)
    assert slip_filter.forces.ground_changes == 0
    assert math.log(0.8) * 1.2 < slip_filter.x[State.LN_RATIO] < -0.05
    assert sigma(slip_filter, State.LN_RATIO) < before
    assert slip_filter.x[State.LN_STIFFNESS] == pytest.approx(0.0, abs=1e-9)


def test_an_adhesion_ratio_that_contradicts_the_estimate_is_a_change_of_the_ground():
    slip_filter = new_filter(sigmas={State.LN_RATIO: 0.03, State.LN_STIFFNESS: 0.05})
    before = sigma(slip_filter, State.LN_STIFFNESS)
    slip_filter.forces.correct_adhesion(
        0, Uncertain(adhesion(slip_filter, 0.3), 0.02), Uncertain(0.05, 0.003), THEN)
    assert slip_filter.forces.ground_changes == 1
    # the forces do not contradict, so C_x has changed little
    assert before < sigma(slip_filter, State.LN_STIFFNESS) <= SAME_FORCES_SIGMA
    assert sigma(slip_filter, State.DRAG) > 0.04
    assert slip_filter.x[State.LN_RATIO] < 0.8 * math.log(0.3)


def test_new_ground_that_is_softer_is_likely_to_resist_rolling_more():
    slip_filter = active_filter()
    slip_filter.forces._change_ground()
    stiffness, drag = State.LN_STIFFNESS, State.DRAG
    correlation = slip_filter.P[stiffness, drag] / (
        sigma(slip_filter, stiffness) * sigma(slip_filter, drag))
    assert -0.7 < correlation < -0.3
    start = SlipFilter(build(SlipEstimatorParams, {})).P
    assert start[stiffness, drag] == pytest.approx(
        SOFT_GROUND_CORRELATION * math.sqrt(start[stiffness, stiffness] * start[drag, drag]))


def test_a_large_change_of_the_adhesion_ratio_is_followed_within_two_sigmas():
    slip_filter = new_filter(sigmas={State.LN_RATIO: 0.7})
    ratio = Uncertain(adhesion(slip_filter, 0.3), 0.02)
    for _ in range(2):
        slip_filter.forces.correct_adhesion(0, ratio, Uncertain(0.05, 0.003), THEN)
        error = slip_filter.x[State.LN_RATIO] - math.log(0.3)
        assert abs(error) < 2.0 * sigma(slip_filter, State.LN_RATIO)


def test_the_lateral_speed_is_filtered_and_compared_with_that_of_a_second_ago():
    speed = LateralSpeed()
    assert not speed.changes  # unknown
    speed.update(0.02, 0.01)
    assert speed.mean == 0.02 and not speed.changes
    means, changes = [], []
    for _ in range(400):
        speed.update(-0.02, 0.01)
        means.append(speed.mean)
        changes.append(speed.changes)
    after = int(100 * LATERAL_CORRELATION_TIME)
    assert means[after - 1] == pytest.approx(-0.02 + 0.04 / math.e, abs=1e-3)
    # 40 mm/s decay to the threshold within a few times the longer time constant
    settled = 100 * LATERAL_CHANGE_TIME * math.log(0.04 / LATERAL_SPEED_CHANGE)
    assert changes.index(True) < 10 and all(changes[10:int(0.9 * settled)])
    assert not any(changes[int(1.2 * settled):])


def test_the_lateral_speed_depends_on_time_not_on_the_rate():
    means = []
    for rate in 100, 400:
        speed = LateralSpeed()
        speed.update(0.0, 1.0 / rate)
        for _ in range(rate // 10):
            speed.update(0.05, 1.0 / rate)
        means.append(speed.mean)
    assert means[0] == pytest.approx(means[1], rel=0.05)


SWERVE = np.sin(2.0 * np.arange(0.0, 0.5, 0.01))  # rad/s


def change_of_stiffness(force, failed=0, rates=SWERVE):
    """Return that of ln C_x by one reading of a lateral force [m/s2] more than in the turn."""
    slip_filter = turn(rates, 1.0, 0.0)
    for check in slip_filter.forces._checks[:failed]:
        check.failed = True
    x = slip_filter.x
    for row in State.FORCE_X, State.FORCE_Y, State.YAW_RATE, State.YAW_ACCEL:
        slip_filter._ekf.set_states([row], x[row], 3.0)  # the reading itself corrects no C_x
    reading = ImuReading(x[State.YAW_RATE], x[State.FORCE_X], x[State.FORCE_Y] + force)
    slip_filter.forces.correct_balance(0.01, reading, 0.0, LEVEL)
    return abs(slip_filter.x[State.LN_STIFFNESS] - x[State.LN_STIFFNESS])


def test_a_push_from_the_side_is_not_a_change_of_c_x():
    assert change_of_stiffness(0.05) > 1e-3 and change_of_stiffness(5.0) < 1e-5


def test_in_a_steady_turn_the_lateral_balance_keeps_c_x():
    assert change_of_stiffness(0.05, rates=np.full(500, 0.8)) < 1e-5


@pytest.mark.parametrize(('failed', 'corrected'), [(0, True), (1, True), (2, False)])
def test_torques_that_contradict_the_forces_of_several_wheels_keep_c_x(failed, corrected):
    assert (change_of_stiffness(0.05, failed) > 1e-3) == corrected
