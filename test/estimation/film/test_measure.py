"""Deflection from charge: accuracy, honesty of sigma, and what no film can have felt."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.film_bench import RATE, several_loops, TRUE

from smart_tire.calibration.bench.film_parameters import identify_film
from smart_tire.errors import ParameterError
from smart_tire.estimation.film.film_file import FilmParams
from smart_tire.estimation.film.measure import measure
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.simulation.film_test_stand import FilmTestStand, ramps, sine

pytestmark = pytest.mark.slow

FILM = FILMS['25x3']
EXACT = FilmParams(film=FILM, covariance=np.zeros((5, 5)), low_corner=0.0, drift=0.0, span=1.0,
                   noise=0.0, misfit=0.0, **TRUE)
QUIET = FilmTestStand(rate=1000.0, low_corner=0.0, high_corner=1e6, charge_noise=0.0, bits=32)
MICRON = 1e-6  # m


@pytest.fixture(scope='module')
def identified():
    return identify_film(several_loops(), FILM)[0]


@cache
def run(top, frequency, duration, seed):
    """Return the motion of a bench and its recording."""
    moved = sine(top, frequency, duration, RATE)
    return moved, FilmTestStand(rate=RATE).run(moved, seed)


def rested(motion):
    """Return a motion that begins with the film at rest, as a zeroed sensor does."""
    return np.concatenate([np.zeros(100), motion])


def test_with_true_parameters_and_no_noise_the_deflection_comes_back():
    moved = rested(sine(0.012, 1.0, 3.0, 1000.0))
    recording = QUIET.run(moved, 1)
    result = measure(recording.time, recording.output, EXACT)
    assert result.told == moved.size
    np.testing.assert_allclose(result.value, moved, rtol=0.0, atol=20.0 * MICRON)


@pytest.mark.parametrize('top, frequency', [
    (0.012, 1.0), (0.012, 5.0), (0.006, 10.0), (0.002, 2.0), (0.0005, 5.0)])
def test_an_identified_film_measures_within_its_sigma(identified, top, frequency):
    moved = rested(sine(top, frequency, 3.0, RATE))
    recording = FilmTestStand(rate=RATE).run(moved, 11)
    result = measure(recording.time, recording.output, identified)
    error = result.value - moved
    assert np.sqrt(np.mean(error**2)) < 70.0 * MICRON
    assert np.mean(np.abs(error) <= 2.0 * result.sigma) > 0.9
    assert np.median(result.sigma) < 120.0 * MICRON


@pytest.mark.parametrize('learnt', [
    (0.006, 2.0, 10.0), (0.012, 5.0, 5.0), (0.002, 3.0, 20.0), (0.012, 1.0, 100.0)])
def test_sigma_is_honest_over_motions_durations_and_seeds(learnt):
    pulls, inside = [], []
    others = [learnt, (0.006, 2.0, 10.0), (0.0005, 5.0, 5.0), (0.002, 10.0, 20.0),
              (0.012, 1.0, 60.0)]
    for seed in range(6):
        params = identify_film(run(*learnt, seed)[1], FILM)[0]
        for number, motion in enumerate(others):
            moved, recording = run(*motion, seed if number == 0 else 100 + seed)
            result = measure(recording.time, recording.output, params)
            told = np.isfinite(result.value)
            pull = ((result.value - moved) / result.sigma)[told]
            pulls.append(np.mean(pull**2))
            inside.append(np.mean(np.abs(pull) <= 2.0))
    assert np.mean(inside) > 0.9
    assert 0.3 < np.sqrt(np.mean(pulls)) < 1.3


def test_a_loop_that_is_too_small_is_honest_in_its_range_and_tells_nothing_beyond():
    small, large = sine(0.0005, 5.0, 5.0, RATE), sine(0.012, 2.0, 5.0, RATE)
    refused = 0
    for seed in range(8):
        own = FilmTestStand(rate=RATE).run(small, seed)
        params = identify_film(own, FILM)[0]
        try:
            result = measure(own.time, own.output, params)
        except ParameterError:  # operators within one sigma have no inverse
            refused += 1
            continue
        assert np.mean(np.abs(result.value - small) <= 2.0 * result.sigma) > 0.9
        other = FilmTestStand(rate=RATE).run(large, 100 + seed)
        result = measure(other.time, other.output, params)
        assert np.nanmax(result.value) < 0.001 and result.told < 0.05 * large.size
    assert refused < 8


def test_an_amplifier_that_can_not_be_told_from_a_drift_makes_sigma_grow():
    recording = FilmTestStand().run(sine(0.006, 2.0, 10.0, 1000.0), 1)
    params, fit, notes = identify_film(recording, FILM)
    assert any('not determined: low_corner' in note for note in notes)
    assert fit.low_corner.sigma > 0.5 * 0.001
    own = measure(recording.time, recording.output, params)
    # what both do to the same motion is known, to another motion it is not
    assert np.median(own.sigma) < 50.0 * MICRON
    assert np.mean(np.abs(own.value - recording.input) <= 2.0 * own.sigma) > 0.9
    other = FilmTestStand(rate=RATE).run(sine(0.002, 2.0, 40.0, RATE), 2)
    sigma = measure(other.time, other.output, params).sigma
    assert np.median(sigma[-2000:]) > 3.0 * np.median(sigma[:2000])


def test_without_the_inverse_the_same_film_is_off_by_far_more(identified):
    moved = rested(sine(0.012, 2.0, 3.0, RATE))
    recording = FilmTestStand(rate=RATE).run(moved, 12)
    result = measure(recording.time, recording.output, identified)
    straight = np.polyval(np.polyfit(recording.output, moved, 3), recording.output)
    assert np.std(straight - moved) > 20.0 * np.std(result.value - moved)


def test_corners_and_minor_loops_are_followed(identified):
    moved = rested(ramps([0.01, 0.004, 0.007, 0.002, 0.009, 0.0], 0.02, RATE))
    recording = FilmTestStand(rate=RATE).run(moved, 13)
    result = measure(recording.time, recording.output, identified)
    # corners can not be smoothed, so the noise stays
    assert np.sqrt(np.mean((result.value - moved)**2)) < 200.0 * MICRON
    assert np.mean(np.abs(result.value - moved) <= 2.0 * result.sigma) > 0.9


def test_uncertain_parameters_make_sigma_larger(identified):
    recording = several_loops()
    sure, unsure = (measure(recording.time, recording.output, replace(
        identified, covariance=scale * identified.covariance)) for scale in (1.0, 400.0))
    assert np.median(unsure.sigma) > 2.0 * np.median(sure.sigma)


def test_the_zero_of_a_used_film_is_unknown(identified):
    recording = several_loops()
    fresh, used = (measure(recording.time, recording.output, identified, used=used)
                   for used in (False, True))
    np.testing.assert_array_equal(used.value, fresh.value)
    assert np.nanmedian(used.sigma) > 10.0 * np.nanmedian(fresh.sigma)


def test_charges_that_no_buckled_film_gives_are_not_told(identified):
    recording = several_loops()
    for wrong in (3e-9, -30e-9):
        charge = recording.output.copy()
        charge[2000:2100] += wrong
        result = measure(recording.time, charge, identified)
        assert np.isnan(result.value[2020:2080]).any()
        np.testing.assert_array_equal(np.isnan(result.value), np.isinf(result.sigma))


def test_a_film_without_geometry_measures_the_input_of_its_operator(identified):
    recording = several_loops()
    raw = measure(recording.time, recording.output, replace(identified, film=None))
    v = FILM.normalised_charge(np.maximum(recording.input, 0.0))
    assert np.std(raw.value - v) < 5e-3
    assert raw.told == v.size


@pytest.mark.parametrize('change, why', [
    ({'b_gain': 0.4 * TRUE['a_gain']}, 'a > b >= a / 2'),
    ({'covariance': np.diag([0.0, (0.5 * TRUE['a_gain'])**2, 0.0, 0.0, 0.0])}, 'too uncertain')])
def test_an_operator_without_inverse_is_refused(change, why):
    recording = several_loops()
    with pytest.raises(ParameterError, match=why):
        measure(recording.time, recording.output, replace(EXACT, **change))


@pytest.mark.parametrize('row, time, charge, why', [
    (50, None, np.nan, r'charge\[50\] is nan'), (50, 0.0, None, r'time\[50\] is 0.0 after')])
def test_a_broken_series_is_refused(row, time, charge, why):
    recording = several_loops()
    times, charges = recording.time.copy(), recording.output.copy()
    times[row] = times[row] if time is None else time
    charges[row] = charges[row] if charge is None else charge
    with pytest.raises(ParameterError, match=why):
        measure(times, charges, EXACT)
