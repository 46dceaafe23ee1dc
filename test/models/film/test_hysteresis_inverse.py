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

"""Inverse Duhem operator: round trips, the branch equation, and rejected states."""

from __future__ import annotations

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.optimize import brentq

from smart_tire.errors import ParameterError
from smart_tire.models.film.hysteresis import DuhemParams, respond, TABLE_I
from smart_tire.models.film.hysteresis_inverse import input_distance, InverseDuhem, invert

NC = 1e-9  # C
# b above a / 2: at a / 2 itself the slope after a reversal is zero and the inverse singular
PARAMS = st.builds(
    lambda alpha, a, share: DuhemParams(alpha=alpha, a=a, b=share * a),
    st.floats(0.01, 10.0), st.floats(0.1, 10.0), st.floats(0.51, 0.99))
INPUTS = st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=60).map(np.array)


@given(PARAMS, INPUTS, st.floats(-1.0, 1.0))
def test_the_inverse_of_the_output_is_the_input(params, u, share):
    start = (0.0, share * params.band)
    back = invert(respond(u, params, start=start), params, start=start)
    np.testing.assert_allclose(back, u, rtol=0.0, atol=1e-9 * 20.0)


@given(PARAMS, INPUTS, st.floats(-1.0, 1.0))
def test_the_output_of_the_inverse_is_the_output(params, y, share):
    start = (0.0, share * params.band)
    there = respond(invert(y, params, start=start), params, start=start)
    np.testing.assert_allclose(there, y, rtol=0.0, atol=1e-9 * 20.0)


@given(PARAMS, INPUTS, st.lists(st.integers(0, 60), max_size=8))
def test_the_result_does_not_depend_on_the_chunks(params, y, cuts):
    inverse = InverseDuhem(params)
    chunks = [inverse.update(part) for part in np.split(y, sorted(min(c, y.size) for c in cuts))]
    np.testing.assert_array_equal(np.concatenate(chunks), invert(y, params))


@example(1e-311, 1.0)
@example(1e-18, 1.0)
@given(st.floats(0.0, 1e3), st.floats(0.0, 1.0))
def test_the_input_distance_solves_its_equation(r, m):
    x = float(input_distance(np.array(r), np.array(m)))
    assert x + m * np.expm1(-x) == pytest.approx(r, rel=1e-12, abs=1e-15)
    assert r <= x <= r + m


@pytest.mark.parametrize('m', [0.0, 0.3, 0.963, 1.0])
@pytest.mark.parametrize('r', [1e-9, 1e-3, 0.1, 1.0, 40.0])
def test_the_input_distance_is_the_root_found_by_brentq(r, m):
    root = brentq(lambda x: x + m * np.expm1(-x) - r, 0.0, r + 1.0, xtol=1e-16, rtol=1e-15)
    x = float(input_distance(np.array(r), np.array(m)))
    assert x == pytest.approx(root, rel=1e-7, abs=1e-15)


@pytest.mark.parametrize('r', [1e-300, 1e-20, 1e-14])
def test_a_short_distance_after_a_reversal_at_the_limit_of_validity_is_a_square_root(r):
    # b = a / 2 and m = 1: the output starts with a slope of zero, r = x^2 / 2
    x = float(input_distance(np.array(r), np.array(1.0)))
    assert x == pytest.approx((2.0 * r)**0.5, rel=1e-6)


@pytest.mark.parametrize('step', [1e-16, 1e-9, 1e-3])
def test_a_saturated_film_at_the_limit_of_validity_can_reverse(step):
    params = DuhemParams(alpha=1.0, a=2.0, b=1.0)
    start = (0.0, -params.band)  # as after a large rise
    y = start[1] - np.array([1.0, 2.0]) * step
    u = invert(y, params, start=start)
    assert np.all(np.diff(u, prepend=0.0) <= 0.0)
    np.testing.assert_allclose(respond(u, params, start=start), y, rtol=0.0, atol=1e-15)


def test_table_i_is_inverted_over_large_and_small_loops():
    t = np.linspace(0.0, 20.0, 20_001)
    u = -4.0 * NC * (1.0 - np.cos(t)) * (1.0 + 0.5 * np.sin(0.37 * t)) + NC * np.sin(31.0 * t)
    np.testing.assert_allclose(invert(respond(u, TABLE_I), TABLE_I), u, rtol=0.0, atol=1e-11 * NC)


@given(PARAMS, st.floats(1.001, 100.0), st.sampled_from([-1.0, 1.0]))
def test_a_state_outside_the_band_is_rejected_with_the_reason(params, share, side):
    with pytest.raises(ParameterError, match='outside the band .* no inverse'):
        InverseDuhem(params, 1.0, params.a + side * share * params.band)


def test_outside_the_band_two_inputs_have_the_same_output():
    y = respond(np.linspace(0.0, 9.0 * NC, 400), TABLE_I, start=(0.0, 3.0 * TABLE_I.band))
    assert np.diff(y)[0] < 0.0 < np.diff(y)[-1]


def test_the_border_of_the_band_is_accepted_despite_rounding():
    edge = TABLE_I.a * NC + TABLE_I.band
    assert InverseDuhem(TABLE_I, NC, edge * (1.0 + 1e-15)).update([edge])[0] == pytest.approx(NC)


def test_the_error_of_a_wrong_start_decays():
    u = -8.0 * NC * np.sin(np.linspace(0.0, 50.0, 5_000))**2
    y = respond(u, TABLE_I)
    apart = invert(y, TABLE_I, start=(0.5 * TABLE_I.band / TABLE_I.a, 0.0)) - u
    assert abs(apart[0]) > 0.8 * NC and abs(apart[-1]) < 1e-3 * NC


def test_noise_stays_on_its_branch_with_a_dead_band():
    u = -8.0 * NC * np.sin(np.linspace(0.0, 50.0, 20_000))**2
    noise = 0.01 * NC * np.random.default_rng(5).standard_normal(u.size)
    y = respond(u, TABLE_I) + noise
    drifting, calm = (invert(y, TABLE_I, dead_band=band) - u for band in (0.0, 0.08 * NC))
    assert calm.std() < 0.3 * NC < drifting.std()


def test_a_charge_that_is_not_finite_is_rejected():
    with pytest.raises(ParameterError, match=r'y\[2\] is inf'):
        invert([0.0, 1.0, np.inf], TABLE_I)
