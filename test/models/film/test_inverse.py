# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The inverse of the Duhem operator: equation, limits, and the same with and without Cython."""

from hypothesis import example, given, strategies as st
import numpy as np
import pytest

from smart_tire.models.film import inverse
from smart_tire.models.film.hysteresis import DuhemParams, respond
from support.compiled import load_source

# b above a / 2: at a / 2 itself the slope after a reversal is zero and the inverse singular
PARAMS = st.builds(
    lambda alpha, a, share: DuhemParams(alpha=alpha, a=a, b=share * a),
    st.floats(0.01, 10.0), st.floats(0.1, 10.0), st.floats(0.51, 0.99))
INPUTS = st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=60).map(np.array)


def inverted(y, params, start):
    """Return the inputs (n,) of the outputs (n,), sample by sample, from ``start`` (u, y)."""
    u, last = start
    z, found = last - params.a * u, []
    for value in y:
        states = np.array([[params.alpha], [params.a], [params.b], [u], [z]])
        (u,), (z,) = inverse.advanced(states, np.array([value - last])).tolist()
        found.append(u)
        last = value
    return np.array(found)


@given(PARAMS, INPUTS, st.floats(-1.0, 1.0))
def test_the_inverse_of_the_output_is_the_input(params, u, share):
    start = (0.0, share * params.band)
    back = inverted(respond(u, params, start=start), params, start)
    np.testing.assert_allclose(back, u, rtol=0.0, atol=1e-9 * 20.0)


@example(1e-311, 1.0)
@example(1e-18, 1.0)
@given(st.floats(0.0, 1e3), st.floats(0.0, 1.0))
def test_the_input_distance_solves_its_equation(r, m):
    x = inverse.input_distance(r, m)
    assert x + m * np.expm1(-x) == pytest.approx(r, rel=1e-12, abs=1e-15)
    assert r <= x <= r + m


@pytest.mark.parametrize('r', [1e-300, 1e-20, 1e-14])
def test_a_short_distance_after_a_reversal_at_the_limit_of_validity_is_a_square_root(r):
    # b = a / 2 and m = 1: the output starts with a slope of zero, r = x^2 / 2
    x = inverse.input_distance(r, 1.0)
    assert x == pytest.approx((2.0 * r)**0.5, rel=1e-6)


@pytest.mark.parametrize('step', [1e-16, 1e-9, 1e-3])
def test_a_saturated_film_at_the_limit_of_validity_can_reverse(step):
    params = DuhemParams(alpha=1.0, a=2.0, b=1.0)
    start = (0.0, -params.band)  # as after a large rise
    y = start[1] - np.array([1.0, 2.0]) * step
    u = inverted(y, params, start)
    assert np.all(np.diff(u, prepend=0.0) <= 0.0)
    np.testing.assert_allclose(respond(u, params, start=start), y, rtol=0.0, atol=1e-15)


def test_each_state_has_its_own_operator_and_direction():
    rng, n = np.random.default_rng(5), 40
    alpha, a = rng.uniform(0.1, 2.0, n), rng.uniform(0.5, 2.0, n)
    b = a * rng.uniform(0.51, 0.99, n)
    states = np.stack([alpha, a, b, rng.uniform(-3.0, 3.0, n),
                       (a - b) / alpha * rng.uniform(-1.0, 1.0, n)])
    dy = np.where(rng.random(n) < 0.2, 0.0, rng.uniform(-3.0, 3.0, n))
    inputs, z = inverse.advanced(states, dy)
    for i, (*params, u, z_0) in enumerate(states.T):
        operator, y = DuhemParams(**dict(zip(('alpha', 'a', 'b'), params))), a[i] * u + z_0
        assert respond(inputs[i], operator, start=(u, y))[0] == pytest.approx(y + dy[i], abs=1e-12)
        assert z[i] == pytest.approx(y + dy[i] - a[i] * inputs[i], abs=1e-12)
    np.testing.assert_array_equal(inputs[dy == 0.0], states[inverse.INPUT, dy == 0.0])
    np.testing.assert_array_equal(
        load_source(inverse).advanced(states, dy), np.stack([inputs, z]))


def test_arrays_of_other_shapes_are_refused():
    for states, dy in (((5, 3), 4), ((4, 3), 3), ((6, 3), 3), ((5, 4), 3)):
        with pytest.raises(ValueError, match='shapes'):
            inverse.advanced(np.ones(states), np.ones(dy))
