# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Film estimator: known deflections, honest sigmas, gaps, flags, heat, zero."""

from dataclasses import replace
import math

import numpy as np
import pytest
from smart_tire.errors import ParameterError
from smart_tire.estimation.film.estimator import FilmEstimator, MEASURING
from smart_tire.models.film.hysteresis import DuhemParams, TABLE_I
from smart_tire.parameters.film import FilmSensorParams
from smart_tire.samples import FilmTemperature, NS_PER_S
from support.films import (
    calibration, charge_of, EPOCH_NS, FILM, flagged, measured, QUIET, RATE, samples_of, strokes)

FRESH = replace(QUIET, fresh=True)
WARMING = 2.0  # K


def between(found, begin, end):
    """Return the rows of ``found`` from ``begin`` to ``end`` [s]."""
    return found[(found[:, 0] >= begin) & (found[:, 0] < end)]


def errors(found, path):
    """Return the errors [m] of ``found`` against the deflection ``path`` at RATE."""
    return found[:, 1] - np.interp(found[:, 0], np.arange(path.size) / RATE, path)


def assert_honest(found, path, sigmas=3.0, share=0.01):
    """Check that few errors of single samples, and none of the mean, exceed the band."""
    normalized = np.abs(errors(found, path)) / found[:, 2]
    assert np.mean(normalized > sigmas) <= share
    assert np.mean(normalized**2) < 4.0


def test_a_fresh_film_is_followed_within_a_hundredth_of_its_range():
    path = strokes(5.0)
    found = between(measured(samples_of(charge_of(path)), FRESH), 0.6, 5.0)
    assert np.isfinite(found).all()
    assert np.sqrt(np.mean(errors(found, path)**2)) < 0.01 * path.max()
    assert_honest(found, path)


def test_a_zero_after_strokes_finds_the_offset_that_the_first_one_could_not_know():
    rest = np.zeros(round(0.5 * RATE))
    path = np.concatenate([strokes(4.0), rest, strokes(4.0, begin=0.5)])
    samples = samples_of(charge_of(path, z=0.9 * TABLE_I.band))
    found = measured(samples, zero_at=4.3)
    before, after = between(found, 2.0, 4.0), between(found, 4.4, 8.5)
    assert np.sqrt(np.mean(errors(before, path)**2)) > 0.05 * path.max()
    assert np.sqrt(np.mean(errors(after, path)**2)) < 0.01 * path.max()
    assert np.median(after[:, 2]) < 0.2 * np.median(before[:, 2])
    assert_honest(after, path)


def test_normalized_errors_are_near_one_for_operators_drawn_at_random():
    squares = []
    for seed in range(100, 116):
        rng = np.random.default_rng(seed)
        a = TABLE_I.a * math.exp(0.2 * rng.standard_normal())
        operator = DuhemParams(alpha=TABLE_I.alpha * math.exp(0.2 * rng.standard_normal()),
                               a=a, b=a * rng.uniform(0.52, 0.75))
        path = strokes(3.5, top=rng.uniform(0.004, 0.012), frequency=rng.uniform(1.0, 6.0))
        charge = charge_of(path, operator=operator, seed=seed,
                           z=rng.uniform(-1.0, 1.0) * operator.band)
        found = between(measured(
            samples_of(charge), film=calibration(operator, rng=rng)), 1.5, 3.5)
        squares.append(float(np.mean((errors(found, path) / found[:, 2])**2)))
    assert 0.4 < np.mean(squares) < 1.8
    assert max(squares) < 9.0


@pytest.mark.parametrize('lost', [0.1, 0.7])
def test_a_gap_widens_the_band_and_loses_no_charge(lost):
    path, begin = strokes(6.0, frequency=1.0), 2.4
    samples = [one for k, one in enumerate(samples_of(charge_of(path)))
               if not begin <= k / RATE < begin + lost]
    found = measured(samples, FRESH)
    before, after = between(found, 1.5, begin), between(found, begin + lost, 6.0)
    assert np.isfinite(after).all()
    assert_honest(after, path)
    assert np.median(after[:200, 2]) > np.median(before[:, 2])


def test_single_lost_samples_cost_next_to_nothing():
    path, rng = strokes(5.0), np.random.default_rng(3)
    samples = [one for one in samples_of(charge_of(path)) if rng.random() > 0.05]
    found = between(measured(samples, FRESH), 0.6, 5.0)
    assert np.sqrt(np.mean(errors(found, path)**2)) < 0.015 * path.max()
    assert_honest(found, path)


def test_lost_samples_of_a_fast_motion_widen_the_band():
    squares = []
    for seed, frequency in enumerate((12.0, 16.0, 20.0)):
        path, rng = strokes(3.0, frequency=frequency), np.random.default_rng(310 + seed)
        samples = [one for one in samples_of(charge_of(path, seed=seed)) if rng.random() > 0.35]
        found = between(measured(samples, FRESH), 1.0, 3.0)
        squares.append(float(np.nanmean((errors(found, path) / found[:, 2])**2)))
    assert 0.4 < np.mean(squares) < 1.8


def test_nothing_is_claimed_while_saturated_and_the_band_holds_afterwards():
    path = strokes(5.0, frequency=1.0)
    limit = 0.7 * np.abs(charge := charge_of(path)).max()
    samples = [flagged(replace(one, charge=float(np.clip(one.charge, -limit, limit))),
                       saturated=abs(one.charge) > limit) for one in samples_of(charge)]
    found = between(measured(samples, FRESH), 1.2, 5.0)
    clipped = np.interp(found[:, 0], np.arange(path.size) / RATE, np.abs(charge)) > 1.05 * limit
    assert np.isnan(found[clipped, 1]).all() and np.isinf(found[clipped, 2]).all()
    known = found[np.isfinite(found[:, 1])]
    assert known.shape[0] > 0.4 * found.shape[0]
    assert_honest(known, path)


def test_after_a_reset_of_the_amplifier_the_deflection_goes_on_with_a_wider_band():
    path, at = strokes(5.0, frequency=0.5), round(2.5 * RATE)
    charge = charge_of(path)
    charge[at:] -= charge[at]
    samples = samples_of(charge)
    samples[at] = flagged(samples[at], discharged=True)
    found = measured(samples, FRESH)
    before, after = between(found, 2.0, 2.49), between(found, 2.52, 5.0)
    assert_honest(after, path)
    assert after[0, 2] > before[-1, 2]
    assert np.abs(errors(after, path)).max() < 0.1 * path.max()


def heated(seconds):
    """Return a flat film at rest that warms by WARMING: path, charge and temperatures."""
    time = np.arange(round(seconds * RATE)) / RATE
    rise = WARMING * np.clip((time - 1.0) / 2.0, 0.0, 1.0)
    heat = FilmSensorParams().pyroelectric_coefficient * FILM.length * FILM.width * rise
    path = strokes(seconds, begin=4.0)
    temperatures = [FilmTemperature(EPOCH_NS + round(t * NS_PER_S), 20.0 + float(dt), 0.02)
                    for t, dt in zip(time[::50], rise[::50])]
    return path, samples_of(charge_of(path, heat=heat)), temperatures


def test_heat_is_subtracted_with_the_temperature_and_in_the_band_without():
    path, samples, temperatures = heated(6.0)
    params = FilmSensorParams(fresh=True, temperature_rate=0.5)
    both = sorted([*samples, *temperatures], key=lambda one: one.stamp_ns)
    compensated = between(measured(both, params), 4.0, 6.0)
    alone = between(measured(samples, params), 4.0, 6.0)
    blind = between(measured(samples, FRESH), 4.0, 6.0)
    rms = [float(np.sqrt(np.nanmean(errors(one, path)**2))) for one in (compensated, alone, blind)]
    assert rms[0] < 0.04 * path.max() and rms[1] > 3.0 * rms[0] and rms[2] > 3.0 * rms[0]
    for one in (compensated, alone):
        known = one[np.isfinite(one[:, 1])]
        assert_honest(known, path)
    assert np.nanmedian(alone[:, 2]) > 2.0 * np.median(compensated[:, 2])


def test_the_order_of_arrival_within_the_window_changes_nothing():
    _, samples, temperatures = heated(3.0)
    ordered = sorted([*samples, *temperatures], key=lambda one: one.stamp_ns)
    rng = np.random.default_rng(1)
    shuffled = sorted(ordered, key=lambda one: one.stamp_ns + 0.02 * NS_PER_S * rng.random())
    assert shuffled != ordered
    params = FilmSensorParams(fresh=True)
    np.testing.assert_array_equal(measured(shuffled, params), measured(ordered, params))


def test_a_moving_film_is_not_taken_for_flat():
    moving = measured(samples_of(charge_of(strokes(3.0, begin=0.0))))
    assert np.isnan(moving[:, 1]).all()
    estimator = FilmEstimator(QUIET, calibration())
    assert not estimator.zero() and estimator.state != MEASURING


def test_a_step_of_the_clock_begins_again():
    samples = samples_of(charge_of(strokes(3.0)))
    back = [replace(one, stamp_ns=one.stamp_ns - 3600 * NS_PER_S) for one in samples]
    estimator = FilmEstimator(FRESH, calibration())
    for one in [*samples, *back]:
        estimator.update(one)
    assert estimator.restarts == 1 and estimator.zeros == 2


@pytest.mark.parametrize('value', [math.nan, 0.0, 1.0])
def test_a_calibration_with_an_inverse_is_required(value):
    with pytest.raises(ParameterError, match='calibration_file must be given'):
        FilmEstimator(FilmSensorParams())
    with pytest.raises(ParameterError, match='expected'):
        FilmEstimator(QUIET, replace(calibration(), b_gain=value))


def test_products_that_are_not_determined_limit_the_range():
    film = replace(calibration(), covariance=np.diag([1e12, 0.0, 0.0, 0.0, 0.0]), span=0.02)
    path = strokes(3.0)
    found = measured(samples_of(charge_of(path)), FRESH, film)
    assert np.isnan(between(found, 1.2, 3.0)[:, 1]).all()
