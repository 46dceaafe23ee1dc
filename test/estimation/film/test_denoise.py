"""Noise, spikes and smoothing of measured signals."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.film.denoise import smoothed, without_spikes
from smart_tire.numerics.robust import noise_level

TIME = np.arange(4000) * 1e-3
SINE = 1.0 - np.cos(2.0 * np.pi * 2.0 * TIME)
TRIANGLE = np.abs((4.0 * TIME) % 2.0 - 1.0)


@pytest.mark.parametrize('signal', [SINE, TRIANGLE, np.zeros(4000)])
def test_the_noise_is_found_on_any_motion(signal):
    noise = 2e-3 * np.random.default_rng(2).standard_normal(signal.size)
    assert noise_level(signal + noise) == pytest.approx(2e-3, rel=0.1)


def test_smoothing_lowers_the_noise_by_what_it_says_and_leaves_the_turns():
    rng = np.random.default_rng(3)
    calm, left = smoothed(SINE + 2e-3 * rng.standard_normal(SINE.size))
    assert left < 0.5 * 2e-3
    assert (calm - SINE).std() == pytest.approx(left, rel=0.25)
    # without noise there is nothing to smooth
    np.testing.assert_allclose(smoothed(TRIANGLE)[0], TRIANGLE, atol=1e-9)


def test_corners_stay_corners():
    rng = np.random.default_rng(4)
    calm, _ = smoothed(TRIANGLE + 2e-3 * rng.standard_normal(SINE.size))
    assert calm.max() == pytest.approx(1.0, abs=8e-3)
    assert calm.min() == pytest.approx(0.0, abs=8e-3)


def test_spikes_are_removed_and_nothing_else():
    spiked = SINE.copy()
    spiked[[100, 700, 701, 2000]] += [0.5, -1.0, -1.0, 3.0]
    calm, count = without_spikes(spiked)
    assert count == 4
    np.testing.assert_allclose(calm, SINE, atol=0.05)
    for signal in (SINE, TRIANGLE, np.zeros(50)):
        same, none = without_spikes(signal)
        assert none == 0 and np.array_equal(same, signal)
