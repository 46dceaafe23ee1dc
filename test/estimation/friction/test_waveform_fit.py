"""The fit of a passage: unbiased, nearly as good as can be, and honest where it can not be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.friction.cramer_rao import friction_bound
from smart_tire.errors import EstimatorError
from smart_tire.estimation.contact.records import FilmSamples
from smart_tire.estimation.contact.trajectory_error import TrajectoryErrors
from smart_tire.estimation.friction.waveform_fit import SlipKnowledge, WaveformFitter
from smart_tire.estimation.friction.waveform_model import Own, Shared
from smart_tire.parameters import build, RobotParams
from support.passages import passage, WHEEL

pytestmark = pytest.mark.slow

KNOWN = 1e-6  # sigma of a slip that is true


def robot(**values):
    return build(RobotParams, {name.replace('_', '.', 1): value
                               for name, value in values.items()})


def fitter(robot, **options):
    return WaveformFitter(robot, robot.film.gains(WHEEL), robot.film.bending(WHEEL), **options)


def fits(robot, count, slip, *, seed=0, known=None, **options):
    """Return fits of ``count`` passages, with the slip known or not."""
    rng, one = np.random.default_rng(seed), fitter(robot)
    found = []
    for _ in range(count):
        seen = passage(rng, robot, slip=slip, **options)
        fit = one.fit(seen)
        found.append(fit if known is None else
                     one.fit(seen, SlipKnowledge((slip, known)), fit))
    return found


def columns(fits, which):
    return np.array([fit.shared(which) for fit in fits]).T


def spread(values):
    low, high = np.quantile(values, [0.25, 0.75])
    return (high - low) / 1.349


@pytest.mark.parametrize(('slip', 'sliding', 'rpm', 'noise', 'release'), [
    (0.05, 0.09, 60.0, 0.005, 'fig8'), (0.1, 0.18, 60.0, 0.005, 'fig8'),
    (0.2, 0.37, 80.0, 0.005, 'fig8'), (0.3, 0.55, 60.0, 0.01, 'fig8'),
    (0.1, 0.18, 60.0, 0.02, 'fig8'), (0.1, 0.85, 60.0, 0.005, 'fig8'),
    (0.1, 0.1, 60.0, 0.002, 'fig8'), (0.1, 0.18, 15.0, 0.005, 'fig8'),
    (0.15, 0.3, 200.0, 0.005, 'fig8'), (-0.1, 0.18, 60.0, 0.005, 'fig8'),
    (-0.25, 0.6, 80.0, 0.005, 'fig8'), (0.3, 1.4, 60.0, 0.005, 'fig8'),
    (0.1, 0.18, 60.0, 0.005, 'state'), (-0.1, 0.18, 60.0, 0.005, 'state')])
def test_with_the_true_slip_friction_is_unbiased_near_the_bound_and_its_sigma_holds(
        slip, sliding, rpm, noise, release):
    here = robot(film_noise=noise, film_release=release)
    value, sigma = columns(fits(here, 140, slip, sliding=sliding, rpm=rpm, known=KNOWN),
                           Shared.SLIDING)
    bound = friction_bound(here, WHEEL, slip=slip, sliding=sliding,
                           speed=rpm / 60.0 * 2.0 * np.pi * here.wheel_radius)
    assert bound < 0.1
    assert abs(np.median(value) / sliding - 1.0) < 0.02
    assert 0.75 * bound < spread(value) / sliding < 1.3 * bound
    assert 0.7 < np.mean(((value - sliding) / sigma)**2) < 1.4


@pytest.mark.parametrize(('slip', 'sliding'), [(0.03, 0.05), (0.1, 0.18), (0.3, 0.5),
                                               (-0.05, 0.1), (-0.2, 0.4), (0.0, 0.2)])
def test_films_alone_tell_the_slip_as_well_as_their_gains_are_known(slip, sliding):
    value, sigma = columns(fits(robot(), 120, slip, sliding=sliding), Shared.SLIP)
    assert abs(np.median(value) - slip) < 0.4 * np.median(sigma)
    assert 0.65 < np.mean(((value - slip) / sigma)**2) < 1.4
    assert np.median(sigma) < np.hypot(0.03 * slip, 0.0025)


@pytest.mark.parametrize('known', [0.002, 0.01])
def test_a_slip_that_is_known_badly_is_a_prior_and_no_more(known):
    here, rng, shifts = robot(), np.random.default_rng(5), []
    one = fitter(here)
    for _ in range(120):
        seen = passage(rng, here, slip=0.1, sliding=0.18)
        fit = one.fit(seen, SlipKnowledge((0.1 + known * rng.standard_normal(), known)))
        slip, sliding = fit.slip, fit.sliding
        shifts.append(((slip[0] - 0.1) / slip[1], (sliding[0] - 0.18) / sliding[1]))
    assert np.all(np.abs(np.mean(np.square(shifts), axis=0) - 1.0) < 0.4)


def test_noise_and_what_lasts_together_are_the_covariance():
    fit = fits(robot(), 1, 0.1, sliding=0.18, known=0.005)[0]
    assert fit.excess < 1.2
    both = [Shared.SLIP, Shared.SLIDING]
    np.testing.assert_allclose(
        fit.excess * fit.lasting + fit.noise, fit.covariance[np.ix_(both, both)], rtol=1e-6)


def test_gains_that_stay_the_same_make_errors_that_stay_the_same():
    here = robot()
    rng, one = np.random.default_rng(2), fitter(here)
    means, noises, lasting = [], [], 0.0
    for _ in range(40):
        gains = [gain * (1.0 + 0.03 * rng.standard_normal()) for gain in here.film.stretch_gain]
        true = robot(film_stretch_gain=tuple(gains))
        found = [one.fit(passage(rng, true, slip=0.1, sliding=0.18, gain_error=0.0))
                 for _ in range(8)]
        slips = np.array([fit.slip[0] for fit in found])
        means.append(slips.mean())
        noises.append(slips.var(ddof=1) / found[0].noise[0, 0])
        lasting = found[0].lasting[0, 0]
    assert np.mean(noises) == pytest.approx(1.0, abs=0.3)
    assert np.var(means) == pytest.approx(lasting, rel=0.6)


def test_a_small_slip_tells_nothing_of_friction_and_the_sigma_says_so():
    value, sigma = columns(fits(robot(), 100, 0.01, sliding=0.02, known=KNOWN), Shared.SLIDING)
    assert np.median(sigma) > 0.02
    assert np.mean(((value - 0.02) / sigma)**2) < 1.4
    assert abs(np.mean(value) - 0.02) < 0.3 * np.median(sigma)


def test_without_slip_the_sliding_is_not_told():
    value, sigma = columns(fits(robot(), 60, 0.0, sliding=0.2, known=0.001), Shared.SLIDING)
    assert np.median(sigma) > 0.3
    assert np.all(np.isfinite(value))


@pytest.mark.parametrize('sliding', [1.2, 2.0])
def test_beyond_the_critical_slip_a_known_slip_tells_friction_and_the_films_do_not(sliding):
    here = robot()
    value, sigma = columns(fits(here, 100, 0.4, sliding=sliding, known=0.005), Shared.SLIDING)
    assert abs(np.median(value) / sliding - 1.0) < 0.02
    assert 0.5 < np.mean(((value - sliding) / sigma)**2) < 1.4


@pytest.mark.parametrize(('slip', 'peak'), [(0.2, 1.55), (-0.2, 2.0)])
def test_clipped_peaks_bias_nothing(slip, peak):
    here = robot(film_bending_peak=(peak, 0.85 * peak))
    found = fits(here, 100, slip, sliding=0.37, known=KNOWN)
    rails = [np.abs(film.rail).sum() for fit in found for film in fit.passage.films]
    assert np.mean(rails) > 2.0
    value, sigma = columns(found, Shared.SLIDING)
    assert abs(np.median(value) / 0.37 - 1.0) < 0.02
    assert 0.5 < np.mean(((value - 0.37) / sigma)**2) < 1.4


def without(fit_passage, begin, end):
    """Return the passage without the samples between two distances: a lost batch."""
    films = []
    for one in fit_passage.films:
        kept = (one.distance < begin) | (one.distance > end)
        films.append(FilmSamples(one.film, one.distance[kept], one.volts[kept], one.rail[kept]))
    return replace(fit_passage, films=tuple(films))


@pytest.mark.parametrize(('begin', 'end'), [(-0.02, 0.002), (0.0, 0.022), (0.01, 0.032),
                                            (0.025, 0.047), (0.03, 0.09), (-0.01, 0.05)])
def test_a_lost_batch_makes_the_sigma_larger_and_the_value_no_worse_than_it(begin, end):
    here, rng = robot(), np.random.default_rng(3)
    one, found, whole = fitter(here), [], []
    for _ in range(100):
        seen = passage(rng, here, slip=0.1, sliding=0.18)
        for fits_, part in ((whole, seen), (found, without(seen, begin, end))):
            fits_.append(one.fit(part, SlipKnowledge((0.1, KNOWN))))
    value, sigma = columns(found, Shared.SLIDING)
    assert np.median(sigma) > 1.1 * np.median(columns(whole, Shared.SLIDING)[1])
    assert abs(np.median(value) / 0.18 - 1.0) < 0.02
    assert 0.6 < np.mean(((value - 0.18) / sigma)**2) < 1.4


def test_stray_samples_neither_move_the_fit_nor_blow_up_its_sigma():
    here, rng = robot(), np.random.default_rng(4)
    one, clean, stray = fitter(here), [], []
    for _ in range(60):
        seen = passage(rng, here, slip=0.1, sliding=0.18)
        clean.append(one.fit(seen, SlipKnowledge((0.1, KNOWN))))
        for film in seen.films:
            film.volts[rng.integers(0, len(film.volts), 3)] += rng.uniform(-0.8, 0.8, 3)
        stray.append(one.fit(seen, SlipKnowledge((0.1, KNOWN))))
    moved = columns(stray, Shared.SLIDING)[0] - columns(clean, Shared.SLIDING)[0]
    sigma = columns(stray, Shared.SLIDING)[1]
    assert np.median(np.abs(moved)) < 0.6 * np.median(sigma)
    assert np.median(sigma) < 1.5 * np.median(columns(clean, Shared.SLIDING)[1])


def test_two_grounds_in_one_passage_are_seen_to_fit_no_model():
    same = fits(robot(), 20, 0.1, sliding=0.18, known=KNOWN)
    both = fits(robot(), 20, 0.1, sliding=0.18, other_sliding=0.45, known=KNOWN)
    assert max(fit.excess for fit in same) < 1.5 < min(fit.excess for fit in both)
    assert (np.median(columns(both, Shared.SLIDING)[1])
            > 1.8 * np.median(columns(same, Shared.SLIDING)[1]))
    assert all(0.18 < fit.sliding[0] < 0.45 for fit in both)


@pytest.mark.parametrize('other', [0.18, 0.195])
def test_each_film_apart_tells_to_first_order_what_a_fit_of_it_alone_does(other):
    here, known, rng = robot(), SlipKnowledge((0.1, 0.001)), np.random.default_rng(19)
    for _ in range(15):
        one, seen = fitter(here), passage(rng, here, slip=0.1, sliding=0.18, other_sliding=other)
        joined = one.fit(seen, known)
        apart = one.apart(joined)
        for i, (value, sigma) in enumerate(apart):
            part = replace(seen, films=seen.films[i:i + 1], sightings=seen.sightings[i:i + 1])
            alone, alone_sigma = one.fit(part, known).sliding
            assert value == pytest.approx(alone, abs=0.5 * sigma)
            assert sigma == pytest.approx(alone_sigma, rel=0.3)
        with pytest.raises(EstimatorError, match='last fit'):
            one.apart(joined)


@pytest.mark.parametrize('length', [0.046, 0.05, 0.07])
def test_a_film_longer_than_the_patch_tells_friction_as_well(length):
    here = robot(film_length=length)
    value, sigma = columns(fits(here, 100, 0.15, sliding=0.3, known=KNOWN), Shared.SLIDING)
    assert abs(np.median(value) / 0.3 - 1.0) < 0.02
    assert 0.6 < np.mean(((value - 0.3) / sigma)**2) < 1.4


def test_a_slip_that_grows_in_the_passage_is_allowed_for():
    here, rng = robot(), np.random.default_rng(6)
    one, found = fitter(here), []
    for _ in range(100):
        seen = passage(rng, here, slip=0.1, sliding=0.18, growth=0.1 * rng.standard_normal())
        found.append(one.fit(seen, SlipKnowledge((0.1, KNOWN), (0.0, 0.01))))
    value, sigma = columns(found, Shared.SLIDING)
    assert 0.6 < np.mean(((value - 0.18) / sigma)**2) < 1.4


def test_a_sliding_share_that_grows_otherwise_than_the_slip_is_allowed_for():
    here, rng = robot(), np.random.default_rng(16)
    one, found = fitter(here), []
    for _ in range(100):
        seen = passage(rng, here, slip=0.1, sliding=0.18, growth=0.05,
                       spread=0.06 * rng.standard_normal())
        found.append(one.fit(seen, SlipKnowledge((0.1, KNOWN), (0.005, 1e-4), 0.0, 0.06)))
    value, sigma = columns(found, Shared.SLIDING)
    assert 0.6 < np.mean(((value - 0.18) / sigma)**2) < 1.4
    changes = np.array([fit.shared(Shared.SPREAD) for fit in found])
    assert np.median(changes[:, 1]) < 0.05  # the films tell as well


def test_a_fit_that_goes_on_from_another_ends_where_one_from_its_values_does():
    here, rng = robot(), np.random.default_rng(18)
    for _ in range(15):
        one, seen = fitter(here), passage(rng, here, slip=0.1, sliding=0.18)
        alone, known = one.fit(seen), SlipKnowledge((0.1, 0.002), (0.0, 0.001))
        onward, anew = one.fit(seen, known, alone), fitter(here).fit(seen, known, alone)
        for which in (Shared.SLIP, Shared.SLIDING):
            (value, sigma), (other, other_sigma) = onward.shared(which), anew.shared(which)
            assert value == pytest.approx(other, abs=0.1 * sigma)
            assert sigma == pytest.approx(other_sigma, rel=0.03)
        assert one.fit(seen).parameters == pytest.approx(alone.parameters)


def test_a_wrong_scale_of_the_distances_is_found_within_its_sigma():
    here = robot()
    found = fits(here, 60, 0.1, sliding=0.18, known=KNOWN, scale=0.01,
                 errors=TrajectoryErrors(0.01, (5e-5, 2e-5)))
    value, sigma = columns(found, Shared.SLIDING)
    assert abs(np.median(value) / 0.18 - 1.0) < 0.02
    assert np.median(sigma) < 1.2 * np.median(
        columns(fits(here, 60, 0.1, sliding=0.18, known=KNOWN), Shared.SLIDING)[1])
    assert np.median(columns(found, Shared.SCALE)[0]) == pytest.approx(-0.01, abs=0.002)


def test_gains_and_contact_length_are_told_when_they_are_asked_for():
    here, rng = robot(), np.random.default_rng(7)
    true = robot(tire_contact_length=0.0475, film_stretch_gain=(320.0, 230.0))
    one, lengths, gains = fitter(here, gain_sigma=0.5, length_sigma=0.1), [], []
    for _ in range(60):
        fit = one.fit(passage(rng, true, slip=0.15, sliding=0.3, gain_error=0.0),
                      SlipKnowledge((0.15, KNOWN)))
        lengths.append(fit.shared(Shared.LENGTH))
        gains.append([fit.own(i, Own.GAIN)[0] for i in range(2)])
    value, sigma = np.array(lengths).T
    assert 0.046 * np.exp(np.median(value)) == pytest.approx(0.0475, rel=0.003)
    assert np.mean(((value - np.log(0.0475 / 0.046)) / sigma)**2) < 2.0
    np.testing.assert_allclose(np.median(gains, axis=0), (320.0 / 307.5 - 1, 230.0 / 242.5 - 1),
                               atol=0.01)


@pytest.mark.parametrize('films', [(0,), (1,), (0, 1, 0)])
def test_any_number_of_films_is_fitted_together(films):
    value, sigma = columns(fits(robot(), 100, 0.1, sliding=0.18, known=KNOWN, films=films),
                           Shared.SLIDING)
    assert abs(np.median(value) / 0.18 - 1.0) < 0.02
    assert 0.6 < np.mean(((value - 0.18) / sigma)**2) < 1.4


def test_more_films_tell_more():
    one, two = (np.median(columns(fits(robot(), 30, 0.1, sliding=0.18, known=KNOWN, films=films),
                                  Shared.SLIDING)[1]) for films in ((0,), (0, 1)))
    assert two < 0.9 * one


def test_the_place_is_told_to_some_hundredths_of_a_millimetre():
    found = fits(robot(), 60, 0.1, sliding=0.18)
    for position in (0, 1):
        value, sigma = np.array([fit.own(position, Own.PLACE) for fit in found]).T
        assert np.mean(((value - 0.03 * position) / sigma)**2) < 1.5
        assert np.std(value - 0.03 * position) < 1e-4


def test_the_fitted_curve_is_as_near_the_samples_as_their_noise():
    here = robot()
    fit = fits(here, 1, 0.1, sliding=0.18)[0]
    curves = fitter(here).volts(fit)
    assert [len(curve) for curve in curves] == [len(one.volts) for one in fit.passage.films]
    for curve, one in zip(curves, fit.passage.films):
        assert np.std(one.volts - curve) == pytest.approx(0.005, rel=0.25)


def test_too_few_samples_are_no_fit():
    here = robot()
    seen = passage(np.random.default_rng(8), here, slip=0.1, sliding=0.18)
    assert fitter(here).fit(without(seen, -0.045, 1.0)) is None
