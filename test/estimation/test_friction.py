"""From readings to friction: the inverse of the brush model, and how far to trust it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.friction import (
    Evidence, FilmReading, friction_estimate, join_slip, map_sliding, single_friction, total_slip,
    traction_force, weigh)
from smart_tire.estimation.motion import UNKNOWN
from smart_tire.models import brush_tire, tread_film

L, FILM = 0.046, 0.020
LOAD, STIFFNESS = (26.7, 0.5), (52.7, 5.27)
GAINS = (307.5, 242.5)
NONE = np.zeros((2, 2))


def reading(slip, sliding, gain=307.5, slip_sigma=0.002, sliding_sigma=0.006, tied=0.1,
            drift=(0.0, 0.0)):
    covariance = np.array([[(gain * slip_sigma)**2, tied * gain * slip_sigma * sliding_sigma],
                           [tied * gain * slip_sigma * sliding_sigma, sliding_sigma**2]])
    return FilmReading(gain * slip, sliding, covariance, gain, np.array(drift))


def evidence(slip=0.11, sliding=0.19, slip_sigma=0.002, sliding_sigma=0.005):
    return Evidence(slip, sliding, np.diag([slip_sigma**2, sliding_sigma**2]), NONE)


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
    for mu in 0.45 * 2.0**rng.standard_normal(4000):
        noise = rng.uniform(0.05, 1.0) / 0.45
        value, sigma = friction_estimate(1.0 / mu + noise * rng.standard_normal(), noise, 0.0)
        if math.isfinite(value):
            told.append((mu - value) / sigma)
    assert 0.6 < np.mean(np.abs(told) < 1.0) < 0.8
    assert np.mean(np.abs(told) < 2.0) > 0.92
    assert abs(np.median(told)) < 0.1


def test_two_films_are_sharper_than_one_but_not_than_their_gains():
    one, two = weigh([reading(0.11, 0.19)], 0.03), weigh(
        [reading(0.11, 0.19, gain) for gain in GAINS], 0.03)
    assert two.sliding_sigma == pytest.approx(one.sliding_sigma / math.sqrt(2.0))
    assert two.slip_sigma < one.slip_sigma
    endless = weigh([reading(0.11, 0.19, gain, slip_sigma=1e-6) for gain in GAINS], 0.03)
    assert endless.slip_sigma == pytest.approx(0.03 * 0.11 / math.sqrt(2.0), rel=0.02)


def test_films_that_contradict_each_other_are_trusted_less():
    agree = weigh([reading(0.11, 0.19), reading(0.11, 0.19)], 0.03)
    differ = weigh([reading(0.11, 0.10), reading(0.11, 0.30)], 0.03)
    assert differ.sliding_sigma > 3.0 * agree.sliding_sigma


def test_a_slip_that_changed_in_the_passage_is_noise():
    calm, rough = (weigh([reading(0.11, 0.19, drift=drift)], 0.03)
                   for drift in ((0.0, 0.0), (10.0, 0.05)))
    assert rough.sliding_sigma > 5.0 * calm.sliding_sigma
    assert rough.slip_sigma > 5.0 * calm.slip_sigma


def test_where_the_whole_patch_may_slide_only_the_ratio_shows():
    films = [reading(0.4, 0.85, gain, slip_sigma=0.03, sliding_sigma=0.06, tied=0.98)
             for gain in GAINS]
    alone = weigh(films, 0.03)
    assert alone.slip_sigma > 0.3
    joined = join_slip(alone, (0.8, 0.01))
    assert joined.sliding == pytest.approx(0.8 * 0.85 / 0.4, rel=0.1)


def test_the_slip_estimator_sharpens_the_slip_and_disagreement_widens_it():
    alone = weigh([reading(0.11, 0.19, gain) for gain in GAINS], 0.03)
    joined, odd = join_slip(alone, (0.112, 0.002)), join_slip(alone, (0.15, 0.002))
    assert joined.slip_sigma < min(alone.slip_sigma, 0.002)
    assert odd.slip_sigma > 3.0 * joined.slip_sigma
    assert join_slip(alone, UNKNOWN) is alone
    assert joined.sliding == pytest.approx(alone.sliding, rel=0.02)


def test_the_printed_map_overestimates_mu_by_two():
    for mu in (0.3, 0.47, 0.8):
        sliding = 0.13 / float(brush_tire.critical_slip(mu, LOAD[0], STIFFNESS[0]))
        exact, printed = (single_friction(
            map_sliding(evidence(sliding=sliding), FILM, L, method), (0.0, 0.0), LOAD, STIFFNESS)
            for method in ('exact', 'printed'))
        assert 1.7 < exact.inverse / printed.inverse < 2.3


def test_the_printed_map_is_the_one_of_the_models():
    x_m = float(tread_film.peak_position((1.0 - 0.19) * L, FILM, L))
    printed = map_sliding(evidence(), FILM, L, 'printed')
    length = float(tread_film.adhesion_length(x_m, FILM, L, 'printed'))
    assert printed.sliding == pytest.approx(1.0 - length / L)


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
