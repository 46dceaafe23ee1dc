"""Signs that the sliding of a side has changed."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.sliding import SlidingChange
from smart_tire.parameters import SlipEstimatorParams

T = 0.0625  # s, 16 Hz


def settled(wheel=1.0, ground=0.9, innovation=0.0):
    change = SlidingChange(SlipEstimatorParams())
    for _ in range(100):
        change.update(T, wheel, ground, innovation, 0.02)
    return change


def test_at_first_nothing_is_known():
    variance, spread = SlidingChange(SlipEstimatorParams()).update(T, 1.0, 0.9, 0.0, 0.02)
    assert variance == spread == pytest.approx(0.15 ** 2, rel=0.1)


def test_while_nothing_happens_nothing_changes():
    assert settled().update(T, 1.0, 0.9, 0.01, 0.02)[0] == 0.0


def test_jitter_of_the_stamps_is_no_change():
    rng, change = np.random.default_rng(1), settled()
    jitter = np.sqrt(2.0) * 0.001 / T
    variances = [change.update(T, 1.0 + jitter * rng.standard_normal(), 0.9, 0.0, 0.02)[0]
                 for _ in range(500)]
    assert np.mean(np.array(variances) > 0.0) < 0.05


@pytest.mark.parametrize('wheel, ground', [(1.4, 0.9), (1.0, 0.6)])
def test_a_change_of_either_speed_is_a_change_of_sliding(wheel, ground):
    variance, spread = settled().update(T, wheel, ground, 0.0, 0.02)
    assert 0.05 < np.sqrt(variance) < 0.5
    assert spread > 0.3 ** 2


def test_one_surprise_is_a_bad_reading_and_two_are_a_change():
    change = settled()
    assert change.update(T, 1.0, 0.9, 0.3, 0.02)[0] == 0.0
    assert change.update(T, 1.0, 0.9, 0.3, 0.02)[0] == pytest.approx(0.26 ** 2)
    change = settled()
    change.update(T, 1.0, 0.9, 0.3, 0.02)
    assert change.update(T, 1.0, 0.9, -0.3, 0.02)[0] == 0.0
