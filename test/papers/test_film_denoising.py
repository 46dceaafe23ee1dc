# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Noise, spikes and smoothing of measured signals."""

import numpy as np
import pytest

from smart_tire.numerics.robust import noise_level
from smart_tire.papers.film_measurement import smoothed, without_spikes

TIME = np.arange(4000) * 1e-3
SINE = 1.0 - np.cos(2.0 * np.pi * 2.0 * TIME)
TRIANGLE = np.abs((4.0 * TIME) % 2.0 - 1.0)


@pytest.mark.parametrize('signal', [SINE, TRIANGLE, np.zeros(4000)])
def test_the_noise_is_estimated_on_any_motion(signal):
    noise = 2e-3 * np.random.default_rng(2).standard_normal(signal.size)
    assert noise_level(signal + noise) == pytest.approx(2e-3, rel=0.1)


def test_smoothing_reduces_the_noise_as_reported_and_keeps_reversals():
    rng = np.random.default_rng(3)
    smooth, left = smoothed(SINE + 2e-3 * rng.standard_normal(SINE.size))
    assert left < 0.5 * 2e-3
    assert (smooth - SINE).std() == pytest.approx(left, rel=0.25)
    # without noise the signal is unchanged
    np.testing.assert_allclose(smoothed(TRIANGLE)[0], TRIANGLE, atol=1e-9)


def test_corners_are_preserved():
    rng = np.random.default_rng(4)
    smooth, _ = smoothed(TRIANGLE + 2e-3 * rng.standard_normal(SINE.size))
    assert smooth.max() == pytest.approx(1.0, abs=8e-3)
    assert smooth.min() == pytest.approx(0.0, abs=8e-3)


def test_only_spikes_are_removed():
    spiked = SINE.copy()
    spiked[[100, 700, 701, 2000]] += [0.5, -1.0, -1.0, 3.0]
    smooth, count = without_spikes(spiked)
    assert count == 4
    np.testing.assert_allclose(smooth, SINE, atol=0.05)
    for signal in (SINE, TRIANGLE, np.zeros(50)):
        same, none = without_spikes(signal)
        assert none == 0 and np.array_equal(same, signal)
