"""Errors of a smoothed course: polynomials as large as those of the noise that is left."""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial.legendre import legfit
import pytest

from smart_tire.estimation.contact.trajectory_error import LEAST, warps


def drawn(rng, density, cutoff, duration, count):
    """Return Legendre coefficients (count, 8) of noise with the described density."""
    total, step = 40.0 * duration, duration / 100.0
    n = round(total / step)
    frequency = np.fft.rfftfreq(n, step) * 2.0 * math.pi
    amplitude = np.sqrt(density / (1.0 + (frequency / cutoff)**6) / step)
    found = []
    for _ in range(count):
        noise = np.fft.irfft(amplitude * np.fft.rfft(rng.standard_normal(n)), n)
        for start in range(0, n - 101, 200):
            found.append(legfit(np.linspace(-1.0, 1.0, 101), noise[start:start + 101], 7))
    return np.array(found)


@pytest.mark.parametrize(('cutoff', 'duration'), [(10.0, 0.2), (10.0, 0.8), (20.0, 1.0)])
def test_the_sigmas_are_those_of_drawn_noise(cutoff, duration):
    density = 1e-7
    found = np.std(drawn(np.random.default_rng(0), density, cutoff, duration, 30), axis=0)
    told = warps(density, cutoff, duration)
    assert len(told) >= 2
    count = min(len(told), 4)
    np.testing.assert_allclose(told[:count], found[2:2 + count], rtol=0.25)


def test_only_what_matters_is_told():
    assert warps(1e-14, 10.0, 0.2) == ()
    few, many = warps(1e-8, 8.0, 0.15), warps(1e-8, 15.0, 1.2)
    assert 0 < len(few) < len(many)
    assert few[-1] > LEAST
    assert np.all(np.diff(few) < 0.0)
