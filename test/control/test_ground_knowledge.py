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

"""Friction of the present ground, and the acceleration that it allows."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control.ground_knowledge import GroundKnowledge, PRIOR_SIGMA
from smart_tire.parameters.path_following import FrictionLimitParams
from smart_tire.samples import GRAVITY, GroundState, NS_PER_S
from smart_tire.uncertain import fused, Uncertain, UNKNOWN

PARAMS = FrictionLimitParams(share=0.5, sigmas=2.0, unknown=0.3, minimum=0.05, fade_distance=2.0,
                             fade_time=10.0)
PRIOR = Uncertain(0.3 + 2.0 * PRIOR_SIGMA, PRIOR_SIGMA)


def ground(mu, sigma=0.0, stiffness=50.0, stiffness_sigma=5.0, correlation=0.0):
    return GroundState(0, Uncertain(stiffness, stiffness_sigma), Uncertain(mu, sigma),
                       stiffness_friction_correlation=correlation)


def knowledge(*grounds, driven=0.0, now_ns=0):
    """Return what is known of these grounds after a distance driven since."""
    made = GroundKnowledge()
    for one in grounds:
        made.set_ground(one)
    made.drive(driven, now_ns)
    return made


def bound(made):
    """Return the lower bound of the friction."""
    return made.acceleration(PARAMS) / (PARAMS.share * GRAVITY)


def test_unknown_friction_is_the_configured_one():
    assert bound(knowledge()) == pytest.approx(0.3)
    assert knowledge().friction(0.3, PARAMS) == (0.3, PRIOR_SIGMA)


@pytest.mark.parametrize(('mu', 'sigma'), [(0.8, 0.04), (0.8, 0.15), (0.2, 0.15), (0.5, 1.0)])
def test_the_lower_bound_is_some_standard_deviations_below_estimate_and_prior(mu, sigma):
    mean, spread = fused(PRIOR, Uncertain(mu, sigma))
    assert bound(knowledge(ground(mu, sigma))) == pytest.approx(mean - 2.0 * spread)


def test_the_lower_bound_has_a_minimum():
    assert bound(knowledge(ground(0.01, 1e-4))) == pytest.approx(0.05)


def test_an_uncertain_estimate_does_not_lower_the_bound_of_unknown_ground():
    assert bound(knowledge(ground(0.6, 0.3))) >= 0.3
    assert bound(knowledge(ground(0.5, 10.0))) == pytest.approx(0.3, abs=1e-3)


def test_an_exact_estimate_has_the_uncertainty_of_the_wheel_load():
    assert bound(knowledge(ground(0.8))) == bound(knowledge(ground(0.8, 0.032)))
    assert bound(knowledge(ground(0.8))) < 0.74


def test_the_latest_ground_counts():
    assert bound(knowledge(ground(0.2), ground(0.8))) == bound(knowledge(ground(0.8)))


@pytest.mark.parametrize('mu', [0.1, 0.9])
def test_knowledge_fades_with_the_distance_driven_and_the_time_since(mu):
    known = bound(knowledge(ground(mu))) - 0.3
    for distance, time in ((2.0, 0.0), (0.0, 10.0), (1.0, 5.0), (0.0, -10.0)):
        made = knowledge(ground(mu), driven=distance, now_ns=round(time * NS_PER_S))
        assert bound(made) == pytest.approx(0.3 + known / math.e)
    assert bound(knowledge(ground(mu), driven=6.1)) == pytest.approx(0.3)
    assert bound(knowledge(ground(mu), now_ns=31 * NS_PER_S)) == pytest.approx(0.3)


def test_an_estimate_is_as_old_as_the_distance_since_it():
    made, certain = knowledge(driven=5.0), bound(knowledge(ground(0.9)))
    made.set_ground(ground(0.9))
    assert bound(made) == certain
    made.set_ground(ground(0.9), behind=2.0)
    assert bound(made) == pytest.approx(0.3 + (certain - 0.3) / math.e)


@pytest.mark.parametrize('bad', [
    *(replace(ground(0.5), friction_coefficient=one) for one in (
        UNKNOWN, Uncertain(0.5, math.inf), Uncertain(0.5, math.nan), Uncertain(math.inf, 0.1),
        Uncertain(1.3, 1e-3), Uncertain(1e9, 0.0), Uncertain(0.0, 0.1), Uncertain(-0.5, 0.1),
        Uncertain(0.5, -0.1))),
    *(ground(0.5, stiffness=one) for one in (0.9, 1.1e6, -50.0, math.nan)),
    *(ground(0.5, stiffness_sigma=one) for one in (-0.1, math.inf, math.nan)),
    *(ground(0.5, correlation=one) for one in (-1.01, 1.01, math.nan))])
def test_an_implausible_ground_changes_nothing(bad):
    made = knowledge(ground(0.6), bad)
    assert bound(made) == bound(knowledge(ground(0.6)))
    made.clear()
    assert made.latest(PARAMS) is None


@pytest.mark.parametrize(('correlation', 'relative'), [
    (0.0, math.sqrt(0.05)), (1.0, 0.1), (-1.0, 0.3)])
def test_the_critical_slip_over_the_load_is_that_of_the_brush_model(correlation, relative):
    made = knowledge(ground(0.5, 0.05, 50.0, 10.0, correlation))
    measured, weight = made.latest(PARAMS)
    assert measured.friction == (0.5, 0.05)
    assert measured.slip_per_load == pytest.approx((0.03, 0.03 * relative))
    assert weight == 1.0


def test_the_critical_slip_has_at_least_the_uncertainty_of_the_wheel_load():
    measured, _ = knowledge(ground(0.5, 0.05, 50.0, 5.0, 1.0)).latest(PARAMS)
    assert measured.slip_per_load == pytest.approx((0.03, 0.03 * 0.04))
