# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Inversion of the brush model, and the standard deviations of its result."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from smart_tire.estimation.friction.output import friction_estimate, friction_record
from smart_tire.estimation.friction.waveform_method import FilmResult, flag_full_sliding, SlipFit
from smart_tire.estimation.ground.estimator import WheelState
from smart_tire.models.tire.brush_tire import LN_FRICTION
from smart_tire.uncertain import Uncertain, UNKNOWN

NO_COV = np.zeros((2, 2))


def slip_fit(slip=0.11, normalized_slip=0.19, slip_sigma=0.002, normalized_slip_sigma=0.005):
    return SlipFit(slip, normalized_slip, np.diag([slip_sigma**2, normalized_slip_sigma**2]),
                   NO_COV)


def test_an_uninformative_crossing_is_unknown_and_a_precise_one_hardly_depends_on_the_prior():
    assert friction_estimate(2.0, 4.0) == UNKNOWN
    assert friction_estimate(30.0, 40.0) == UNKNOWN
    for mu in (0.9, 0.05):
        found = friction_estimate(1.0 / mu, 1e-4 / mu)
        assert found == pytest.approx((mu, 1e-4 * mu), rel=1e-4)


def test_the_estimate_is_consistent_for_surfaces_drawn_from_the_prior():
    rng = np.random.default_rng(0)
    normalized = []
    for mu in np.exp(LN_FRICTION.value + LN_FRICTION.sigma * rng.standard_normal(3000)):
        noise = rng.uniform(0.05, 0.35) / math.exp(LN_FRICTION.value)
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
                       for _ in range(150)])
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


@pytest.mark.parametrize(('films', 'sliding', 'known'), [
    (slip_fit(), False, True), (slip_fit(0.1, 0.21, 0.003, 0.006), False, True),
    (slip_fit(slip=0.13), False, False),           # 6.3 sigmas
    (slip_fit(normalized_slip=0.24), False, False),  # 5 sigmas
    (slip_fit(normalized_slip=0.24, normalized_slip_sigma=0.02), False, True),
    (slip_fit(normalized_slip=1.4), True, True)])    # its size is not determined
def test_a_crossing_whose_films_contradict_the_ground_has_no_friction(films, sliding, known):
    state = WheelState(
        slip=Uncertain(0.11, 0.0025), normalized_slip=Uncertain(0.19, 0.0087),
        load=Uncertain(26.0, 0.5), stiffness=Uncertain(50.0, 2.0), friction=Uncertain(0.4, 0.02),
        critical_slip=Uncertain(0.58, 0.03))
    crossing = SimpleNamespace(stamp_ns=5, speed=1.0)
    found = friction_record(
        'front_left', 0.04, crossing, FilmResult(films, 0.0, sliding), state)
    assert (found.friction_coefficient == state.friction) is known
    assert (found.critical_slip == state.critical_slip) is known
    assert found.friction_coefficient == (state.friction if known else UNKNOWN)
    assert (found.slip, found.stiffness) == (state.slip, state.stiffness)


def test_films_of_a_wheel_in_an_unknown_state_contradict_nothing():
    found = friction_record('front_left', 0.04, SimpleNamespace(stamp_ns=5, speed=1.0),
                            FilmResult(slip_fit(), 0.0, False), WheelState())
    assert found.friction_coefficient == UNKNOWN and found.film_slip.value == 0.11


def correlated(normalized_slip=0.85):
    """Return a fit that determines slip / normalized slip better than either."""
    slip = 0.4
    both = np.array([slip, normalized_slip])
    return SlipFit(slip, normalized_slip,
                   0.06**2 * np.outer(both, both) + np.diag([1e-6, 1e-5]), NO_COV)


def test_where_the_whole_patch_may_slide_only_the_ratio_is_determined():
    fit = correlated()
    inflated = flag_full_sliding(fit)
    assert inflated.slip_sigma > 0.3
    # conditioned on another slip
    slope = inflated.white_cov[0, 1] / inflated.white_cov[0, 0]
    assert 0.85 + slope * (0.8 - 0.4) == pytest.approx(0.8 * 0.85 / 0.4, rel=0.05)


def test_where_little_slides_the_fit_is_unchanged():
    for fit in (slip_fit(), correlated(normalized_slip=0.3)):
        assert flag_full_sliding(fit) is fit
