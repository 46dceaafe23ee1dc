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

"""Bayes filter of the friction coefficient over revolutions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.friction.bayes_filter import FrictionFilter
from smart_tire.estimation.friction.brush_inversion import (
    FrictionSample, GroundStiffness, single_friction, SlipFit)
from smart_tire.uncertain import Uncertain

NOMINAL, LOAD = 52.7, Uncertain(26.7, 0.0)  # N, C_0 and the load
STRAIGHT = Uncertain(0.0, 0.0)              # -, lateral slip


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


def test_an_uninformative_crossing_increases_the_sigma_like_one_without_result():
    with_crossings, without = FrictionFilter(), FrictionFilter()
    for friction_filter in (with_crossings, without):
        update(friction_filter, *[sample(0.47, white=0.05)] * 20)
    for _ in range(30):
        before = with_crossings.estimate().sigma
        wide = with_crossings.update(sample(0.47, white=200.0))
        assert wide.sigma > before
        assert tuple(wide) == pytest.approx(tuple(without.update(None)), rel=0.05)
    assert wide.sigma > 0.2


def crossing(rng, mu, slip, slip_error, slip_sigma, noise, stiffness=NOMINAL):
    """Return a revolution of films with the ``noise`` of normalized slip."""
    t = abs(slip) * stiffness / (3.0 * mu * LOAD.value) + noise * rng.standard_normal()
    fit = SlipFit(slip + slip_error, t, np.diag([0.0, noise**2]), np.diag([slip_sigma**2, 0.0]))
    return single_friction(fit, STRAIGHT, LOAD, NOMINAL, slip_sigma)


@pytest.mark.parametrize(('before', 'after', 'slip'), [
    (0.2, 0.2, 0.0), (0.2, 0.2, 0.003), (0.8, 0.2, 0.006), (0.47, 0.47, 0.006)])
def test_after_hundreds_of_revolutions_without_slip_the_sigma_is_that_of_the_prior(
        before, after, slip):
    # the slip is wrong by a constant, which the filter must not take for many measurements
    normalized, relative = [], []
    for seed in range(20):
        rng, friction_filter = np.random.default_rng(seed), FrictionFilter()
        error = 0.004 * rng.standard_normal()
        update(friction_filter, *[crossing(rng, before, 0.1, error, 0.004, 0.01)] * 15)
        mu, sigma = update(friction_filter, *(
            crossing(rng, after, slip, error, 0.004, 0.04) for _ in range(300)))
        relative.append(sigma / mu if math.isfinite(mu) else 1.0)
        normalized.append((mu - after) / sigma)
    assert np.median(relative) > 0.75 and min(relative) > 0.4
    assert np.nanmean(np.square(normalized)) < 1.6


def test_mu_follows_the_present_stiffness_and_critical_slip_does_not():
    friction_filter = FrictionFilter()
    mu = update(friction_filter, *[sample(0.47)] * 20).value
    nominal = friction_filter.estimate_nominal()
    assert friction_filter.estimate(GroundStiffness(0.5)).value == pytest.approx(0.5 * mu)
    friction_filter.update(None, GroundStiffness(0.5, 0.3))
    assert friction_filter.estimate_nominal().value == pytest.approx(nominal.value, rel=0.02)


def test_a_change_of_stiffness_alone_is_not_a_surface_change():
    friction_filter = FrictionFilter()
    for ratio in [1.0] * 20 + [0.4] * 20:
        friction_filter.update(sample(0.47, white=0.02), GroundStiffness(ratio, 0.05))
    assert friction_filter.changes == 0


@pytest.mark.parametrize('ratio', [0.4, 0.8, 1.5])
def test_the_prior_is_that_of_mu_on_any_ground(ratio):
    vague = [sample(0.3, white=0.6), sample(0.5, white=0.9)]
    mu, friction_filter = update(FrictionFilter(), *vague), FrictionFilter()
    for one in vague:  # the same surface by its mu_0
        found = friction_filter.update(FrictionSample(
            ratio * one.inverse_mu, ratio * one.white_sigma, ratio * one.systematic_sigma,
            one.scale_sigma), GroundStiffness(ratio))
    assert found.value == pytest.approx(mu.value, rel=0.01)
    assert found.sigma == pytest.approx(mu.sigma, rel=0.25)  # the grid ends at 4 for mu_0


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_errors_that_slip_and_stiffness_share_cancel(sign):
    friction_filter = FrictionFilter()
    # a larger slip lowers 1 / mu_0 when driving and raises it when braking
    update(friction_filter, *[sample(0.47, white=0.03, systematic=0.1, scale=0.0,
                                     slip_effect=-0.1 * sign)] * 400)
    mu, nominal = friction_filter.estimate_nominal()
    cancelled, independent, added = (
        friction_filter.estimate(GroundStiffness(1.0, 0.1, rho * sign)).sigma / mu
        for rho in (-1.0, 0.0, 1.0))
    assert cancelled < 0.04
    assert independent == pytest.approx(math.hypot(nominal / mu, 0.1))
    assert added > 0.19


@pytest.mark.parametrize(('rho', 'sigma', 'slip_sigma', 'slip'), [
    (0.0, 0.1, 0.005, 0.1), (-1.0, 0.1, 0.01, 0.1), (-0.9, 0.1, 0.01, 0.1),
    (0.9, 0.1, 0.01, -0.1), (0.6, 0.06, 0.005, 0.1), (-0.5, 0.06, 0.01, 0.15)])
def test_errors_with_a_wrong_stiffness_are_consistent(rho, sigma, slip_sigma, slip):
    rng, mu, stiffness = np.random.default_rng(1), 0.25, 25.0  # sand
    covariance = [[sigma**2, rho * sigma * slip_sigma], [rho * sigma * slip_sigma, slip_sigma**2]]
    fused, single = [], []
    for _ in range(150):
        log_error, slip_error = rng.multivariate_normal((0.0, 0.0), covariance)
        ground = GroundStiffness(stiffness * math.exp(log_error) / NOMINAL, sigma, rho)
        friction_filter = FrictionFilter()
        for _ in range(10):
            one = crossing(rng, mu, slip, slip_error, slip_sigma, 0.01, stiffness)
            found = friction_filter.update(one, ground)
        fused.append((found.value - mu) / found.sigma)
        alone = one.estimate(ground)
        single.append((alone.value - mu) / alone.sigma)
    # errors that vary slowly are counted as partly white, too: small ones are overestimated
    assert 0.4 < np.mean(np.square(fused)) < 1.3
    assert 0.6 < np.nanmean(np.square(single)) < 1.3
    assert np.mean(np.abs(fused) < 2.0) > 0.92


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
