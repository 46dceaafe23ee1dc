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

"""Lower bound of the friction coefficient from the estimates of the wheels."""

from __future__ import annotations

import math

import pytest

from smart_tire.control.ground_knowledge import GroundKnowledge
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters.path_following import FrictionLimitParams
from smart_tire.samples import Friction, LEFT, NS_PER_S, RIGHT
from smart_tire.uncertain import Uncertain, UNKNOWN

PARAMS = FrictionLimitParams(share=0.5, sigmas=2.0, unknown=0.3, minimum=0.05, fade_distance=2.0,
                             fade_time=10.0)


def limit(*estimates, driven=0.0, now_ns=0):
    """Return a limit with estimates (wheel, mu, sigma), and a distance driven since."""
    made = GroundKnowledge()
    for wheel, mu, sigma in estimates:
        made.update(Friction(0, wheel, Uncertain(mu, sigma)))
    made.drive(driven, now_ns)
    return made


def test_unknown_friction_is_the_configured_one():
    assert limit().lower_bound(PARAMS) == 0.3
    assert limit().acceleration(PARAMS) == pytest.approx(0.5 * 0.3 * GRAVITY)


@pytest.mark.parametrize(('mu', 'sigma', 'bound'), [
    (0.8, 0.04, 0.759 - 2.0 * 0.0371),
    (0.8, 0.1, 0.65 - 2.0 * 0.1 / math.sqrt(2.0)),  # as certain as the prior, 0.5 +- 0.1
    (0.2, 0.1, 0.35 - 2.0 * 0.1 / math.sqrt(2.0)),
    (0.5, 10.0, 0.3),         # nothing is known: the prior
    (0.01, 1e-4, 0.05)])      # minimum
def test_the_lower_bound_is_some_standard_deviations_below_estimate_and_prior(mu, sigma, bound):
    assert limit(('front_left', mu, sigma)).lower_bound(PARAMS) == pytest.approx(bound, rel=1e-3)


def test_an_uncertain_estimate_does_not_lower_the_bound_of_unknown_ground():
    assert limit(('front_left', 0.6, 0.3)).lower_bound(PARAMS) >= 0.3


def alone(mu):
    """Return the bound of one wheel with an exact estimate."""
    return limit(('front_left', mu, 0.0)).lower_bound(PARAMS)


def test_an_exact_estimate_has_the_uncertainty_of_the_wheel_load():
    assert alone(0.8) == pytest.approx(limit(('front_left', 0.8, 0.032)).lower_bound(PARAMS))
    assert alone(0.8) < 0.74


def test_the_smallest_bound_counts_and_the_latest_of_each_wheel():
    high, low = ('front_left', 0.8, 0.0), ('front_right', 0.2, 0.0)
    assert limit(high, low).lower_bound(PARAMS) == alone(0.2)
    assert limit(low, high).lower_bound(PARAMS) == alone(0.2)
    assert limit(('front_left', 0.2, 0.0), high).lower_bound(PARAMS) == alone(0.8)


@pytest.mark.parametrize('mu', [0.1, 0.9])
def test_knowledge_fades_with_the_distance_driven_and_the_time_since(mu):
    known = alone(mu) - 0.3
    for distance, time in ((2.0, 0.0), (0.0, 10.0), (1.0, 5.0), (0.0, -10.0)):
        made = limit(('front_left', mu, 0.0), driven=distance, now_ns=round(time * NS_PER_S))
        assert made.lower_bound(PARAMS) == pytest.approx(0.3 + known / math.e)
    assert limit(('front_left', mu, 0.0), driven=6.1).lower_bound(PARAMS) == 0.3
    assert limit(('front_left', mu, 0.0), now_ns=31 * NS_PER_S).lower_bound(PARAMS) == 0.3


def test_an_estimate_is_as_old_as_the_distance_since_it():
    made = limit(driven=5.0)
    made.update(Friction(0, 'front_left', Uncertain(0.9, 0.0)))
    assert made.lower_bound(PARAMS) == alone(0.9)
    made.update(Friction(0, 'front_left', Uncertain(0.9, 0.0)), behind=2.0)
    assert made.lower_bound(PARAMS) == pytest.approx(0.3 + (alone(0.9) - 0.3) / math.e)


@pytest.mark.parametrize('estimate', [
    UNKNOWN, Uncertain(0.5, math.inf), Uncertain(0.5, math.nan), Uncertain(math.inf, 0.1),
    Uncertain(1.3, 1e-3), Uncertain(1e9, 0.0), Uncertain(0.0, 0.1), Uncertain(-0.5, 0.1),
    Uncertain(0.5, -0.1)])
def test_an_implausible_coefficient_changes_nothing(estimate):
    made = limit(('front_left', 0.6, 0.0))
    made.update(Friction(1, 'front_left', estimate))
    made.update(Friction(1, 'spare', Uncertain(0.1, 0.0)))
    assert made.lower_bound(PARAMS) == alone(0.6)


def test_each_side_has_its_latest_measurement_and_its_weight():
    made = limit(('front_left', 0.5, 0.0), driven=2.0)
    made.update(Friction(0, 'rear_left', Uncertain(0.4, 0.1), normal_load=Uncertain(20.0, 1.0),
                         critical_slip=Uncertain(0.5, 0.1)))
    measured, weight = made.latest(LEFT, PARAMS)
    assert (measured.friction, measured.per_load, weight) == ((0.4, 0.1), (0.025, 0.005), 1.0)
    assert made.latest(RIGHT, PARAMS) is None
    made.clear()
    assert made.latest(LEFT, PARAMS) is None
