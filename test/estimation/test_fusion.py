"""Many revolutions, one friction coefficient."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.friction import Single
from smart_tire.estimation.fusion import FrictionFusion


def single(mu, noise=0.1, slip=0.02, constant=0.1):
    """Return a passage with sigmas relative to mu."""
    return Single(1.0 / mu, noise / mu, slip / mu, constant)


def feed(fusion, *passages):
    return [fusion.update(passage) for passage in passages][-1]


def noisy(rng, mu, noise, count):
    return [Single(1.0 / mu + noise / mu * rng.standard_normal(), noise / mu, 0.0, 0.0)
            for _ in range(count)]


def test_noise_averages_out_and_what_lasts_does_not():
    mu, sigma = feed(FrictionFusion(), *[single(0.47)] * 400)
    assert mu == pytest.approx(0.47, rel=0.01)
    assert sigma / mu == pytest.approx(math.hypot(0.02, 0.1), rel=0.03)


def test_what_uses_the_same_stiffness_again_is_sharper():
    fusion = FrictionFusion()
    mu, sigma = feed(fusion, *[single(0.47)] * 400)
    assert fusion.estimate(constant=False) == (mu, pytest.approx(0.02 * mu, rel=0.1))
    assert sigma > 4.0 * fusion.estimate(constant=False)[1]


def test_the_average_is_right_and_its_sigma_too():
    rng = np.random.default_rng(0)
    normalised = []
    for _ in range(200):
        fusion = FrictionFusion()
        mu, sigma = feed(fusion, *noisy(rng, 0.47, 0.2, 10))
        normalised.append((mu - 0.47) / sigma)
    assert abs(np.mean(normalised)) < 0.25
    assert 0.8 < np.std(normalised) < 1.25


def test_nothing_known_is_unknown():
    fusion = FrictionFusion()
    assert math.isnan(fusion.update(None)[0])
    assert fusion.estimate()[1] == math.inf


@pytest.mark.parametrize(('before', 'after'), [(0.47, 0.20), (0.20, 0.60), (0.60, 0.47)])
def test_a_new_ground_is_believed_within_three_revolutions(before, after):
    fusion = FrictionFusion()
    feed(fusion, *[single(before, noise=0.03)] * 20)
    mu, sigma = feed(fusion, *[single(after, noise=0.03)] * 3)
    assert mu == pytest.approx(after, rel=0.1)
    assert fusion.changes == 1
    assert abs(mu - after) < sigma


def test_the_first_surprise_widens_the_sigma_and_a_stray_one_is_forgotten():
    fusion = FrictionFusion()
    _, calm = feed(fusion, *[single(0.47, noise=0.05)] * 20)
    mu, doubt = fusion.update(single(0.37, noise=0.05))
    assert fusion.changes == 0
    assert doubt > 1.4 * calm
    assert mu == pytest.approx(0.47, rel=0.02)
    mu, after = feed(fusion, *[single(0.47, noise=0.05)] * 5)
    assert mu == pytest.approx(0.47, rel=0.02)
    assert after < 1.1 * calm


def test_revolutions_that_tell_nothing_widen_the_sigma_until_the_next_that_does():
    fusion = FrictionFusion()
    feed(fusion, *[single(0.47)] * 10)
    sigmas = [fusion.update(None)[1] for _ in range(30)]
    assert np.all(np.diff(sigmas) > 0.0)
    assert sigmas[-1] > 0.15
    assert fusion.update(single(0.47))[1] < sigmas[0]


def test_passages_at_small_slip_do_not_drag_the_average():
    fusion = FrictionFusion()
    feed(fusion, *[single(0.47)] * 5)
    mu, _ = feed(fusion, *[Single(6.0, 4.0, 0.0, 0.0)] * 50)
    assert mu == pytest.approx(0.47, rel=0.05)
