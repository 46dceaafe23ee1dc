# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Heavy elastica: a general solver, limits, energy and the printed series."""

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest
from scipy.integrate import solve_bvp, trapezoid
from scipy.optimize import minimize_scalar

from smart_tire.errors import ParameterError
from smart_tire.models.film import elastica
from smart_tire.models.film.elastica_with_weight import GREEN, INTEGRAL_WEIGHTS, NODES, solve


def by_solve_bvp(stroke, weight):
    """Return s, (x, y, theta, m) and f of A(7), A(8), starting without weight."""
    def slopes(s, v, p):
        return [np.cos(v[2]), np.sin(v[2]), v[3],
                weight * s * np.cos(v[2]) - p[0] * np.sin(v[2])]

    def ends(left, right, p):
        return [left[0], left[1], left[2], right[0] - 1.0 + stroke, right[2]]
    s = np.linspace(0.0, 1.0, 61)
    guess = elastica.shape(stroke, s)
    solution = solve_bvp(slopes, ends, s, [guess.x, guess.y, guess.theta, guess.curvature],
                         p=[float(elastica.load(stroke))], tol=1e-9,
                         max_nodes=20_000)
    assert solution.success
    return solution


@pytest.mark.parametrize('stroke, weight', [
    (0.001, 0.02), (0.05, 0.3), (0.3, 1.0), (0.6, 4.0), (0.2, -0.5), (0.6, -3.0)])
def test_a_general_solver_finds_the_same_film(stroke, weight):
    other, film = by_solve_bvp(stroke, weight), solve(stroke, weight)
    assert float(film.load) == pytest.approx(other.p[0], rel=1e-7)
    np.testing.assert_allclose(film.theta, other.sol(NODES)[2], rtol=0.0, atol=1e-6)


@given(st.floats(1e-6, 0.98))
def test_without_weight_it_is_the_closed_form(stroke):
    # a negligible weight, so that the Newton iteration runs
    film = solve(stroke, 1e-13 * np.sqrt(stroke))
    assert float(film.load) == pytest.approx(float(elastica.load(stroke)), rel=1e-10)
    assert float(film.charge) == pytest.approx(float(elastica.charge(stroke)), abs=1e-10)
    closed = elastica.shape(stroke, NODES).theta
    np.testing.assert_allclose(film.theta, closed, rtol=0.0, atol=1e-9)


@settings(max_examples=40)
@given(st.floats(0.02, 0.9), st.floats(-5.0, 5.0))
def test_boundary_conditions_a8_and_the_integral_equation_hold(stroke, weight):
    film = solve(max(stroke, 1e-3 * weight**2), weight)
    assert np.cos(film.theta) @ INTEGRAL_WEIGHTS == pytest.approx(
        1.0 - float(film.stroke), abs=1e-12)
    assert film.theta[[0, -1]] == pytest.approx(0.0, abs=1e-12)
    bending = weight * NODES * np.cos(film.theta) - film.load * np.sin(film.theta)
    np.testing.assert_allclose(GREEN @ bending, film.theta, rtol=0.0, atol=1e-9)


def test_small_strokes_have_the_weight_term_that_a15_drops():
    # with w = 0.01 sqrt(delta)^3 all other terms are of higher order
    stroke = np.array([1e-5, 1e-4, 1e-3])
    weight = 0.01 * stroke**1.5
    extra = (solve(stroke, weight).charge - elastica.charge(stroke)) / weight
    np.testing.assert_allclose(extra * np.pi**3 * np.sqrt(stroke), 1.0, rtol=3e-3)
    # A(13): the load has the weight over pi sqrt(delta)
    thrust = 0.005 / (np.pi * np.sqrt(0.01))
    np.testing.assert_allclose(solve(0.01, 0.005).load, elastica.load(0.01) + thrust, rtol=2e-4)


@pytest.mark.parametrize('weight', [0.02, 0.5, 2.0])
def test_an_arched_film_exists_above_the_stroke_of_the_fold(weight):
    # small angles: theta = w / f (s - sin(r s) / sin(r)), r = sqrt(f), at minimum stroke
    s = np.linspace(0.0, 1.0, 2001)

    def stroke(r):
        return 0.5 * trapezoid(((s - np.sin(r * s) / np.sin(r)) / r**2)**2, s)
    fold = minimize_scalar(stroke, bounds=(3.3, 6.2), method='bounded').fun * weight**2
    assert np.isfinite(solve(1.02 * fold, weight).load)
    with pytest.raises(ParameterError, match='too flat to be arched'):
        solve(0.98 * fold, weight)


def test_many_films_at_once_have_the_same_solutions_as_single_ones():
    stroke, weight = np.meshgrid(np.linspace(0.01, 0.8, 20), [-0.5, 0.0, 0.02, 1.0])
    film = solve(stroke, weight)
    assert film.load.shape == film.charge.shape == (4, 20)
    assert float(film.load[3, 7]) == pytest.approx(
        float(solve(stroke[3, 7], weight[3, 7]).load), rel=1e-12)
    np.testing.assert_allclose(film.load[1], elastica.load(stroke[1]), rtol=1e-14)


@pytest.mark.parametrize('stroke, weight, why', [
    (-0.1, 0.0, 'stroke is -0.1'), (1.0, 0.1, 'clamps have met'), (0.1, np.nan, 'weight is nan'),
    (0.0, 0.1, 'flat'), (1e-6, -1e4, 'sharply|equilibrium')])
def test_films_without_solution_are_rejected_with_the_reason(stroke, weight, why):
    with pytest.raises(ParameterError, match=why):
        solve(stroke, weight)
