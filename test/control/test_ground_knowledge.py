# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction and stiffness of the present ground, as measured."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control.constants import PRIOR_SIGMA
from smart_tire.control.ground_knowledge import GroundKnowledge
from smart_tire.parameters.path_following import FrictionLimitParams
from smart_tire.samples import GRAVITY, GroundState, NS_PER_S
from smart_tire.uncertain import fused, Uncertain, UNKNOWN

PARAMS = FrictionLimitParams(share=0.5, sigmas=2.0, unknown=0.3, minimum=0.05, fade_distance=2.0,
                             fade_time=10.0)
PRIOR = Uncertain(0.3 + 2.0 * PRIOR_SIGMA, PRIOR_SIGMA)


def ground(mu, sigma=0.0, stiffness=50.0):
    return GroundState(0, Uncertain(stiffness, 5.0), Uncertain(mu, sigma))


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


@pytest.mark.parametrize('mu', [0.1, 0.9])
def test_knowledge_fades_with_the_distance_driven_and_the_time_since(mu):
    known = bound(knowledge(ground(mu))) - 0.3
    for distance, time in ((2.0, 0.0), (0.0, 10.0), (1.0, 5.0)):
        made = knowledge(ground(mu), driven=distance, now_ns=round(time * NS_PER_S))
        assert bound(made) == pytest.approx(0.3 + known / math.e)
    made = knowledge(replace(ground(mu), stamp_ns=10 * NS_PER_S))  # ahead of the odometry
    assert bound(made) == pytest.approx(0.3 + known / math.e)
    assert bound(knowledge(ground(mu), driven=40.0)) == pytest.approx(0.3)
    assert bound(knowledge(ground(mu), now_ns=200 * NS_PER_S)) == pytest.approx(0.3)


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
        Uncertain(0.5, -0.1)))])
def test_implausible_friction_changes_nothing(bad):
    made = knowledge(ground(0.6), bad)
    assert bound(made) == bound(knowledge(ground(0.6)))
    made.drive(0.0, -10 * NS_PER_S)
    assert bound(made) == pytest.approx(0.3)


@pytest.mark.parametrize('bad', [0.0, -50.0, math.nan, math.inf])
def test_implausible_stiffness_changes_nothing(bad):
    made = knowledge(ground(0.6, stiffness=40.0), ground(0.6, stiffness=bad))
    assert made.stiffness(50.0, PARAMS) == pytest.approx(40.0)
    made.drive(0.0, -10 * NS_PER_S)
    assert made.stiffness(50.0, PARAMS) == 50.0


def test_stiffness_is_known_without_friction_and_fades_like_it():
    made = knowledge(replace(ground(0.6, stiffness=30.0), friction_coefficient=UNKNOWN))
    assert bound(made) == pytest.approx(0.3)
    assert made.stiffness(50.0, PARAMS) == 30.0
    made.drive(2.0, 0)
    assert made.stiffness(50.0, PARAMS) == pytest.approx(50.0 - 20.0 / math.e)
    made.drive(38.0, 0)
    assert made.stiffness(50.0, PARAMS) == pytest.approx(50.0)
