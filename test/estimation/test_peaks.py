"""One film's passage, measured: exact without noise, honest with it, None for anything else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.peaks import PassageMeter
from smart_tire.models import tread_film
from smart_tire.parameters import build, RobotParams

ROBOT = RobotParams()
L, FILM = ROBOT.tire.contact_length, ROBOT.film.length
CRITICAL = 0.71
GAIN, BENDING = 307.5, 0.83
SHAPE = {'film_length': FILM, 'contact_length': L, 'bending_alpha': ROBOT.film.bending_alpha,
         'stretch_gain': GAIN, 'critical_slip': CRITICAL}


def passage(slip, *, step=0.0027, phase=0.3, noise=0.0, total=None, release='fig8',
            bending=0.9, rng=None):
    """Return distances from the middle, and volts, of a film sampled every ``step`` [m]."""
    x = np.arange(-0.045, 0.075, step) + phase * step
    total = abs(slip) * 1.3 if total is None else total
    volts = tread_film.passage(x, slip=slip, total_slip=total, bending_peak=bending,
                               release=release, **SHAPE)
    volts = volts - 0.12 * bending * tread_film.contact_bumps(x, FILM, L)
    if rng is not None:
        volts = volts + rng.normal(0.0, noise, len(x))
    return x - 0.5 * (L - FILM), volts


def measure(distance, volts, **robot):
    meter = PassageMeter(build(RobotParams, robot))
    return meter.measure(distance, volts, bending=BENDING, gain=GAIN, scale_sigma=0.005,
                         warp_sigma=0.0, between=(-0.02, 0.02))


@pytest.mark.parametrize('release', ['fig8', 'state'])
@pytest.mark.parametrize('slip', [0.05, 0.1, 0.3, -0.05, -0.1, -0.3])
def test_without_noise_the_passage_is_read_exactly_between_the_samples(slip, release):
    for phase in (0.0, 0.37, 0.8):
        shape = measure(*passage(slip, phase=phase, release=release), **{'film.release': release})
        assert shape.middle == pytest.approx(0.0, abs=5e-5)
        assert shape.stretch / GAIN == pytest.approx(slip, rel=0.025)
        assert shape.sliding == pytest.approx(1.3 * abs(slip) / CRITICAL, rel=0.03)
        assert shape.bending == pytest.approx(0.9, rel=0.01)


def test_the_peaks_are_those_of_the_model_where_raw_samples_miss_the_minimum_by_a_tenth_volt():
    distance, volts = passage(0.1, phase=0.55)
    assert volts.min() > -0.9 + 0.095
    meter = PassageMeter(ROBOT)
    peaks = meter.peaks(measure(distance, volts), 0.0)
    x_m = float(tread_film.peak_position((1.0 - 0.13 / CRITICAL) * L, FILM, L))
    top = GAIN * float(tread_film.stretch_integral(x_m, 0.1, 0.13, CRITICAL, FILM, L))
    assert peaks.position == pytest.approx(x_m, abs=2e-4)
    assert peaks.height == pytest.approx(top, abs=0.005)


@pytest.mark.parametrize(('slip', 'step', 'noise'), [
    (0.1, 0.0014, 0.005), (0.1, 0.0027, 0.02), (0.05, 0.0027, 0.005), (0.3, 0.0045, 0.02),
    (-0.1, 0.0027, 0.005), (-0.2, 0.0014, 0.02)])
def test_errors_are_as_large_as_their_sigmas_say(slip, step, noise):
    rng = np.random.default_rng(4)
    errors = []
    for _ in range(100):
        distance, volts = passage(slip, step=step, phase=rng.uniform(), noise=noise, rng=rng,
                                  bending=BENDING * rng.uniform(0.85, 1.15))
        shape = measure(distance, volts)
        sigma = np.sqrt(np.diag(shape.covariance))
        errors.append(((shape.stretch - GAIN * slip) / sigma[1],
                       (shape.sliding - 1.3 * abs(slip) / CRITICAL) / sigma[2]))
    normalised = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all((normalised > 0.75) & (normalised < 1.3)), normalised
    assert np.all(np.abs(np.median(errors, axis=0)) < 0.4)


def test_a_small_slip_shows_no_sliding_and_the_sigma_says_so():
    rng = np.random.default_rng(1)
    shape = measure(*passage(0.01, noise=0.02, rng=rng))
    assert math.sqrt(shape.covariance[2, 2]) > 10.0 * 0.013 / CRITICAL
    assert abs(shape.stretch / GAIN - 0.01) < 0.03


def test_lost_samples_make_the_sigma_larger_not_the_value_wrong():
    rng = np.random.default_rng(2)
    distance, volts = passage(0.1, noise=0.005, rng=rng, step=0.0014)
    whole = measure(distance, volts)
    x = distance + 0.5 * (L - FILM)
    kept = (x < 0.010) | (x > 0.032)  # the maximum is lost
    part = measure(distance[kept], volts[kept])
    assert part.coverage < 0.8 < whole.coverage
    assert part.covariance[2, 2] > 2.0 * whole.covariance[2, 2]
    assert abs(part.sliding - 0.13 / CRITICAL) < 3.0 * math.sqrt(part.covariance[2, 2])


def test_one_wild_sample_does_not_move_the_passage():
    rng = np.random.default_rng(3)
    distance, volts = passage(0.1, noise=0.005, rng=rng, step=0.0014)
    volts[np.searchsorted(distance, 0.004)] += 0.8
    shape = measure(distance, volts)
    assert shape.middle == pytest.approx(0.0, abs=5e-4)
    assert shape.stretch / GAIN == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize('make', [
    lambda x, rng: rng.normal(0.0, 0.02, len(x)),
    lambda x, rng: -0.12 * tread_film.contact_bumps(x, FILM, L),
    lambda x, rng: np.where(np.abs(x) < 0.002, 1.2, 0.0),
    lambda x, rng: np.full(len(x), 0.8),
], ids=['noise', 'bumps', 'spike', 'constant'])
def test_what_is_no_passage_is_not_measured(make):
    rng = np.random.default_rng(5)
    distance, _ = passage(0.1)
    volts = make(distance + 0.5 * (L - FILM), rng) + rng.normal(0.0, 0.005, len(distance))
    assert measure(distance, volts) is None


def test_too_few_samples_are_no_passage():
    distance, volts = passage(0.1)
    assert measure(distance[20:25], volts[20:25]) is None


def test_a_drifting_slip_is_what_the_drift_says_it_is():
    distance, _ = passage(0.1, step=0.001)
    x = distance + 0.5 * (L - FILM)
    change = 0.02  # relative, over a contact length
    slip = 0.1 * (1.0 + change * distance / L)
    volts = tread_film.passage(x, slip=slip, total_slip=1.3 * slip, bending_peak=0.9,
                               release='fig8', **SHAPE)
    steady, drifting = measure(*passage(0.1, step=0.001)), measure(distance, volts)
    assert drifting.sliding - steady.sliding == pytest.approx(
        change * steady.drift[2], rel=0.3)


def test_a_film_longer_than_the_patch_is_measured_as_well():
    values = {'film.length': 0.05}
    x = np.arange(-0.08, 0.09, 0.0014)
    volts = tread_film.passage(x, slip=0.2, total_slip=0.26, bending_peak=0.9,
                               **{**SHAPE, 'film_length': 0.05})
    shape = measure(x - 0.5 * (L - 0.05), volts, **values)
    assert shape.middle == pytest.approx(0.0, abs=2e-4)
    assert shape.stretch / GAIN == pytest.approx(0.2, rel=0.05)
