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

"""Every patch crossing and no others, with their quantities: scripted and simulated."""

from __future__ import annotations

from dataclasses import replace
import math
import random

import numpy as np
import pytest

from smart_tire.errors import EstimatorError
from smart_tire.estimation.contact.prediction import MAX_CROSSINGS_PER_STEP
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.estimation.streams import GROUND_STATE_PERIOD_NS
from smart_tire.parameters import build, FrictionEstimatorParams, SimulatorParams
from smart_tire.samples import (
    FRICTION_QUANTITIES, GroundState, ImuSample, Odometry, TireSample, WheelSample, WheelSlip)
from smart_tire.simulation.offline import simulate
from smart_tire.uncertain import Uncertain, UNKNOWN
from support.rolling import (
    along, CRITICAL, films, in_order, passes, ROBOT, ROUND, stamp, START_NS, steady,
    surroundings, WHEEL)

pytestmark = pytest.mark.slow

MU = CRITICAL * 52.7 / (3.0 * 0.25 * ROBOT.mass * 9.80665)


def estimate(samples, **values):
    estimator = FrictionEstimator(build(FrictionEstimatorParams, values))
    return [found for sample in samples for found in estimator.update(sample)], estimator


def rolled(trajectory, duration, **options):
    """Return all samples of a scripted trajectory; ``options`` of films or surroundings."""
    both = {key: options[key] for key in ('slip', 'total') if key in options}
    other = {key: options[key] for key in ('slip_sigma', 'wheel_rate', 'positions')
             if key in options}
    own = {key: value for key, value in options.items() if key not in other}
    return in_order(films(trajectory, duration, **own),
                    surroundings(trajectory, duration, **both, **other))


def seconds(found):
    return [(crossing.stamp_ns - START_NS) * 1e-9 for crossing in found]


def test_a_crossing_at_the_end_of_the_samples_is_complete_and_counted_once():
    trajectory = steady(60.0)
    end = passes(trajectory, 5.0)[-1] + 0.12  # s, the last film has just left the patch
    found, estimator = estimate(rolled(trajectory, end))
    last = estimator.finish()
    assert seconds([*found, *last]) == pytest.approx(passes(trajectory, end), abs=0.004)
    assert len(last) == 1
    for name in ('film_slip', 'adhesion_ratio', 'slip', 'friction_coefficient_single'):
        value, sigma = last[0].quantity(name)
        assert math.isfinite(value) and math.isfinite(sigma), name
    assert abs(last[0].film_slip.value - 0.1) < 3.0 * last[0].film_slip.sigma
    assert abs(last[0].adhesion_ratio.value - (1.0 - 0.13 / CRITICAL)) < 3.0 * (
        last[0].adhesion_ratio.sigma)
    assert estimator.finish() == []


@pytest.mark.parametrize('options', [
    {}, {'noise': 0.02}, {'slip': -0.1}, {'slip': 0.3, 'total': 0.31},
    {'slip': -0.3, 'total': 0.31}, {'slip': 0.0, 'total': 0.02}, {'wheel_rate': 4.0},
    {'wheel_rate': 200.0}, {'positions': False}, {'release': 'state'}], ids=str)
@pytest.mark.parametrize('rpm', [15.0, 90.0, 200.0])
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
        mu = [crossing.friction_coefficient_single.value for crossing in found[2:-1]]
        assert np.median(mu) == pytest.approx(MU, rel=0.1)
        force = found[3].traction_force.value
        assert math.copysign(1.0, force) == (-1.0 if reverse else 1.0)


def test_noise_at_standstill_and_bumps_are_not_crossings():
    trajectory = along([(0.0, 0.0), (5.0, 0.0), (6.0, 0.2), (7.0, 0.0), (10.0, 0.0)])
    found, estimator = estimate(rolled(trajectory, 10.0, noise=0.02))
    assert found == []
    assert estimator.status()['crossings'] == 0


@pytest.mark.parametrize('inside', [0.26, 0.28, 0.30, 0.32, 0.34])
def test_rolling_in_and_back_out_is_not_a_crossing(inside):
    knots, time = [(0.0, 0.0)], 0.0
    for goal in (0.0, ROUND, ROUND + inside, ROUND, ROUND + inside, ROUND, 2.0 * ROUND):
        knots += [(time + 1.0, goal), (time + 1.5, goal)]
        time += 1.5
    trajectory = along(knots)
    found, _ = estimate(rolled(trajectory, time))
    assert len(found) == 2
    assert found[0].stamp_ns < stamp(3.0)
    assert found[1].stamp_ns > stamp(time - 1.6)


def test_one_film_alone_is_not_a_crossing_of_the_pair():
    # the first film leaves the patch at 0.348 m less the spacing; the second is still inside
    knots = [(0.0, 0.0), (1.0, 0.0), (2.0, ROUND), (3.0, ROUND + 0.335), (4.0, ROUND), (5.0, 0.0)]
    found, _ = estimate(rolled(along(knots), 5.5))
    assert [round(t) for t in seconds(found)] == [2, 4]


@pytest.mark.parametrize('wait', [0.5, 60.0])
def test_a_wait_inside_the_patch_is_one_crossing_for_any_duration(wait):
    trajectory = along([(0.0, 0.0), (1.0, 0.0), (4.0, 2.0 * ROUND), (5.0, 2.0 * ROUND + 0.29),
                        (5.0 + wait, 2.0 * ROUND + 0.29), (6.0 + wait, 3.0 * ROUND),
                        (7.0 + wait, 3.0 * ROUND)])
    found, _ = estimate(rolled(trajectory, 7.0 + wait))
    assert seconds(found) == pytest.approx(passes(trajectory, 7.0 + wait), abs=0.05)
    assert math.isnan(found[2].friction_coefficient_single.value)


def test_a_stop_right_after_the_patch_does_not_delay_the_crossing():
    trajectory = along([(0.0, 0.0), (1.0, 0.0), (3.0, ROUND), (4.0, ROUND + 0.36)])
    found, _ = estimate(rolled(trajectory, 5.0))
    assert len(found) == 2


def test_a_crossing_has_all_quantities_within_their_sigmas():
    found, _ = estimate(rolled(steady(120.0), 6.0))
    crossing = found[-1]
    total = 0.13
    ratio = 1.0 - total / CRITICAL
    for name, truth in {
            'friction_coefficient': MU, 'friction_coefficient_single': MU, 'slip': 0.1,
            'film_slip': 0.1, 'total_slip': total, 'adhesion_ratio': ratio,
            'adhesion_length': ratio * 0.046, 'normal_load': 26.72, 'stiffness': 52.7,
            'critical_slip': CRITICAL}.items():
        sigma = crossing.quantity(name).sigma
        assert 0.0 < sigma < 0.25 * truth, name
        assert abs(crossing.quantity(name).value - truth) < 3.0 * sigma, name
    assert crossing.peak_interval.value == pytest.approx(0.0232, rel=0.05)
    assert crossing.stretch_voltage.value == pytest.approx(0.36, rel=0.1)


def test_braking_determines_friction_but_has_no_peaks():
    found, _ = estimate(rolled(steady(120.0), 6.0, slip=-0.1))
    assert len(found) > 8
    for crossing in found[-5:]:
        for name in ('stretch_voltage', 'peak_interval'):
            assert math.isnan(crossing.quantity(name).value), name
            assert crossing.quantity(name).sigma == math.inf, name
        assert crossing.film_slip.value == pytest.approx(-0.1, abs=0.01)
        assert crossing.slip.value == pytest.approx(-0.1, abs=0.01)
        assert crossing.traction_force.value < -3.0
        assert crossing.normal_load.value == pytest.approx(26.72, rel=0.01)
        for name, truth in {'friction_coefficient': MU, 'friction_coefficient_single': MU,
                            'adhesion_ratio': 1.0 - 0.13 / CRITICAL, 'critical_slip': CRITICAL,
                            'adhesion_length': 0.046 * (1.0 - 0.13 / CRITICAL)}.items():
            assert crossing.quantity(name).sigma < 0.15 * truth, name
            quantity = crossing.quantity(name)
            assert abs(quantity.value - truth) < 3.0 * quantity.sigma, name


def test_the_two_peak_method_has_no_friction_when_braking_but_slip_and_load():
    found, _ = estimate(rolled(steady(120.0), 4.0, slip=-0.1), method='two_peaks')
    for crossing in found:
        for name in ('friction_coefficient', 'friction_coefficient_single', 'adhesion_ratio',
                     'stretch_voltage', 'peak_interval', 'critical_slip'):
            assert math.isnan(crossing.quantity(name).value), name
        assert crossing.slip.value == pytest.approx(-0.1, abs=0.01)
        assert crossing.normal_load.value == pytest.approx(26.72, rel=0.01)


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


def test_a_small_slip_does_not_determine_friction():
    found, _ = estimate(rolled(steady(120.0), 8.0, slip=0.01, total=0.013, noise=0.02))
    assert len(found) > 10
    assert all(math.isnan(p.friction_coefficient_single.value) for p in found)


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
    assert math.isnan(found[3].film_slip.value)
    assert found[3].slip.value == pytest.approx(0.1, abs=0.01)
    assert math.isfinite(found[3].friction_coefficient.value)
    assert found[3].friction_coefficient.sigma > found[2].friction_coefficient.sigma
    assert estimator.status()['crossings_lost'] == 1


def test_a_wheel_without_ground_contact_has_no_crossings():
    trajectory = steady(60.0)
    samples = [replace(s, volts=(1.65, 1.65)) if isinstance(s, TireSample)
               and s.stamp_ns > stamp(4.5) else s for s in rolled(trajectory, 8.0)]
    found, _ = estimate(samples)
    assert len(found) == len([t for t in passes(trajectory, 8.0) if t < 4.5])


def test_the_order_of_arrival_does_not_matter():
    samples = rolled(steady(120.0), 5.0)
    rng = random.Random(1)
    late = sorted(samples, key=lambda s: s.stamp_ns + rng.uniform(0.0, 50e6))
    one, _ = estimate(samples)
    other, estimator = estimate(late)
    assert sum(estimator.late.values()) == 0
    assert repr(one) == repr(other[:len(one)])
    assert len(one) > 5


def test_late_samples_are_counted():
    samples = rolled(steady(120.0), 2.0)
    old = [s for s in samples if isinstance(s, TireSample)][-200]
    _, estimator = estimate([*samples, old])
    assert estimator.late == {'tire_samples': 1}


def test_duplicates_are_counted_and_ignored():
    samples = rolled(steady(120.0), 4.0)
    once, plain = estimate(samples)
    twice, estimator = estimate([sample for sample in samples for _ in range(2)])
    assert len(once) > 4
    assert repr(twice) == repr(once)
    assert sum(estimator.late.values()) == sum(plain.late.values()) == 0
    settled = estimator.dropped.total() / len(samples)
    assert 0.95 < settled <= 1.0  # the newest are still in the reorder buffer
    assert set(estimator.dropped) == {'tire_samples', 'wheel_states', 'odom', 'wheel_slip'}
    assert estimator.status()['dropped.odom'] == estimator.dropped['odom']
    assert not plain.dropped


@pytest.mark.parametrize(('kind', 'change'), [
    (WheelSample, {'velocity': (1e6,) * 4}), (WheelSample, {'velocity': (1e9,) * 4}),
    (WheelSample, {'velocity': (-1e300,) * 4}), (WheelSample, {'velocity': (math.nan,) * 4}),
    (WheelSlip, {'ratio': (1e300,) * 4}), (WheelSlip, {'sigma': (1e300,) * 4}),
    (Odometry, {'linear': (math.nan,) * 3}), (TireSample, {'volts': (math.nan,) * 2}),
], ids=str)
@pytest.mark.parametrize('positions', [True, False])
def test_impossible_samples_are_counted_and_ignored(kind, change, positions):
    samples = rolled(steady(120.0), 5.0, positions=positions)
    indices = [i for i, sample in enumerate(samples) if isinstance(sample, kind)][20::20]
    corrupt = list(samples)
    for i in indices[:2]:
        corrupt[i] = replace(corrupt[i], **change)
    once, _ = estimate(samples)
    found, estimator = estimate(corrupt)
    assert estimator.dropped.total() == 2
    assert len(found) == len(once) > 6
    assert seconds(found) == pytest.approx(seconds(once), abs=0.01)


def test_an_implausible_spin_for_a_minute_yields_a_bounded_number_of_crossings():
    samples = rolled(steady(120.0), 4.0, positions=False)
    late = [replace(s, stamp_ns=s.stamp_ns + 50 * 10**9) for s in samples]
    spin = WheelSample(stamp(53.9), (999.0,) * 4)
    found, estimator = estimate([*samples, *in_order([spin], late)])
    again, _ = estimate(late)
    assert not estimator.dropped
    assert len(found) < 2 * len(again) + MAX_CROSSINGS_PER_STEP + 5


def test_a_repeated_bag_restarts_the_estimator():
    samples = rolled(steady(120.0), 4.0)
    found, estimator = estimate([*samples, *samples])
    once, _ = estimate(samples)
    assert estimator.status()['clock_resets'] == 1
    assert len(found) >= 2 * len(once) - 1


def test_a_reset_clears_the_state():
    samples = rolled(steady(120.0), 4.0)
    estimator = FrictionEstimator(build(FrictionEstimatorParams, {}))
    first = [found for sample in samples for found in estimator.update(sample)]
    estimator.reset()
    second = [found for sample in samples for found in estimator.update(sample)]
    assert repr(first) == repr(second)
    assert estimator.status()['crossings'] == 2 * len(first)


def test_without_slip_and_odometry_the_film_quantities_are_reported():
    samples = [s for s in rolled(steady(120.0), 5.0)
               if not isinstance(s, (WheelSlip, Odometry))]
    found, _ = estimate(samples)
    assert len(found) > 5
    assert found[-1].slip.value == pytest.approx(0.1, abs=0.01)
    assert math.isfinite(found[-1].adhesion_ratio.value)
    assert math.isnan(found[-1].friction_coefficient.value)
    assert math.isnan(found[-1].total_slip.value)


def grounds(duration, stiffness):
    """Return the states of the ground, every 64 ms on the grid, of ``stiffness`` (time)."""
    first = -(-START_NS // GROUND_STATE_PERIOD_NS) * GROUND_STATE_PERIOD_NS
    stamps = range(first, stamp(duration), GROUND_STATE_PERIOD_NS)
    return [GroundState(ns, Uncertain(stiffness((ns - START_NS) * 1e-9), 2.0), UNKNOWN,
                        (0.0, 0.0)) for ns in stamps]


def test_friction_is_that_of_the_present_ground():
    samples = rolled(steady(120.0), 6.0)
    calibrated, _ = estimate(samples)
    found, _ = estimate(in_order(
        samples, grounds(6.0, lambda time: 52.7 if time < 3.0 else 26.35)))
    assert len(found) == len(calibrated)
    for crossing, other in zip(found, calibrated):
        share = crossing.stiffness.value / 52.7
        if abs((crossing.stamp_ns - START_NS) * 1e-9 - 3.0) > 0.2:
            assert share == (1.0 if crossing.stamp_ns < stamp(3.0) else 0.5)
        for name in ('friction_coefficient_single', 'traction_force'):
            value, sigma = other.quantity(name)
            if sigma < 0.2 * abs(value):
                assert crossing.quantity(name).value == pytest.approx(share * value, rel=1e-3)
    last, other = found[-1], calibrated[-1]
    assert last.stiffness.sigma == 2.0
    assert last.friction_coefficient.value == pytest.approx(
        0.5 * other.friction_coefficient.value, rel=0.01)
    assert tuple(last.critical_slip) == pytest.approx(tuple(other.critical_slip), rel=0.05)


def test_a_ground_state_that_arrives_late_is_awaited():
    samples, states = rolled(steady(120.0), 6.0), grounds(6.0, lambda time: 30.0 + 5.0 * time)
    in_time, _ = estimate(in_order(samples, states))
    delay = 300_000_000
    arrivals = sorted([(s.stamp_ns, 0, s) for s in samples] + [
        (s.stamp_ns + delay * (s.stamp_ns > stamp(0.5)), 1, s) for s in states],
        key=lambda one: one[:2])
    late, estimator = estimate([s for _, _, s in arrivals])
    assert not estimator.late
    assert len(late) > 6 and repr(late) == repr(in_time[:len(late)])


def test_film_slip_is_independent_of_the_slip_estimator():
    samples = rolled(steady(120.0), 4.0)
    shifted = [replace(s, ratio=tuple(r + 0.05 for r in s.ratio))
               if isinstance(s, WheelSlip) else s for s in samples]
    one, other = estimate(samples)[0], estimate(shifted)[0]
    assert [p.film_slip.value for p in one] == [p.film_slip.value for p in other]
    assert one[-1].slip.value != other[-1].slip.value


def test_a_single_film_is_sufficient():
    samples = [replace(s, volts=s.volts[:1]) if isinstance(s, TireSample) else s
               for s in rolled(steady(120.0), 5.0)]
    found, _ = estimate(samples)
    assert len(found) >= 7
    assert found[-1].friction_coefficient_single.value == pytest.approx(MU, rel=0.2)


def test_the_printed_map_gives_twice_the_friction_and_two_peaks_scatter():
    samples = rolled(steady(60.0), 20.0)
    exact, printed = (estimate(samples, method='two_peaks', map=name)[0]
                      for name in ('exact', 'printed'))
    fitted, _ = estimate(samples)
    ratio = np.median([(1.0 - e.adhesion_ratio.value) / (1.0 - p.adhesion_ratio.value)
                       for p, e in zip(printed, exact)])
    assert 1.7 < ratio < 2.3
    true = 1.0 - 0.13 / CRITICAL
    error, fitted_error = (np.array([one.adhesion_ratio.value - true for one in found])
                           for found in (exact, fitted))
    assert np.nanstd(error) > 5.0 * np.std(fitted_error)
    sigma = np.array([one.adhesion_ratio.sigma for one in exact])
    assert 0.5 < np.sqrt(np.nanmean((error / sigma)**2)) < 2.0


def test_samples_of_other_wheels_are_counted_and_other_types_are_refused():
    _, estimator = estimate([TireSample(START_NS, 'rear_left', (1.65, 1.65)),
                             WheelSample(START_NS + 10**8, (0.0,) * 4)])
    assert estimator.status()['foreign_samples'] == 1
    with pytest.raises(EstimatorError, match='ImuSample'):
        estimator.update(ImuSample(START_NS, (0.0,) * 3, (0.0,) * 3))


@pytest.mark.parametrize('values', [{'film.length': 0.05}, {'film.release': 'state'}], ids=str)
def test_two_peaks_are_refused_for_configurations_without_them(values):
    build(FrictionEstimatorParams, values)
    with pytest.raises(ValueError, match='two_peaks'):
        build(FrictionEstimatorParams, {'method': 'two_peaks', **values})


def simulated(seed, schedule, duration, **values):
    """Return true crossings, and those estimated with the true slip and odometry."""
    wheels = {'film.wheels': ('front_left', 'front_right')}
    events = simulate(build(SimulatorParams, {
        'seed': seed, 'ground.base': 'concrete', **wheels, **values}), schedule, duration)
    truth = [s for _, topic, s in events if topic == 'ground_truth/tire_friction']
    exact = {'ground_truth/odom', 'ground_truth/wheel_slip', 'tire_samples', 'wheel_states'}
    samples = [replace(s, sigma=tuple(1.0 if math.isnan(r) else 0.003 for r in s.ratio))
               if isinstance(s, WheelSlip) else s for _, topic, s in events if topic in exact]
    found, _ = estimate(samples, **wheels, **{
        k: v for k, v in values.items() if k.startswith('film.')})
    return truth, found


def paired(truth, found):
    """Return each true crossing with the estimate of the same wheel within 20 ms."""
    return [(t, next((f for f in found if f.wheel == t.wheel
                      and abs(f.stamp_ns - t.stamp_ns) < 20_000_000), None)) for t in truth]


@pytest.mark.parametrize('values', [
    {}, {'film.noise': 0.02}, {'radio.loss': 0.075}, {'ground.friction': (0.2, 0.35)},
    {'ground.friction': (0.8, 0.35)}], ids=str)
def test_on_the_simulated_robot_friction_is_accurate_and_its_sigma_consistent(values):
    pairs = []
    for seed in (70, 71, 72, 73):
        truth, found = simulated(seed, [(0, 0, 0), (1, 120, 60), (9, 60, 120), (17, 0, 0)], 19.0,
                                 **values)
        pairs += paired(truth, found)
        assert len(found) <= len(truth)
    slipping = [(t, f) for t, f in pairs if abs(t.slip.value) > 0.05]  # driving and braking
    name = 'friction_coefficient_single'
    assert len(slipping) > 60
    informative = [(t.quantity(name).value, *f.quantity(name)) for t, f in slipping
                   if f is not None and f.quantity(name).sigma < 0.6 * f.quantity(name).value]
    assert len(informative) >= 0.9 * len(slipping)
    true, value, sigma = np.array(informative).T
    assert np.median(np.abs(value / true - 1.0)) < (0.08 if 'film.noise' in values else 0.04)
    assert abs(np.median(value / true) - 1.0) < 0.02
    assert np.mean(np.abs(value - true) < 2.0 * sigma) >= 0.9
    assert np.mean(np.abs(value - true) < sigma) >= 0.6
    # the adhesion ratio depends on the waveform alone: a tighter bound
    error = np.array([(f.adhesion_ratio.value - t.adhesion_ratio.value) / f.adhesion_ratio.sigma
                      for t, f in slipping if f is not None and f.adhesion_ratio.sigma < 0.1])
    assert 0.7 < np.mean(error**2) < 1.4
    assert sum(f is None for _, f in pairs) <= 1


@pytest.mark.parametrize(('positions', 'turns'), [
    ((0.0,), 1), ((0.0, 0.03, 0.06), 1), ((0.0, 0.03, 0.27, 0.30), 2), ((0.0, 0.18, 0.36), 3)])
def test_any_number_of_films_anywhere_on_the_wheel(positions, turns):
    count, errors = len(positions), []
    for seed in (73, 74, 75, 76):
        truth, found = simulated(seed, [(0, 0, 0), (1, 100, 60), (5, -80, -120)], 9.0, **{
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


def test_in_rough_driving_no_crossing_is_missed_or_invented():
    schedule = [(0, 0, 0), (1, 80, 80), (2.2, -60, 40), (3.1, 0, 0), (3.5, 100, -100),
                (5, 30, 120), (6.5, -90, -120), (8, 15, 30), (11, 150, 90), (13, 0, 0)]
    truth, found = simulated(72, schedule, 15.0)
    pairs = paired(truth, found)
    assert len(truth) > 25
    assert len(found) == len(truth)
    assert sum(f is None for _, f in pairs) == 0


def test_the_wheel_is_the_one_whose_films_were_sampled():
    found, _ = estimate(rolled(steady(120.0), 3.0))
    assert {crossing.wheel for crossing in found} == {WHEEL}


def test_each_crossing_is_passed_on_with_its_fit():
    course, found = steady(60.0), []
    estimator = FrictionEstimator(
        FrictionEstimatorParams(robot=ROBOT), on_crossing=found.append)
    estimates = [estimate for sample in in_order(films(course, 4.0), surroundings(course, 4.0))
                 for estimate in estimator.update(sample)] + estimator.finish()
    assert [crossing.friction for crossing in found] == estimates
    assert sum(crossing.waveform is not None for crossing in found) >= 3
    fitted = [crossing for crossing in found if crossing.waveform is not None]
    assert all(len(crossing.waveform.samples.films) == 2 for crossing in fitted)
    assert not any(crossing.surface_changed for crossing in found)
