"""Many revolutions, one friction coefficient."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.friction.bayes_filter import FrictionFilter
from smart_tire.estimation.friction.brush_inversion import FrictionSample


def single(mu, noise=0.1, slip=0.02, constant=0.1):
    """Return a passage with sigmas relative to mu."""
    return FrictionSample(1.0 / mu, noise / mu, slip / mu, constant)


def feed(fusion, *passages):
    return [fusion.update(passage) for passage in passages][-1]


def noisy(rng, mu, noise, count):
    return [FrictionSample(1.0 / mu + noise / mu * rng.standard_normal(), noise / mu, 0.0, 0.0)
            for _ in range(count)]


def test_noise_averages_out_and_what_lasts_does_not():
    mu, sigma = feed(FrictionFilter(), *[single(0.47)] * 400)
    assert mu == pytest.approx(0.47, rel=0.01)
    assert sigma / mu == pytest.approx(math.hypot(0.02, 0.1), rel=0.03)


def test_what_uses_the_same_stiffness_again_is_sharper():
    fusion = FrictionFilter()
    mu, sigma = feed(fusion, *[single(0.47)] * 400)
    assert fusion.estimate(constant=False) == (mu, pytest.approx(0.022 * mu, rel=0.2))
    assert sigma > 3.5 * fusion.estimate(constant=False)[1]


def test_the_average_is_right_and_its_sigma_too():
    rng = np.random.default_rng(0)
    normalised = []
    for _ in range(200):
        fusion = FrictionFilter()
        mu, sigma = feed(fusion, *noisy(rng, 0.47, 0.2, 10))
        normalised.append((mu - 0.47) / sigma)
    assert abs(np.mean(normalised)) < 0.25
    # the ground might have changed in between, which takes some certainty away
    assert 0.7 < np.std(normalised) < 1.25


def test_nothing_known_is_unknown():
    fusion = FrictionFilter()
    assert math.isnan(fusion.update(None)[0])
    assert fusion.estimate()[1] == math.inf


@pytest.mark.parametrize(('before', 'after'), [(0.47, 0.20), (0.20, 0.60), (0.60, 0.47)])
def test_a_new_ground_is_believed_within_three_revolutions(before, after):
    fusion = FrictionFilter()
    feed(fusion, *[single(before, noise=0.03)] * 20)
    mu, sigma = feed(fusion, *[single(after, noise=0.03)] * 3)
    assert mu == pytest.approx(after, rel=0.1)
    assert fusion.changes == 1
    assert abs(mu - after) < sigma


def test_the_first_surprise_widens_the_sigma_and_a_stray_one_is_forgotten():
    fusion = FrictionFilter()
    _, calm = feed(fusion, *[single(0.47, noise=0.05)] * 20)
    mu, doubt = fusion.update(single(0.40, noise=0.05))
    assert fusion.changes == 0
    assert doubt > 1.02 * calm
    assert mu == pytest.approx(0.47, rel=0.02)
    mu, after = feed(fusion, *[single(0.47, noise=0.05)] * 5)
    assert mu == pytest.approx(0.47, rel=0.02)
    assert after < 1.1 * calm


def test_revolutions_that_tell_nothing_widen_the_sigma_until_the_next_that_does():
    fusion = FrictionFilter()
    feed(fusion, *[single(0.47)] * 10)
    sigmas = [fusion.update(None)[1] for _ in range(15)]
    assert np.all(np.diff(sigmas) > 0.0)
    assert sigmas[-1] > 0.15
    assert fusion.update(single(0.47))[1] < sigmas[0]


def test_after_a_long_silence_it_is_unknown():
    fusion = FrictionFilter()
    feed(fusion, *[single(0.47)] * 10, *[None] * 200)
    mu, sigma = fusion.estimate()
    assert math.isnan(mu) or sigma > 0.7 * mu


@pytest.mark.parametrize('mu', [0.2, 0.47, 0.8])
def test_noisy_passages_average_out_to_the_truth(mu):
    rng = np.random.default_rng(3)
    found, sigma = feed(FrictionFilter(), *[
        FrictionSample(1.0 / mu + 3.0 * rng.standard_normal(), 3.0, 0.0, 0.0) for _ in range(400)])
    assert abs(found - mu) < 2.5 * sigma
    assert sigma < 0.5 * mu


def test_a_slip_too_small_to_see_friction_still_bounds_it_from_below():
    fusion = FrictionFilter()
    # 1 / mu is small, up to a noise of 2: what slides as little as this has some grip
    for _ in range(3):
        fusion.update(FrictionSample(1.2, 2.0, 0.0, 0.0))
    mu, sigma = fusion.estimate()
    assert math.isnan(mu) or mu - sigma > 0.1
    fusion.update(FrictionSample(-0.5, 0.5, 0.0, 0.0))
    assert fusion.estimate()[0] > 0.7


def test_a_new_ground_is_counted_once():
    fusion = FrictionFilter()
    feed(fusion, *[single(0.47, noise=0.03)] * 10)
    assert fusion.changes == 0
    feed(fusion, *[single(0.8, noise=0.03)] * 10)
    assert fusion.changes == 1
    feed(fusion, *[single(0.47, noise=0.03)] * 10)
    assert fusion.changes == 2
