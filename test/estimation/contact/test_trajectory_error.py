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

"""Error model of a smoothed trajectory against simulated noise."""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial.legendre import legfit
import pytest

from smart_tire.estimation.contact.trajectory_error import MIN_SHAPE_SIGMA, shape_error_sigmas


def simulated(rng, density, cutoff, duration, count):
    """Return Legendre coefficients (n, 8) of noise with the described density."""
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
def test_the_sigmas_are_those_of_simulated_noise(cutoff, duration):
    density = 1e-7
    found = np.std(simulated(np.random.default_rng(0), density, cutoff, duration, 30), axis=0)
    sigmas = shape_error_sigmas(density, cutoff, duration)
    assert len(sigmas) >= 2
    count = min(len(sigmas), 4)
    np.testing.assert_allclose(sigmas[:count], found[2:2 + count], rtol=0.25)


def test_negligible_polynomials_are_left_out():
    assert shape_error_sigmas(1e-14, 10.0, 0.2) == ()
    few, many = shape_error_sigmas(1e-8, 8.0, 0.15), shape_error_sigmas(1e-8, 15.0, 1.2)
    assert 0 < len(few) < len(many)
    assert few[-1] > MIN_SHAPE_SIGMA
    assert np.all(np.diff(few) < 0.0)
