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

from smart_tire.control.friction_limit import FrictionLimit, GRAVITY
from smart_tire.parameters.path_following import FrictionLimitParams
from smart_tire.samples import Friction
from smart_tire.uncertain import Uncertain, UNKNOWN

PARAMS = FrictionLimitParams(share=0.5, sigmas=2.0, unknown=0.3, minimum=0.05, fade_distance=2.0)


def limit(*estimates, driven=0.0):
    """Return a limit with estimates (wheel, mu, sigma), and a distance driven since."""
    made = FrictionLimit()
    for wheel, mu, sigma in estimates:
        made.update(Friction(0, wheel, Uncertain(mu, sigma)))
    made.drive(driven)
    return made


def test_unknown_friction_is_the_configured_one():
    assert limit().lower_bound(PARAMS) == 0.3
    assert limit().acceleration(PARAMS) == pytest.approx(0.5 * 0.3 * GRAVITY)


@pytest.mark.parametrize(('mu', 'sigma', 'bound'), [
    (0.8, 1e-4, 0.8 - 2e-4),  # mu - 2 sigma
    (0.8, 0.1, 0.65 - 2.0 * 0.1 / math.sqrt(2.0)),  # as certain as the prior, 0.5 +- 0.1
    (0.2, 0.1, 0.35 - 2.0 * 0.1 / math.sqrt(2.0)),
    (0.5, 10.0, 0.3),         # nothing is known: the prior
    (0.01, 1e-4, 0.05)])      # minimum
def test_the_lower_bound_is_some_standard_deviations_below_estimate_and_prior(mu, sigma, bound):
    assert limit(('a', mu, sigma)).lower_bound(PARAMS) == pytest.approx(bound, rel=1e-3)


def test_an_uncertain_estimate_does_not_lower_the_bound_of_unknown_ground():
    assert limit(('a', 0.6, 0.3)).lower_bound(PARAMS) >= 0.3


def test_the_smallest_bound_counts_and_the_latest_of_each_wheel():
    assert limit(('a', 0.8, 0.0), ('b', 0.2, 0.0)).lower_bound(PARAMS) == pytest.approx(0.2)
    assert limit(('b', 0.2, 0.0), ('a', 0.8, 0.0)).lower_bound(PARAMS) == pytest.approx(0.2)
    assert limit(('a', 0.2, 0.0), ('a', 0.8, 0.0)).lower_bound(PARAMS) == pytest.approx(0.8)


@pytest.mark.parametrize('mu', [0.1, 0.9])
def test_knowledge_fades_with_the_distance_driven_since(mu):
    bounds = [limit(('a', mu, 0.0), driven=driven).lower_bound(PARAMS)
              for driven in (0.0, 2.0, 5.9, 6.1)]
    assert bounds == pytest.approx([mu, 0.3 + (mu - 0.3) / math.e,
                                    0.3 + (mu - 0.3) * math.exp(-2.95), 0.3])


def test_an_estimate_is_as_old_as_the_distance_since_it():
    made = limit(driven=5.0)
    made.update(Friction(0, 'a', Uncertain(0.9, 0.0)))
    assert made.lower_bound(PARAMS) == pytest.approx(0.9)


@pytest.mark.parametrize('estimate', [
    UNKNOWN, Uncertain(0.5, math.inf), Uncertain(0.5, math.nan), Uncertain(math.inf, 0.1)])
def test_an_unobservable_coefficient_changes_nothing(estimate):
    made = limit(('a', 0.6, 0.0))
    made.update(Friction(1, 'a', estimate))
    assert made.lower_bound(PARAMS) == pytest.approx(0.6)
