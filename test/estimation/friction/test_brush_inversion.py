"""From readings to friction: the inverse of the brush model, and how far to trust it."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.estimation.friction.brush_inversion import (
    consistency_inflation, flag_full_sliding, friction_estimate, single_friction, SlipFit,
    total_slip, traction_force)
from smart_tire.estimation.friction.motion_history import UNKNOWN
from smart_tire.models.tire import brush_tire

LOAD, STIFFNESS = (26.7, 0.5), (52.7, 5.27)
NONE = np.zeros((2, 2))


def evidence(slip=0.11, sliding=0.19, slip_sigma=0.002, sliding_sigma=0.005):
    return SlipFit(slip, sliding, np.diag([slip_sigma**2, sliding_sigma**2]), NONE)


@pytest.mark.parametrize('mu', [0.1, 0.47, 0.9])
@pytest.mark.parametrize(('slip', 'lateral'), [(0.05, 0.0), (0.11, 0.09), (0.2, -0.1)])
def test_mu_is_that_whose_brush_tire_slides_as_much(mu, slip, lateral):
    total = math.hypot(slip, lateral)
    sliding = total / float(brush_tire.critical_slip(mu, LOAD[0], STIFFNESS[0]))
    single = single_friction(evidence(slip, sliding), (lateral, 0.0), LOAD, STIFFNESS)
    assert 1.0 / single.inverse == pytest.approx(mu)


@pytest.mark.parametrize(('change', 'share'), [
    ({'slip_sigma': 0.011}, 'noise'), ({'sliding_sigma': 0.019}, 'noise')])
def test_relative_errors_of_what_is_measured_become_those_of_mu(change, share):
    exact = {'slip_sigma': 0.0, 'sliding_sigma': 0.0}
    single = single_friction(evidence(**{**exact, **change}), (0.0, 0.0), LOAD, STIFFNESS)
    assert getattr(single, share) / single.inverse == pytest.approx(0.1)
    assert single.constant == pytest.approx(math.hypot(0.1, 0.5 / 26.7))


def test_the_stiffness_alone_keeps_the_sigma_up():
    single = single_friction(evidence(slip_sigma=0.0, sliding_sigma=1e-9), (0.0, 0.0), LOAD,
                             STIFFNESS)
    mu, sigma = single.estimate()
    assert sigma / mu == pytest.approx(math.hypot(0.1, 0.5 / 26.7), rel=0.01)


def test_without_slip_load_or_lateral_speed_there_is_no_mu():
    assert single_friction(evidence(slip=0.0), (0.0, 0.0), LOAD, STIFFNESS) is None
    assert single_friction(evidence(), UNKNOWN, LOAD, STIFFNESS) is None
    assert single_friction(evidence(), (0.0, 0.0), UNKNOWN, STIFFNESS) is None
    assert total_slip((0.1, 0.01), UNKNOWN) == UNKNOWN


def test_a_passage_that_says_little_is_unknown_and_a_sharp_one_is_taken_as_it_is():
    assert friction_estimate(2.0, 4.0, 0.1) == UNKNOWN
    assert friction_estimate(30.0, 40.0, 0.1) == UNKNOWN
    mu, sigma = friction_estimate(1.0 / 0.9, 0.01, 0.1)
    assert mu == pytest.approx(0.9)
    assert sigma == pytest.approx(0.09, rel=0.02)


def test_the_estimate_covers_the_grounds_that_there_are():
    rng = np.random.default_rng(0)
    told = []
    for mu in 0.45 * 2.0**rng.standard_normal(10000):
        noise = rng.uniform(0.05, 0.35) / 0.45
        value, sigma = friction_estimate(1.0 / mu + noise * rng.standard_normal(), noise, 0.0)
        if math.isfinite(value):
            told.append((mu - value) / sigma)
    assert 0.6 < np.mean(np.abs(told) < 1.0) < 0.8
    assert np.mean(np.abs(told) < 2.0) > 0.92
    assert abs(np.median(told)) < 0.1


@pytest.mark.parametrize('mu', [0.2, 0.47, 0.7])
@pytest.mark.parametrize('noise', [0.2, 0.5, 0.75, 0.8, 1.0, 2.0])
def test_whether_a_passage_is_told_does_not_hang_on_what_it_says(mu, noise):
    rng = np.random.default_rng(1)
    told = np.array([friction_estimate(1.0 / mu + noise * rng.standard_normal(), noise, 0.0)[0]
                     for _ in range(400)])
    share = np.mean(np.isfinite(told))
    if noise * mu > 0.3:  # also one that came out low is not told
        assert share in (0.0, 1.0)
    if share == 1.0 and mu < 0.5:
        assert abs(np.median(told) / mu - 1.0) < 0.1


def test_on_a_slippery_ground_that_is_known_less_slip_is_enough():
    assert friction_estimate(5.0, 1.0, 0.0) == UNKNOWN
    mu, sigma = friction_estimate(5.0, 1.0, 0.0, likely=0.2)
    assert 0.2 < mu < 0.25  # the prior knows other grounds
    assert 0.15 < sigma / mu < 0.5
    assert friction_estimate(2.0, 1.0, 0.0, likely=2.0) == UNKNOWN  # a typical one is possible


def test_a_negative_sliding_is_noise_and_pulls_down_the_inverse():
    single = single_friction(evidence(sliding=-0.01, sliding_sigma=0.05), (0.0, 0.0), LOAD,
                             STIFFNESS)
    assert single.inverse < 0.0 < single.noise
    assert math.isnan(single.estimate()[0]) or single.estimate()[1] > 0.3 * single.estimate()[0]


def test_what_lasts_is_apart_from_noise():
    told = SlipFit(0.11, 0.19, np.diag([0.0, 0.0019**2]), np.diag([0.0011**2, 0.0]))
    single = single_friction(told, (0.0, 0.0), LOAD, STIFFNESS)
    assert single.noise / single.inverse == pytest.approx(0.01)
    assert single.lasting / single.inverse == pytest.approx(0.01)


def tied(sliding=0.85):
    """Return evidence of a ridge: slip and sliding may both be larger."""
    slip = 0.4
    both = np.array([slip, sliding])
    return SlipFit(slip, sliding, 0.06**2 * np.outer(both, both) + np.diag([1e-6, 1e-5]), NONE)


def test_where_the_whole_patch_may_slide_only_the_ratio_shows():
    wide = flag_full_sliding(tied())
    assert wide.slip_sigma > 0.3
    # what a slip from elsewhere makes of it
    sliding = 0.85 + wide.noise[0, 1] / wide.noise[0, 0] * (0.8 - 0.4)
    assert sliding == pytest.approx(0.8 * 0.85 / 0.4, rel=0.05)


def test_what_is_added_to_the_noise_does_not_hide_that_only_the_ratio_shows():
    strayed = replace(tied(), noise=tied().noise + 2.0 * np.diag(np.diag(tied().noise)))
    assert flag_full_sliding(strayed) is strayed
    assert flag_full_sliding(strayed, tied().noise).slip_sigma > 0.3


def test_where_little_slides_the_slip_is_what_it_is():
    for told in (evidence(), tied(sliding=0.3)):
        assert flag_full_sliding(told) is told


def test_slips_that_agree_change_nothing_and_others_widen():
    assert consistency_inflation(evidence(), (0.112, 0.002)) == 1.0
    assert consistency_inflation(evidence(), UNKNOWN) == 1.0
    scale = consistency_inflation(evidence(), (0.15, 0.002))
    assert scale > 10.0
    assert evidence().inflated(scale).slip_sigma == pytest.approx(0.002 * math.sqrt(scale))


@pytest.mark.parametrize('direction', [1, -1])
@pytest.mark.parametrize('slip', [0.11, -0.11])
def test_the_force_is_that_of_the_brush_tire_with_this_friction(slip, direction):
    told = evidence(slip)
    mu = 1.0 / single_friction(told, (0.05, 0.0), LOAD, STIFFNESS).inverse
    force, sigma = traction_force(told, (0.05, 0.0), direction, LOAD, STIFFNESS)
    expected = brush_tire.brush_force(direction * slip, 0.05, mu, LOAD[0], STIFFNESS[0])[0]
    assert force == pytest.approx(float(expected))
    assert math.copysign(1.0, force) == math.copysign(1.0, slip * direction)
    assert sigma > 0.1 * abs(force)
    assert traction_force(told, UNKNOWN, direction, LOAD, STIFFNESS) == UNKNOWN
