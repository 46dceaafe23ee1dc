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

"""Inversion of the brush model, and the standard deviations of its result."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.estimation.friction.brush_inversion import (
    consistency_inflation, flag_full_sliding, friction_estimate, GroundStiffness,
    single_friction, SlipFit, total_slip, traction_force)
from smart_tire.models.tire import brush_tire
from smart_tire.uncertain import Uncertain, UNKNOWN

NOMINAL = 52.7  # N, the stiffness C_0
LOAD, STIFFNESS = Uncertain(26.7, 0.5), Uncertain(NOMINAL, 0.1 * NOMINAL)
GROUND = GroundStiffness(sigma=0.1)
NO_LATERAL_SLIP = Uncertain(0.0, 0.0)
NO_COV = np.zeros((2, 2))


def slip_fit(slip=0.11, normalized_slip=0.19, slip_sigma=0.002, normalized_slip_sigma=0.005):
    return SlipFit(slip, normalized_slip, np.diag([slip_sigma**2, normalized_slip_sigma**2]),
                   NO_COV)


@pytest.mark.parametrize('mu', [0.1, 0.47, 0.9])
@pytest.mark.parametrize(('slip', 'lateral'), [(0.05, 0.0), (0.11, 0.09), (0.2, -0.1)])
def test_mu_is_that_of_the_brush_tire_with_the_same_normalized_slip(mu, slip, lateral):
    total = math.hypot(slip, lateral)
    normalized_slip = total / float(
        brush_tire.critical_slip(mu, LOAD.value, STIFFNESS.value))
    sample = single_friction(
        slip_fit(slip, normalized_slip), Uncertain(lateral, 0.0), LOAD, NOMINAL)
    assert 1.0 / sample.inverse_mu == pytest.approx(mu)


@pytest.mark.parametrize('change', [{'slip_sigma': 0.011}, {'normalized_slip_sigma': 0.019}])
def test_relative_errors_of_the_measurement_are_those_of_mu(change):
    exact = {'slip_sigma': 0.0, 'normalized_slip_sigma': 0.0}
    sample = single_friction(slip_fit(**{**exact, **change}), NO_LATERAL_SLIP, LOAD, NOMINAL)
    assert sample.white_sigma / sample.inverse_mu == pytest.approx(0.1)
    assert sample.scale_sigma == pytest.approx(0.5 / 26.7)


def test_the_stiffness_bounds_the_sigma_of_exact_measurements():
    sample = single_friction(slip_fit(slip_sigma=0.0, normalized_slip_sigma=1e-9),
                             NO_LATERAL_SLIP, LOAD, NOMINAL)
    mu, sigma = sample.estimate(GROUND)
    assert sigma / mu == pytest.approx(math.hypot(0.1, 0.5 / 26.7), rel=0.01)


def test_without_slip_load_or_lateral_slip_there_is_no_mu():
    assert single_friction(slip_fit(slip=0.0), NO_LATERAL_SLIP, LOAD, NOMINAL) is None
    assert single_friction(slip_fit(), UNKNOWN, LOAD, NOMINAL) is None
    assert single_friction(slip_fit(), NO_LATERAL_SLIP, UNKNOWN, NOMINAL) is None
    assert total_slip(Uncertain(0.1, 0.01), UNKNOWN) == UNKNOWN


def test_an_uninformative_crossing_is_unknown_and_a_precise_one_ignores_the_prior():
    assert friction_estimate(2.0, 4.0) == UNKNOWN
    assert friction_estimate(30.0, 40.0) == UNKNOWN
    assert friction_estimate(1.0 / 0.9, 0.01) == pytest.approx((0.9, 0.9**2 * 0.01))


def test_the_estimate_is_consistent_for_surfaces_drawn_from_the_prior():
    rng = np.random.default_rng(0)
    normalized = []
    for mu in 0.45 * 2.0**rng.standard_normal(10000):
        noise = rng.uniform(0.05, 0.35) / 0.45
        value, sigma = friction_estimate(1.0 / mu + noise * rng.standard_normal(), noise)
        if math.isfinite(value):
            normalized.append((mu - value) / sigma)
    assert 0.6 < np.mean(np.abs(normalized) < 1.0) < 0.8
    assert np.mean(np.abs(normalized) < 2.0) > 0.92
    assert abs(np.median(normalized)) < 0.1


@pytest.mark.parametrize('mu', [0.2, 0.47, 0.7])
@pytest.mark.parametrize('noise', [0.2, 0.5, 0.75, 0.8, 1.0, 2.0])
def test_whether_a_crossing_is_informative_does_not_depend_on_the_measured_value(mu, noise):
    rng = np.random.default_rng(1)
    values = np.array([friction_estimate(1.0 / mu + noise * rng.standard_normal(), noise)[0]
                       for _ in range(400)])
    share = np.mean(np.isfinite(values))
    if noise * mu > 0.3:  # low outcomes are unknown, too
        assert share in (0.0, 1.0)
    if share == 1.0 and mu < 0.5:
        assert abs(np.median(values) / mu - 1.0) < 0.1


def test_on_a_known_slippery_surface_less_slip_is_sufficient():
    assert friction_estimate(5.0, 1.0) == UNKNOWN
    mu, sigma = friction_estimate(5.0, 1.0, likely=0.2)
    assert 0.2 < mu < 0.25  # the prior pulls towards other surfaces
    assert 0.15 < sigma / mu < 0.5
    assert friction_estimate(2.0, 1.0, likely=2.0) == UNKNOWN  # a typical one is possible


def test_a_negative_normalized_slip_is_noise_and_gives_a_negative_inverse():
    sample = single_friction(slip_fit(normalized_slip=-0.01, normalized_slip_sigma=0.05),
                             NO_LATERAL_SLIP, LOAD, NOMINAL)
    assert sample.inverse_mu < 0.0 < sample.white_sigma
    mu, sigma = sample.estimate()
    assert math.isnan(mu) or sigma > 0.3 * mu


def test_systematic_and_white_errors_are_kept_separate():
    fit = SlipFit(0.11, 0.19, np.diag([0.0, 0.0019**2]), np.diag([0.0011**2, 0.0]))
    sample = single_friction(fit, NO_LATERAL_SLIP, LOAD, NOMINAL)
    assert sample.white_sigma / sample.inverse_mu == pytest.approx(0.01)
    assert sample.systematic_sigma / sample.inverse_mu == pytest.approx(0.01)


def correlated(normalized_slip=0.85):
    """Return a fit that determines slip / normalized slip better than either."""
    slip = 0.4
    both = np.array([slip, normalized_slip])
    return SlipFit(slip, normalized_slip,
                   0.06**2 * np.outer(both, both) + np.diag([1e-6, 1e-5]), NO_COV)


def test_where_the_whole_patch_may_slide_only_the_ratio_is_determined():
    inflated = flag_full_sliding(correlated())
    assert inflated.slip_sigma > 0.3
    # conditioned on another slip
    slope = inflated.white_cov[0, 1] / inflated.white_cov[0, 0]
    assert 0.85 + slope * (0.8 - 0.4) == pytest.approx(0.8 * 0.85 / 0.4, rel=0.05)


def test_added_white_errors_do_not_hide_the_correlation():
    fit = correlated()
    varied = replace(fit, white_cov=fit.white_cov + 2.0 * np.diag(np.diag(fit.white_cov)))
    assert flag_full_sliding(varied) is varied
    assert flag_full_sliding(varied, fit.white_cov).slip_sigma > 0.3


def test_where_little_slides_the_fit_is_unchanged():
    for fit in (slip_fit(), correlated(normalized_slip=0.3)):
        assert flag_full_sliding(fit) is fit


def test_consistent_slips_change_nothing_and_others_inflate():
    assert consistency_inflation(slip_fit(), Uncertain(0.112, 0.002)) == 1.0
    assert consistency_inflation(slip_fit(), UNKNOWN) == 1.0
    factor = consistency_inflation(slip_fit(), Uncertain(0.15, 0.002))
    assert factor > 10.0
    assert slip_fit().inflated(factor).slip_sigma == pytest.approx(0.002 * math.sqrt(factor))


@pytest.mark.parametrize('slip', [0.05, 0.11, -0.11])
@pytest.mark.parametrize('normalized_slip', [0.1, 0.5, 0.9])
def test_with_a_known_force_mu_needs_neither_stiffness_nor_the_amount_of_slip(
        slip, normalized_slip):
    mu, share = 0.25, 0.07  # of the slip, by which it is wrong
    force = mu * LOAD.value * (1.0 - (1.0 - normalized_slip)**3)
    found = []
    for estimated in (slip, (1.0 + share) * slip):
        stiffness = force / (abs(estimated) * (1.0 - normalized_slip + normalized_slip**2 / 3.0))
        ground = GroundStiffness(stiffness / NOMINAL, share, -math.copysign(1.0, slip))
        fit = SlipFit(estimated, normalized_slip, np.diag([0.0, (0.01 * normalized_slip)**2]),
                      np.diag([(share * estimated)**2, 0.0]))
        found.append(single_friction(fit, NO_LATERAL_SLIP, Uncertain(LOAD.value, 0.0), NOMINAL,
                                     share * abs(estimated)).estimate(ground))
    for estimate in found:
        assert estimate.value == pytest.approx(mu)
        assert estimate.sigma / mu == pytest.approx(0.01, rel=0.02)


def test_only_the_error_of_the_slip_estimator_is_shared_with_the_stiffness():
    # films with gains know the slip as well: half of the variance is that of the gains
    fit = SlipFit(0.1, 0.2, NO_COV, np.diag([0.5 * 0.01**2, 0.0]))
    sample = single_friction(fit, NO_LATERAL_SLIP, LOAD, NOMINAL, 0.01)
    assert sample.slip_effect == pytest.approx(-0.05 * sample.inverse_mu)
    assert sample.systematic_sigma == pytest.approx(math.sqrt(0.5) * 0.1 * sample.inverse_mu)
    unknown = single_friction(fit, NO_LATERAL_SLIP, LOAD, NOMINAL)
    assert unknown.slip_effect == 0.0


def test_the_effect_of_a_slip_error_does_not_depend_on_a_normalized_slip_within_noise():
    errors = [single_friction(
        SlipFit(0.01, t, np.diag([0.0, 0.05**2]), np.diag([0.005**2, 0.0])), NO_LATERAL_SLIP,
        LOAD, NOMINAL, 0.005) for t in (-0.05, 0.0, 0.05)]
    for sample in errors:
        assert sample.systematic_sigma == pytest.approx(0.5 * sample.white_sigma)


def test_the_error_of_a_known_force_is_small_although_slip_and_stiffness_are_not_known():
    fit = SlipFit(0.1, 0.01, NO_COV, np.diag([0.01**2, 0.0]))
    force, independent = traction_force(fit, NO_LATERAL_SLIP, 1, LOAD, STIFFNESS)
    assert independent == pytest.approx(math.hypot(0.1, 0.1) * force, rel=0.01)
    assert traction_force(fit, NO_LATERAL_SLIP, 1, LOAD, STIFFNESS, -1.0).sigma < 0.01 * force


@pytest.mark.parametrize('direction', [1, -1])
@pytest.mark.parametrize('slip', [0.11, -0.11])
def test_the_force_is_that_of_the_brush_tire_with_the_same_friction(slip, direction):
    fit, lateral = slip_fit(slip), Uncertain(0.05, 0.0)
    mu = 1.0 / single_friction(fit, lateral, LOAD, NOMINAL).inverse_mu
    force, sigma = traction_force(fit, lateral, direction, LOAD, STIFFNESS)
    expected = brush_tire.brush_force(direction * slip, 0.05, mu, LOAD.value, STIFFNESS.value)[0]
    assert force == pytest.approx(float(expected))
    assert math.copysign(1.0, force) == math.copysign(1.0, slip * direction)
    assert sigma > 0.1 * abs(force)
    assert traction_force(fit, UNKNOWN, direction, LOAD, STIFFNESS) == UNKNOWN
