# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Slip estimator against exact truth, over seeds, maneuvers and sensor faults."""

from dataclasses import replace
from functools import cache
import math
import random

import numpy as np
import pytest

from smart_tire.analysis.pipeline import smooth
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.inputs import merged
from smart_tire.estimation.slip.state import State
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.rotation import euler
from smart_tire.samples import (
    GRAVITY, Icr, ImuSample, NS_PER_S, Odometry, WheelSample, WheelSlip)
from support.driving import drive, ramp, START_NS, STEP

pytestmark = pytest.mark.slow

FAST, SLOW = 1.093, 0.547  # m/s, 120 and 60 rpm
# slips of both sides about their ICRs, with that of a rolling resistance of 0.05
TURN_SLIP = 0.14, -0.08
CIRCLE = [(0, 0, 0), (3, 0, 0), (3.4, FAST, SLOW), (11, FAST, SLOW)]
SEEDS = pytest.mark.parametrize('seeds', [
    range(2), pytest.param(range(8), marks=pytest.mark.long)])


def estimate(samples, **values):
    estimator = SlipEstimator(build(SlipEstimatorParams, values))
    out = [estimate for sample in samples for estimate in estimator.update(sample)]
    return estimator, out


def of(kind, out):
    return [item for item in out if isinstance(item, kind)]


def seconds(items):
    return np.array([(item.stamp_ns - START_NS) / NS_PER_S for item in items])


def slips(run, out):
    """Return time, estimated ratio, sigma and true ratio of the two sides."""
    slip = of(WheelSlip, out)
    time = seconds(slip)
    index = np.round(time / STEP).astype(int)
    ground = run.twist[:, :1] + np.array([-0.19, 0.19]) * run.twist[:, 2:]
    with np.errstate(divide='ignore', invalid='ignore'):
        truth = np.clip(1.0 - ground / run.rolling, -1.0, 1.0)[index]
    return (time, np.array([s.ratio[:2] for s in slip]), np.array([s.sigma[:2] for s in slip]),
            truth)


def turning(seed=0, slip=TURN_SLIP, knots=CIRCLE, **options):
    rolling = ramp(knots)
    return drive(rolling, rolling * np.array(slip), seed=seed, **options)


@cache
def usual():
    """Return a turn and its estimates."""
    run = turning(4, icr=0.05)
    return run, estimate(run.samples)[1]


@cache
def turned(seed, slip):
    """Return a turn with a tilted IMU, and its estimates."""
    run = turning(seed, slip, mounting_tilt=0.005)
    return run, estimate(run.samples)[1]


def mapped(kind, change, run):
    """Return the samples of ``run``, those of ``kind`` changed."""
    return [change(s) if isinstance(s, kind) else s for s in run.samples]


@SEEDS
@pytest.mark.parametrize('slip', [TURN_SLIP, (0.06, 0.0)])
def test_slip_of_both_sides_is_estimated_in_a_turn_within_its_sigma(slip, seeds):
    errors, normalized = [], []
    for seed in seeds:
        time, ratio, sigma, truth = slips(*turned(seed, slip))
        steady = time > 5.0
        errors.append((ratio - truth)[steady])
        normalized.append(((ratio - truth) / sigma)[steady])
    assert np.sqrt(np.mean(np.square(errors))) < 0.04
    assert np.mean(np.square(normalized)) < 2.0


@SEEDS
def test_position_error_is_consistent_with_the_pose_covariance(seeds):
    normalized = []
    for seed in seeds:
        run, out = turned(seed, TURN_SLIP)
        odometry = of(Odometry, out)[-1]
        index = round((odometry.stamp_ns - START_NS) / NS_PER_S / STEP)
        error = np.array(odometry.position[:2]) - run.pose[index, :2]
        assert np.hypot(*error) < 0.15
        covariance = np.array(odometry.pose_covariance).reshape(6, 6)[:2, :2]
        normalized.append(error @ np.linalg.solve(covariance, error) / 2.0)
    assert np.mean(normalized) < 2.0


@pytest.mark.parametrize('options', [
    {'imu_rate': 20.0, 'wheel_rate': 200.0}, {'imu_rate': 1000.0, 'wheel_rate': 4.0},
    {'positions': False}])
def test_slip_is_estimated_at_any_rate_and_without_positions(options):
    run = turning(3, **options)
    time, ratio, sigma, truth = slips(run, estimate(run.samples)[1])
    steady = time > 6.0
    assert np.all(np.abs(np.mean((ratio - truth)[steady], axis=0)) < 0.06)
    assert np.all(np.abs((ratio - truth)[steady]) < 4.0 * sigma[steady] + 0.02)


@pytest.mark.parametrize('lost', [pytest.param(0.3, marks=pytest.mark.long), 0.6])
def test_lost_velocities_without_positions_are_no_slip(lost):
    errors = []
    for seed in range(2):
        run, rng = turning(seed, positions=False), np.random.default_rng(seed)
        samples = [sample for sample in run.samples
                   if not isinstance(sample, WheelSample) or rng.random() >= lost]
        time, ratio, _, truth = slips(run, estimate(samples)[1])
        errors.append((ratio - truth)[time > 5.0])
    assert np.sqrt(np.mean(np.square(np.concatenate(errors)))) < 0.03


def test_slip_has_the_same_sign_in_reverse():
    knots = [(t, -left, -right) for t, left, right in CIRCLE]
    run = turning(1, knots=knots)
    time, ratio, _, truth = slips(run, estimate(run.samples)[1])
    assert truth[-1] == pytest.approx(list(TURN_SLIP))
    assert np.mean((ratio - truth)[time > 5.0], axis=0) == pytest.approx([0.0, 0.0], abs=0.06)


def test_slip_is_nan_if_and_only_if_robot_and_wheels_are_stationary():
    time, ratio, sigma, _ = slips(*usual())
    assert np.all(np.isnan(ratio[time < 3.0]))
    assert np.all(sigma[time < 3.0] == 1.0)
    assert np.all(np.isfinite(ratio[time > 3.3]))


def test_slip_is_minus_one_for_a_pushed_robot_with_locked_wheels():
    rolling = ramp([(0, 0, 0), (8.0, 0, 0)])
    ground = ramp([(0, 0, 0), (4, 0, 0), (4.5, 0.8, 0.8), (7.0, 0.8, 0.8), (8.0, 0, 0)])
    run = drive(rolling, -ground, seed=5)
    time, ratio, _, _ = slips(run, estimate(run.samples)[1])
    assert np.all(ratio[(time > 4.6) & (time < 6.0)] == -1.0)


def test_sigma_grows_in_steady_straight_driving_and_covers_the_error():
    rolling = ramp([(0, 0, 0), (3, 0, 0), (4, 0.8, 0.8), (14, 0.8, 0.8)])
    run = drive(rolling, 0.05 * rolling, seed=7)
    time, ratio, sigma, truth = slips(run, estimate(run.samples)[1])
    early, late = sigma[np.searchsorted(time, 5.0)], sigma[-1]
    assert np.all(late > 0.8 * early)
    assert np.all(np.abs(ratio - truth)[time > 4.5] < 3.0 * sigma[time > 4.5])


def test_estimates_are_on_the_grid_and_the_icr_is_published_in_turns_only():
    run, out = usual()
    stamps = [item.stamp_ns for item in of(Odometry, out)]
    assert set(np.diff(stamps)) == {8_000_000} and stamps[0] % 8_000_000 == 0
    icr = of(Icr, out)
    assert min(seconds(icr)) > 3.0
    assert np.mean([item.x for item in icr[-500:]]) == pytest.approx(0.05, abs=0.03)
    radius = run.twist[-1, 0] / run.twist[-1, 2]
    assert np.mean([item.y for item in icr[-500:]]) == pytest.approx(radius, rel=0.03)


def test_order_of_arrival_within_the_window_does_not_change_the_estimates():
    (run, out), rng = usual(), random.Random(4)
    shuffled = sorted(run.samples, key=lambda s: s.stamp_ns + rng.randrange(29_000_000))
    assert repr(estimate(shuffled)[1]) == repr(out)  # NaN equals NaN


def test_duplicates_are_counted_and_change_nothing():
    run, out = usual()
    estimator, again = estimate([sample for sample in run.samples for _ in range(2)])
    assert of(Odometry, again)[-1].position == pytest.approx(
        of(Odometry, out)[-1].position, abs=1e-9)
    assert estimator.dropped['imu/data'] > 1000 and estimator.dropped['wheel_states'] > 100


@pytest.mark.parametrize('lost', [ImuSample, WheelSample])
def test_a_dropout_of_two_seconds_is_bridged_with_growing_sigma(lost):
    run, whole = usual()
    _, out = estimate([s for s in run.samples if not (
        isinstance(s, lost) and 5.0 < (s.stamp_ns - START_NS) / NS_PER_S < 7.0)])
    time, ratio, sigma, truth = slips(run, out)
    assert len(time) == len(slips(run, whole)[0])
    assert np.all(sigma[np.searchsorted(time, 6.9)] > sigma[np.searchsorted(time, 4.9)])
    recovered = time > 9.5
    assert np.all(np.abs((ratio - truth)[recovered]) < 4.0 * sigma[recovered] + 0.02)


def test_wheel_speed_outliers_hardly_change_the_slip():
    run, _ = usual()
    corrupted = [WheelSample(s.stamp_ns, (400.0,) * 4)
                 if isinstance(s, WheelSample) and k % 400 == 0 else s
                 for k, s in enumerate(run.samples)]
    time, ratio, _, truth = slips(run, estimate(corrupted)[1])
    steady = time > 6.0
    assert np.sqrt(np.mean((ratio - truth)[steady] ** 2)) < 0.05


def test_imu_spikes_are_rejected_and_counted():
    run, out = usual()
    corrupted = list(run.samples)
    for begin, rate, force in ((6, 0.0, 50.0), (7, 0.0, 900.0), (8, 90.0, 0.0)):
        index = next(k for k, s in enumerate(run.samples)
                     if isinstance(s, ImuSample) and s.stamp_ns > START_NS + begin * NS_PER_S)
        bad = run.samples[index]
        corrupted[index] = ImuSample(bad.stamp_ns, (force, *bad.acceleration[1:]),
                                     (*bad.rate[:2], bad.rate[2] + rate))
    estimator, found = estimate(corrupted)
    assert estimator.status()['imu_spikes'] == 3
    assert np.nanmax(np.abs(slips(run, found)[1] - slips(run, out)[1])) < 0.02


def test_physically_impossible_samples_are_dropped_and_counted():
    (run, out), extra = usual(), []
    for second, impossible in enumerate((1e300, 1e6, math.nan, math.inf), 4):
        stamp = START_NS + second * NS_PER_S + 1
        extra += [ImuSample(stamp, (impossible, 0.0, 9.8), (0.0,) * 3),
                  WheelSample(stamp, (impossible,) * 4)]
    estimator, found = estimate(sorted(run.samples + extra, key=lambda sample: sample.stamp_ns))
    assert repr(found) == repr(out)
    assert estimator.dropped == {'imu/data': 4, 'wheel_states': 4}


def test_a_lasting_impact_is_accepted():
    rolling = ramp([(0, 0, 0), (5, 0, 0)])
    run = drive(rolling, rolling, noise=0.0)
    estimator, out = estimate(mapped(ImuSample, lambda s: replace(
        s, acceleration=(30.0, 0.0, 9.81)) if 4.0 < (s.stamp_ns - START_NS) / NS_PER_S < 4.05
        else s, run))
    assert estimator.status()['imu_spikes'] == 2  # its first sample, and the first one after it
    assert max(o.linear[0] for o in of(Odometry, out)) > 0.5


def test_nothing_is_published_before_both_inputs_have_been_received():
    run, _ = usual()
    for kind, missing in ((ImuSample, 'wheel_states'), (WheelSample, 'imu/data')):
        estimator, out = estimate([s for s in run.samples if isinstance(s, kind)])
        assert out == []
        assert missing in str(estimator.status()['state'])


@pytest.mark.parametrize('method', [0, 1], ids=['filtered', 'smoothed'])
def test_odom_begins_at_its_origin_with_the_first_wheel_sample(method):
    run, _ = usual()
    late = [s for s in run.samples
            if isinstance(s, ImuSample) or s.stamp_ns > START_NS + 0.5 * NS_PER_S]
    poses = smooth(build(SlipEstimatorParams, {}), late)[method].poses()
    assert poses.stamp_ns[0] > START_NS + 0.5 * NS_PER_S
    assert poses.pose[0] == pytest.approx([0.0, 0.0, 0.0], abs=0.5e-3)
    assert np.sqrt(np.diagonal(poses.covariance[0])) == pytest.approx([0.0, 0.0, 0.0], abs=1e-4)


@pytest.mark.parametrize('speed', [-3.0, 0.0, 1.0])
def test_a_robot_in_motion_at_the_start_may_slide(speed):
    samples = [ImuSample(NS_PER_S, (0.0, 0.0, GRAVITY), (0.0, 0.0, 0.0))]
    samples += [WheelSample(NS_PER_S + i, (speed / 0.087,) * 4) for i in (0, 50_000_000)]
    first = of(Odometry, estimate(samples)[1])[0]
    assert math.sqrt(first.twist_covariance[0]) > 0.3 * abs(speed)


def test_a_robot_that_was_just_switched_on_does_not_turn_by_its_gyro_bias():
    bias, samples = 0.02, []
    for i in range(100):
        stamp_ns = NS_PER_S + i * 10_000_000
        samples.append(ImuSample(stamp_ns, (0.0, 0.0, GRAVITY), (0.0, 0.0, bias)))
        if i % 6 == 0:
            samples.append(WheelSample(stamp_ns, (0.0,) * 4, (0.0,) * 4, None))
    poses = of(Odometry, estimate(samples)[1])
    yaw = np.array([euler(one.orientation)[2] for one in poses if one.stamp_ns > 1.8 * NS_PER_S])
    assert np.abs(yaw).max() < 0.2 * bias * 0.8


def test_at_rest_the_heading_is_held_and_consistent_when_the_robot_moves_off():
    """The same readings show the gyro bias and turn the heading."""
    errors = {2.0: [], 11.9: [], 14.9: []}
    for seed in range(12):
        run = turning(seed, (0.0, 0.0), [
            (0, 0, 0), (12, 0, 0), (12.4, FAST, FAST), (15, FAST, FAST)])
        odometry = of(Odometry, estimate(run.samples)[1])
        time = seconds(odometry)
        sigma = np.sqrt([one.pose_covariance[35] for one in odometry])
        assert sigma[(time > 2.0) & (time < 12.0)].max() < 0.0025  # 0.005 of independent noises
        for at, found in errors.items():
            i = int(np.searchsorted(time, at))
            yaw = euler(odometry[i].orientation)[2]
            found.append((yaw - run.pose[round(at / STEP), 2]) / sigma[i])
    for found in errors.values():
        assert 0.3 < np.mean(np.square(found)) < 2.0


def test_readings_before_the_pose_show_the_gyro_bias_but_have_not_turned_it():
    """The wheels are late, and stamps of the IMU jitter."""
    rng, errors = np.random.default_rng(3), []
    for seed in range(8):
        run = turning(seed, (0.0, 0.0), [(0, 0, 0), (5, 0, 0)])
        samples = [
            replace(sample, stamp_ns=sample.stamp_ns + round(4e6 * rng.uniform(-1.0, 1.0)))
            if isinstance(sample, ImuSample) else sample for sample in run.samples
            if isinstance(sample, ImuSample) or sample.stamp_ns > START_NS + 2 * NS_PER_S]
        estimator, out = estimate(samples)
        assert estimator.restarts == 0
        last = of(Odometry, out)[-1]
        errors.append(euler(last.orientation)[2] / math.sqrt(last.pose_covariance[35]))
    assert 0.2 < np.mean(np.square(errors)) < 2.5


@pytest.mark.parametrize('jump', [3600.0, -3600.0])
def test_the_pose_goes_on_when_the_clock_is_set_in_motion(jump):
    run, _ = usual()
    half = run.samples[len(run.samples) // 2].stamp_ns
    estimator, out = estimate([s if s.stamp_ns <= half else replace(
        s, stamp_ns=s.stamp_ns + round(jump * NS_PER_S)) for s in run.samples])
    assert estimator.status()['clock_jumps'] == 1 and estimator.restarts == 0
    found = of(Odometry, out)
    at = next(k for k, (one, other) in enumerate(zip(found, found[1:]))
              if abs(other.stamp_ns - one.stamp_ns) > 60 * NS_PER_S)
    assert math.dist(found[at].position, (0.0, 0.0, 0.0)) > 0.5
    assert math.dist(found[at].position, found[at + 1].position) < 0.1
    estimator.reset()
    assert estimator._segment.filter.kalman.x[State.X] == 0.0


@pytest.mark.parametrize('gap', [0.9, 2.5, 59.0])
def test_in_a_gap_of_all_sensors_there_are_estimates_for_a_second_then_one_each_second(gap):
    run, _ = usual()
    half = run.samples[len(run.samples) // 2].stamp_ns
    later = [replace(s, stamp_ns=s.stamp_ns + round(gap * NS_PER_S))
             for s in run.samples if s.stamp_ns > half]
    _, out = estimate([s for s in run.samples if s.stamp_ns <= half] + later)
    stamps = np.array([o.stamp_ns for o in of(Odometry, out)])
    inside = stamps[(stamps > half) & (stamps < later[0].stamp_ns)]
    assert len(inside) == pytest.approx(125 * min(gap, 1.0) + max(math.ceil(gap) - 2, 0), abs=2)
    assert np.diff(stamps).max() <= NS_PER_S
    assert len(stamps[stamps > later[0].stamp_ns]) == pytest.approx(
        125 * (later[-1].stamp_ns - later[0].stamp_ns) / NS_PER_S, abs=25)


def test_wheels_do_not_show_how_far_to_the_side_the_imu_is():
    run, _ = usual()
    estimator, _ = estimate(run.samples, **{'imu.position_sigma': 0.1})
    kalman = estimator._segment.filter.kalman
    assert kalman.x[State.IMU_Y] == 0.0
    assert kalman.P[State.IMU_Y, State.IMU_Y] == pytest.approx(0.01)


def test_the_mounting_rotation_of_the_imu_is_compensated():
    run, expected = usual()
    turned = mapped(ImuSample, lambda s: ImuSample(
        s.stamp_ns, (-s.acceleration[0], -s.acceleration[1], s.acceleration[2]),
        (-s.rate[0], -s.rate[1], s.rate[2])), run)
    _, out = estimate(turned, **{'imu.rotation': [0.0, 0.0, math.pi]})
    assert of(Odometry, out)[-1].position == pytest.approx(
        of(Odometry, expected)[-1].position, abs=1e-9)


def test_reset_odometry_moves_the_origin_to_the_robot():
    run, _ = usual()
    half = len(run.samples) // 2
    estimator, _ = estimate(run.samples[:half])
    estimator.reset_odometry()
    out = [e for sample in run.samples[half:half + 20] for e in estimator.update(sample)]
    assert np.hypot(*of(Odometry, out)[0].position[:2]) < 0.05


def test_covariances_stay_symmetric_and_positive_semidefinite():
    run = turning(1, knots=[(0, 0, 0)] + [
        (4 * k + 4, *((FAST, SLOW) if k % 2 else (0.0, 0.0))) for k in range(6)])
    for odometry in of(Odometry, estimate(run.samples)[1])[::50]:
        for covariance in (odometry.pose_covariance, odometry.twist_covariance):
            matrix = np.array(covariance).reshape(6, 6)
            assert np.array_equal(matrix, matrix.T)
            assert np.linalg.eigvalsh(matrix).min() >= -1e-12


def test_a_mean_wheel_speed_does_not_count_as_two_sides():
    run, _ = usual()
    estimator, out = estimate(mapped(WheelSample, lambda s: WheelSample(
        s.stamp_ns, (sum(s.velocity) / 4.0,) * 4), run))
    P = estimator._segment.filter.kalman.P
    before = SlipEstimator(SlipEstimatorParams())._segment.filter.kalman.P
    icrs = np.ix_([State.ICR_L, State.ICR_R], [State.ICR_L, State.ICR_R])
    assert P[icrs].sum() > 0.9 * before[icrs].sum()  # of the effective track
    truth, odometry = run.twist[-1], of(Odometry, out)[-1]
    assert odometry.angular[2] == pytest.approx(truth[2], abs=0.05)
    assert odometry.linear[0] == pytest.approx(truth[0], abs=0.08)


def test_one_encoder_per_side_is_enough():
    nan = math.nan
    run, _ = usual()
    _, out = estimate(mapped(WheelSample, lambda s: WheelSample(
        s.stamp_ns, (*s.velocity[:2], nan, nan), (*s.position[:2], nan, nan)), run), **{
        'joints.rear_left': '', 'joints.rear_right': ''})
    last = of(WheelSlip, out)[-1]
    assert np.isfinite(last.ratio[:2]).all() and np.isnan(last.ratio[2:]).all()
    assert last.ratio[0] == pytest.approx(TURN_SLIP[0], abs=0.08)


def spoil_state(filter_):
    filter_.kalman.x[State.SLIP_VEL_L] = math.nan


def spoil_large(filter_):
    filter_.kalman.x[State.V_X] = math.inf


def spoil_variance(filter_):
    filter_.kalman.P[State.ICR_X, State.ICR_X] = -1.0


def spoil_covariance(filter_):
    filter_.kalman.P[State.YAW, State.YAW] = math.inf


def spoil_equations(filter_):
    filter_.predict = failing


def failing(*_):
    raise OverflowError('math range error')


@pytest.mark.parametrize('spoil', [
    spoil_state, spoil_large, spoil_variance, spoil_covariance, spoil_equations])
def test_a_state_that_is_none_restarts_from_the_priors_at_the_same_pose(spoil):
    run = turning(4)
    estimator, before, after = SlipEstimator(SlipEstimatorParams()), [], []
    middle_ns = START_NS + 7 * NS_PER_S
    for sample in run.samples:
        if estimator.restarts == 0 and sample.stamp_ns > middle_ns and not after:
            spoil(estimator._segment.filter)
        (after if sample.stamp_ns > middle_ns else before).extend(estimator.update(sample))
    assert estimator.restarts == 1 and estimator.status()['restarts'] == 1
    last, *_ = reversed(of(Odometry, before))
    first, *rest = of(Odometry, after)
    assert 0 < first.stamp_ns - last.stamp_ns < NS_PER_S
    assert math.dist(first.position, last.position) < FAST * 0.5
    assert first.pose_covariance[0] >= 0.5 * last.pose_covariance[0]
    assert all(math.isfinite(number) for one in (first, *rest) for number in (
        *one.position, *one.linear, *one.pose_covariance, *one.twist_covariance))
    assert np.hypot(*rest[-1].linear[:2]) == pytest.approx(0.5 * (FAST + SLOW), rel=0.2)
    assert len(rest) > 400


@pytest.mark.parametrize('reported', [0.0, 0.3, 0.8])
def test_the_reported_velocity_of_the_first_sample_is_no_speed_where_positions_follow(reported):
    speed, estimator, found = 0.5, SlipEstimator(build(SlipEstimatorParams, {
        'imu.position': [0.0, 0.0, 0.0],
        'tire.longitudinal_stiffness': 5000.0})), []  # wheels without resistance hardly slip
    for i in range(200):
        stamp_ns = NS_PER_S + i * 10_000_000
        samples = [ImuSample(stamp_ns, (0.0, 0.0, GRAVITY), (0.0, 0.0, 0.0))]
        if i % 5 == 0:
            velocity = (reported if i == 0 else speed) / 0.087
            samples.append(WheelSample(
                stamp_ns, (velocity,) * 4, (speed * i * 0.01 / 0.087,) * 4, None))
        found += [one for sample in samples for one in estimator.update(sample)
                  if isinstance(one, Odometry)]
    late = [one.linear[0] for one in found if one.stamp_ns > 1.2 * NS_PER_S]
    assert late == pytest.approx([speed] * len(late), abs=0.01)


def test_wheel_samples_that_are_too_close_are_merged():
    """At 200 Hz, errors of stamps are a fifth of the period."""
    samples = [WheelSample(i, (1.0 + i, 2.0, 3.0, math.nan), (0.1 * i,) * 4, (0.5 * i,) * 4)
               for i in range(3)]
    one = merged(samples)
    assert (one.stamp_ns, one.position) == (2, (0.2,) * 4)
    assert one.velocity[:3] == (2.0, 2.0, 3.0) and math.isnan(one.velocity[3])
    assert one.effort == (0.5,) * 4
    assert merged([*samples, replace(samples[0], effort=None)]).effort is None
    assert merged(samples[:1]) is samples[0]
    errors = []
    for rate in (16.0, 200.0):
        run = turning(5, wheel_rate=rate)
        time, ratio, _, truth = slips(run, estimate(run.samples)[1])
        errors.append(float(np.sqrt(np.mean(np.square(ratio - truth)[time > 6.0]))))
    assert errors[1] < 1.5 * errors[0]
