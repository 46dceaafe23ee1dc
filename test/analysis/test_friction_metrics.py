"""Passages find their partners, and their friction is judged by what the brief of a run asks."""

import math

import numpy as np
import pytest

from smart_tire.analysis.friction_metrics import friction_score, friction_scores, kind_of, match
from smart_tire.samples import Friction
from smart_tire.uncertain import Uncertain

EPOCH = 1_700_000_000_000_000_000


def passage(time_s, wheel='front_right', **value):
    quantities = {name: Uncertain(value[name], value.get(f'{name}_sigma', math.inf))
                  for name in value if not name.endswith('_sigma')}
    return Friction(EPOCH + round(time_s * 1e9), wheel, **quantities)


def true(time_s, slip=0.1, mu=0.47, **others):
    return passage(time_s, slip=slip, friction_coefficient=mu, adhesion_ratio=0.5, **others)


def guess(time_s, single, sigma=0.05, **others):
    return passage(time_s, friction_coefficient_single=single,
                   friction_coefficient_single_sigma=sigma, **others)


def test_each_passage_finds_the_nearest_of_its_own_wheel():
    truths = [true(1.0), true(2.0), true(2.0, wheel='front_left')]
    estimates = [guess(2.01, 0.2), guess(0.99, 0.1), guess(1.97, 0.3, wheel='front_left')]
    found = match(estimates, truths)
    partners = {(t.stamp_ns, t.wheel): e.friction_coefficient_single.value
                for t, e in found.pairs}
    assert list(partners.values()) == [0.1, 0.2, 0.3]
    assert found.false == []


def test_a_passage_that_is_found_twice_leaves_a_false_one():
    found = match([guess(1.01, 0.1), guess(1.001, 0.2)], [true(1.0)])
    assert found.pairs[0][1].friction_coefficient_single.value == 0.2
    assert [e.friction_coefficient_single.value for e in found.false] == [0.1]


def test_a_passage_far_from_any_truth_is_false_and_the_truth_is_missed():
    found = match([guess(1.3, 0.1)], [true(1.0)])
    assert found.pairs[0][1] is None and len(found.false) == 1


def test_every_estimate_is_false_where_nothing_passed():
    assert len(match([guess(1.0, 0.1), guess(2.0, 0.1)], []).false) == 2


@pytest.mark.parametrize('slip, kind', [
    (0.2, 'traction'), (-0.2, 'braking'), (0.04, 'gentle'), (-0.05, 'gentle'),
    (math.nan, 'gentle')])
def test_kinds_are_told_by_the_true_slip(slip, kind):
    assert kind_of(true(0.0, slip=slip)) == kind


def test_a_missed_passage_counts_as_one_that_tells_nothing():
    found = friction_score([(true(0.0), guess(0.0, 0.47)), (true(1.0), None)])
    assert (found.passages, found.found, found.telling) == (2, 1, 1)
    assert found.telling_share == 0.5


@pytest.mark.parametrize('single, sigma', [(math.nan, math.inf), (0.47, 0.4), (0.47, math.inf),
                                           (0.47, math.nan)])
def test_a_value_without_a_telling_sigma_is_found_but_tells_nothing(single, sigma):
    found = friction_score([(true(0.0), guess(0.0, single, sigma))])
    assert (found.found, found.telling) == (1, 0)
    assert math.isnan(found.median_relative_error)


def test_errors_and_coverage_are_those_put_in():
    rng = np.random.default_rng(1)
    pairs = [(true(i), guess(i, 0.47 + rng.normal(0.0, 0.05), 0.05)) for i in range(2000)]
    found = friction_score(pairs)
    assert found.telling_share == 1.0
    assert found.median_relative_error == pytest.approx(0.6745 * 0.05 / 0.47, rel=0.1)
    assert found.median_bias == pytest.approx(0.0, abs=0.01)
    assert found.within_one == pytest.approx(0.683, abs=0.03)
    assert found.within_two == pytest.approx(0.954, abs=0.015)


def test_a_bias_shows_with_its_sign():
    pairs = [(true(i), guess(i, 0.47 * 0.8, 0.05)) for i in range(10)]
    assert friction_score(pairs).median_bias == pytest.approx(-0.2)


def test_fused_values_and_adhesion_are_judged_by_themselves():
    pairs = [(true(0.0), passage(0.0, friction_coefficient=0.517, friction_coefficient_sigma=0.03,
                                 adhesion_ratio=0.6, adhesion_ratio_sigma=0.05))]
    found = friction_score(pairs)
    assert found.telling == 0
    assert found.fused_median_relative_error == pytest.approx(0.1)
    assert found.fused_within_two == 1.0
    assert found.adhesion_ratio.mean == pytest.approx(0.1)
    assert found.adhesion_ratio.normalised_rms == pytest.approx(2.0)


def test_traction_and_braking_are_judged_apart():
    pairs = [(true(0.0, slip=0.1), guess(0.0, 0.47)), (true(1.0, slip=-0.1), guess(1.0, math.nan))]
    found = friction_scores(pairs)
    assert list(found) == ['traction', 'braking']
    assert (found['traction'].telling_share, found['braking'].telling_share) == (1.0, 0.0)
