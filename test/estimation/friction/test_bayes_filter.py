"""Bayes filter of the friction coefficient over revolutions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.friction.bayes_filter import FrictionFilter
from smart_tire.estimation.friction.brush_inversion import FrictionSample


def sample(mu, white=0.1, systematic=0.02, scale=0.1, slip_effect=0.0):
    """Return a revolution with standard deviations relative to mu."""
    return FrictionSample(1.0 / mu, white / mu, systematic / mu, scale, slip_effect / mu)


def update(friction_filter, *samples):
    return [friction_filter.update(one) for one in samples][-1]


def noisy(rng, mu, noise, count):
    return [FrictionSample(1.0 / mu + noise / mu * rng.standard_normal(), noise / mu, 0.0, 0.0)
            for _ in range(count)]


def test_white_errors_average_out_and_systematic_errors_do_not():
    mu, sigma = update(FrictionFilter(), *[sample(0.47)] * 400)
    assert mu == pytest.approx(0.47, rel=0.01)
    assert sigma / mu == pytest.approx(math.hypot(0.02, 0.1), rel=0.03)


def test_without_the_scale_error_the_sigma_is_smaller():
    friction_filter = FrictionFilter()
    mu, sigma = update(friction_filter, *[sample(0.47)] * 400)
    without = friction_filter.estimate_nominal()
    assert without == (mu, pytest.approx(0.022 * mu, rel=0.2))
    assert sigma > 3.5 * without.sigma


def test_the_average_and_its_sigma_are_consistent():
    rng = np.random.default_rng(0)
    normalized = []
    for _ in range(200):
        mu, sigma = update(FrictionFilter(), *noisy(rng, 0.47, 0.2, 10))
        normalized.append((mu - 0.47) / sigma)
    assert abs(np.mean(normalized)) < 0.25
    # the possibility of a surface change adds some uncertainty
    assert 0.7 < np.std(normalized) < 1.25


def test_without_information_friction_is_unknown():
    friction_filter = FrictionFilter()
    assert math.isnan(friction_filter.update(None).value)
    assert friction_filter.estimate().sigma == math.inf


@pytest.mark.parametrize(('before', 'after'), [(0.47, 0.20), (0.20, 0.60), (0.60, 0.47)])
def test_a_surface_change_is_detected_within_three_revolutions(before, after):
    friction_filter = FrictionFilter()
    update(friction_filter, *[sample(before, white=0.03)] * 20)
    mu, sigma = update(friction_filter, *[sample(after, white=0.03)] * 3)
    assert mu == pytest.approx(after, rel=0.1)
    assert friction_filter.changes == 1
    assert abs(mu - after) < sigma


def test_an_outlier_increases_the_sigma_for_a_few_revolutions():
    friction_filter = FrictionFilter()
    before = update(friction_filter, *[sample(0.47, white=0.05)] * 20)
    outlier = friction_filter.update(sample(0.40, white=0.05))
    assert friction_filter.changes == 0
    assert outlier.sigma > 1.02 * before.sigma
    assert outlier.value == pytest.approx(0.47, rel=0.02)
    after = update(friction_filter, *[sample(0.47, white=0.05)] * 5)
    assert after.value == pytest.approx(0.47, rel=0.02)
    assert after.sigma < 1.1 * before.sigma


def test_revolutions_without_information_increase_the_sigma():
    friction_filter = FrictionFilter()
    update(friction_filter, *[sample(0.47)] * 10)
    sigmas = [friction_filter.update(None).sigma for _ in range(15)]
    assert np.all(np.diff(sigmas) > 0.0)
    assert sigmas[-1] > 0.15
    assert friction_filter.update(sample(0.47)).sigma < sigmas[0]


def test_after_many_revolutions_without_information_friction_is_unknown():
    mu, sigma = update(FrictionFilter(), *[sample(0.47)] * 10, *[None] * 200)
    assert math.isnan(mu) or sigma > 0.7 * mu


@pytest.mark.parametrize('mu', [0.2, 0.47, 0.8])
def test_noisy_revolutions_converge_to_the_truth(mu):
    rng = np.random.default_rng(3)
    found, sigma = update(FrictionFilter(), *[
        FrictionSample(1.0 / mu + 3.0 * rng.standard_normal(), 3.0, 0.0, 0.0) for _ in range(400)])
    assert abs(found - mu) < 2.5 * sigma
    assert sigma < 0.5 * mu


def test_a_small_slip_bounds_friction_from_below():
    friction_filter = FrictionFilter()
    # a small 1 / mu with a standard deviation of 2 excludes a very low friction
    for _ in range(3):
        friction_filter.update(FrictionSample(1.2, 2.0, 0.0, 0.0))
    mu, sigma = friction_filter.estimate()
    assert math.isnan(mu) or mu - sigma > 0.1
    friction_filter.update(FrictionSample(-0.5, 0.5, 0.0, 0.0))
    assert friction_filter.estimate().value > 0.7


def test_each_surface_change_is_counted_once():
    friction_filter = FrictionFilter()
    update(friction_filter, *[sample(0.47, white=0.03)] * 10)
    assert friction_filter.changes == 0
    update(friction_filter, *[sample(0.8, white=0.03)] * 10)
    assert friction_filter.changes == 1
    update(friction_filter, *[sample(0.47, white=0.03)] * 10)
    assert friction_filter.changes == 2
