# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tests of the window on robots of the simulator, and of its parts."""

from dataclasses import replace
import math

from benchmarks.robots.draws import draw
from benchmarks.robots.plant import Lift as LiftedWheel, plant_with, Traits
import numpy as np
import pytest
from smart_tire.estimation.ground import window
from smart_tire.estimation.ground.body_model import LOAD as LOAD_COLUMN
from smart_tire.estimation.ground.estimator import GroundEstimator, HOP_NS
from smart_tire.estimation.ground.events import EventSearch
from smart_tire.estimation.ground.measurements import (
    FORCE_X, MeasuredCrossing, Measurements, TORQUE, WindowData)
from smart_tire.estimation.ground.unknowns import (
    DERIVATIVE_STEP, DYNAMIC, FREEDOM, GROUND, Hypothesis, initial, LENGTH, Lift, NEVER,
    OLD_GROUND, ONE_GROUND, priors, REWEIGHTINGS, SIZE, Unknown, WindowPrior)
from smart_tire.estimation.ground.window import _gain, _mixed, GroundWindow
from smart_tire.estimation.ground.window_fit import (
    start_of, student, Whitening, WindowFit, WindowNoise)
from smart_tire.messages.joint_state import GROUND_RANGES
from smart_tire.parameters import RobotParams, SimulatorParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.parameters.simulation import PatchParams, SurfaceParams
from smart_tire.samples import ImuSample, NS_PER_S, Odometry, WheelSample
from smart_tire.simulation.offline import simulate

ROBOT = RobotParams(film=TreadFilmParams(wheels=()))
LOAD = np.array([0.25 * ROBOT.mass * 9.80665])  # N
NOTHING = Hypothesis(WindowPrior(np.zeros(SIZE), np.eye(SIZE)), np.zeros(SIZE)).events[np.newaxis]
STIFFNESS, FRICTION, DRAG = 30.0, 0.4, 0.05
LEGS = [(2.0, 90.0, 90.0), (4.0, 120.0, 70.0), (6.0, 70.0, 120.0), (8.0, 120.0, 60.0)]


def ground(**change):
    """Return one surface, with a patch of another one if given."""
    return SurfaceParams(names=('one', 'other'), friction=(FRICTION, 0.2), drag=(DRAG, 0.1),
                         stiffness=(STIFFNESS, 60.0), base='one', **{'patches': (), **change})


def drive(duration=10.0, legs=LEGS, seed=3, surfaces=None):
    """Return the samples of a simulated drive, without films."""
    params = SimulatorParams(seed=seed, ground=surfaces or ground(), robot=ROBOT)
    return [sample for _, _, sample in simulate(params, legs, duration)]


CHANGING = [(1.0, 90.0, 90.0), (3.0, 110.0, 90.0), (4.5, 80.0, 110.0), (6.5, 110.0, 80.0)]


def onto(end):
    """Return the surfaces with another one from x = 2.2 m to ``end`` [m]."""
    return ground(patches=(PatchParams(name='p', surface='other', x=(2.2, end),
                                       y=(-99.0, 99.0)),))


@pytest.fixture(scope='module')
def samples():
    return drive()


@pytest.fixture(scope='module')
def torques(samples):
    """Return the estimator and its solutions with torques, without films."""
    return run(samples)


@pytest.fixture(scope='module')
def films(samples):
    """Return the estimator and its solutions with torques and films."""
    return run(samples, crossings=true_crossings(samples))


@pytest.fixture(scope='module')
def changed():
    """Return the samples of a drive onto another ground, the estimator and its solutions."""
    drive_on = drive(9.0, CHANGING, surfaces=onto(99.0))
    return drive_on, *run(drive_on)


def run(samples, robot=ROBOT, crossings=()):
    """Return the estimator after ``samples``, and its solutions."""
    estimator, found, waiting = GroundEstimator(robot, 0.02), [], sorted(
        crossings, key=lambda one: one[0])
    for sample in samples:
        if not isinstance(sample, (ImuSample, WheelSample)):
            continue
        estimator.add_sample(sample)
        while waiting and waiting[0][0] <= sample.stamp_ns:
            estimator.add_crossing(*waiting.pop(0))
        solution = estimator.advance(sample.stamp_ns)
        if solution is not None:
            found.append(solution)
    return estimator, found


def true_crossings(samples, every=0.6, sigma=(0.003, 0.006), scale=1.0, wheel=1):
    """Return exact film results of a front wheel, from the ground truth."""
    found, due = [], 0.0
    truths = [s for s in samples if type(s).__name__ == 'WheelSlip']
    motion = {s.stamp_ns: s for s in samples if isinstance(s, Odometry)}
    covariance = np.diag(np.square(sigma))
    for truth in truths:
        time = truth.stamp_ns / NS_PER_S
        odometry = motion.get(truth.stamp_ns)
        slip = truth.ratio[wheel]
        if odometry is None or time < due or not math.isfinite(slip) or abs(slip) > 0.9:
            continue
        due = time + every
        lateral = (odometry.linear[1] + 0.13 * odometry.angular[2]) / (
            truth.slip_velocity[wheel] / slip if slip else math.inf)
        load = 10.9 * 9.80665 / 4.0
        ratio = math.hypot(slip, lateral) * STIFFNESS / (3.0 * FRICTION * load)
        found.append((truth.stamp_ns, 'front_right', slip, min(ratio * scale, 1.0), covariance,
                      False))
    return found


def test_the_ground_is_found_from_torques_and_films(films):
    estimator, found = films
    state = estimator.state(found[-1])
    for value, true in ((state.stiffness, STIFFNESS), (state.friction_coefficient, FRICTION),
                        (state.rolling_resistance, DRAG)):
        assert value.value == pytest.approx(true, rel=0.2)
        assert abs(value.value - true) < 3.0 * value.sigma
    assert state.stiffness.sigma < 0.1 * state.stiffness.value
    assert state.center_of_mass_x.sigma <= 0.005
    assert estimator.known and estimator.status['ground_changes'] == 0


def test_without_films_torques_show_stiffness_and_with_more_doubt_friction(torques, films):
    estimator, found = torques
    state = estimator.state(found[-1])
    for value, true in ((state.stiffness, STIFFNESS), (state.friction_coefficient, FRICTION)):
        assert abs(math.log(value.value / true)) < 3.0 * value.sigma / value.value
    assert state.friction_coefficient.sigma > films[0].state(
        films[1][-1]).friction_coefficient.sigma
    first = estimator.state(found[0])  # at rest
    assert math.isnan(first.friction_coefficient.value)
    assert math.isinf(first.friction_coefficient.sigma)


def test_without_films_and_torques_nothing_is_known(samples):
    plain = [replace(s, effort=None) if isinstance(s, WheelSample) else s for s in samples]
    estimator, found = run(plain)
    assert not found and not estimator.known  # no window is solved: it could not be published
    assert 'no films' in estimator.status['ground']


def test_torques_that_come_late_show_as_much_as_without_the_windows_before(samples, torques):
    late = samples[0].stamp_ns + 4 * NS_PER_S
    estimator, found = run([
        replace(s, effort=None) if isinstance(s, WheelSample) and s.stamp_ns < late else s
        for s in samples])
    begin = samples[0].stamp_ns / NS_PER_S
    assert estimator.known and found[0].end + begin < late / NS_PER_S + 0.5 + 1e-6
    for one, other in zip(found[::-1], torques[1][::-1]):
        own, mine = (estimate.fit.covariance[Unknown.STIFFNESS, Unknown.STIFFNESS]
                     for estimate in (other, one))
        assert abs(one.fit.x[Unknown.STIFFNESS] - other.fit.x[Unknown.STIFFNESS]) < math.sqrt(
            own + mine)


def test_windows_end_at_multiples_of_the_hop(samples, torques):
    _, found = torques
    begin = next(s.stamp_ns for s in samples if isinstance(s, (ImuSample, WheelSample)))
    for solution in found:
        assert (begin + round(solution.end * NS_PER_S)) % HOP_NS == 0
    assert 18 <= len(found) <= 19  # the first one after 0.75 s of samples


def test_a_change_of_ground_is_found_and_located(changed):
    samples, estimator, found = changed
    crossed = next(s.stamp_ns for s in samples if isinstance(s, Odometry)
                   and s.position[0] > 2.2) / NS_PER_S
    assert estimator.status['ground_changes'] == 1
    new = next(one.hypothesis.new for one in reversed(found) if one.hypothesis.new != ONE_GROUND)
    begin = min(s.stamp_ns for s in samples) / NS_PER_S
    for change, end in new:
        assert change + begin == pytest.approx(crossed, abs=0.3) and end == math.inf
    assert estimator.state(found[-1]).rolling_resistance.value == pytest.approx(0.1, rel=0.4)


CONCRETE, SAND = (52.7, 0.01), (30.0, 0.11)  # C_x [N], rolling resistance over the load
RIDE = [(1.5, 90.0, 90.0), (4.0, 120.0, 60.0)]  # the left wheels are outside


@pytest.fixture(scope='module')
def ridden():
    """Return when [s] the left wheels ride on another ground, the estimator, its solutions."""
    samples = drive(9.5, RIDE, surfaces=SurfaceParams(
        names=('concrete', 'sand'), friction=(0.47, 0.35), stiffness=(CONCRETE[0], SAND[0]),
        drag=(CONCRETE[1], SAND[1]), base='concrete', patches=(PatchParams(
            name='p', surface='sand', x=(2.7, 99.0), y=(-99.0, 99.0)),)))
    begin = next(s.stamp_ns for s in samples if isinstance(s, (ImuSample, WheelSample)))
    times = []
    for sample in samples:
        if isinstance(sample, Odometry):
            yaw = 2.0 * math.atan2(sample.orientation[2], sample.orientation[3])
            left, right = (sample.position[0] - y * math.sin(yaw) for y in (
                0.5 * ROBOT.track_width, -0.5 * ROBOT.track_width))  # m, of the sides
            assert right < 2.7
            if left > 2.7:
                times.append((sample.stamp_ns - begin) / NS_PER_S)
    return (times[0], times[-1]), *run(samples)


def test_a_side_that_rides_on_another_ground_is_found_with_its_begin_and_end(ridden):
    (begin, end), estimator, found = ridden
    assert estimator.status['ground_changes'] == 2 and end - begin > 1.5
    left, right = next(one.hypothesis.new for one in reversed(found)
                       if one.hypothesis.new != ONE_GROUND)
    assert left == pytest.approx((begin, end), abs=0.3)
    assert right == NEVER
    during = [one for one in found if begin + 1.3 < one.end < end]
    assert during
    for one in during:  # that of each side by itself
        fit = one.fit
        for side, (stiffness, drag) in enumerate((SAND, CONCRETE)):
            rows = one.hypothesis.ground(side, one.end)
            for row, true in ((rows.start, stiffness), (rows.start + 2, drag)):
                value, sigma = math.exp(fit.x[row]), math.sqrt(fit.covariance[row, row])
                assert abs(value - true) < 3.0 * sigma * value
    value = estimator.state(found[-1]).stiffness
    assert abs(math.log(value.value / CONCRETE[0])) < 3.0 * value.sigma / value.value


def test_one_ground_for_sides_on_two_has_their_difference_as_its_error(ridden):
    (begin, end), estimator, found = ridden
    one = next(one for one in found if begin + 1.3 < one.end < end)
    state, x = estimator.state(one), one.fit.x
    for value, row in ((state.stiffness, Unknown.STIFFNESS),
                       (state.rolling_resistance, Unknown.RESISTANCE)):
        sides = x[row], x[OLD_GROUND][row]
        to_one = one.hypothesis.one_ground(one.end)[row]
        own = one.hypothesis.one_ground(one.end)[row + Unknown.SIDE_STIFFNESS] @ x
        variance = to_one @ one.fit.covariance @ to_one + own ** 2
        median = row == Unknown.STIFFNESS  # the resistance is a mean
        assert math.log(value.value) == pytest.approx(
            np.mean(sides) + (0.0 if median else 0.5 * variance))
        assert value.sigma / value.value > abs(np.subtract(*sides)) / 2.0


@pytest.mark.parametrize('difference, known', [(0.3, True), (2.4, False)])
def test_a_resistance_less_certain_than_its_prior_is_unknown(ridden, difference, known):
    _, estimator, found = ridden
    one = found[-1]
    x = one.fit.x.copy()
    x[Unknown.SIDE_RESISTANCE] = difference
    resistance = estimator.state(one._replace(fit=one.fit._replace(x=x))).rolling_resistance
    assert math.isfinite(resistance.value) == known
    _, most = GROUND_RANGES['rolling_resistance']  # that receivers accept
    assert not (resistance.value > most or most < resistance.sigma < math.inf)


@pytest.mark.parametrize('new', [((1.0, math.inf), NEVER), (NEVER, (1.0, math.inf)),
                                 ((1.0, 2.0), NEVER), ((1.0, math.inf), (1.5, math.inf)),
                                 ((1.0, 2.0), (1.5, math.inf))])
def test_sides_on_two_grounds_are_one_with_a_difference_once_they_are_the_past(new):
    rows, random = priors(ROBOT), np.random.default_rng(2)
    root = random.standard_normal((SIZE, SIZE))
    given = Hypothesis(WindowPrior(random.standard_normal(SIZE), root @ root.T), root[0], new)
    assert given.settled(0.5, rows) is given and given.settled(1.0, rows) is given
    found = given.settled(3.0, rows)
    assert found.new == ONE_GROUND and found.settled(3.0, rows) is found
    logs = []
    for one in given, found:  # of the left and the right side
        matrix = np.zeros((6, SIZE))
        for side, sign in enumerate((1.0, -1.0)):
            own = slice(3 * side, 3 * side + 3)
            matrix[own, one.ground(side, 3.0)] = np.eye(3)
            matrix[own, Unknown.SIDE_STIFFNESS:Unknown.DELAY] = sign * np.eye(3)
        logs.append((matrix @ one.prior.mean, matrix @ one.x,
                     matrix @ one.prior.covariance @ matrix.T))
    for before, after in zip(*logs):
        np.testing.assert_allclose(after, before)
    assert np.linalg.eigvalsh(found.prior.covariance).min() > 0.0


def test_a_gap_of_the_imu_restarts_the_window_and_keeps_what_was_learned(samples):
    begin = samples[0].stamp_ns
    kept = [s for s in samples if not (
        isinstance(s, ImuSample) and 5.0 < (s.stamp_ns - begin) / NS_PER_S < 6.5)]
    estimator, found = run(kept, crossings=true_crossings(samples))
    state = estimator.state(found[-1])
    assert abs(math.log(state.stiffness.value / STIFFNESS)) < 0.25
    assert all(np.isfinite(one.fit.x).all() for one in found)


def test_velocities_serve_where_there_are_no_positions(samples):
    plain = [replace(s, position=None) if isinstance(s, WheelSample) else s for s in samples]
    estimator, found = run(plain, crossings=true_crossings(samples))
    assert estimator.state(found[-1]).stiffness.value == pytest.approx(STIFFNESS, rel=0.3)


def test_one_encoder_per_side_is_enough(samples):
    def front(values):
        return (*values[:2], math.nan, math.nan)
    plain = [replace(s, position=front(s.position), velocity=front(s.velocity), effort=None)
             if isinstance(s, WheelSample) else s for s in samples]
    _, found = run(plain, crossings=true_crossings(samples))
    assert np.isfinite(found[-1].fit.x).all()
    assert math.exp(found[-1].fit.x[Unknown.STIFFNESS]) == pytest.approx(STIFFNESS, rel=0.4)


def test_odometry_serves_in_place_of_the_imu_until_there_is_one(samples):
    estimator, found = GroundEstimator(ROBOT, 0.02), []
    crossings = true_crossings(samples)
    for sample in samples:
        if isinstance(sample, (Odometry, WheelSample)):
            estimator.add_sample(sample)
            while crossings and crossings[0][0] <= sample.stamp_ns:
                estimator.add_crossing(*crossings.pop(0))
            solution = estimator.advance(sample.stamp_ns)
            found += [] if solution is None else [solution]
    assert estimator.state(found[-1]).stiffness.value == pytest.approx(STIFFNESS, rel=0.3)
    before = len(estimator._imu)
    estimator.add_sample(next(s for s in samples if isinstance(s, ImuSample)))
    estimator.add_sample(replace(next(s for s in samples if isinstance(s, Odometry)),
                                 stamp_ns=samples[-1].stamp_ns + 10_000_000))
    assert len(estimator._imu) == before


def test_an_outlying_crossing_hardly_matters(samples, films):
    wild = true_crossings(samples)
    wild[5] = (*wild[5][:2], -0.6, 0.95, *wild[5][4:])
    expected, other = (estimator.state(found[-1]).friction_coefficient
                       for estimator, found in (films, run(samples, crossings=wild)))
    assert abs(expected.value - other.value) < expected.sigma


def test_the_sides_may_differ(samples):
    slippery = [(stamp, 'front_left', *rest) for stamp, _, *rest in true_crossings(
        samples, wheel=0, scale=1.8)]
    _, found = run(samples, crossings=[*true_crossings(samples), *slippery])
    x = found[-1].fit.x
    # of the left side over the mean: half of ln (1 / 1.8), ten sigma of the prior of equal sides
    difference = x[Unknown.SIDE_FRICTION] - x[Unknown.SIDE_STIFFNESS]
    assert difference == pytest.approx(-0.5 * math.log(1.8), abs=0.15)


def test_the_wheel_state_is_that_of_the_motion(samples, films):
    estimator, found = films
    end = estimator.end_ns - 700_000_000
    state = estimator.wheel_state(found[-1], end, 'front_right')
    near = min((s for s in samples if type(s).__name__ == 'WheelSlip'),
               key=lambda s: abs(s.stamp_ns - end))
    assert state.slip.value == pytest.approx(near.ratio[1], abs=0.02)
    assert state.load.value == pytest.approx(26.7, rel=0.15)
    assert state.load.sigma >= 0.02 * state.load.value
    assert state.critical_slip.value == pytest.approx(
        3.0 * state.friction.value * state.load.value / state.stiffness.value, rel=0.02)
    assert state.friction.sigma > 0.03 * state.friction.value


# parts


@pytest.fixture(scope='module')
def measurements(samples):
    estimator = GroundEstimator(ROBOT, 0.02)
    for sample in samples:
        if isinstance(sample, (ImuSample, WheelSample)):
            estimator.add_sample(sample)
    crossing = MeasuredCrossing(8.0, 1, 0.1, 0.2, 1e-4 * np.eye(2), False)
    data = WindowData(np.array(estimator._imu).reshape(-1, 4),
                      np.array(estimator._wheels).reshape(-1, 9), [crossing])
    return Measurements(ROBOT, data, 5.5, 6.0, 9.0)


def test_derivatives_by_the_linear_unknowns_are_those_of_the_prediction(measurements):
    x = initial(priors(ROBOT)).mean
    heading = measurements.heading(0.0, (6.0, 0.0))
    start = np.array([0.7, 0.0, 0.3])

    def motion(x):
        return measurements.simulate(x[np.newaxis], start, heading, NOTHING)

    def predicted(x):
        return measurements.predict(x[np.newaxis], motion(x))[0]

    linear, base = measurements.linear(x, predicted(x), motion(x)), predicted(x)
    for row in range(DYNAMIC, Unknown.FILM_GAIN):
        changed = x.copy()
        changed[row] += 1e-5
        assert linear[:, :, row - DYNAMIC] == pytest.approx(
            (predicted(changed) - base) / 1e-5, abs=1e-3), Unknown


def test_covariances_are_positive_definite_and_blocks_without_samples_have_no_weight(measurements):
    predicted = measurements.values
    noise = measurements.noise(predicted, np.zeros_like(predicted), np.zeros(3), 0.0)
    assert np.linalg.eigvalsh(noise).min() > 0.0
    assert (np.sqrt(np.diagonal(noise, axis1=1, axis2=2))[:, ~measurements.used] > 1e5).all()
    used = np.sqrt(np.diagonal(noise, axis1=1, axis2=2))[:, measurements.used]
    assert used[FORCE_X].max() < 1.0 and used[TORQUE:].max() < 1.0


def test_a_crossing_in_full_sliding_determines_the_ratio_of_slips_only(measurements):
    sliding = measurements.crossings[0]._replace(slip=0.1, normalized_slip=0.9, sliding=True)
    measurements.set_crossings([sliding])
    noise = measurements.crossing_noise(np.array([0.5, 1.5]), np.zeros(2), LOAD)
    along, across = np.array([0.1, 0.9]), np.array([0.9, -0.1])
    assert along @ noise @ along > 50.0 * (across @ noise @ across)
    measurements.set_crossings([sliding._replace(sliding=False)])


def test_films_show_the_product_of_both_slips_with_the_same_error_at_any_slip(measurements):
    noise, measured = [], []
    for slip, ratio in ((0.004, 0.4), (0.004, -0.3)):  # hardly any stretch
        covariance = np.diag([1e-6, (4e-4 / slip) ** 2])
        measurements.set_crossings([
            MeasuredCrossing(8.0, 1, slip, ratio, covariance, False)])
        measured.append(measurements.crossings[0].measured)
        noise.append(measurements.crossing_noise(
            np.array([0.01, 0.01 * 0.02]), np.zeros(2), LOAD))
    measurements.set_crossings([MeasuredCrossing(8.0, 1, 0.1, 0.2, 1e-4 * np.eye(2), False)])
    assert measured == [(0.004, pytest.approx(0.0016)), (0.004, pytest.approx(-0.0012))]
    for one, ratio in zip(noise, (0.4, -0.3)):  # 4e-4 / 0.01 of a ratio at the predicted slip
        assert math.sqrt(one[1, 1]) == pytest.approx(math.hypot(4e-4, 1e-3 * ratio), rel=0.15)


def test_films_weigh_little_in_a_start_but_show_the_ground_in_full_sliding(measurements):
    transient = np.array([0.01, 0.004])
    plain = measurements.crossing_noise(np.array([0.1, 0.02]), np.zeros(2), LOAD)
    more = measurements.crossing_noise(np.array([0.1, 0.02]), transient, LOAD) - plain
    assert more == pytest.approx(np.diag(transient ** 2))
    measurements.set_crossings([measurements.crossings[0]._replace(
        slip=0.5, normalized_slip=1.5, sliding=True)])
    plain = measurements.crossing_noise(np.array([0.5, 1.5]), np.zeros(2), LOAD)
    noise = measurements.crossing_noise(np.array([0.5, 1.5]), np.array([0.1, 0.3]), LOAD)
    measurements.set_crossings([MeasuredCrossing(8.0, 1, 0.1, 0.2, 1e-4 * np.eye(2), False)])
    across = np.array([1.5, -0.5])  # an error of slip / t
    assert across @ noise @ across == pytest.approx(across @ plain @ across)
    assert noise[0, 0] - plain[0, 0] == pytest.approx(0.1 ** 2)


def test_the_lasting_error_of_the_films_bounds_what_many_crossings_show(samples):
    weak = [(stamp, wheel, slip, ratio, np.diag([1e-6, (1e-4 / abs(slip)) ** 2]), sliding)
            for stamp, wheel, slip, ratio, _, sliding in true_crossings(samples, every=0.1)]
    _, few = run(samples, crossings=[*weak[::4]])
    _, many = run(samples, crossings=weak)
    row = Unknown.FILM_ERROR + 1
    sigma = [math.sqrt(found[-1].fit.covariance[row, row]) for found in (few, many)]
    prior = priors(ROBOT)[row].sigma
    assert min(sigma) > 1e-5 and max(sigma) < prior


def test_a_start_from_standstill_weighs_little_and_a_steady_turn_fully(measurements):
    predicted = measurements.values
    transient = np.zeros_like(predicted)
    transient[FORCE_X, -4] = 1.5
    plain, lagging = (np.diagonal(measurements.noise(predicted, one, np.zeros(3), 0.0), 0, 1, 2)
                      for one in (np.zeros_like(predicted), transient))
    assert math.sqrt(lagging[FORCE_X, -4]) == pytest.approx(3.0, rel=0.05)
    lagging = lagging.copy()
    lagging[FORCE_X, -4] = plain[FORCE_X, -4]
    np.testing.assert_array_equal(lagging, plain)


def test_errors_of_wheel_speeds_are_errors_of_torques_where_tires_adhere(measurements):
    x = initial(priors(ROBOT)).mean.copy()
    predicted = np.zeros_like(measurements.values)
    adhering = measurements.slip_noise(x, predicted)
    x[Unknown.STIFFNESS] += math.log(2.0)
    assert measurements.slip_noise(x, predicted) == pytest.approx(4.0 * adhering)
    limit = math.exp(x[Unknown.FRICTION]) * float(LOAD[0]) * ROBOT.wheel_radius
    predicted[TORQUE:] = -limit * (1.0 - 0.5 ** 3)  # half of the patch slides
    assert measurements.slip_noise(x, predicted) == pytest.approx(adhering / 4.0)
    predicted[TORQUE:] = 1.1 * limit
    assert not measurements.slip_noise(x, predicted).any()
    noise = measurements.noise(predicted, 0.0 * predicted, np.zeros(3), adhering)
    without = measurements.noise(predicted, 0.0 * predicted, np.zeros(3), 0.0 * adhering)
    more = np.diagonal(noise - without, axis1=1, axis2=2)
    used = measurements.used  # the others are not measured
    assert more[TORQUE:, used] == pytest.approx(adhering[:, used], rel=1e-6)
    assert not more[:TORQUE].any()


def test_derivatives_count_as_far_as_they_exceed_what_errors_of_wheel_speeds_make(measurements):
    fit, x = WindowFit(ROBOT, priors(ROBOT)), initial(priors(ROBOT)).mean
    steps = np.append(fit.steps, 0.1)
    predicted = np.zeros((DYNAMIC + 2, *measurements.values.shape))
    predicted[1:] = 0.3 * steps[:, np.newaxis, np.newaxis]
    heading = measurements.heading(0.0, (6.0, 0.0))
    motion = measurements.simulate(x[np.newaxis], np.zeros(3), heading, NOTHING)

    def columns(sigma):
        noise = np.full((4, len(measurements.centers)), sigma ** 2)
        return fit._columns(x, predicted, 0.0 * predicted[0], measurements, motion, steps, noise)
    exact, noisy, lost = columns(0.0), columns(0.05), columns(0.11)
    curve = [Unknown.STIFFNESS, Unknown.OLD_FRICTION, Unknown.SIDE_STIFFNESS, SIZE]
    others = [Unknown.RESISTANCE, Unknown.RADIUS, Unknown.SLOPE_X]
    assert exact[:, :, curve] == pytest.approx(0.3)
    assert noisy[TORQUE:, :, curve] == pytest.approx(0.3 * (1.0 - 9.0 * 0.05 ** 2 / 0.3 ** 2))
    assert not lost[TORQUE:, :, curve].any()
    for found in (noisy, lost):
        np.testing.assert_array_equal(found[:TORQUE], exact[:TORQUE])
        np.testing.assert_array_equal(found[:, :, others], exact[:, :, others])


@pytest.mark.parametrize('seed', [8507, *(pytest.param(seed, marks=pytest.mark.long)
                                          for seed in range(8821, 8829))])
def test_slow_straight_driving_does_not_show_a_stiffness_that_is_too_low(seed):
    one = draw('straight', seed)
    estimator, solution = GroundEstimator(one.robot, 0.02), None
    for sample in one.inputs():
        if isinstance(sample, (ImuSample, WheelSample)):
            estimator.add_sample(sample)
            solution = estimator.advance(sample.stamp_ns) or solution
    surfaces = one.simulator.ground
    true = math.log(surfaces.stiffness[surfaces.names.index(surfaces.base)])
    sigma = math.sqrt(solution.fit.covariance[Unknown.STIFFNESS, Unknown.STIFFNESS])
    # errors of the wheel speeds, in the derivative as in the residual, made it -2.5 to -7 sigmas
    assert solution.fit.x[Unknown.STIFFNESS] == pytest.approx(true, abs=3.0 * sigma)


def test_a_friction_that_seems_low_does_not_exclude_the_likely_one_by_its_local_slope():
    fit = WindowFit(ROBOT, priors(ROBOT))
    x = initial(priors(ROBOT)).mean.copy()
    likely = x[Unknown.FRICTION]
    covariance = np.eye(SIZE)

    def step(below, sigma):
        x[Unknown.FRICTION] = likely - below
        covariance[Unknown.FRICTION, Unknown.FRICTION] = sigma ** 2
        return fit._friction_step(x, covariance)

    assert step(0.7, 0.4) == pytest.approx(0.7)    # that of the prior, within two sigmas
    assert step(0.7, 0.1) == pytest.approx(0.2)    # excluded: two sigmas
    assert step(-0.5, 0.3) == step(0.0, 0.3) == pytest.approx(0.3)


@pytest.mark.parametrize('legs', [
    [(1.0, 60.0, 60.0), (2.0, 110.0, 60.0)], [(1.0, 40.0, 40.0), (2.0, 90.0, 90.0)],
    [(1.0, 120.0, 120.0), (3.0, 40.0, 90.0)]])
def test_on_ice_all_starts_of_a_fit_end_at_one_friction_within_its_sigma(legs):
    """From the first slide on: rolling resistance and friction are hard to distinguish then."""
    icy = SurfaceParams(names=('ice',), friction=(0.09,), stiffness=(40.0,), drag=(0.01,),
                        base='ice', patches=())
    estimator, found = run(drive(5.0, legs, surfaces=icy))
    row = Unknown.FRICTION
    for solution in found:
        ends, costs = [], []
        for friction in (0.15, 0.4, 0.8):
            x = solution.hypothesis.x.copy()
            x[row] = math.log(friction)
            fit = estimator._window._fit.fit(
                replace(solution.hypothesis, x=x), solution.measurements, -math.inf, False)
            ends.append(fit.x[row])
            costs.append(fit.cost)
        sigma = math.sqrt(solution.fit.covariance[row, row])
        assert np.ptp(ends) < 0.5 * sigma and np.ptp(costs) < 6.0
        assert abs(solution.fit.x[row] - math.log(0.09)) < 2.5 * sigma
    assert sigma < 0.2


def test_friction_is_as_uncertain_as_the_wider_of_its_derivative_and_its_secant(monkeypatch):
    concrete = SurfaceParams(names=('concrete',), friction=(0.47,), stiffness=(52.7,),
                             drag=(0.01,), base='concrete', patches=())
    estimator, found = run(drive(5.0, [(1.0, 60.0, 60.0), (2.5, 0.0, 0.0)], surfaces=concrete))

    def sigmas():
        fits = [estimator._window._fit.fit(one.hypothesis, one.measurements, math.inf, False)
                for one in found]
        for fit, one in zip(fits, found):  # what is handed on to the next window is the same
            if one.measurements.used.all():
                np.testing.assert_allclose(
                    fit.leaving[0], fit.rows.jacobian.T @ fit.rows.jacobian, rtol=1e-6, atol=1e-3)
        return np.array([fit.covariance[Unknown.FRICTION, Unknown.FRICTION] for fit in fits])
    wider = sigmas()
    monkeypatch.setattr(estimator._window._fit, '_friction_step', lambda x, covariance: 1e-3)
    ratio = wider / sigmas()
    assert ratio.min() > 0.999 and ratio.max() > 1.05


def test_the_friction_of_gears_is_found_that_the_data_sheet_has_twice_too_small(samples, torques):
    motor = replace(ROBOT.motor, coulomb_friction=0.5 * ROBOT.motor.coulomb_friction,
                    axle_friction=0.5 * ROBOT.motor.axle_friction)
    estimator, found = run(samples, replace(ROBOT, motor=motor))
    fit, row, (_, given) = found[-1].fit, Unknown.MOTOR_FRICTION, torques
    sigma = math.sqrt(fit.covariance[row, row])
    assert fit.x[row] > given[-1].fit.x[row] + 0.1  # not only the offsets take it
    assert abs(fit.x[row] - math.log(2.0)) < 3.0 * sigma < 1.0
    stiffness = estimator.state(found[-1]).stiffness
    assert abs(stiffness.value - STIFFNESS) < 3.0 * stiffness.sigma < 0.5 * STIFFNESS


def test_the_position_of_the_imu_is_found_where_it_was_not_measured(samples):
    true_x, true_y, height = ROBOT.imu.position
    imu = replace(ROBOT.imu, position=(true_x - 0.12, true_y + 0.08, height), position_sigma=0.1)
    estimator, found = run(samples, replace(ROBOT, imu=imu))
    state = estimator.state(found[-1])
    for one, true in ((state.imu_x, true_x), (state.imu_y, true_y)):
        assert abs(one.value - true) < 3.0 * one.sigma < 0.09
    estimator, found = run(samples)
    measured = estimator.state(found[-1])
    assert measured.imu_x == (pytest.approx(true_x, abs=1e-6), pytest.approx(1e-6, rel=0.1))


def test_the_friction_of_a_crossing_is_unknown_while_the_ground_may_change(ridden):
    _, estimator, found = ridden
    solution = min((one for one in found if one.hypothesis.disturbances
                    and one.hypothesis.disturbances[-1][1] < one.end - 0.1),
                   key=lambda one: one.fit.covariance[Unknown.FRICTION, Unknown.FRICTION])
    begin, end = solution.hypothesis.disturbances[-1]

    def friction(time):
        stamp = estimator.end_ns + round((time - found[-1].end) * NS_PER_S)
        return estimator.wheel_state(solution, stamp, 'front_left').friction
    for time in (begin - 0.01, end + 0.01):
        assert friction(time).value > 0.0
    for time in (begin + 0.01, end - 0.01):
        assert math.isnan(friction(time).value) and math.isinf(friction(time).sigma)


def test_friction_is_less_certain_to_larger_values_and_unknown_sooner(films):
    estimator, found = films
    solution, row = found[-1], Unknown.FRICTION

    def sigma(log_sigma):
        covariance = 1e-12 * np.eye(SIZE)
        covariance[row, row] = log_sigma ** 2
        changed = solution._replace(fit=solution.fit._replace(covariance=covariance))
        stamp = round(estimator.end_ns - 0.5 * NS_PER_S)
        both = (estimator.wheel_state(changed, stamp, 'front_left').friction,
                estimator.state(changed).friction_coefficient)
        return [one.sigma / one.value for one in both]

    assert sigma(0.2) == pytest.approx([0.25, 0.25], rel=0.1)  # 1 / 0.8 - 1, and of the curve
    assert not np.isfinite(sigma(0.27)).any() and not np.isfinite(sigma(1.2)).any()


def test_derivatives_for_the_output_are_those_by_the_steps_of_the_fit(films):
    _, found = films
    solution = found[-1]
    values, slopes = solution.values_at(solution.end - 0.5, [0])
    runs = np.vstack([solution.fit.x, solution.fit.varied_x])
    moved = runs[1 + 1 + Unknown.FRICTION] - runs[1]
    assert np.count_nonzero(moved) == 1 and moved[Unknown.FRICTION] > 1e-3
    assert abs(slopes[0, 1, Unknown.FRICTION] / values[0, 1] + 1.0) < 0.1  # t ~ 1 / mu


def test_the_prior_of_a_changed_ground_keeps_the_old_one_aside():
    rows = priors(ROBOT)
    prior = initial(rows)
    prior.mean[GROUND] = 1.0, -2.0, -3.0
    prior.covariance[GROUND, GROUND] = np.diag([0.01, 0.02, 0.03])
    changed = prior.with_change(rows)
    assert changed.mean[OLD_GROUND].tolist() == [1.0, -2.0, -3.0]
    assert np.diag(changed.covariance)[OLD_GROUND] == pytest.approx([0.01, 0.02, 0.03])
    assert np.diag(changed.covariance)[GROUND] == pytest.approx(
        [row.sigma ** 2 for row in rows[:3]])
    assert np.linalg.eigvalsh(changed.covariance).min() > 0.0


def test_the_prior_of_the_stiffness_has_the_error_of_the_tire_and_the_spread_of_grounds():
    tire = replace(ROBOT.tire, longitudinal_stiffness_sigma=0.3)
    assert priors(replace(ROBOT, tire=tire))[Unknown.STIFFNESS].sigma == pytest.approx(0.5)


def test_priors_walk_with_time_and_travel():
    rows = priors(ROBOT)
    prior = initial(rows)
    later = prior.after(2.0, 3.0, rows)
    added = np.diag(later.covariance - prior.covariance)
    assert added[Unknown.STIFFNESS] == pytest.approx(3.0 * rows[Unknown.STIFFNESS].ground ** 2)
    assert added[Unknown.TORQUE_SCALE] == pytest.approx(
        2.0 * rows[Unknown.TORQUE_SCALE].walk ** 2)


def test_estimates_do_not_depend_on_the_clock(samples, torques):
    """Windows end at other instants relative to the drive: the estimates agree within noise."""
    shift = 7 * NS_PER_S + HOP_NS // 2
    _, first = torques
    _, later = run([replace(s, stamp_ns=s.stamp_ns + shift - HOP_NS // 2) for s in samples])
    assert later[-1].fit.x == pytest.approx(first[-1].fit.x, abs=1e-6)
    _, between = run([replace(s, stamp_ns=s.stamp_ns + shift) for s in samples])
    sigma = np.sqrt(np.diag(first[-1].fit.covariance))
    assert (np.abs(between[-1].fit.x - first[-1].fit.x)[:4] < 2.0 * sigma[:4]).all()


@pytest.mark.parametrize('every', [2, 8, 40])  # of the samples of 16 Hz
def test_slow_wheel_readings_give_an_estimate_or_none(samples, every):
    wheels = [s for s in samples if isinstance(s, WheelSample)][::every]
    kept = sorted([*wheels, *(s for s in samples if isinstance(s, ImuSample))],
                  key=lambda s: s.stamp_ns)
    _, found = run(kept)
    assert bool(found) == (every < 40)
    assert all(np.isfinite(one.fit.x).all() for one in found)


def test_readings_before_a_counter_reset_are_not_used(samples):
    begin = samples[0].stamp_ns
    reset = [replace(s, position=tuple(p - 500.0 for p in s.position))
             if isinstance(s, WheelSample) and s.stamp_ns - begin > 6 * NS_PER_S else s
             for s in samples]
    estimator, found = run(reset)
    gap = [one.end + begin / NS_PER_S for one in found]
    assert max(np.diff(gap)) == pytest.approx(1.0, abs=0.01)  # 0.75 s of samples again
    state = estimator.state(found[-1])
    assert abs(math.log(state.stiffness.value / STIFFNESS)) < 3.0 * (
        state.stiffness.sigma / state.stiffness.value)


def test_a_window_without_solution_is_counted_and_the_next_starts_again(samples, monkeypatch):
    update, calls = GroundWindow.solve, []

    def failing(window, *arguments):
        calls.append(window)
        if len(calls) == 5:
            raise np.linalg.LinAlgError('not positive definite')
        return update(window, *arguments)
    monkeypatch.setattr(GroundWindow, 'solve', failing)
    estimator, found = run(samples)
    assert estimator.failures == estimator.status['ground_failures'] == 1
    assert len(found) == len(calls) - 1 and calls[5] is not calls[4]
    assert np.isfinite(found[-1].fit.x).all()


def test_a_strip_that_is_crossed_in_a_second_is_a_disturbance_and_no_change():
    samples = drive(9.6, CHANGING, surfaces=onto(2.9))
    estimator, found = run(samples)
    assert any(one.hypothesis.disturbances for one in found)
    assert estimator.status['ground_changes'] == 0
    state = estimator.state(found[-1])
    for value, true in ((state.stiffness, STIFFNESS), (state.rolling_resistance, DRAG)):
        assert abs(math.log(value.value / true)) < 2.5 * value.sigma / value.value
    assert not found[-1].hypothesis.disturbances  # forgotten, as they have left the window


def test_while_a_change_is_undecided_the_covariance_covers_both_grounds(changed, monkeypatch):
    monkeypatch.setattr(window, 'EVENT_EVIDENCE', 1e6)  # never decided
    estimator, found = run(changed[0])
    assert estimator.status['ground_changes'] == 0
    first = next(i for i, one in enumerate(found) if one.hypothesis.disturbances)
    assert abs(found[first].end - changed[-1][first].end) < 1e-9
    for one in found[first:first + 2]:  # later the old ground is excluded
        sigma = math.sqrt(one.fit.covariance[Unknown.RESISTANCE, Unknown.RESISTANCE])
        for drag in (DRAG, 0.1):
            assert abs(one.fit.x[Unknown.RESISTANCE] - math.log(drag)) < 2.5 * sigma


def test_an_error_of_a_sensor_beyond_its_prior_is_named_and_widens_sigma(samples, torques):
    _, given = torques
    biased = [replace(one, acceleration=(one.acceleration[0], one.acceleration[1] + 0.8,
                                         one.acceleration[2]))
              if isinstance(one, ImuSample) else one for one in samples]
    estimator, found = run(biased)
    tension = found[-1].tension
    assert tension.name == 'accel_bias_y' and tension.size > 3.0 > 2.0 > given[-1].tension.size
    assert estimator.status['ground_tension'] == f'{tension.size:.1f} sigma: accel_bias_y'
    row = Unknown.STIFFNESS
    ratio = found[-1].fit.covariance[row, row] / given[-1].fit.covariance[row, row]
    assert ratio == pytest.approx((tension.size / 2.0) ** 2, rel=0.4)


def test_the_covariance_of_a_mixture_is_positive_definite(films):
    _, found = films
    fit = found[-1].fit
    random = np.random.default_rng(1).standard_normal((SIZE, SIZE))
    vague = fit._replace(covariance=random @ random.T + 0.1 * np.eye(SIZE))
    sure = fit._replace(covariance=1e-6 * np.eye(SIZE), x=fit.x + 1e-3)
    for one, other in ((vague, sure), (sure, vague)):
        mixed = _mixed(one, other).covariance
        assert np.linalg.eigvalsh(mixed).min() > 0.0
        np.testing.assert_allclose(
            mixed[OLD_GROUND, OLD_GROUND], one.covariance[OLD_GROUND, OLD_GROUND])
        assert mixed[0, 0] == pytest.approx(
            0.5 * (one.covariance[0, 0] + other.covariance[0, 0] + 1e-6))


def test_events_tried_together_have_each_its_evidence(films):
    solution = films[1][-1]
    main, fit, measurements = solution.hypothesis, solution.fit, solution.measurements
    search = EventSearch(WindowFit(ROBOT, priors(ROBOT)))
    first, second = measurements.begin + 1.0, measurements.begin + 2.0
    lift = replace(main, lifts=(Lift(1, first),))
    events = [*search._changes(main, fit.x, [(first, first), (first, second), (None, second)]),
              *search._lifts(main, fit.x, [second]), *search._lifts(lift, fit.x, [second])]
    assert {event.unknown.stop - event.unknown.start for event in events} == {0, 1, 3}
    events = [event._replace(hypothesis=replace(
        event.hypothesis, x=event.hypothesis.x + 0.002 * i)) for i, event in enumerate(events)]
    residual, found = search._evidence(main, fit, measurements, events)
    steps, rows = DERIVATIVE_STEP * np.array([row.sigma for row in priors(ROBOT)]), priors(ROBOT)
    for event, expected in zip(events, found):
        # by its definition
        own = [*range(SIZE)[event.unknown]]
        x = event.hypothesis.x + np.vstack([np.zeros(SIZE), np.diag(steps)[own]])
        motion = measurements.simulate(
            x, start_of(main, measurements)[0], fit.heading,
            np.tile(event.hypothesis.events, (len(x), 1)))
        blocks = measurements.values - measurements.predict(x, motion)
        white = np.concatenate([np.linalg.solve(np.linalg.cholesky(noise), own) for noise, own in (
            *zip(fit.noise.blocks, blocks.transpose(1, 2, 0)),
            (fit.noise.films, (measurements.crossing_measured
                               - measurements.crossing_values(
                                   x, measurements.at_crossings(motion))).T))])
        slopes = (white[:, :1] - white[:, 1:]) / steps[own]
        spread = np.diag([rows[row].sigma ** -2 for row in own])
        off = np.array([rows[row].mean for row in own]) - event.hypothesis.x[own]
        left = white[:, 0]
        inside = [measurements.within(one) for one in event.transitions]
        used = ~np.any(inside, axis=0)
        for _ in range(REWEIGHTINGS):
            weighted = slopes.T * (used / np.maximum((FREEDOM + left ** 2) / (FREEDOM + 1.0), 1.0))
            matrix = weighted @ slopes + spread
            value = np.linalg.inv(matrix) @ (weighted @ white[:, 0] + spread @ off)
            left = white[:, 0] - slopes @ value
        np.testing.assert_allclose(expected[1], value, atol=1e-8)
        cost = student(left[used] ** 2).sum() + (value - off) @ spread @ (value - off)
        cost += np.linalg.slogdet(matrix)[1] - np.linalg.slogdet(spread)[1]
        blocks = measurements.values.size
        for one in inside:
            for part in [*np.split(np.where(one, left, np.nan)[:blocks], len(measurements.values)),
                         np.where(one, left, np.nan)[blocks:]]:
                square = part[np.isfinite(part)] ** 2
                if square.size:
                    growth = max(square.mean(), 1.0)
                    cost += square.sum() / growth + square.size * math.log(growth)
        assert expected[0] == pytest.approx(student(residual ** 2).sum() - cost, abs=1e-7)


def test_a_disturbance_has_errors_of_the_size_that_is_seen(measurements):
    shape, interval = measurements.values.shape, (7.0, 8.0)
    inside = measurements.within(interval)
    centers = (measurements.centers >= 7.0) & (measurements.centers <= 8.0)
    assert inside[:measurements.values.size].reshape(shape)[:, centers].all()
    assert inside.sum() == shape[0] * centers.sum() + 2  # and the crossing at 8 s
    blocks, residual = np.tile(np.eye(shape[1]), (shape[0], 1, 1)), np.full(shape, 0.5)
    residual[TORQUE, centers] = 10.0
    plain, aware = (Whitening(WindowNoise(blocks, np.eye(2)), residual, np.zeros(2), False, rows)
                    for rows in ([], [inside]))
    own = aware(residual[:, :, np.newaxis], np.zeros((2, 1)))[:, 0]
    squares = own[:residual.size].reshape(shape)
    assert abs(squares[:, centers]).max() < 1e-4  # a push is no noise: it is not used
    assert squares[TORQUE, ~centers] == pytest.approx(0.5)
    assert squares[FORCE_X, ~centers] == pytest.approx(0.5)
    assert plain.penalty.sum() == 0.0
    seen = aware.penalty[:residual.size].reshape(shape)  # likelihood with errors of that size
    assert seen[TORQUE, centers] == pytest.approx(1.0 + math.log(100.0))
    assert seen[FORCE_X, centers] == pytest.approx(0.25)  # not larger than expected


def test_weighted_squares_with_their_penalty_are_the_student_likelihood():
    residual = np.array([[0.0, 0.8, 1.0, 3.0, -20.0]]) * 0.1
    blocks = 0.01 * np.eye(5)[np.newaxis]
    whiten = Whitening(WindowNoise(blocks, np.zeros((0, 0))), residual, np.zeros(0), True, [])
    white = whiten(residual[:, :, np.newaxis], np.zeros((0, 1)))[:, 0]
    cost = white ** 2 + whiten.penalty - math.log(0.01)
    expected = [0.0, 0.64, 1.0, *(1.0 + 6.0 * math.log(square / 6.0) for square in (14.0, 405.0))]
    assert cost == pytest.approx(expected)
    assert student((residual[0] / 0.1) ** 2) == pytest.approx(expected)


def test_what_is_not_used_does_not_count_in_the_evidence(films):
    fit = films[1][-1].fit
    rows = fit.rows.residual.copy()
    rows[3] += 2.0
    other = fit._replace(rows=fit.rows._replace(residual=rows), cost=fit.cost + (
        rows[3] ** 2 - fit.rows.residual[3] ** 2))
    unused = np.arange(len(rows)) == 3
    assert _gain(fit, other, ~unused & False) == pytest.approx(fit.cost - other.cost)
    assert _gain(fit, other, unused) == pytest.approx(0.0, abs=1e-9)


# lifted wheels


WHEEL, LIFT_BEGIN, LIFT_END = 2, 5.2, 7.3


@pytest.fixture(scope='module')
def lifted():
    """Return the estimator and its solutions in a drive with a lifted wheel."""
    params = SimulatorParams(seed=4, ground=ground(), robot=ROBOT)
    plant = plant_with(Traits(lifts=(LiftedWheel(LIFT_BEGIN, LIFT_END, WHEEL),)))
    samples = [sample for _, _, sample in simulate(params, LEGS, 11.0, plant=plant)]
    begin = next(s.stamp_ns for s in samples if isinstance(s, (ImuSample, WheelSample)))
    shift = (begin - samples[0].stamp_ns) / NS_PER_S
    return *run(samples), shift


def test_a_lifted_wheel_is_found_with_its_begin_and_end_and_is_no_change_of_ground(lifted):
    estimator, found, shift = lifted
    assert estimator.status['ground_changes'] == 0
    lifts = [one.hypothesis.lifts[-1] for one in found if one.hypothesis.lifts]
    assert lifts
    assert lifts[-1].wheel in (WHEEL, 3 - WHEEL)  # both have lost their load
    assert lifts[-1].begin + shift == pytest.approx(LIFT_BEGIN, abs=0.25)
    assert lifts[-1].end + shift == pytest.approx(LIFT_END, abs=0.25)
    assert (estimator.status['wheel_lifts'], estimator.status['ground_changes']) == (1, 0)
    for one in found:  # not before it begins, and not once it has left the window
        if one.end + shift < LIFT_BEGIN or one.end + shift > LIFT_END + 4.1:
            assert not one.hypothesis.lifts
    during = [one for one in found if LIFT_BEGIN + 1.0 < one.end + shift < LIFT_END]
    assert during and all(one.hypothesis.lifts[-1].end == math.inf for one in during)
    assert during[-1].fit.x[Unknown.MOVED_LOAD] == pytest.approx(-1.0, abs=0.25)


def test_the_ground_is_that_of_the_wheels_that_carry(lifted):
    estimator, found, shift = lifted
    one = next(one for one in found if one.end + shift > LIFT_BEGIN + 1.0)
    values, _ = one.values_at(one.end, range(4))
    assert values[[WHEEL, 3 - WHEEL], LOAD_COLUMN].max() < 0.2 * LOAD[0]
    for solution in found[-4:]:
        state = estimator.state(solution)
        for value, true in ((state.stiffness, STIFFNESS), (state.rolling_resistance, DRAG)):
            assert abs(math.log(value.value / true)) < 3.0 * value.sigma / value.value


def test_a_crossing_of_a_wheel_without_load_says_nothing_of_the_ground(measurements):
    values = np.array([0.1, 0.1 * 0.5])
    loaded, light, none = (measurements.crossing_noise(values, 0.0 * values, load) for load in (
        LOAD, 0.5 * LOAD, 0.004 * LOAD))
    ratio = [math.sqrt(one[1, 1]) / 0.1 for one in (loaded, light, none)]
    assert ratio[0] < 0.5 * 0.1 and ratio[2] > 5.0 * 0.5
    assert ratio[0] < ratio[1] < ratio[2]
    assert loaded[0, 0] == none[0, 0]


def test_an_event_that_stays_undecided_is_dropped_and_its_disturbance_forgotten(monkeypatch):
    monkeypatch.setattr(window, 'EVENT_EVIDENCE', 1e6)
    samples, times = drive(11.0, CHANGING, surfaces=onto(2.9)), []
    solve = GroundWindow.solve

    def noted(self, *arguments):
        solution = solve(self, *arguments)
        times.append((solution.end, self._undecided))
        return solution
    monkeypatch.setattr(GroundWindow, 'solve', noted)
    estimator, found = run(samples)
    assert estimator.status['ground_changes'] == 0 and any(at is not None for _, at in times)
    assert all(end - at < LENGTH for end, at in times if at is not None)
    assert not found[-1].hypothesis.lifts and found[-1].hypothesis.new == ONE_GROUND
