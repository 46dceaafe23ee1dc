# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Deflection from charge: accuracy, honesty of sigma, and what no film can have felt."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from smart_tire.errors import ParameterError
from smart_tire.estimation.film.calibration import FilmParams
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.papers.film_bench import identify_film
from smart_tire.papers.film_experiments import bench
from smart_tire.papers.film_measurement import measure
from smart_tire.simulation.film import FilmTestStand
from support.film_bench import ramps, RATE, several_loops, sine, TRUE

pytestmark = pytest.mark.slow

FILM = FILMS['25x3']
EXACT = FilmParams(film=FILM, covariance=np.zeros((5, 5)), low_corner=0.0, drift=0.0, span=1.0,
                   noise=0.0, model_error=0.0, **TRUE)
QUIET = FilmTestStand(low_corner=0.0, high_corner=1e6, charge_noise=0.0, bits=32)
MICRON = 1e-6  # m


@pytest.fixture(scope='module')
def identified():
    return identify_film(several_loops(), FILM)[0]


@cache
def run(top, frequency, duration, seed):
    """Return the motion of a bench and its recording."""
    deflection = sine(top, frequency, duration, RATE)
    return deflection, bench(FilmTestStand(), deflection, RATE, seed)


def from_standstill(motion):
    """Return a motion that begins with a stationary flat film, like zeroing."""
    return np.concatenate([np.zeros(100), motion])


def test_true_parameters_without_noise_reproduce_the_deflection():
    deflection = from_standstill(sine(0.012, 1.0, 3.0, 1000.0))
    recording = bench(QUIET, deflection, 1000.0, 1)
    result = measure(recording.time, recording.output, EXACT)
    assert result.valid_count == deflection.size
    np.testing.assert_allclose(result.value, deflection, rtol=0.0, atol=20.0 * MICRON)


@pytest.mark.parametrize('top, frequency', [
    (0.012, 1.0), (0.012, 5.0), (0.006, 10.0), (0.002, 2.0), (0.0005, 5.0)])
def test_an_identified_film_is_accurate_within_its_sigma(identified, top, frequency):
    deflection = from_standstill(sine(top, frequency, 3.0, RATE))
    recording = bench(FilmTestStand(), deflection, RATE, 11)
    result = measure(recording.time, recording.output, identified)
    error = result.value - deflection
    assert np.sqrt(np.mean(error**2)) < 70.0 * MICRON
    assert np.mean(np.abs(error) <= 2.0 * result.sigma) > 0.9
    assert np.median(result.sigma) < 120.0 * MICRON


@pytest.mark.parametrize(('calibration', 'seeds'), [((0.006, 2.0, 10.0), 2), *(
    pytest.param(calibration, 6, marks=pytest.mark.long) for calibration in (
        (0.006, 2.0, 10.0), (0.012, 5.0, 5.0), (0.002, 3.0, 20.0), (0.012, 1.0, 100.0)))])
def test_sigma_is_consistent_over_motions_durations_and_seeds(calibration, seeds):
    pulls, inside = [], []
    others = [calibration, (0.006, 2.0, 10.0), (0.0005, 5.0, 5.0), (0.002, 10.0, 20.0),
              (0.012, 1.0, 60.0)]
    for seed in range(seeds):
        params = identify_film(run(*calibration, seed)[1], FILM)[0]
        for number, motion in enumerate(others):
            deflection, recording = run(*motion, seed if number == 0 else 100 + seed)
            result = measure(recording.time, recording.output, params)
            valid = np.isfinite(result.value)
            pull = ((result.value - deflection) / result.sigma)[valid]
            pulls.append(np.mean(pull**2))
            inside.append(np.mean(np.abs(pull) <= 2.0))
    assert np.mean(inside) > 0.9
    assert 0.3 < np.sqrt(np.mean(pulls)) < 1.3


@pytest.mark.parametrize('seeds', [(15,), pytest.param(range(10, 18), marks=pytest.mark.long)])
def test_a_small_calibration_loop_limits_the_measuring_range(seeds):
    small, large = sine(0.0005, 5.0, 5.0, RATE), sine(0.012, 2.0, 5.0, RATE)
    refused = 0
    for seed in seeds:
        own = bench(FilmTestStand(), small, RATE, seed)
        params = identify_film(own, FILM)[0]
        try:
            result = measure(own.time, own.output, params)
        except ParameterError:  # operators within one standard deviation have none
            refused += 1
            continue
        assert np.mean(np.abs(result.value - small) <= 2.0 * result.sigma) > 0.9
        other = bench(FilmTestStand(), large, RATE, 100 + seed)
        result = measure(other.time, other.output, params)
        assert np.nanmax(result.value) < 0.001 and result.valid_count < 0.05 * large.size
    assert refused < len(seeds)


@pytest.mark.parametrize('film', [FILM, None])
def test_what_is_unknown_is_nan_with_an_infinite_sigma(film):
    params = replace(EXACT, film=film)
    value, sigma = params.deflections(np.array([-0.5, np.nan]), np.array([0.01, 0.01]))
    assert np.isfinite(value[0]) and 0.0 < sigma[0] < np.inf
    assert np.isnan(value[1]) and sigma[1] == np.inf


def test_sigma_grows_with_time_if_amplifier_and_drift_are_not_separable():
    recording = bench(FilmTestStand(), sine(0.006, 2.0, 10.0, 1000.0), 1000.0, 1)
    params, fit, notes = identify_film(recording, FILM)
    assert any('not determined: low_corner' in note for note in notes)
    assert fit.low_corner.sigma > 0.5 * 0.001
    own = measure(recording.time, recording.output, params)
    # their sum is known for the calibration motion, but not for others
    assert np.median(own.sigma) < 50.0 * MICRON
    assert np.mean(np.abs(own.value - recording.input) <= 2.0 * own.sigma) > 0.9
    other = bench(FilmTestStand(), sine(0.002, 2.0, 40.0, RATE), RATE, 2)
    sigma = measure(other.time, other.output, params).sigma
    assert np.median(sigma[-2000:]) > 3.0 * np.median(sigma[:2000])


def test_corners_and_minor_loops_are_measured(identified):
    deflection = from_standstill(ramps([0.01, 0.004, 0.007, 0.002, 0.009, 0.0], 0.02, RATE))
    recording = bench(FilmTestStand(), deflection, RATE, 13)
    result = measure(recording.time, recording.output, identified)
    # corners cannot be smoothed, so the noise remains
    assert np.sqrt(np.mean((result.value - deflection)**2)) < 200.0 * MICRON
    assert np.mean(np.abs(result.value - deflection) <= 2.0 * result.sigma) > 0.9


def test_uncertain_parameters_increase_sigma(identified):
    recording = several_loops()
    certain, uncertain = (measure(recording.time, recording.output, replace(
        identified, covariance=scale * identified.covariance)) for scale in (1.0, 400.0))
    assert np.median(uncertain.sigma) > 2.0 * np.median(certain.sigma)


def test_the_zero_of_a_used_film_is_unknown(identified):
    recording = several_loops()
    fresh, used = (measure(recording.time, recording.output, identified, used=used)
                   for used in (False, True))
    assert np.all(np.abs(used.value - fresh.value) <= used.sigma)
    assert np.nanmedian(used.sigma) > 10.0 * np.nanmedian(fresh.sigma)


def test_charges_that_a_buckled_film_cannot_have_are_invalid(identified):
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
    v = FILM.normalized_charge(np.maximum(recording.input, 0.0))
    assert np.std(raw.value - v) < 5e-3
    assert raw.valid_count == v.size


def test_an_operator_without_inverse_is_refused():
    recording = several_loops()
    with pytest.raises(ParameterError, match='a > b >= a / 2'):
        measure(recording.time, recording.output, replace(EXACT, b_gain=0.4 * TRUE['a_gain']))


@pytest.mark.parametrize('row, time, charge, reason', [
    (50, None, np.nan, r'charge\[50\] is nan'), (50, 0.0, None, r'time\[50\] is 0.0 after')])
def test_a_broken_series_is_refused(row, time, charge, reason):
    recording = several_loops()
    times, charges = recording.time.copy(), recording.output.copy()
    times[row] = times[row] if time is None else time
    charges[row] = charges[row] if charge is None else charge
    with pytest.raises(ParameterError, match=reason):
        measure(times, charges, EXACT)
