# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Gains, contact length, positions and angles of films: right within their sigmas, or refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
import math

import numpy as np
import pytest
from smart_tire.calibration.film_gains import (
    film_angle, identify_gains, volts_per_slip)
from smart_tire.calibration.priors import PRIORS
from smart_tire.errors import EstimatorError
from smart_tire.models.tire import strain_charge
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain
from support.crossings import WHEEL
from support.gains import ANGLE, recording
from support.identifying import assert_agrees, assert_consistent, rms

NOMINAL = RobotParams()
LENGTH, SPACING = 0.048, 0.0312  # m, against nominal 46 and 30 mm
GAINS = (296.0, 251.0)           # V/m, against nominal 307.5 and 242.5
TURN = (0.1,)
SCATTER = 0.004  # rad, of an angle


def robot(**film):
    """Return a robot that differs from the nominal one."""
    return replace(NOMINAL, tire=replace(NOMINAL.tire, contact_length=LENGTH), film=replace(
        NOMINAL.film, **{'spacing': SPACING, 'stretch_gain': GAINS, **film}))


def configured(robot=NOMINAL, **film):
    return replace(robot, film=replace(robot.film, **film))


def gains(found):
    return {(one.wheel, one.film): one.gain for one in found.films}


@cache
def of_seed(seed):
    """Return a random robot, and what is found in its recording."""
    rng = np.random.default_rng([seed, 11])
    true = robot(length=NOMINAL.film.length * (1.0 + 0.005 * rng.standard_normal()),
                 stretch_gain=tuple((np.array(NOMINAL.film.stretch_gain) * (
                     1.0 + 0.03 * rng.standard_normal(2))).tolist()))
    crossings = recording(rng, true, radius_error=0.002 * rng.standard_normal())
    return true, identify_gains([crossings], NOMINAL)


@cache
def usual():
    """Return a recording of three crossings in each turn, and what is found in it."""
    crossings = recording(np.random.default_rng(3), robot(), each=3)
    return crossings, identify_gains([crossings], NOMINAL)


def test_gains_are_accurate_to_two_percent_and_consistent_with_their_sigmas(seeds):
    values, errors = np.array([
        (one.per_slip.value / volts_per_slip(gain, true.film.length, LENGTH) - 1.0,
         one.per_slip.sigma / one.per_slip.value)
        for true, found in map(of_seed, seeds)
        for one, gain in zip(found.films, true.film.stretch_gain)]).T
    assert np.median(np.abs(values)) < 0.02
    assert np.median(errors) < 0.025
    assert 0.5 < rms(values / errors) < 1.5


def test_lengths_are_consistent_with_the_sigmas_of_wheel_radius_and_film_length(seeds):
    results = [found for _, found in map(of_seed, seeds)]
    for found, true in (([one.length for one in results], LENGTH),
                        ([one.places[1] for one in results], SPACING)):
        assert_consistent(found, true, 0.5, 1.5)
        assert all(0.001 < one.sigma / true < 0.006 for one in found)


def test_angle_of_film_1_and_bending_peaks_are_correct(seeds):
    for _, found in map(of_seed, seeds):
        angle = found.angles[0, WHEEL]
        assert angle.value == pytest.approx(ANGLE, abs=max(3.0 * angle.sigma, 0.004))
        for one, peak in zip(found.films, NOMINAL.film.bending_peak):
            assert_agrees(one.bending, peak, 4.0)


@pytest.mark.parametrize('wrong', [0.7, pytest.param(1.3, marks=pytest.mark.long)])
def test_the_result_does_not_depend_on_the_initial_gains_and_length(wrong):
    crossings, near = usual()
    far = identify_gains([crossings], replace(
        configured(stretch_gain=tuple(wrong * gain for gain in NOMINAL.film.stretch_gain)),
        tire=replace(NOMINAL.tire, contact_length=0.043)))
    for key, gain in gains(near).items():
        assert gains(far)[key].value == pytest.approx(gain.value, abs=0.2 * gain.sigma)
    assert far.length.value == pytest.approx(near.length.value, abs=0.2 * near.length.sigma)


@pytest.mark.parametrize('release', [pytest.param('fig8', marks=pytest.mark.long), 'state'])
def test_gains_are_correct_for_either_release_and_large_noise(release):
    true, rng = robot(release=release, noise=0.02), np.random.default_rng(8)
    found = identify_gains([recording(rng, true, slip_sigma=0.003)],
                           configured(release=release, noise=0.02))
    for gain, expected in zip(gains(found).values(), GAINS):
        assert_agrees(gain, expected)
        assert gain.sigma < 0.05 * gain.value
    assert_agrees(found.length, LENGTH)


def test_a_single_film_has_a_gain_and_no_spacing():
    single = {'positions': (0.0,), 'stretch_gain': (296.0,), 'bending_peak': (0.83,)}
    found = identify_gains(
        [recording(np.random.default_rng(4), robot(**single), films=(0,))],
        configured(**{**single, 'stretch_gain': (307.5,)}))
    gain, = gains(found).values()
    assert_agrees(gain, 296.0)
    assert not found.places and not found.refused


def test_films_that_cross_separately_are_located_by_their_angles():
    rng, films = np.random.default_rng(9), {
        'stretch_gain': (*GAINS, 280.0), 'bending_peak': (0.83, 0.66, 0.7)}
    true = robot(positions=(0.0, SPACING, 0.203), **films)
    behind = [replace(one, origin=ANGLE + 0.203 / true.wheel_radius)
              for one in recording(rng, true, films=(2,))]
    found = identify_gains([[*recording(rng, true), *behind]],
                           configured(positions=(0.0, 0.03, 0.2), **films))
    for film, place in ((1, SPACING), (2, 0.203)):
        assert_agrees(found.places[film], place)
        assert found.places[film].sigma < 0.001
    assert_agrees(gains(found)[WHEEL, 2], 280.0)


def test_a_film_that_is_never_detected_is_refused_and_the_other_is_not():
    found = identify_gains([recording(np.random.default_rng(4), robot(), films=(0,))], NOMINAL)
    assert list(gains(found)) == [(WHEEL, 0)]
    assert '0 crossings' in found.refused[f'gain of film 2, {WHEEL}']
    assert 'never detected together' in found.refused['spacing, film 1 to 2']


def test_more_recordings_reduce_the_sigma_and_each_has_an_angle():
    runs = [recording(np.random.default_rng([seed, 12]), robot(), each=2) for seed in range(3)]
    runs[2] = [replace(one, origin=one.origin + 1.0) for one in runs[2]]
    one, all_three = identify_gains(runs[:1], NOMINAL), identify_gains(runs, NOMINAL)
    for film, true in enumerate(GAINS):
        gain = gains(all_three)[WHEEL, film]
        assert_agrees(gain, true)
        assert gain.sigma < 0.75 * gains(one)[WHEEL, film].sigma
    assert all_three.angles[2, WHEEL].value - all_three.angles[0, WHEEL].value == pytest.approx(
        1.0, abs=0.01)


def test_each_wheel_has_its_own_gains_and_all_share_the_contact_length():
    rng, wheels = np.random.default_rng(6), ('front_left', WHEEL)
    stronger = tuple(1.2 * gain for gain in GAINS)
    crossings = [*recording(rng, robot(stretch_gain=stronger), wheel='front_left'),
                 *recording(rng, robot())]
    found = identify_gains([crossings], configured(wheels=wheels))
    for (wheel, film), gain in gains(found).items():
        assert_agrees(gain, (stronger if wheel == 'front_left' else GAINS)[film])
    assert list(gains(found)) == [(wheel, film) for wheel in wheels for film in (0, 1)]
    assert set(found.angles) == {(0, wheel) for wheel in wheels}


def test_more_crossings_of_one_turn_do_not_remove_the_error_of_its_slip():
    few, more = (identify_gains([recording(np.random.default_rng(5), robot(), turns=TURN,
                                           each=each)], NOMINAL) for each in (6, 24))
    for one, other in zip(gains(few).values(), gains(more).values()):
        assert other.sigma > 0.85 * one.sigma
        assert other.sigma > 0.03 * other.value


def test_a_turn_with_a_wrong_slip_has_little_weight():
    rng = np.random.default_rng(7)
    crossings = recording(rng, robot(), turns=(0.1, -0.12, 0.06, 0.15, -0.07, 0.09))
    good = identify_gains([crossings], NOMINAL)
    spoiled = [replace(one, slip=Uncertain(one.slip.value + 0.06, one.slip.sigma))
               if i < 4 else one for i, one in enumerate(crossings)]
    found = identify_gains([spoiled], NOMINAL)
    for key, gain in gains(found).items():
        assert gain.value == pytest.approx(gains(good)[key].value, abs=2.0 * gain.sigma)
        assert gain.sigma > gains(good)[key].sigma


def test_without_slip_gains_are_refused_with_the_reason_and_lengths_are_not():
    found = identify_gains(
        [recording(np.random.default_rng(1), robot(), turns=(0.004, -0.006))], NOMINAL)
    assert all(one.gain is None for one in found.films)
    reason = found.refused[f'gain of film 1, {WHEEL}']
    assert '0 of 8 crossings' in reason and 'turn' in reason
    assert_agrees(found.length, LENGTH)


@pytest.mark.parametrize('sigma, sign, reason', [(0.028, 1.0, 'standard error'),
                                                 (0.006, -1.0, 'negative')])
def test_uncertain_slips_and_those_of_the_wrong_sign_are_refused(sigma, sign, reason):
    crossings = [replace(one, slip=Uncertain(sign * one.slip.value, sigma)) for one in recording(
        np.random.default_rng(2), robot(), turns=TURN, each=8, slip_sigma=sigma)]
    found = identify_gains([crossings], NOMINAL)
    assert reason in found.refused[f'gain of film 1, {WHEEL}']


def test_no_crossings_raise_a_clear_error():
    with pytest.raises(EstimatorError, match='expected at least 5'):
        identify_gains([[]], NOMINAL)


def test_without_wheel_positions_only_the_angle_is_refused():
    crossings = [replace(one, origin=math.nan) for one in usual()[0]]
    found = identify_gains([crossings], NOMINAL)
    assert 'without positions' in found.refused[f'angle of film 1, {WHEEL}']
    assert all(found.films)
    assert found.length is not None


def test_volts_per_slip_is_the_peak_stretch_in_full_adhesion():
    x = np.linspace(-0.02, LENGTH, 20001)
    stretch = 300.0 * strain_charge.overlap_integral(x, 1e-3, 1e-3, np.inf, 0.02, LENGTH)
    assert volts_per_slip(300.0, 0.02, LENGTH) == pytest.approx(stretch.max() / 1e-3, rel=1e-4)


def readings(seed, angle, speeds, latency=0.0):
    """Return angle readings over many revolutions of the wheel."""
    rng = np.random.default_rng(seed)
    speeds = np.asarray(speeds)
    turns = math.tau * np.arange(len(speeds))
    return (angle + turns + latency * speeds + SCATTER * rng.standard_normal(len(speeds)),
            speeds)


@pytest.mark.parametrize('angle', [0.0, 0.001, 3.0, math.tau - 0.001])
def test_angles_near_the_wrap_around_are_correct(angle):
    found = film_angle(*readings(1, angle, [6.0] * 20))
    assert 0.0 <= found.value < math.tau
    assert abs(math.remainder(found.value - angle, math.tau)) < 3.0 * found.sigma


@pytest.mark.parametrize('speeds', [[6.0] * 16, [4.0, 9.0] * 8, [8.0, -8.0] * 8], ids=str)
def test_a_latency_is_estimated_from_several_speeds_or_included_in_the_sigma(speeds):
    found = []
    for seed in range(60):
        latency = PRIORS['latency of films'].sigma * float(
            np.random.default_rng([seed, 1]).standard_normal())
        found.append(film_angle(*readings(seed, 2.0, speeds, latency)))
    assert_consistent(found, 2.0, 0.75, 1.3)
    assert (found[0].sigma > 0.01) == (len(set(speeds)) == 1)


def test_an_outlier_is_excluded():
    angles, speeds = readings(3, 2.0, [8.0, -8.0] * 8)
    spoiled = angles.copy()
    spoiled[4] += 0.5
    clean = film_angle(np.delete(angles, 4), np.delete(speeds, 4))
    assert film_angle(spoiled, speeds).value == pytest.approx(clean.value, abs=1e-3)


@pytest.mark.parametrize(('angles', 'reason'), [
    ([1.0, 1.0], '2 crossings'), ([1.0, math.nan, 1.0, 1.0], 'without positions'),
    ([0.2, 1.9, 3.0, 4.4, 5.8, 2.2], 'scatter')])
def test_an_unobservable_angle_is_refused_with_the_reason(angles, reason):
    with pytest.raises(EstimatorError, match=reason):
        film_angle(angles, [6.0] * len(angles))
