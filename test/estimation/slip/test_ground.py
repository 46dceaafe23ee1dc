# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Slip filter with the ground given: consistency, changes of the ground, its end."""

from array import array
from dataclasses import replace
from functools import cache
import math

from benchmarks.events import inputs_of, truth_of
from benchmarks.motion import (
    as_estimate, as_truth, in_motion, slip_errors, speed_errors, steady_sides)
from benchmarks.robots.draws import draw, FILMS, TORQUES
from benchmarks.robots.scoring import estimates_of
from benchmarks.scenarios import SCENARIOS
import numpy as np
import pytest

from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.filter import ICR_LEARNED, SlipFilter
from smart_tire.estimation.slip.ground import ground_prior, LastingError, MotorTorques
from smart_tire.estimation.slip.inputs import ImuInput, WheelSpeeds
from smart_tire.estimation.slip.kalman import KalmanFilter
from smart_tire.estimation.slip.output import OutputContext, SlipOutputBuilder
from smart_tire.estimation.slip.state import (
    BALANCE_SIGMA, EXPIRY_TIME, ImuReading, ImuStep, LEARNING_TIME, MODEL_TIME, N, PUSH_TIME,
    SLIP_CORRELATION_TIME, State)
from smart_tire.models.vehicle.drive import friction_torque
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.samples import (
    GroundState, ImuSample, NS_PER_S, Odometry, WheelSample, WheelSlip)
from smart_tire.simulation.plant import SurfaceMap
from smart_tire.uncertain import Uncertain

pytestmark = pytest.mark.slow

PARAMS = SlipEstimatorParams()
SEEDS = (11, 12)  # not used by a benchmark
SHORT, WHOLE = 24.0, math.inf  # s, of a scenario
PERIOD_NS = 500_000_000
DELAY_NS = 100_000_000  # after which a state is published
STIFFNESS_SIGMA, FRICTION_SIGMA, RESISTANCE_SIGMA = 0.10, 0.08, 0.10  # relative


def runs(short, *others):
    """Return a decorator for short runs of one seed, and whole ones of others and more seeds."""
    return pytest.mark.parametrize(('name', 'seeds', 'duration'), [
        *((name, SEEDS[:1], SHORT) for name in short), *(
            pytest.param(name, SEEDS, WHOLE, marks=pytest.mark.long)
            for name in (*short, *others))])


def test_quantities_that_a_ground_state_does_not_have_are_unknown():
    estimator, found = SlipEstimator(SlipEstimatorParams()), []
    for tick in range(300):
        stamp_ns = NS_PER_S + tick * 10_000_000
        found += estimator.update(ImuSample(stamp_ns, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0)))
        if tick % 6 == 0:
            found += estimator.update(WheelSample(stamp_ns, (6.0,) * 4))
        if tick % 50 == 0:
            estimator.update(GroundState(stamp_ns, Uncertain(50.0, 2.0)))
    assert estimator.status()['ground'] == 'given'
    assert math.isfinite(sum(map(sum, (
        [*one.linear, *one.twist_covariance] for one in found if isinstance(one, Odometry)))))


def test_the_velocity_of_the_robot_stays_when_the_position_of_the_imu_is_given():
    robot = replace(PARAMS.robot, imu=replace(PARAMS.robot.imu, position_sigma=0.1))
    slip_filter = SlipFilter(replace(PARAMS, robot=robot))
    x, P = slip_filter.kalman.x, slip_filter.kalman.P
    step = ImuStep(0.01, ImuReading(0.8, 0.0, 0.0), 1e-6, 1e-4, 0.8, 0.8)
    slip_filter.predict(0.01, step)
    nominal_x, nominal_y, _ = robot.imu.position

    def velocity():
        return [x[State.V_X] + (nominal_y + x[State.IMU_Y]) * 0.8,
                x[State.V_Y] - (nominal_x + x[State.IMU_X]) * 0.8]

    x[State.V_X], x[State.V_Y], before = 0.7, 0.1, P.copy()
    expected = velocity()
    slip_filter.set_ground(GroundState(0, Uncertain(50.0, 2.0)))  # without a position
    assert (x[State.IMU_X], P[State.IMU_X, State.IMU_X]) == (0.0, pytest.approx(0.01))
    slip_filter.set_ground(GroundState(
        0, Uncertain(50.0, 2.0), imu_x=Uncertain(nominal_x + 0.12, 0.02),
        imu_y=Uncertain(nominal_y - 0.07, 0.03)))
    assert velocity() == pytest.approx(expected)
    assert (x[State.IMU_X], x[State.IMU_Y]) == (pytest.approx(0.12), pytest.approx(-0.07))
    by_arm = np.eye(N)
    by_arm[State.V_X, State.IMU_Y], by_arm[State.V_Y, State.IMU_X] = 0.8, -0.8
    old, new = by_arm @ before @ by_arm.T, by_arm @ P @ by_arm.T  # of the velocity of the robot
    rows = np.ix_([State.V_X, State.V_Y], [State.V_X, State.V_Y])
    np.testing.assert_allclose(new[rows], old[rows], rtol=1e-9)
    assert np.diag(P)[[State.IMU_X, State.IMU_Y]] == pytest.approx([0.0004, 0.0009])
    assert new[State.V_Y, State.IMU_X] == pytest.approx(0.0, abs=1e-12)


class Corrected(KalmanFilter):
    """Keeps the arguments of corrections, and makes none."""

    def __init__(self, other):
        super().__init__(other.x, other.P)
        self.found = []

    def correct(self, *arguments):
        self.found.append(arguments)
        return 0.0


def lasting_sigmas(innovations, dt=0.008):
    """Return the sigmas [m/s2] of the lasting error after each of the innovations [m/s2]."""
    error = LastingError()
    found = []
    for one in innovations:
        error.add_innovation(one, dt)
        found.append(math.sqrt(error.variance + error.push))
    return found


@pytest.mark.parametrize('explained', [0.0, 0.05])
def test_the_lasting_error_is_learned_from_what_white_errors_do_not_explain(explained):
    error, dt, sigmas = LastingError(), 0.01, []
    for _ in range(round(6.0 * LEARNING_TIME / dt)):
        error.add_innovation(-0.3, dt)
        error.learn(explained, dt)
        sigmas.append(math.sqrt(error.variance))
    assert sigmas[50] < 1.5 * BALANCE_SIGMA  # an outlier at first
    assert sigmas[-1] == pytest.approx(math.sqrt(0.09 - explained), rel=0.01)
    for _ in range(round(12.0 * LEARNING_TIME / dt)):
        error.add_innovation(0.0, dt)
        error.learn(explained, dt)
    assert error.variance == BALANCE_SIGMA ** 2


def test_the_errors_that_were_learned_on_the_prior_are_not_those_of_a_ground_that_is_given():
    forces = SlipFilter(PARAMS).forces
    state = GroundState(0, Uncertain(50.0, 2.0))
    forces.set_ground(state)
    along = forces._along
    forces.set_ground(state)
    assert forces._along is along
    forces.age(EXPIRY_TIME)
    forces.set_ground(state)
    assert forces._along is not along


def test_the_prior_is_that_of_the_tire_and_of_all_grounds():
    robot = replace(PARAMS.robot, tire=replace(PARAMS.robot.tire, longitudinal_stiffness=100.0,
                                               longitudinal_stiffness_sigma=0.3))
    stiffness, friction, resistance, *_ = ground_prior(robot)
    assert stiffness == pytest.approx((100.0 * math.exp(-0.2), 50.0 * math.exp(-0.2)))
    assert friction == pytest.approx((0.4, 0.24))
    assert 0.2 < resistance.value + 2.0 * resistance.sigma < 0.3  # deep sand
    slip_filter = SlipFilter(replace(PARAMS, robot=robot))
    variances = np.diag(slip_filter.kalman.P)[[State.LN_STIFFNESS, State.LN_FRICTION]]
    assert variances == pytest.approx([0.25, 0.36])
    assert slip_filter.forces.friction_ignorance == pytest.approx(1.0)


def test_a_push_is_a_lasting_error_of_the_balance_within_the_time_of_the_tires():
    rest, push = [0.02] * 200, [0.5] * 60
    sigmas = lasting_sigmas(rest + push)
    assert sigmas[199] == pytest.approx(BALANCE_SIGMA)
    reached = 200 + round(2.0 * PUSH_TIME / 0.008)
    assert max(sigmas[200:reached]) > 0.2
    assert max(sigmas[reached:]) == pytest.approx(0.48 * 0.6, abs=0.06)  # less its own mean
    released = lasting_sigmas(rest + push + rest)
    after = int(np.argmax(released[260:])) + 260
    assert released[after] > 0.2  # the release is a change, too
    later = round(2.0 * MODEL_TIME / 0.008)  # the change decays by its square
    assert released[after + later] ** 2 - BALANCE_SIGMA ** 2 == pytest.approx(
        (released[after] ** 2 - BALANCE_SIGMA ** 2) * math.exp(-2.0), rel=0.1)


def test_the_lasting_error_of_a_push_is_the_same_to_either_side():
    left, right = (lasting_sigmas([0.0] * 50 + [sign * 0.4] * 20) for sign in (1.0, -1.0))
    assert left == right


def test_what_changes_slowly_or_has_always_varied_is_no_push():
    slow = 0.5 * np.linspace(0.0, 1.0, 1000)  # within 8 s
    assert max(lasting_sigmas(slow)) == pytest.approx(BALANCE_SIGMA)
    rng = np.random.default_rng(5)
    rough = np.convolve(rng.normal(0.0, 1.0, 6000), np.ones(8) / 8.0, 'same')  # ice
    sigmas = lasting_sigmas(rough)
    assert np.mean(np.array(sigmas[4000:]) > 2.0 * BALANCE_SIGMA) < 0.02


@pytest.mark.parametrize(('row', 'seeds'), [
    ('pushes', (8604,)), *(pytest.param(row, (8701, 8702, 8703), marks=pytest.mark.long)
                           for row in ('pushes', 'lifted'))])
def test_the_lateral_speed_is_consistent_while_something_disturbs_the_robot(row, seeds):
    squares = []
    for seed in seeds:
        one = draw(row, seed)
        events = one.events()
        motion = as_truth(truth_of(events), one.true)
        series = as_estimate(estimates_of(one, inputs_of(events)))
        age = (motion.stamp_ns - motion.stamp_ns[0]) / NS_PER_S
        disturbed = np.any([(age > each.begin) & (age < each.end) for each in (
            *one.traits.pushes, *one.traits.lifts)], axis=0)
        errors = speed_errors(series, motion, 1, disturbed)
        squares.append(np.mean((errors.error / errors.sigma) ** 2))
    assert np.mean(squares) < 5.0  # 42 in pushes, 6 under lifted wheels with a constant sigma


@pytest.mark.parametrize('seeds', [
    (8604,), pytest.param((8831, 8832, 8833, 8834), marks=pytest.mark.long)])
def test_slip_on_ice_that_nothing_shows_is_within_its_sigma(seeds):
    """Without films and torques: slips of 0.2 to 0.5 that their difference shows."""
    slips, speeds = [], []
    for seed in seeds:
        one = replace(draw('ice', seed), without=(FILMS, TORQUES))
        events = one.events()
        motion = as_truth(truth_of(events), one.true)
        series = as_estimate(estimates_of(one, inputs_of(events)))
        steady, (error, sigma) = steady_sides(motion), slip_errors(series, motion)
        slips.append(np.mean(np.abs(error[steady]) < 2.0 * sigma[steady]))
        moving = in_motion(motion) & (motion.stamp_ns - motion.stamp_ns[0] > 2 * NS_PER_S)
        errors = speed_errors(series, motion, 0, moving)
        speeds.append(np.mean((errors.error / errors.sigma) ** 2))
    assert np.mean(slips) > 0.9  # 0.83 by the difference of the sides alone
    assert np.mean(speeds) < 3.0  # 3.8


def test_hidden_common_slip_is_an_error_of_slip_and_speed_but_not_of_the_wheels():
    builder = SlipOutputBuilder(PARAMS)
    x, P = array('d', bytes(8 * N)), 1e-6 * np.eye(N)
    x[State.V_X] = 1.0
    reading = ImuReading(0.0, 0.0, 0.0)
    context = OutputContext(NS_PER_S, 0.0, reading, 1e-6, (0.0,) * 4)

    def sigmas(hidden):
        odometry, slip = builder.build(context._replace(hidden=hidden), x, P)[:2]
        return [*np.sqrt([odometry.twist_covariance[i] for i in (0, 7)]), *slip.sigma]
    shown, hidden = sigmas((0.0, 0.0)), sigmas((0.09, 0.04))
    assert hidden[:2] == [pytest.approx(0.3, rel=1e-4), pytest.approx(0.2, rel=1e-4)]
    assert hidden[2:] == [pytest.approx(0.3, rel=1e-4)] * 4  # of a slip velocity, over 1 m/s
    assert max(shown) < 0.002
    assert P[State.V_X, State.V_X] == 1e-6  # that of the filter stays


def test_what_is_hidden_depends_on_how_well_friction_is_known():
    slip_filter = SlipFilter(PARAMS)
    slip_filter._sides = [0.7, 0.7]
    assert slip_filter.hidden_variance == (0.0, 0.0)  # no more than the prior
    slip_filter._difference.add_square(0.3 ** 2, math.inf)  # ice
    along, across = slip_filter.hidden_variance
    assert along == pytest.approx(9.0 * across)
    assert across == pytest.approx((0.3 ** 2 - PARAMS.differential_slip_sigma ** 2) * 0.7 ** 2)
    slip_filter._sides = [-0.7, 0.7]  # in place: slip of the sides is none along the robot
    assert slip_filter.hidden_variance == (0.0, 0.0)
    slip_filter._sides = [0.7, 0.7]
    slip_filter.set_ground(GroundState(0, Uncertain(50.0, 2.0)))  # without friction
    assert slip_filter.hidden_variance == pytest.approx((along, across))
    slip_filter.set_ground(GroundState(0, Uncertain(50.0, 2.0), Uncertain(0.4, 0.024)))
    assert slip_filter.hidden_variance == pytest.approx((0.01 * along, 0.01 * across))


def test_tires_that_slide_along_hold_the_lateral_speed_less():
    """A slope is held by F v_y / slip velocity, with mu two sigmas low in F = mu m g."""
    def noise(slip, friction=None):
        slip_filter = SlipFilter(PARAMS)
        slip_filter.kalman.x[State.SLIP_VEL_L] = slip_filter.kalman.x[State.SLIP_VEL_R] = slip
        if friction is not None:
            slip_filter.set_ground(GroundState(0, Uncertain(50.0, 2.0), friction))
        slip_filter.kalman = Corrected(slip_filter.kalman)
        slip_filter.correct_lateral(0.0, 2.0 * SLIP_CORRELATION_TIME)
        return slip_filter.kalman.found[0][2] - PARAMS.lateral_sigma ** 2

    ice = Uncertain(0.1, 0.01)
    least, prior = 0.1 * math.exp(-2.0 * 0.1), 0.4 * math.exp(-2.0 * 0.6)
    assert noise(0.5) == pytest.approx((0.5 * PARAMS.slope_sigma / prior) ** 2)
    assert noise(0.0, ice) == pytest.approx(0.0)
    assert noise(0.5, ice) == pytest.approx((0.5 * PARAMS.slope_sigma / least) ** 2)
    assert noise(-0.5, ice) == noise(0.5, ice)


@pytest.mark.parametrize(('balanced', 'given', 'changed', 'learned'), [
    (True, True, False, True), (False, True, False, False), (True, False, False, False),
    (True, True, True, False)])
def test_where_the_forces_show_the_lateral_speed_only_the_icr_is_learned(
        balanced, given, changed, learned):
    slip_filter = SlipFilter(PARAMS)
    if given:
        slip_filter.set_ground(GroundState(0, Uncertain(50.0, 2.0)))
    slip_filter._balanced = balanced
    if changed:
        slip_filter.forces._since_change = 0.0
    slip_filter.kalman = Corrected(slip_filter.kalman)
    slip_filter.correct_lateral(0.5, 0.1)
    assert np.array_equal(slip_filter.kalman.found[0][3], ICR_LEARNED) is learned


@pytest.mark.parametrize(('given', 'sigma', 'taken'), [
    ((50.0, 0.5, 0.01), 0.02, False),  # as before the change, and contradicts the own one
    ((50.0, 0.5, 0.01), 20.0, False),  # as before, contradicts nothing: less certain than that
    ((31.0, 0.3, 0.1), 0.05, True)])
def test_a_ground_as_before_does_not_replace_what_the_filter_has_found(given, sigma, taken):
    slip_filter = SlipFilter(PARAMS)
    forces, P = slip_filter.forces, slip_filter.kalman.P

    def state(values, relative):
        return GroundState(0, *(Uncertain(value, relative * value) for value in values))
    slip_filter.set_ground(state((50.0, 0.5, 0.01), 0.02))
    forces._since_change = 0.0  # it has found a change
    forces._add_to_ground((math.log(30.0 / 50.0), math.log(0.6), 0.09))
    P[State.LN_STIFFNESS, State.LN_STIFFNESS] = 0.1 ** 2
    own = forces._given
    slip_filter.set_ground(state(given, sigma))
    assert forces.follows is not taken
    assert tuple(forces._given[:3]) == (given if taken else own[:3])


def test_the_balance_at_an_imu_far_from_the_center_of_mass_has_the_noise_of_the_yaw_acceleration(
        monkeypatch):
    def variances(x, y):
        robot = PARAMS.robot
        robot = replace(robot, imu=replace(robot.imu, position=(x, y, 0.1)))
        slip_filter, imu, found = SlipFilter(replace(PARAMS, robot=robot)), ImuInput(robot), []
        for tick in range(3):
            imu.add_sample(0.01 * tick, ImuSample(0, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0)))
        slip_filter.kalman.x[State.V_X] = 0.7
        slip_filter.set_ground(GroundState(0, Uncertain(50.0, 2.0)))
        monkeypatch.setattr(slip_filter.forces, '_correct',
                            lambda y, axis, variance, *shared: found.append(variance))
        assert slip_filter.forces.correct(imu, (0.0,) * 4, 0.01)
        return np.array(found)

    noise = 2.0 * (0.01 / 0.01) ** 2  # (rad/s2)^2: two samples of the gyroscope, 0.01 s apart
    assert variances(0.3, 0.0) - variances(0.0, 0.0) == pytest.approx([0.0, 0.09 * noise])
    assert variances(0.0, 0.2) - variances(0.0, 0.0) == pytest.approx([0.04 * noise, 0.0])


def balanced(monkeypatch, step, distances=()):
    """Return variances and Jacobians of the balance after a step [m/s] of the slip, and a way."""
    slip_filter, imu, found = SlipFilter(PARAMS), ImuInput(PARAMS.robot), []
    for tick in range(3):
        imu.add_sample(0.01 * tick, ImuSample(0, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0)))
    slip_filter.kalman.x[State.V_X] = 0.5
    slip_filter.set_ground(GroundState(0, Uncertain(50.0, 2.0)))
    monkeypatch.setattr(slip_filter.forces, '_correct', lambda y, axis, variance, *_: found.append(
        (variance, np.array(slip_filter.forces._forces.H[axis]))))
    wheels = WheelSpeeds(0.06, (0.5,) * 4, (0.5, 0.5), 0.0, True)
    slip_filter.forces.find_change(imu, None, wheels, step)
    slip_filter.forces.find_change(imu, None, wheels, 0.5 * step)  # a smaller one afterwards
    for distance in (*distances, 0.005):
        found.clear()
        assert slip_filter.forces.correct(imu, (0.0,) * 4, distance / 0.5)
    return found


def test_forces_follow_a_change_of_slip_over_the_relaxation_length(monkeypatch):
    relaxation = 0.5 * PARAMS.robot.tire.contact_length
    (steady, h), (aside, _) = balanced(monkeypatch, 0.0)
    by_slip = h[State.SLIP_VEL_L] + h[State.SLIP_VEL_R]
    assert by_slip > 10.0  # 1/s, four tires of 50 N at 0.5 m/s and 11 kg
    for way in (0.0, 0.02, 0.05):
        (found, _), (lateral, _) = balanced(monkeypatch, 0.1, (way,) if way else ())
        late = 0.1 * math.exp(-(way + 0.005) / relaxation)
        assert found - steady == pytest.approx(
            2.0 * relaxation / 0.005 * (by_slip * late) ** 2, rel=1e-6)
        assert lateral == pytest.approx(aside)


@pytest.mark.parametrize('duration, known, share', [
    (0.0046, True, 0.951626), (0.046, True, 0.632121), (0.46, True, 0.0999955),
    (0.046, False, 0.632121)])
@pytest.mark.parametrize('side', [0, 1])
def test_a_change_of_wheel_speed_is_slip_until_the_force_has_followed(
        duration, known, share, side):
    slip_filter = SlipFilter(PARAMS)  # a relaxation length of 0.023 m
    if known:
        slip_filter.set_ground(GroundState(0, Uncertain(50.0, 2.0)))
    R = np.diag([1e-12, 1e-12])
    slip_filter._add_slip_change([0.5, 0.5], R, duration, 0.0)
    before = np.diag(slip_filter.kalman.P).copy()
    speeds = [0.5, 0.5]
    speeds[side] = 0.502
    slip_filter._add_slip_change(speeds, R, duration, 0.0)
    added = np.sqrt(np.diag(slip_filter.kalman.P) - before)[
        [State.SLIP_VEL_L, State.SLIP_VEL_R]].tolist()
    change = 0.002 - 3.0 * math.sqrt(2.0) * 1e-6 / duration  # beyond the noise
    assert [added[side], slip_filter._step] == pytest.approx([share * change] * 2, rel=0.003)
    assert added[1 - side] == 0.0


def test_slip_changes_by_as_much_as_it_is_up_to_the_speed_of_the_wheels():
    slip_filter = SlipFilter(PARAMS)
    slip_filter._sides = [1.0, 0.6]
    x, plain = slip_filter.kalman.x, slip_filter._common_variance
    x[State.SLIP_VEL_L], x[State.SLIP_VEL_R] = 0.5, -0.5  # of a turn, not common
    assert slip_filter._common_variance == pytest.approx(plain)
    x[State.SLIP_VEL_R] = 0.3
    assert slip_filter._common_variance - plain == pytest.approx((0.4 / 0.8) ** 2)
    x[State.SLIP_VEL_L], x[State.SLIP_VEL_R] = -9.0, -7.0
    assert slip_filter._common_variance - plain == pytest.approx(1.0)


def test_forces_by_the_torques_have_the_friction_and_the_scale_that_are_given():
    motor, radius = PARAMS.robot.motor, PARAMS.robot.wheel_radius
    torques, loads = MotorTorques(PARAMS.robot), [20.0] * 4
    args = (0.5, -0.4, 0.6, -0.3), (0.8, -0.8, 0.8, -0.8), loads
    plain = np.array(torques.forces(*args))
    narrow = torques.variance(0, 1.0, 0.0, 1.0, 0.05)
    torques.set_ground(GroundState(0, Uncertain(50.0, 2.0), motor_friction=Uncertain(1.5, 0.3),
                                   torque_scale=Uncertain(1.1, 0.01)))
    friction = friction_torque(np.array(args[1]) / radius, loads, replace(
        motor, viscous_friction=0.0), radius)
    assert np.array(torques.forces(*args)) == pytest.approx(
        plain + (0.1 * np.array(args[0]) - 0.5 * friction) / radius)
    wide = torques.variance(0, 1.0, 0.0, 1.0, 0.05)
    own = (0.3 * motor.coulomb_friction) ** 2 + (0.1 * motor.coulomb_friction) ** 2 * (
        1.5 ** 2 - 1.0)
    assert wide - narrow == pytest.approx(2.0 * MODEL_TIME / 0.05 * 2.0 * own / radius ** 2)
    torques.set_ground(GroundState(0, Uncertain(50.0, 2.0)))  # not observable: as before
    assert torques.variance(0, 1.0, 0.0, 1.0, 0.05) == wide


def ground_states(ground, truth, seed, until):
    """Yield states as the window would estimate them until ``until`` [s] after the first pose."""
    stiffness_error, friction_error, resistance_error = np.random.default_rng(
        seed).standard_normal(3) * (STIFFNESS_SIGMA, FRICTION_SIGMA, RESISTANCE_SIGMA)
    surfaces, begin_ns, next_ns = SurfaceMap(ground), truth[0].stamp_ns, 0
    for pose in truth:
        if pose.stamp_ns < next_ns or (pose.stamp_ns - begin_ns) * 1e-9 >= until:
            continue
        next_ns = (pose.stamp_ns // PERIOD_NS + 1) * PERIOD_NS
        surface = surfaces.at(*pose.position[:2])
        stiffness = surface.stiffness * math.exp(stiffness_error)
        friction = surface.friction * math.exp(friction_error)
        resistance = surface.drag * (1.0 + resistance_error)
        yield GroundState(
            pose.stamp_ns, Uncertain(stiffness, STIFFNESS_SIGMA * stiffness),
            Uncertain(friction, FRICTION_SIGMA * friction),
            Uncertain(resistance, RESISTANCE_SIGMA * resistance), Uncertain(0.5, 0.3),
            Uncertain(1.0, 0.03), Uncertain(0.0, 0.003), Uncertain(0.0, 0.003))


@cache
def errors(name, seed=SEEDS[0], duration=SHORT, begin=0.0, until=math.inf):
    """Return time [s] and errors with sigmas of the left slip and of v_x, and the estimator."""
    scenario = SCENARIOS[name]
    scenario = replace(scenario, duration=min(scenario.duration, duration))
    events = scenario.events(seed)
    poses = [sample for _, topic, sample in events if topic == 'ground_truth/odom']
    slips = {sample.stamp_ns: sample for _, topic, sample in events
             if topic == 'ground_truth/wheel_slip'}
    speeds = {pose.stamp_ns: pose for pose in poses}
    states = list(ground_states(scenario.ground, poses, seed, until))
    estimator = SlipEstimator(SlipEstimatorParams(robot=scenario.robot))
    rows = []
    last = {}
    for _, topic, sample in events:
        if topic.startswith('ground_truth/') or not isinstance(sample, (ImuSample, WheelSample)):
            continue
        if (sample.stamp_ns - poses[0].stamp_ns) * 1e-9 < begin:
            continue
        due = []
        while states and states[0].stamp_ns + DELAY_NS < sample.stamp_ns:
            due.append(states.pop(0))
        for item in (*due, sample):
            for record in estimator.update(item):
                if isinstance(record, Odometry):
                    last[record.stamp_ns] = record
                elif isinstance(record, WheelSlip) and record.stamp_ns in slips:
                    true, speed = slips[record.stamp_ns], speeds[record.stamp_ns]
                    odometry = last[record.stamp_ns]
                    rows.append((
                        (record.stamp_ns - poses[0].stamp_ns) * 1e-9,
                        record.ratio[0] - 0.5 * (true.ratio[0] + true.ratio[2]), record.sigma[0],
                        odometry.linear[0] - speed.linear[0],
                        math.sqrt(odometry.twist_covariance[0])))
    table = np.array(rows)
    return table[np.isfinite(table).all(axis=1)], estimator


@runs(['sand', 'spin_reverse'], 'concrete', 'sweep_60')
def test_slip_and_speed_are_accurate_and_within_two_sigma(name, seeds, duration):
    table = np.concatenate([errors(name, seed, duration)[0] for seed in seeds])
    late = table[table[:, 0] > 5.0]
    assert np.sqrt(np.mean(late[:, 3] ** 2)) < 0.03
    assert np.median(np.abs(late[:, 1])) < 0.015
    assert np.mean(np.abs(late[:, 1]) < 2.0 * late[:, 2]) > 0.88
    assert np.mean(np.abs(late[:, 3]) < 2.0 * late[:, 4]) > 0.88


@runs(['spin_reverse'], 'concrete', 'sand', 'sweep_60')  # of firm and of soft ground
def test_without_a_ground_normalized_errors_are_consistent_with_sigma(name, seeds, duration):
    table = np.concatenate([errors(name, seed, duration, until=0.0)[0] for seed in seeds])
    slip, speed = table[:, 1] / table[:, 2], table[:, 3] / table[:, 4]
    assert len(table) > 200 * len(seeds)
    # neither overconfident nor uninformative
    assert 0.05 < np.mean(slip ** 2) < 2.0
    assert 0.05 < np.mean(speed ** 2) < 2.0
    assert np.mean(np.abs(slip) < 2.0) > 0.9


@runs(['mu_jumps'])
def test_after_a_change_of_ground_slip_and_speed_stay_within_two_sigma(name, seeds, duration):
    table = np.concatenate([errors(name, seed, duration)[0] for seed in seeds])
    late = table[table[:, 0] > 5.0]
    assert np.mean(np.abs(late[:, 1]) < 2.0 * late[:, 2]) > 0.85
    assert np.mean(np.abs(late[:, 3]) < 2.0 * late[:, 4]) > 0.85


def test_the_filter_goes_on_when_ground_state_ends():
    table, estimator = errors('sand', until=12.0)
    with_ground, without = (table[(table[:, 0] > a) & (table[:, 0] < b)]
                            for a, b in ((8.0, 12.0), (19.0, 24.0)))
    assert estimator.status()['ground'] == 'prior'
    assert np.mean(without[:, 2]) > np.mean(with_ground[:, 2])
    assert np.mean(np.abs(without[:, 1]) < 2.0 * without[:, 2]) > 0.85


def test_a_start_in_motion_does_not_ruin_the_heading():
    _, estimator = errors('figure_eight', begin=8.0, until=0.0)
    bias = estimator.gyro_bias
    _, rested = errors('figure_eight', until=0.0)
    assert abs(bias.value - rested.gyro_bias.value) < 3.0 * bias.sigma + 0.002
