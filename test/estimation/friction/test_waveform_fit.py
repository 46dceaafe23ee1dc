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

from __future__ import annotations

from dataclasses import replace

from benchmarks.friction.cramer_rao import friction_bound
import numpy as np
import pytest
from smart_tire.estimation.contact.records import FilmSamples
from smart_tire.estimation.contact.records import TrajectoryErrors
from smart_tire.estimation.friction.waveform_fit import (
    CrossingSlipPrior, WaveformFitter)
from smart_tire.estimation.friction.waveform_model import PerFilm, Shared
from smart_tire.parameters import build, RobotParams
from smart_tire.uncertain import Uncertain
from support.crossings import crossing_samples, known_shape, WHEEL

pytestmark = pytest.mark.slow

EXACT = 1e-6  # standard deviation of a prior with the true slip


def robot(**values):
    return build(RobotParams, {name.replace('_', '.', 1): value
                               for name, value in values.items()})


def fitter(robot, **options):
    """Return a fitter that knows the shape of release and bumps."""
    return WaveformFitter(robot, robot.film.gains(WHEEL), robot.film.bending(WHEEL),
                          known_shape(), **options)


def fits(robot, count, slip, normalized_slip, *, seed=0, sigma=None, **options):
    """Return fits of ``count`` crossings, with a prior on slip of this ``sigma`` or without."""
    rng, one = np.random.default_rng(seed), fitter(robot)
    found = []
    for _ in range(count):
        samples = crossing_samples(
            rng, robot, slip=slip, normalized_slip=normalized_slip, **options)
        fit = one.fit(samples)
        found.append(fit if sigma is None else one.fit(samples, slip_prior(slip, sigma), fit))
    return found


def slip_prior(slip, sigma, **options):
    return CrossingSlipPrior(Uncertain(slip, sigma), **options)


def columns(fits, which):
    return np.array([fit.shared(which) for fit in fits]).T


def spread(values):
    low, high = np.quantile(values, [0.25, 0.75])
    return (high - low) / 1.349


@pytest.mark.parametrize(('slip', 'normalized_slip', 'rpm', 'noise', 'release'), [
    (0.05, 0.09, 60.0, 0.005, 'fig8'), (0.1, 0.18, 60.0, 0.005, 'fig8'),
    (0.2, 0.37, 80.0, 0.005, 'fig8'), (0.3, 0.55, 60.0, 0.01, 'fig8'),
    (0.1, 0.18, 60.0, 0.02, 'fig8'), (0.1, 0.85, 60.0, 0.005, 'fig8'),
    (0.1, 0.1, 60.0, 0.002, 'fig8'), (0.1, 0.18, 15.0, 0.005, 'fig8'),
    (0.15, 0.3, 200.0, 0.005, 'fig8'), (-0.1, 0.18, 60.0, 0.005, 'fig8'),
    (-0.25, 0.6, 80.0, 0.005, 'fig8'), (0.3, 1.4, 60.0, 0.005, 'fig8'),
    (0.1, 0.18, 60.0, 0.005, 'state'), (-0.1, 0.18, 60.0, 0.005, 'state')])
def test_with_the_true_slip_the_fit_is_unbiased_near_the_bound_and_consistent(
        slip, normalized_slip, rpm, noise, release):
    here = robot(film_noise=noise, film_release=release)
    value, sigma = columns(fits(here, 140, slip, normalized_slip, rpm=rpm, sigma=EXACT),
                           Shared.NORM_SLIP)
    bound = friction_bound(here, WHEEL, slip=slip, normalized_slip=normalized_slip,
                           speed=rpm / 60.0 * 2.0 * np.pi * here.wheel_radius)
    assert bound < 0.1
    assert abs(np.median(value) / normalized_slip - 1.0) < 0.02
    assert 0.75 * bound < spread(value) / normalized_slip < 1.3 * bound
    assert 0.7 < np.mean(((value - normalized_slip) / sigma)**2) < 1.4


@pytest.mark.parametrize(('slip', 'normalized_slip'), [(0.03, 0.05), (0.1, 0.18), (0.3, 0.5),
                                                       (-0.05, 0.1), (-0.2, 0.4), (0.0, 0.2)])
def test_the_films_alone_determine_slip_within_the_gain_tolerance(slip, normalized_slip):
    value, sigma = columns(fits(robot(), 120, slip, normalized_slip), Shared.SLIP)
    assert abs(np.median(value) - slip) < 0.4 * np.median(sigma)
    assert 0.65 < np.mean(((value - slip) / sigma)**2) < 1.4
    assert np.median(sigma) < np.hypot(0.03 * slip, 0.0025)


@pytest.mark.parametrize('sigma', [0.002, 0.01])
def test_an_uncertain_slip_is_used_as_a_prior_with_its_sigma(sigma):
    here, rng, errors = robot(), np.random.default_rng(5), []
    one = fitter(here)
    for _ in range(120):
        samples = crossing_samples(rng, here, slip=0.1, normalized_slip=0.18)
        fit = one.fit(samples, slip_prior(0.1 + sigma * rng.standard_normal(), sigma))
        slip, normalized_slip = fit.slip, fit.normalized_slip
        errors.append(((slip.value - 0.1) / slip.sigma,
                       (normalized_slip.value - 0.18) / normalized_slip.sigma))
    assert np.all(np.abs(np.mean(np.square(errors), axis=0) - 1.0) < 0.4)


def test_white_and_systematic_covariance_add_up_to_the_covariance():
    fit = fits(robot(), 1, 0.1, 0.18, sigma=0.005)[0]
    assert fit.excess < 1.2
    both = [Shared.SLIP, Shared.NORM_SLIP]
    np.testing.assert_allclose(
        fit.excess * fit.systematic_cov + fit.white_cov, fit.covariance[np.ix_(both, both)],
        rtol=1e-6)


def test_the_systematic_covariance_is_that_of_constant_gain_errors():
    here = robot()
    rng, one = np.random.default_rng(2), fitter(here)
    means, white_ratios, systematic = [], [], 0.0
    for _ in range(40):
        gains = [gain * (1.0 + 0.03 * rng.standard_normal()) for gain in here.film.stretch_gain]
        true = robot(film_stretch_gain=tuple(gains))
        found = [one.fit(crossing_samples(
            rng, true, slip=0.1, normalized_slip=0.18, gain_error=0.0)) for _ in range(8)]
        slips = np.array([fit.slip.value for fit in found])
        means.append(slips.mean())
        white_ratios.append(slips.var(ddof=1) / found[0].white_cov[0, 0])
        systematic = found[0].systematic_cov[0, 0]
    assert np.mean(white_ratios) == pytest.approx(1.0, abs=0.3)
    assert np.var(means) == pytest.approx(systematic, rel=0.6)


def test_without_slip_normalized_slip_is_not_observable():
    value, sigma = columns(fits(robot(), 60, 0.0, 0.2, sigma=0.001), Shared.NORM_SLIP)
    assert np.median(sigma) > 0.3
    assert np.all(np.isfinite(value))


@pytest.mark.parametrize('normalized_slip', [1.2, 2.0])
def test_above_the_critical_slip_a_slip_estimate_determines_normalized_slip(normalized_slip):
    here = robot()
    value, sigma = columns(fits(here, 100, 0.4, normalized_slip, sigma=0.005), Shared.NORM_SLIP)
    assert abs(np.median(value) / normalized_slip - 1.0) < 0.02
    assert 0.5 < np.mean(((value - normalized_slip) / sigma)**2) < 1.4


@pytest.mark.parametrize(('slip', 'peak'), [(0.2, 1.55), (-0.2, 2.0)])
def test_clipped_peaks_do_not_bias_the_fit(slip, peak):
    here = robot(film_bending_peak=(peak, 0.85 * peak))
    found = fits(here, 100, slip, 0.37, sigma=EXACT)
    rails = [np.abs(film.rail).sum() for fit in found for film in fit.samples.films]
    assert np.mean(rails) > 2.0
    value, sigma = columns(found, Shared.NORM_SLIP)
    assert abs(np.median(value) / 0.37 - 1.0) < 0.02
    assert 0.5 < np.mean(((value - 0.37) / sigma)**2) < 1.4


def without(samples, begin, end):
    """Return ``samples`` without those between two distances: a lost batch."""
    films = []
    for one in samples.films:
        kept = (one.distance < begin) | (one.distance > end)
        films.append(FilmSamples(one.film, one.distance[kept], one.volts[kept], one.rail[kept]))
    return replace(samples, films=tuple(films))


@pytest.mark.parametrize(('begin', 'end'), [(-0.02, 0.002), (0.0, 0.022), (0.01, 0.032),
                                            (0.025, 0.047), (0.03, 0.09), (-0.01, 0.05)])
def test_a_lost_batch_increases_the_sigma_consistently(begin, end):
    here, rng = robot(), np.random.default_rng(3)
    one, found, whole = fitter(here), [], []
    for _ in range(100):
        samples = crossing_samples(rng, here, slip=0.1, normalized_slip=0.18)
        for fits_, part in ((whole, samples), (found, without(samples, begin, end))):
            fits_.append(one.fit(part, slip_prior(0.1, EXACT)))
    value, sigma = columns(found, Shared.NORM_SLIP)
    assert np.median(sigma) > 1.1 * np.median(columns(whole, Shared.NORM_SLIP)[1])
    assert abs(np.median(value) / 0.18 - 1.0) < 0.02
    assert 0.6 < np.mean(((value - 0.18) / sigma)**2) < 1.4


def test_outliers_hardly_change_the_fit_and_its_sigma():
    here, rng = robot(), np.random.default_rng(4)
    one, clean, spoiled = fitter(here), [], []
    for _ in range(60):
        samples = crossing_samples(rng, here, slip=0.1, normalized_slip=0.18)
        clean.append(one.fit(samples, slip_prior(0.1, EXACT)))
        for film in samples.films:
            film.volts[rng.integers(0, len(film.volts), 3)] += rng.uniform(-0.8, 0.8, 3)
        spoiled.append(one.fit(samples, slip_prior(0.1, EXACT)))
    moved = columns(spoiled, Shared.NORM_SLIP)[0] - columns(clean, Shared.NORM_SLIP)[0]
    sigma = columns(spoiled, Shared.NORM_SLIP)[1]
    assert np.median(np.abs(moved)) < 0.6 * np.median(sigma)
    assert np.median(sigma) < 1.5 * np.median(columns(clean, Shared.NORM_SLIP)[1])


def test_two_surfaces_in_one_crossing_have_a_large_residual():
    same = fits(robot(), 20, 0.1, 0.18, sigma=EXACT)
    both = fits(robot(), 20, 0.1, 0.18, other_normalized_slip=0.45, sigma=EXACT)
    assert max(fit.excess for fit in same) < 1.5 < min(fit.excess for fit in both)
    assert (np.median(columns(both, Shared.NORM_SLIP)[1])
            > 1.8 * np.median(columns(same, Shared.NORM_SLIP)[1]))
    assert all(0.18 < fit.normalized_slip.value < 0.45 for fit in both)


@pytest.mark.parametrize('length', [0.046, 0.05, 0.07])
def test_a_film_longer_than_the_patch_determines_normalized_slip(length):
    here = robot(film_length=length)
    value, sigma = columns(fits(here, 100, 0.15, 0.3, sigma=EXACT), Shared.NORM_SLIP)
    assert abs(np.median(value) / 0.3 - 1.0) < 0.02
    assert 0.6 < np.mean(((value - 0.3) / sigma)**2) < 1.4


def test_a_change_of_slip_within_the_prior_does_not_bias_the_fit():
    here, rng = robot(), np.random.default_rng(6)
    one, found = fitter(here), []
    for _ in range(100):
        samples = crossing_samples(rng, here, slip=0.1, normalized_slip=0.18,
                                   growth=0.1 * rng.standard_normal())
        found.append(one.fit(samples, slip_prior(0.1, EXACT, change=Uncertain(0.0, 0.01))))
    value, sigma = columns(found, Shared.NORM_SLIP)
    assert 0.6 < np.mean(((value - 0.18) / sigma)**2) < 1.4


def test_a_continued_fit_converges_to_the_result_of_one_from_the_same_start():
    here, rng = robot(), np.random.default_rng(18)
    for _ in range(15):
        one, samples = fitter(here), crossing_samples(rng, here, slip=0.1, normalized_slip=0.18)
        first, prior = one.fit(samples), slip_prior(0.1, 0.002, change=Uncertain(0.0, 0.001))
        continued, restarted = (own.fit(samples, prior, first) for own in (one, fitter(here)))
        for which in (Shared.SLIP, Shared.NORM_SLIP):
            (value, sigma), (other, other_sigma) = continued.shared(which), restarted.shared(which)
            assert value == pytest.approx(other, abs=0.1 * sigma)
            assert sigma == pytest.approx(other_sigma, rel=0.03)
        assert one.fit(samples).parameters == pytest.approx(first.parameters)


def test_a_scale_error_of_the_distances_is_estimated():
    here = robot()
    found = fits(here, 60, 0.1, 0.18, sigma=EXACT, scale=0.01,
                 errors=TrajectoryErrors(0.01, (5e-5, 2e-5)))
    value, sigma = columns(found, Shared.NORM_SLIP)
    assert abs(np.median(value) / 0.18 - 1.0) < 0.02
    assert np.median(sigma) < 1.2 * np.median(
        columns(fits(here, 60, 0.1, 0.18, sigma=EXACT), Shared.NORM_SLIP)[1])
    assert np.median(columns(found, Shared.SCALE)[0]) == pytest.approx(-0.01, abs=0.002)


def test_gains_and_contact_length_are_estimated_with_wide_priors():
    here, rng = robot(), np.random.default_rng(7)
    true = robot(tire_contact_length=0.0475, film_stretch_gain=(320.0, 230.0))
    one, lengths, gains = fitter(here, gain_sigma=0.5, length_sigma=0.1), [], []
    for _ in range(60):
        fit = one.fit(crossing_samples(
            rng, true, slip=0.15, normalized_slip=0.3, gain_error=0.0), slip_prior(0.15, EXACT))
        lengths.append(fit.shared(Shared.LENGTH))
        gains.append([fit.film_parameter(i, PerFilm.GAIN).value for i in range(2)])
    value, sigma = np.array(lengths).T
    assert 0.046 * np.exp(np.median(value)) == pytest.approx(0.0475, rel=0.003)
    assert np.mean(((value - np.log(0.0475 / 0.046)) / sigma)**2) < 2.0
    np.testing.assert_allclose(np.median(gains, axis=0), (320.0 / 307.5 - 1, 230.0 / 242.5 - 1),
                               atol=0.01)


@pytest.mark.parametrize('films', [(0,), (1,), (0, 1, 0)])
def test_any_number_of_films_is_fitted_jointly(films):
    value, sigma = columns(fits(robot(), 100, 0.1, 0.18, sigma=EXACT, films=films),
                           Shared.NORM_SLIP)
    assert abs(np.median(value) / 0.18 - 1.0) < 0.02
    assert 0.6 < np.mean(((value - 0.18) / sigma)**2) < 1.4


def test_the_center_is_estimated_to_some_hundredths_of_a_millimeter():
    found = fits(robot(), 60, 0.1, 0.18)
    for position in (0, 1):
        value, sigma = np.array([fit.film_parameter(position, PerFilm.CENTER) for fit in found]).T
        assert np.mean(((value - 0.03 * position) / sigma)**2) < 1.5
        assert np.std(value - 0.03 * position) < 1e-4


def test_the_residuals_of_the_fitted_curve_are_those_of_the_noise():
    here = robot()
    fit = fits(here, 1, 0.1, 0.18)[0]
    curves = fitter(here).volts(fit)
    assert [len(curve) for curve in curves] == [len(one.volts) for one in fit.samples.films]
    for curve, one in zip(curves, fit.samples.films):
        assert np.std(one.volts - curve) == pytest.approx(0.005, rel=0.25)


def test_too_few_samples_are_not_fitted():
    here = robot()
    samples = crossing_samples(np.random.default_rng(8), here, slip=0.1, normalized_slip=0.18)
    assert fitter(here).fit(without(samples, -0.045, 1.0)) is None
