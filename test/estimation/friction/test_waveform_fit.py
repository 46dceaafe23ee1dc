# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Waveform fit of a crossing: unbiased, near the Cramer-Rao bound, with consistent sigmas."""

from dataclasses import replace

from benchmarks.friction.cramer_rao import friction_bound
import numpy as np
import pytest
from smart_tire.estimation.contact.records import FilmSamples, TrajectoryErrors
from smart_tire.estimation.friction.waveform_fit import (
    CrossingSlipPrior, WaveformFitter)
from smart_tire.estimation.friction.waveform_model import PerFilm, Shared
from smart_tire.parameters import build, RobotParams
from smart_tire.uncertain import Uncertain
from support.crossings import crossing_samples, known_shape, WHEEL

pytestmark = pytest.mark.slow

EXACT = 1e-6  # standard deviation of a prior with the true slip
USUAL = 0.1, 0.18, {}  # slip, normalized slip, options of ``fits``
USUAL_CASES = [
    USUAL, (0.05, 0.09, {}), (0.2, 0.37, {'rpm': 80.0}),
    (0.3, 0.55, {'robot': {'film.noise': 0.01}}), (0.1, 0.18, {'robot': {'film.noise': 0.02}}),
    (0.1, 0.85, {}), (0.1, 0.1, {'robot': {'film.noise': 0.002}}), (0.1, 0.18, {'rpm': 15.0}),
    (0.15, 0.3, {'rpm': 200.0}), (-0.1, 0.18, {}), (-0.25, 0.6, {'rpm': 80.0}), (0.3, 1.4, {}),
    (0.1, 0.18, {'robot': {'film.release': 'state'}}),
    (-0.1, 0.18, {'robot': {'film.release': 'state'}})]
BATCHES = [(-0.02, 0.002), (0.0, 0.022), (0.01, 0.032), (0.025, 0.047), (0.03, 0.09),
           (-0.01, 0.05)]  # m, that are lost
CLIPPED = [(0.2, 0.37, {'robot': {'film.bending_peak': (1.55, 0.85 * 1.55)}}),
           (-0.2, 0.37, {'robot': {'film.bending_peak': (2.0, 0.85 * 2.0)}})]
OTHER_CASES = [
    *CLIPPED, *((0.4, share, {'sigma': 0.005}) for share in (1.2, 2.0)),  # full sliding
    *((0.15, 0.3, {'robot': {'film.length': length}}) for length in (0.046, 0.05, 0.07)),
    *((0.1, 0.18, {'films': films}) for films in ((0,), (1,), (0, 1, 0))),
    *((0.1, 0.18, {'lost': batch}) for batch in BATCHES), (0.1, 0.18, {'change': 0.1})]
OWN_OPTIONS = 'robot', 'sigma', 'lost', 'change'  # of ``fits``; others are of the samples


def fitter(robot, **options):
    """Return a fitter that knows the shape of release and bumps."""
    return WaveformFitter(robot, robot.film.gains(WHEEL), robot.film.bending(WHEEL),
                          known_shape(), **options)


def fits(count, slip, normalized_slip, options, *, seed=0):
    """
    Return fits of crossings with a prior on slip of ``sigma``; None: of the films alone.

    ``change`` is the standard deviation of the relative change of slip in a contact length.
    """
    options = {'robot': {}, 'sigma': EXACT, 'lost': None, 'change': 0.0, **options}
    robot, sigma, lost, change = (options.pop(name) for name in OWN_OPTIONS)
    here, rng, found = build(RobotParams, robot), np.random.default_rng(seed), []
    one, prior = fitter(here), slip_prior(slip, sigma, change=Uncertain(0.0, change * abs(slip)))
    for _ in range(count):
        samples = crossing_samples(rng, here, slip=slip, normalized_slip=normalized_slip,
                                   growth=change * rng.standard_normal(), **options)
        samples = without(samples, *lost) if lost else samples
        fit = one.fit(samples)
        found.append(fit if sigma is None else one.fit(samples, prior, fit))
    return found


def without(samples, begin, end):
    """Return ``samples`` without those between two distances: a lost batch."""
    films = []
    for one in samples.films:
        kept = (one.distance < begin) | (one.distance > end)
        films.append(FilmSamples(one.film, one.distance[kept], one.volts[kept], one.rail[kept]))
    return replace(samples, films=tuple(films))


def slip_prior(slip, sigma, **options):
    return CrossingSlipPrior(Uncertain(slip, sigma), **options)


def columns(fits, which=Shared.NORM_SLIP):
    return np.array([fit.shared(which) for fit in fits]).T


def over(cases, few, many):
    """Return a decorator for ``few`` crossings of all cases together, and ``many`` of each."""
    return pytest.mark.parametrize(('cases', 'count'), [(cases, few), *(
        pytest.param([case], many, marks=pytest.mark.long) for case in cases)])


@over(USUAL_CASES, 10, 140)
def test_with_the_true_slip_the_fit_is_unbiased_near_the_bound_and_consistent(cases, count):
    relative, over_bound, over_sigma = [], [], []
    for slip, true, options in cases:
        value, sigma = columns(fits(count, slip, true, options))
        here = build(RobotParams, options.get('robot', {}))
        bound = friction_bound(here, WHEEL, slip=slip, normalized_slip=true, speed=options.get(
            'rpm', 60.0) / 60.0 * 2.0 * np.pi * here.wheel_radius)
        relative += (value / true - 1.0).tolist()
        over_bound += ((value / true - 1.0) / bound).tolist()
        over_sigma += ((value - true) / sigma).tolist()
    assert abs(np.median(relative)) < 0.02
    low, high = np.quantile(over_bound, [0.25, 0.75])
    assert 0.75 < (high - low) / 1.349 < 1.3
    assert 0.7 < np.mean(np.square(over_sigma)) < 1.4


@over(OTHER_CASES, 8, 200)
def test_in_other_conditions_it_is_unbiased_and_consistent(cases, count):
    relative, over_sigma = [], []
    for slip, true, options in cases:
        value, sigma = columns(fits(count, slip, true, options, seed=3))
        relative += (value / true - 1.0).tolist()
        over_sigma += ((value - true) / sigma).tolist()
    assert abs(np.median(relative)) < 0.02
    assert (0.5 if len(cases) == 1 else 0.7) < np.mean(np.square(over_sigma)) < 1.4


@over([(slip, true, {'sigma': None}) for slip, true in (
    (0.03, 0.05), (0.1, 0.18), (0.3, 0.5), (-0.05, 0.1), (-0.2, 0.4), (0.0, 0.2))], 20, 120)
def test_the_films_alone_determine_slip_within_the_gain_tolerance(cases, count):
    errors = []
    for case in cases:
        value, sigma = columns(fits(count, *case), Shared.SLIP)
        assert np.median(sigma) < np.hypot(0.03 * case[0], 0.0025)
        errors += ((value - case[0]) / sigma).tolist()
    assert abs(np.median(errors)) < 0.4
    assert 0.65 < np.mean(np.square(errors)) < 1.4


@pytest.mark.parametrize('sigma', [0.002, pytest.param(0.01, marks=pytest.mark.long)])
def test_an_uncertain_slip_is_used_as_a_prior_with_its_sigma(sigma):
    here, rng, errors = RobotParams(), np.random.default_rng(5), []
    one = fitter(here)
    for _ in range(120):
        samples = crossing_samples(rng, here, slip=0.1, normalized_slip=0.18)
        fit = one.fit(samples, slip_prior(0.1 + sigma * rng.standard_normal(), sigma))
        slip, normalized_slip = fit.slip, fit.normalized_slip
        errors.append(((slip.value - 0.1) / slip.sigma,
                       (normalized_slip.value - 0.18) / normalized_slip.sigma))
    assert np.all(np.abs(np.mean(np.square(errors), axis=0) - 1.0) < 0.4)


def test_white_and_systematic_covariance_add_up_to_the_covariance():
    fit = fits(1, 0.1, 0.18, {'sigma': 0.005})[0]
    assert fit.excess < 1.2
    both = [Shared.SLIP, Shared.NORM_SLIP]
    np.testing.assert_allclose(
        fit.excess * fit.systematic_cov + fit.white_cov, fit.covariance[np.ix_(both, both)],
        rtol=1e-6)


def test_the_systematic_covariance_is_that_of_constant_gain_errors():
    one, gains = fitter(RobotParams()), np.array(RobotParams().film.stretch_gain)

    def fitted(errors):
        rng, true = np.random.default_rng(2), build(RobotParams, {
            'film.stretch_gain': (gains * (1.0 + np.array(errors))).tolist()})
        return [one.fit(crossing_samples(rng, true, slip=0.1, normalized_slip=0.18,
                                         gain_error=0.0)) for _ in range(6)]

    right, *wrong = (np.mean([fit.slip.value for fit in fitted(errors)])
                     for errors in ((0.0, 0.0), (0.03, 0.0), (0.0, 0.03)))
    assert fitted((0.0, 0.0))[0].systematic_cov[0, 0] == pytest.approx(
        sum((other - right)**2 for other in wrong), rel=0.1)


def test_without_slip_normalized_slip_is_not_observable():
    value, sigma = columns(fits(10, 0.0, 0.2, {'sigma': 0.001}))
    assert np.median(sigma) > 0.3
    assert np.all(np.isfinite(value))


@pytest.mark.parametrize(('slip', 'normalized_slip', 'options'), CLIPPED)
def test_peaks_are_clipped(slip, normalized_slip, options):
    rails = [np.abs(film.rail).sum() for fit in fits(10, slip, normalized_slip, options)
             for film in fit.samples.films]
    assert np.mean(rails) > 2.0


@pytest.mark.parametrize('batch', BATCHES)
def test_a_lost_batch_increases_the_sigma(batch):
    part, whole = (columns(fits(6, 0.1, 0.18, {'lost': lost}))[1] for lost in (batch, None))
    assert np.median(part) > 1.1 * np.median(whole)


def test_outliers_hardly_change_the_fit_and_its_sigma():
    here, rng = RobotParams(), np.random.default_rng(4)
    one, clean, spoiled = fitter(here), [], []
    for _ in range(20):
        samples = crossing_samples(rng, here, slip=0.1, normalized_slip=0.18)
        clean.append(one.fit(samples, slip_prior(0.1, EXACT)))
        for film in samples.films:
            film.volts[rng.integers(0, len(film.volts), 3)] += rng.uniform(-0.8, 0.8, 3)
        spoiled.append(one.fit(samples, slip_prior(0.1, EXACT)))
    (value, sigma), (expected, least) = columns(spoiled), columns(clean)
    assert np.median(np.abs(value - expected)) < 0.6 * np.median(sigma)
    assert np.median(sigma) < 1.5 * np.median(least)


def test_two_surfaces_in_one_crossing_have_a_large_residual():
    same, both = (fits(8, 0.1, 0.18, {'other_normalized_slip': other}) for other in (None, 0.45))
    assert max(fit.excess for fit in same) < 1.5 < min(fit.excess for fit in both)
    assert np.median(columns(both)[1]) > 1.8 * np.median(columns(same)[1])
    assert all(0.18 < fit.normalized_slip.value < 0.45 for fit in both)


def test_a_continued_fit_converges_to_the_result_of_one_from_the_same_start():
    here, rng = RobotParams(), np.random.default_rng(18)
    for _ in range(5):
        one, samples = fitter(here), crossing_samples(rng, here, slip=0.1, normalized_slip=0.18)
        first, prior = one.fit(samples), slip_prior(0.1, 0.002, change=Uncertain(0.0, 0.001))
        continued, restarted = (own.fit(samples, prior, first) for own in (one, fitter(here)))
        for which in (Shared.SLIP, Shared.NORM_SLIP):
            (value, sigma), (other, other_sigma) = continued.shared(which), restarted.shared(which)
            assert value == pytest.approx(other, abs=0.1 * sigma)
            assert sigma == pytest.approx(other_sigma, rel=0.03)
        assert one.fit(samples).parameters == pytest.approx(first.parameters)


def test_a_scale_error_of_the_distances_is_estimated():
    found = fits(30, 0.1, 0.18, {'scale': 0.01, 'errors': TrajectoryErrors(0.01, (5e-5, 2e-5))})
    value, sigma = columns(found)
    assert abs(np.median(value) / 0.18 - 1.0) < 0.02
    assert np.median(sigma) < 1.2 * np.median(columns(fits(10, *USUAL))[1])
    assert np.median(columns(found, Shared.SCALE)[0]) == pytest.approx(-0.01, abs=0.002)


def test_gains_and_contact_length_are_estimated_with_wide_priors():
    rng, true = np.random.default_rng(7), build(RobotParams, {
        'tire.contact_length': 0.0475, 'film.stretch_gain': (320.0, 230.0)})
    one, lengths, gains = fitter(RobotParams(), gain_sigma=0.5, length_sigma=0.1), [], []
    for _ in range(40):
        fit = one.fit(crossing_samples(
            rng, true, slip=0.15, normalized_slip=0.3, gain_error=0.0), slip_prior(0.15, EXACT))
        lengths.append(fit.shared(Shared.LENGTH))
        gains.append([fit.film_parameter(i, PerFilm.GAIN).value for i in range(2)])
    value, sigma = np.array(lengths).T
    assert 0.046 * np.exp(np.median(value)) == pytest.approx(0.0475, rel=0.003)
    assert np.mean(((value - np.log(0.0475 / 0.046)) / sigma)**2) < 2.0
    np.testing.assert_allclose(np.median(gains, axis=0), (320.0 / 307.5 - 1, 230.0 / 242.5 - 1),
                               atol=0.01)


def test_the_center_is_estimated_to_some_hundredths_of_a_millimeter_and_noise_remains():
    found = fits(40, 0.1, 0.18, {'sigma': None})
    for position in (0, 1):
        value, sigma = np.array([fit.film_parameter(position, PerFilm.CENTER) for fit in found]).T
        assert np.mean(((value - 0.03 * position) / sigma)**2) < 1.5
        assert np.std(value - 0.03 * position) < 1e-4
    curves = fitter(RobotParams()).volts(found[0])
    for curve, one in zip(curves, found[0].samples.films, strict=True):
        assert np.std(one.volts - curve) == pytest.approx(0.005, rel=0.25)


def test_too_few_samples_are_not_fitted():
    samples = crossing_samples(
        np.random.default_rng(8), RobotParams(), slip=0.1, normalized_slip=0.18)
    assert fitter(RobotParams()).fit(without(samples, -0.045, 1.0)) is None
