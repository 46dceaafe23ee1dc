"""Shaking: nothing on a smooth floor, all of it on a rough one."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.vibration import VibrationMonitor


def shaken(sigma, seconds=5.0, rate=100.0, seed=0, noise=0.05):
    rng, shaking = np.random.default_rng(seed), VibrationMonitor(noise)
    for k in range(round(seconds * rate)):
        shaking.push(k / rate, 9.81 + np.hypot(noise, sigma) * rng.standard_normal())
    return shaking.sigma


@pytest.mark.parametrize('seed', range(5))
def test_the_noise_of_the_unit_is_no_shaking(seed):
    assert shaken(0.0, seed=seed) == 0.0


@pytest.mark.parametrize('rate', [20.0, 100.0, 400.0])
def test_shaking_is_measured_at_any_rate(rate):
    assert np.mean([shaken(1.2, rate=rate, seed=seed) for seed in range(10)]) == pytest.approx(
        1.2, rel=0.15)


def test_a_tilted_unit_does_not_shake():
    shaking = VibrationMonitor(0.05)
    for k in range(500):
        shaking.push(k / 100.0, 9.0)
    assert shaking.sigma == 0.0
