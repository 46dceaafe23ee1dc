"""Signs that the sliding of a side has changed."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.slip_process import SlipChange, SlipChangeDetector, SlipPrior
from smart_tire.parameters import SlipEstimatorParams

T = 0.0625  # s, 16 Hz


QUIET = 1e-5  # (m/s2)^2 s, noise of an accelerometer at rest


def settled(wheel=1.0, ground=0.9, innovation=0.0):
    change = SlipChangeDetector(SlipEstimatorParams())
    for _ in range(100):
        change.update(T, wheel, ground, innovation, 0.02, QUIET)
    return change


def test_at_first_nothing_is_known():
    change = SlipChangeDetector(SlipEstimatorParams()).update(T, 1.0, 0.9, 0.0, 0.02, QUIET)
    assert change.variance == np.inf


def test_while_nothing_happens_nothing_changes():
    assert settled().update(T, 1.0, 0.9, 0.01, 0.02, QUIET).variance == 0.0


def test_jitter_of_the_stamps_is_no_change():
    rng, change = np.random.default_rng(1), settled()
    jitter = np.sqrt(2.0) * 0.001 / T
    variances = [
        change.update(T, 1.0 + jitter * rng.standard_normal(), 0.9, 0.0, 0.02, QUIET).variance
        for _ in range(500)]
    assert np.mean(np.array(variances) > 0.0) < 0.05


def test_the_shaking_of_a_robot_is_no_change_of_its_speed():
    assert settled().update(T, 1.0, 0.94, 0.0, 0.02, QUIET).variance > 0.0
    assert settled().update(T, 1.0, 0.94, 0.0, 0.02, 0.3 ** 2 * 0.05).variance == 0.0


@pytest.mark.parametrize('wheel, ground', [(1.4, 0.9), (1.0, 0.6)])
def test_a_change_of_either_speed_is_a_change_of_sliding(wheel, ground):
    change = settled().update(T, wheel, ground, 0.0, 0.02, QUIET)
    assert 0.05 < np.sqrt(change.variance) < 0.5
    assert change.beyond > 0.25 ** 2
    assert change.acceleration == pytest.approx((ground - 0.9) / 0.3)


def test_one_surprise_is_a_bad_reading_and_two_are_a_change():
    change = settled()
    assert change.update(T, 1.0, 0.9, 0.3, 0.02, QUIET).variance == 0.0
    assert change.update(T, 1.0, 0.9, 0.3, 0.02, QUIET).variance == pytest.approx(0.3 ** 2)
    change = settled()
    change.update(T, 1.0, 0.9, 0.3, 0.02, QUIET)
    assert change.update(T, 1.0, 0.9, -0.3, 0.02, QUIET).variance == 0.0


def sigmas(spread):
    """Return one sigma of the mean and of half the difference of the sides' sliding."""
    return [np.sqrt(np.array([0.5, sign]) @ spread @ np.array([0.5, sign]))
            for sign in (0.5, -0.5)]


def test_sides_are_more_likely_to_slip_against_each_other_than_together():
    together, apart = sigmas(
        SlipPrior(SlipEstimatorParams()).of([SlipChange(0.0, 1.0, 0.0, 0.0)] * 2))
    assert together == pytest.approx(0.07, rel=0.05)
    assert apart == pytest.approx(0.15, rel=0.05)


def test_accelerating_makes_slip_that_both_sides_share_likely():
    spread = SlipPrior(SlipEstimatorParams())
    fast = sigmas(spread.of([SlipChange(0.0, 1.0, 3.0, 0.0)] * 2))
    slow = sigmas(spread.of([SlipChange(0.0, 1.0, 0.0, 0.0)] * 2))
    # 10.9 kg over four tires of 52.7 N: 0.052 per m/s2
    assert fast[0] == pytest.approx(np.hypot(slow[0], 3.0 * 10.9 / (4.0 * 52.7)), rel=1e-6)
    assert fast[1] == pytest.approx(slow[1])


@pytest.mark.parametrize('speeds', [(1.0, 1.0), (0.0, 1.0), (0.7, 0.7), (0.0, 0.0)])
def test_the_spread_is_a_covariance(speeds):
    changes = [SlipChange(0.0, abs(speed), 1.0, 0.0) for speed in speeds]
    assert np.linalg.eigvalsh(SlipPrior(SlipEstimatorParams()).of(changes)).min() > 0.0


def test_small_slip_means_firm_ground_and_large_slip_that_was_seen_does_not():
    spread = SlipPrior(SlipEstimatorParams())
    assert spread.rolling(0.0, 0.12 ** 2, 0.0).weight > 0.5
    assert spread.rolling(0.15, 0.02 ** 2, 0.0).weight < 1e-3
    assert spread.rolling(0.15, 0.15 ** 2, 0.0).weight > 0.3  # not seen, only guessed
    assert spread.rolling(0.0, 0.08 ** 2, 0.5).weight < 1e-3  # a turn tells by itself
    assert spread.rolling(0.0, 0.01 ** 2, 0.0).weight < 0.01  # and so does what was just seen


def test_ground_that_was_soft_stays_soft_for_a_while():
    spread = SlipPrior(SlipEstimatorParams())
    firm = sigmas(spread.of([SlipChange(0.0, 1.0, 0.0, 0.0)] * 2))[0]
    for _ in range(100):
        spread.watch(0.2, 0.01 ** 2, 0.0625)
    assert sigmas(spread.of([SlipChange(0.0, 1.0, 0.0, 0.0)] * 2))[0] > 2.0 * firm
    for _ in range(400):
        spread.watch(0.0, 0.01 ** 2, 0.0625)
    unchanged = [SlipChange(0.0, 1.0, 0.0, 0.0)] * 2
    assert sigmas(spread.of(unchanged))[0] == pytest.approx(firm, rel=0.01)
