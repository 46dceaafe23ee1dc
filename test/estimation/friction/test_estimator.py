# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Every patch crossing and no others, with their quantities: scripted and simulated."""

from dataclasses import replace
from functools import cache, lru_cache
from itertools import product
import math

from benchmarks.events import cached_events
import numpy as np
import pytest

from smart_tire.errors import EstimatorError
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.parameters import build, FrictionEstimatorParams, SimulatorParams
from smart_tire.samples import (
    Friction, FRICTION_QUANTITIES, GroundState, ImuSample, NAN, TireSample, WheelSample,
    WheelSlip)
from smart_tire.simulation.offline import simulate
from smart_tire.uncertain import UNKNOWN
from support.rolling import (
    along, CRITICAL, films, in_order, passes, ROBOT, ROUND, stamp, START_NS, steady, wheels)

pytestmark = pytest.mark.slow

OF_MOTION = ('slip', 'total_slip', 'normal_load', 'stiffness', 'friction_coefficient',
             'friction_coefficient_single', 'critical_slip', 'traction_force')
BOTH_WHEELS = {'film.wheels': ('front_left', 'front_right')}
CURVES = [(0, 0, 0), (1, 120, 60), (9, 60, 120), (17, 0, 0)]  # s, rpm left, rpm right


def estimate(samples, **values):
    """Return the crossings in ``samples`` before the estimator is finished, and the estimator."""
    estimator = FrictionEstimator(build(FrictionEstimatorParams, values))
    return [found for sample in samples for found in estimator.update(sample)
            if isinstance(found, Friction)], estimator


def rolled(trajectory, duration, **options):
    """Return films and wheel speeds of a scripted trajectory; ``options`` of either."""
    other = {key: options.pop(key) for key in ('wheel_rate', 'positions') if key in options}
    return in_order(films(trajectory, duration, **options),
                    wheels(trajectory, duration, **other))


def seconds(found):
    return [(crossing.stamp_ns - START_NS) * 1e-9 for crossing in found]


def test_a_crossing_at_the_end_of_the_samples_is_complete_and_counted_once():
    trajectory = steady(60.0)
    end = passes(trajectory, 5.0)[-1] + 0.12  # s, the last film has just left the patch
    found, estimator = estimate(rolled(trajectory, end))
    last = estimator.finish()
    assert seconds([*found, *last]) == pytest.approx(passes(trajectory, end), abs=0.004)
    assert len(last) == 1
    assert abs(last[0].film_slip.value - 0.1) < 3.0 * last[0].film_slip.sigma
    assert abs(last[0].adhesion_ratio.value - (1.0 - 0.13 / CRITICAL)) < 3.0 * (
        last[0].adhesion_ratio.sigma)
    assert estimator.finish() == []


def test_samples_without_the_second_film_are_left_out_of_its_waveform():
    trajectory, count = steady(60.0), 0
    samples = rolled(trajectory, 5.0)
    for index, sample in enumerate(samples):
        if isinstance(sample, TireSample):
            count += 1
            if count % 9 == 0:
                samples[index] = replace(sample, volts=sample.volts[:1])
    found, _ = estimate(samples)
    assert len(found) >= len(passes(trajectory, 4.5))
    assert all(abs(one.film_slip.value - 0.1) < 4.0 * one.film_slip.sigma for one in found[1:])


OPTIONS = ({}, {'wheel_rate': 200.0}, {'slip': -0.1}, {'slip': 0.3, 'total': 0.31},
           {'noise': 0.02}, {'slip': -0.3, 'total': 0.31}, {'slip': 0.0, 'total': 0.02},
           {'wheel_rate': 4.0}, {'positions': False}, {'release': 'state'})


@pytest.mark.parametrize(('rpm', 'options'), [
    pytest.param(rpm, options, id=f'{rpm} {options}',
                 marks=() if number % 3 == first else pytest.mark.long)
    for first, rpm in enumerate((90.0, 200.0, 15.0)) for number, options in enumerate(OPTIONS)])
def test_each_revolution_is_one_crossing_at_its_instant(rpm, options):
    trajectory, duration = steady(rpm), 0.5 + 3.6 * 60.0 / rpm
    found, _ = estimate(rolled(trajectory, duration + 1.0, **options),
                        **{'film.release': options.get('release', 'fig8')})
    expected = [t for t in passes(trajectory, duration + 1.0) if t < duration]
    assert len(expected) == 4
    # four samples a second do not resolve the sudden start of the wheel
    tolerance = 0.02 if options.get('wheel_rate') == 4.0 else 0.004
    assert seconds(found)[:len(expected)] == pytest.approx(expected, abs=tolerance)


def test_backward_the_films_cross_in_the_other_order_with_the_same_result():
    forward, back = steady(90.0), along([(0.0, 0.0), (0.5, 0.0), (5.5, -5.0), (6.0, -5.0)])
    for trajectory, reverse in ((forward, False), (back, True)):
        found, _ = estimate(rolled(trajectory, 6.0, reverse=reverse))
        expected = passes(trajectory, 6.0)
        assert seconds(found) == pytest.approx(expected[:len(found)], abs=0.004)
        assert len(found) >= len(expected) - 1
        for crossing in found[2:-1]:
            assert crossing.film_slip.value == pytest.approx(0.1, abs=0.01)
            assert crossing.adhesion_ratio.value == pytest.approx(1.0 - 0.13 / CRITICAL, abs=0.03)


def test_one_film_alone_is_not_a_crossing_of_the_pair():
    # the first film leaves the patch at 0.348 m less the spacing; the second is still inside
    knots = [(0.0, 0.0), (1.0, 0.0), (2.0, ROUND), (3.0, ROUND + 0.335), (4.0, ROUND), (5.0, 0.0)]
    found, _ = estimate(rolled(along(knots), 5.5))
    assert [round(t) for t in seconds(found)] == [2, 4]


@pytest.mark.parametrize('slip', [0.1, -0.1])
def test_the_films_alone_determine_their_quantities_within_their_sigmas(slip):
    found, _ = estimate(rolled(steady(120.0), 4.0, slip=slip))
    crossing, ratio = found[-1], 1.0 - 0.13 / CRITICAL
    for name, truth in {'film_slip': slip, 'adhesion_ratio': ratio,
                        'adhesion_length': ratio * 0.046}.items():
        value, sigma = crossing.quantity(name)
        assert 0.0 < sigma < 0.25 * abs(truth), name
        assert abs(value - truth) < 3.0 * sigma, name
    assert {crossing.quantity(name) for name in OF_MOTION} == {UNKNOWN}
    if slip > 0.0:
        assert crossing.peak_interval.value == pytest.approx(0.0232, rel=0.05)
        assert crossing.stretch_voltage.value == pytest.approx(0.36, rel=0.1)
    else:
        assert crossing.stretch_voltage == crossing.peak_interval == UNKNOWN


def test_nan_and_infinite_sigma_coincide_in_every_crossing():
    trajectory = along([(0.0, 0.0), (1.0, 0.0), (4.0, 2.0), (6.0, -1.0), (9.0, 2.0)])
    kept = [s for s in rolled(trajectory, 9.0, slip=0.02, total=0.02, noise=0.02)
            if not isinstance(s, TireSample) or s.stamp_ns // 40_000_000 % 7]
    found, _ = estimate(kept)
    assert len(found) > 8
    for crossing in found:
        for name in FRICTION_QUANTITIES:
            value, sigma = crossing.quantity(name)
            assert math.isnan(value) == (sigma == math.inf), name
            assert sigma >= 0.0, name


@pytest.mark.parametrize(('film', 'begin', 'end'), [(0, -0.098, 0.003), (1, -0.003, 0.098)])
def test_a_lost_film_does_not_shift_the_crossing(film, begin, end):
    trajectory = steady(60.0)
    expected = passes(trajectory, 6.0)
    samples = [s for s in rolled(trajectory, 6.0) if not (
        isinstance(s, TireSample) and stamp(expected[3] + begin) < s.stamp_ns
        < stamp(expected[3] + end))]
    found, _ = estimate(samples)
    assert seconds(found)[3] == pytest.approx(expected[3], abs=0.004)
    assert found[3].film_slip.value == pytest.approx(0.1, abs=0.02)
    assert math.isnan(found[3].stretch_voltage.value) == (film == 0)


def test_a_crossing_lost_by_the_radio_is_reported_as_unknown():
    trajectory = steady(60.0)
    expected = passes(trajectory, 6.0)
    gone = expected[3]
    samples = [s for s in rolled(trajectory, 6.0) if not (
        isinstance(s, TireSample) and abs(s.stamp_ns - stamp(gone)) < 150_000_000)]
    found, estimator = estimate(samples)
    assert seconds(found) == pytest.approx(expected[:len(found)], abs=0.01)
    assert found[3].film_slip == found[3].adhesion_ratio == UNKNOWN
    assert estimator.status()['crossings_lost'] == 1


def test_a_wheel_without_ground_contact_has_no_crossings():
    trajectory = steady(60.0)
    samples = [replace(s, volts=(1.65, 1.65)) if isinstance(s, TireSample)
               and s.stamp_ns > stamp(4.5) else s for s in rolled(trajectory, 8.0)]
    found, _ = estimate(samples)
    assert len(found) == len([t for t in passes(trajectory, 8.0) if t < 4.5])


def test_duplicates_are_counted_and_ignored(driven):
    twice, estimator = estimate([one for one in driven for _ in range(2)], **BOTH_WHEELS)
    assert len(twice) > 4
    assert repr(twice) == repr(of_drive()[1])
    assert estimator.late.total() == 0
    settled = estimator.dropped.total() / len(driven)
    assert 0.95 < settled <= 1.0  # the newest are still in the reorder buffer
    assert set(estimator.dropped) == {'tire_samples', 'wheel_states', 'imu/data'}
    assert estimator.status()['dropped.imu/data'] == estimator.dropped['imu/data']


@pytest.mark.parametrize('positions', [True, False])
def test_impossible_samples_are_counted_and_ignored(positions):
    samples, once = of_drive(positions)
    corrupt = list(samples)
    for number, (kind, change) in enumerate((
            (WheelSample, {'velocity': (-1e300,) * 4}), (WheelSample, {'velocity': (NAN,) * 4}),
            (ImuSample, {'rate': (NAN,) * 3}), (ImuSample, {'acceleration': (1e300,) * 3}),
            (TireSample, {'volts': (NAN,) * 2})), 1):
        index = [i for i, sample in enumerate(samples) if isinstance(sample, kind)][20 * number]
        corrupt[index] = replace(corrupt[index], **change)
    found, estimator = estimate(corrupt, **BOTH_WHEELS)
    assert estimator.dropped.total() == 5
    assert len(found) == len(once) > 6
    assert seconds(found) == pytest.approx(seconds(once), abs=0.01)
    for one, other in zip(found, once):
        assert one.slip.value == pytest.approx(
            other.slip.value, abs=max(one.slip.sigma, 1e-9), nan_ok=True)


def test_a_repeated_bag_restarts_the_estimator(driven):
    found, estimator = estimate([*driven, *driven], **BOTH_WHEELS)
    once = of_drive()[1]
    assert estimator.status()['clock_resets'] == 1
    assert repr(found[-len(once):]) == repr(once)


def test_a_reset_clears_the_state(driven):
    estimator = FrictionEstimator(build(FrictionEstimatorParams, BOTH_WHEELS))
    first, second = [], []
    for found in (first, second):
        found += [one for sample in driven for one in estimator.update(sample)]
        found += estimator.finish()
        estimator.reset()
    assert repr(first) == repr(second)
    assert estimator.status()['crossings'] == 2 * sum(isinstance(f, Friction) for f in first)


def test_samples_of_other_wheels_are_counted_and_other_types_are_refused():
    _, estimator = estimate([TireSample(START_NS, 'rear_left', (1.65, 1.65)),
                             WheelSample(START_NS + 10**8, (0.0,) * 4)])
    assert estimator.status()['foreign_samples'] == 1
    with pytest.raises(EstimatorError, match='WheelSlip'):
        estimator.update(WheelSlip(START_NS, (0.0,) * 4, (0.0,) * 4, (1.0,) * 4))


def simulated(seed, schedule, duration, motion='imu/data', **values):
    """
    Return true crossings, estimated ones and states of the ground; ``values`` of the simulation.

    ``motion`` is the topic of the motion, empty for none; ``film.*`` also configures the
    estimator.
    """
    return _simulated(seed, tuple(schedule), duration, motion, tuple(values.items()))


@cache
def _simulated(seed, schedule, duration, motion, values):
    own = {key: value for key, value in values if key[:5] == 'film.'}
    events = drive(seed, schedule, duration, values)
    truth = [s for _, topic, s in events if topic == 'ground_truth/tire_friction']
    estimator = FrictionEstimator(build(FrictionEstimatorParams, {**BOTH_WHEELS, **own}))
    found = [one for _, topic, s in events if topic in (motion, 'tire_samples', 'wheel_states')
             for one in estimator.update(s)] + estimator.finish()
    return truth, *([one for one in found if isinstance(one, kind)]
                    for kind in (Friction, GroundState))


@lru_cache(4)
def drive(seed, schedule, duration, values=()):
    """Return the events of a drive on concrete with two wheels that have films."""
    params = build(SimulatorParams, {
        'seed': seed, 'ground.base': 'concrete', **BOTH_WHEELS, **dict(values)})
    return cached_events(repr((params, schedule, duration)), lambda: simulate(
        params, schedule, duration))


@cache
def of_drive(positions=True):
    """Return the samples of a drive of 6 s, in order of their stamps, and its crossings."""
    samples = in_order([s if positions or not isinstance(s, WheelSample)
                        else replace(s, position=None) for _, topic, s in drive(
                            5, tuple(CURVES), 6.0)
                        if topic in ('imu/data', 'tire_samples', 'wheel_states')])
    return samples, estimate(samples, **BOTH_WHEELS)[0]


@pytest.fixture
def driven():
    return of_drive()[0]


FILMS = [((0.0,), 1), ((0.0, 0.03, 0.27, 0.30), 2), ((0.0, 0.03, 0.06), 1),
         ((0.0, 0.18, 0.36), 3)]  # positions [m], and crossings per revolution


def paired(truth, found):
    """Return each true crossing with the estimate of the same wheel within 20 ms."""
    return [(t, next((f for f in found if f.wheel == t.wheel
                      and abs(f.stamp_ns - t.stamp_ns) < 20_000_000), None)) for t in truth]


def _film_friction(one):
    return one.friction_coefficient_single.value * one.normal_load.value / one.stiffness.value


@pytest.mark.parametrize(('cases', 'seeds'), [(FILMS[:2], (73,)), *(
    pytest.param([case], range(73, 77), marks=pytest.mark.long) for case in FILMS)])
def test_any_number_of_films_anywhere_on_the_wheel(cases, seeds):
    errors = []
    for (positions, turns), seed in product(cases, seeds):
        count = len(positions)
        schedule = [(0, 0, 0), (1, 100, 60), (5, -80, -120), (9, 0, 0)]
        truth, found, _ = simulated(seed, schedule, 10.0, **{
            'film.positions': positions, 'film.stretch_gain': (300.0,) * count,
            'film.bending_peak': (0.8,) * count})
        ends = {f.wheel: f.stamp_ns + 20_000_000 for f in found}
        truth = [t for t in truth if t.stamp_ns < ends[t.wheel]]
        pairs = paired(truth, found)
        assert len(truth) > 16 * turns
        assert len(found) == len(truth)
        assert all(f is not None for _, f in pairs)
        finite = [(t, f) for t, f in pairs if math.isfinite(f.adhesion_ratio.value)]
        assert len(finite) > 0.8 * len(pairs)
        errors += [(f.adhesion_ratio.value - t.adhesion_ratio.value)
                   / f.adhesion_ratio.sigma for t, f in finite]
    assert 0.5 < np.mean(np.square(errors)) < 1.8


@pytest.mark.parametrize(('values', 'seeds'), [({}, (70, 71)), *(
    pytest.param(values, range(70, 74), marks=pytest.mark.long) for values in (
        {}, {'film.noise': 0.02}, {'radio.loss': 0.075}, {'ground.friction': (0.2, 0.35)},
        {'ground.friction': (0.8, 0.35)}))], ids=str)
def test_on_the_simulated_robot_friction_is_accurate_and_its_sigma_consistent(values, seeds):
    pairs = []
    for seed in seeds:
        truth, found, _ = simulated(seed, CURVES, 19.0, **values)
        pairs += paired(truth, found)
        assert len(found) <= len(truth)
    slipping = [(t, f) for t, f in pairs if abs(t.slip.value) > 0.05]  # driving and braking
    name = 'friction_coefficient_single'
    assert len(slipping) > 15 * len(seeds)
    informative = [(t.quantity(name).value, *f.quantity(name)) for t, f in slipping
                   if f is not None and f.quantity(name).sigma < 0.6 * f.quantity(name).value]
    assert len(informative) >= 0.9 * len(slipping)
    true, value, sigma = np.array(informative).T
    # mu F_z / C_x is what the films measure, given the slip
    ratio = np.array([_film_friction(f) / _film_friction(t) for t, f in slipping
                      if f is not None and f.quantity(name).sigma < 0.6 * f.quantity(name).value])
    assert np.median(np.abs(ratio - 1.0)) < (0.08 if 'film.noise' in values else 0.04)
    assert abs(np.median(ratio) - 1.0) < (0.03 if 'film.noise' in values else 0.02)
    assert np.mean(np.abs(value - true) < 2.0 * sigma) >= 0.9
    assert np.mean(np.abs(value - true) < sigma) >= 0.6
    # the adhesion ratio depends on the waveform alone: a tighter bound
    error = np.array([(f.adhesion_ratio.value - t.adhesion_ratio.value) / f.adhesion_ratio.sigma
                      for t, f in slipping if f is not None and f.adhesion_ratio.sigma < 0.1])
    assert 0.7 < np.mean(error**2) < 1.4
    assert sum(f is None for _, f in pairs) <= 1


def errors(truth, found, name):
    """Return normalized errors of a quantity of crossings after the first 3 s."""
    return np.array([(f.quantity(name).value - t.quantity(name).value) / f.quantity(name).sigma
                     for t, f in paired(truth, found) if f is not None
                     and t.stamp_ns > truth[0].stamp_ns + 3 * 10**9
                     and math.isfinite(f.quantity(name).value)])


@pytest.mark.parametrize(('motion', 'seeds'), [('imu/data', (70, 71)), *(
    pytest.param(motion, (70, 71, 72), marks=pytest.mark.long)
    for motion in ('imu/data', 'ground_truth/odom'))])
def test_slip_load_and_ground_are_within_their_sigmas(motion, seeds):
    names = ('slip', 'total_slip', 'normal_load', 'stiffness', 'friction_coefficient',
             'critical_slip', 'traction_force')
    runs = [simulated(seed, CURVES, 19.0, motion) for seed in seeds]
    for name in names:
        found = np.concatenate([errors(*run[:2], name) for run in runs])
        assert len(found) > 26 * len(seeds), name
        assert np.mean(np.abs(found) < 2.0) > 0.9, name


def test_without_motion_each_crossing_still_has_the_quantities_of_its_films():
    truth, found, grounds = simulated(5, CURVES, 6.0, motion='')
    assert len(found) == len(truth) and not grounds
    for crossing in found:
        assert {crossing.quantity(name) for name in OF_MOTION} == {UNKNOWN}
    assert np.mean([math.isfinite(one.adhesion_ratio.value) for one in found]) > 0.8
    _, with_imu, _ = simulated(5, CURVES, 6.0)
    for name in ('film_slip', 'adhesion_ratio', 'adhesion_length', 'peak_interval'):
        assert [repr(one.quantity(name)) for one in with_imu] == [
            repr(one.quantity(name)) for one in found]


def test_records_come_in_order_each_wheel_with_the_ground_of_its_window():
    _, found, grounds = simulated(5, CURVES, 6.0)
    for wheel in BOTH_WHEELS['film.wheels']:
        stamps = [one.stamp_ns for one in found if one.wheel == wheel]
        assert stamps == sorted(stamps)
    assert np.all(np.diff([one.stamp_ns for one in grounds[:-1]]) == 500_000_000)
    assert all(one.stamp_ns % 500_000_000 == 0 for one in grounds[:-1])


def test_a_record_is_complete_soon_after_its_crossing(driven):
    estimator, newest_ns = FrictionEstimator(build(FrictionEstimatorParams, BOTH_WHEELS)), 0
    for sample in driven:
        newest_ns = max(newest_ns, sample.stamp_ns)
        for one in estimator.update(sample):
            if isinstance(one, Friction) and math.isfinite(one.slip.value):
                assert newest_ns - one.stamp_ns < 900_000_000


@pytest.mark.parametrize(('first', 'second'), [
    (0.47, 0.2), pytest.param(0.2, 0.47, marks=pytest.mark.long)])
def test_some_revolutions_after_a_change_of_the_ground_friction_is_that_of_the_present_one(
        first, second):
    fields = {'ground.names': ('first', 'second'), 'ground.friction': (first, second),
              'ground.stiffness': (52.7, 52.7), 'ground.drag': (0.015, 0.015),
              'ground.base': 'first', 'ground.patches.names': ('field',),
              'ground.patches.field.surface': 'second', 'ground.patches.field.x': (4.0, 100.0),
              'ground.patches.field.y': (-50.0, 50.0)}
    bends = [(2.5 + 3.0 * i, *((70, 120), (120, 70))[i % 2]) for i in range(5)]
    truth, found, _ = simulated(80, [(0, 0, 0), (1, 120, 70), *bends], 17.0, **fields)
    pairs = paired(truth, found)
    true = np.array([t.friction_coefficient.value for t, _ in pairs])
    assert {first, second} <= set(np.round(true, 2))
    for own in ((one for one in pairs if one[0].wheel == wheel) for wheel in
                BOTH_WHEELS['film.wheels']):
        value, sigma = np.array([f.friction_coefficient for _, f in list(own)[-6:]]).T
        assert np.median(np.abs(value / second - 1.0)) < 0.1
        assert np.mean(np.abs(value - second) < 3.0 * sigma) > 0.8


def test_in_rough_driving_no_crossing_is_missed_or_invented():
    schedule = [(0, 0, 0), (1, 80, 80), (2.2, -60, 40), (3.1, 0, 0), (3.5, 100, -100),
                (5, 30, 120), (6.5, -90, -120), (8, 15, 30), (11, 150, 90), (13, 0, 0)]
    truth, found, _ = simulated(72, schedule, 15.0)
    pairs = paired(truth, found)
    assert len(truth) > 25
    assert len(found) == len(truth)
    assert sum(f is None for _, f in pairs) == 0


def test_each_crossing_is_passed_on_with_its_fit():
    course, found = steady(60.0), []
    estimator = FrictionEstimator(
        FrictionEstimatorParams(robot=ROBOT), on_crossing=found.append)
    estimates = [estimate for sample in rolled(course, 4.0)
                 for estimate in estimator.update(sample)] + estimator.finish()
    assert [crossing.friction for crossing in found] == estimates
    fits = [crossing.result.waveform for crossing in found if crossing.result is not None]
    assert len(fits) >= 3 and all(len(fit.samples.films) == 2 for fit in fits)
