# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Matching of crossings, and scores of their friction."""

import math

import numpy as np
import pytest

from smart_tire.analysis.friction_metrics import friction_score, friction_scores, kind_of, match
from smart_tire.samples import Friction
from smart_tire.uncertain import Uncertain

EPOCH = 1_700_000_000_000_000_000


def crossing(time_s, wheel='front_right', **value):
    quantities = {name: Uncertain(value[name], value.get(f'{name}_sigma', math.inf))
                  for name in value if not name.endswith('_sigma')}
    return Friction(EPOCH + round(time_s * 1e9), wheel, **quantities)


def true(time_s, slip=0.1, mu=0.47, **others):
    return crossing(time_s, slip=slip, friction_coefficient=mu, adhesion_ratio=0.5, **others)


def estimate(time_s, single, sigma=0.05, **others):
    return crossing(time_s, friction_coefficient_single=single,
                    friction_coefficient_single_sigma=sigma, **others)


def test_each_crossing_is_matched_with_the_nearest_of_its_wheel():
    truths = [true(1.0), true(2.0), true(2.0, wheel='front_left')]
    estimates = [estimate(2.01, 0.2), estimate(0.99, 0.1), estimate(1.97, 0.3, wheel='front_left')]
    found = match(estimates, truths)
    partners = {(t.stamp_ns, t.wheel): e.friction_coefficient_single.value
                for t, e in found.pairs}
    assert list(partners.values()) == [0.1, 0.2, 0.3]
    assert found.false == []


@pytest.mark.parametrize('times, truths, false', [
    ((1.01, 1.001), [true(1.0)], [1.01]), ((1.3,), [true(1.0)], [1.3]),
    ((1.0, 2.0), [], [1.0, 2.0])])
def test_duplicates_and_estimates_far_from_any_true_crossing_are_false(times, truths, false):
    estimates = [estimate(time, time) for time in times]
    found = match(estimates, truths)
    assert [e.friction_coefficient_single.value for e in found.false] == false
    assert [e for _, e in found.pairs if e] == [e for e in estimates if e not in found.false]


@pytest.mark.parametrize('slip, kind', [
    (0.2, 'traction'), (-0.2, 'braking'), (0.04, 'low slip'), (-0.05, 'low slip'),
    (math.nan, 'low slip')])
def test_the_kind_of_a_crossing_depends_on_its_true_slip(slip, kind):
    assert kind_of(true(0.0, slip=slip)) == kind


def test_a_missed_crossing_is_not_informative():
    found = friction_score([(true(0.0), estimate(0.0, 0.47)), (true(1.0), None)])
    assert (found.crossings, found.found, found.informative) == (2, 1, 1)
    assert found.informative_share == 0.5


@pytest.mark.parametrize('single, sigma', [(math.nan, math.inf), (0.47, 0.4), (0.47, math.inf),
                                           (0.47, math.nan)])
def test_a_found_value_with_a_large_sigma_is_not_informative(single, sigma):
    found = friction_score([(true(0.0), estimate(0.0, single, sigma))])
    assert (found.found, found.informative) == (1, 0)
    assert math.isnan(found.median_relative_error)


def test_known_errors_and_coverage_are_recovered():
    rng = np.random.default_rng(1)
    pairs = [(true(i), estimate(i, 0.47 + rng.normal(0.0, 0.05), 0.05)) for i in range(2000)]
    found = friction_score(pairs)
    assert found.informative_share == 1.0
    assert found.median_relative_error == pytest.approx(0.6745 * 0.05 / 0.47, rel=0.1)
    assert found.median_bias == pytest.approx(0.0, abs=0.01)
    assert found.within_one == pytest.approx(0.683, abs=0.03)
    assert found.within_two == pytest.approx(0.954, abs=0.015)
    low = friction_score([(true(i), estimate(i, 0.47 * 0.8, 0.05)) for i in range(10)])
    assert low.median_bias == pytest.approx(-0.2)


def test_fused_values_and_adhesion_are_scored_separately():
    pairs = [(true(0.0), crossing(0.0, friction_coefficient=0.517, friction_coefficient_sigma=0.03,
                                  adhesion_ratio=0.6, adhesion_ratio_sigma=0.05))]
    found = friction_score(pairs)
    assert found.informative == 0
    assert found.fused_median_relative_error == pytest.approx(0.1)
    assert found.fused_within_two == 1.0
    assert found.adhesion_ratio.mean == pytest.approx(0.1)
    assert found.adhesion_ratio.normalized_rms == pytest.approx(2.0)


def test_traction_and_braking_are_scored_separately():
    pairs = [(true(0.0, slip=0.1), estimate(0.0, 0.47)),
             (true(1.0, slip=-0.1), estimate(1.0, math.nan))]
    found = friction_scores(pairs)
    assert list(found) == ['traction', 'braking']
    assert (found['traction'].informative_share, found['braking'].informative_share) == (1.0, 0.0)
