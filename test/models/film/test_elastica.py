# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Weightless elastica: quadrature, series, energy and limits."""

from hypothesis import given, strategies as st
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from smart_tire.errors import ParameterError
from smart_tire.models.film import elastica
from support.derivatives import derivative

STROKES = st.floats(0.0, 0.999)


def by_quadrature(parameter, power):
    """Return the integral of (1 - m sin^2)^power over a quarter period."""
    return quad(lambda phi: (1.0 - parameter * np.sin(phi)**2)**power, 0.0, 0.5 * np.pi,
                epsabs=1e-14)[0]


@pytest.mark.parametrize('angle', [0.01, 0.4, 1.0, 1.8, 2.2])  # rad, maximum angle of the film
def test_stroke_load_and_charge_agree_with_quadrature(angle):
    parameter = np.sin(0.5 * angle)**2
    K, E = by_quadrature(parameter, -0.5), by_quadrature(parameter, 0.5)
    stroke, load = 2.0 - 2.0 * E / K, 4.0 * K**2
    assert elastica.stroke_of(parameter) == pytest.approx(stroke, abs=1e-12)
    assert elastica.load(stroke) == pytest.approx(load, rel=1e-10)
    assert elastica.charge(stroke) == pytest.approx(load * (1.0 - stroke) / np.pi**2 - 1.0,
                                                    abs=1e-12)


@pytest.mark.parametrize('stroke', [1e-6, 0.05, 0.4, 0.8, 0.95])
def test_the_shape_solves_a7_and_a8(stroke):
    load = float(elastica.load(stroke))
    start = elastica.shape(stroke, 0.0)
    s = np.linspace(0.0, 1.0, 41)
    exact = solve_ivp(
        lambda _, v: [np.cos(v[2]), np.sin(v[2]), v[3], -load * np.sin(v[2])], (0.0, 1.0),
        [0.0, 0.0, 0.0, float(start.curvature)], t_eval=s, rtol=1e-11, atol=1e-13,
        max_step=0.02).y
    got = elastica.shape(stroke, s)
    for values, expected in zip((got.x, got.y, got.theta, got.curvature), exact):
        np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-8)
    assert got.x[-1] == pytest.approx(1.0 - stroke, abs=1e-14)
    assert got.theta[-1] == pytest.approx(0.0, abs=1e-13)


def test_an_almost_flat_film_is_the_euler_column():
    stroke, s = 1e-8, np.linspace(0.0, 1.0, 11)
    assert elastica.load(0.0) == pytest.approx(np.pi**2, rel=1e-15)
    theta = elastica.shape(stroke, s).theta
    np.testing.assert_allclose(theta, 2.0 * np.sqrt(stroke) * np.sin(np.pi * s), atol=1e-11)
    flat = elastica.shape(0.0, s)
    np.testing.assert_allclose(flat.x, s, atol=1e-15)
    assert not flat.y.any() and not flat.theta.any() and elastica.charge(0.0) == 0.0


@pytest.mark.parametrize('stroke', [1e-3, 1e-2, 0.0199, 0.0201, 0.1])
def test_no_digits_are_lost_for_small_strokes(stroke):
    # the sum of the integrals' series in exact fractions of the parameter, term by term
    m = float(elastica.parameter_of(stroke))
    squares, K, E = 1.0, 1.0, 1.0
    for n in range(1, 40):
        squares *= ((2 * n - 1) / (2 * n))**2
        K += squares * m**n
        E -= squares * m**n / (2 * n - 1)
    excess = K - 1.0
    assert elastica.stroke_of(m) == pytest.approx(2.0 * (K - E) / K, rel=1e-12)
    assert elastica.charge(stroke) == pytest.approx(
        (2.0 * excess + excess**2) * (1.0 - stroke) - stroke, rel=1e-11)


@given(STROKES)
def test_inverse_functions_return_the_stroke(stroke):
    assert elastica.stroke_of(elastica.parameter_of(stroke)) == pytest.approx(stroke, rel=1e-12)
    assert elastica.stroke_from_charge(elastica.charge(stroke)) == pytest.approx(
        stroke, rel=1e-9, abs=1e-15)


@given(st.floats(1e-4, 0.99))
def test_the_charge_slope_is_the_derivative_of_the_charge(stroke):
    assert elastica.charge_slope(stroke) == pytest.approx(
        derivative(elastica.charge, stroke, 1e-5), rel=1e-6)
    assert elastica.charge_slope(stroke) < 0.0


def test_the_halves_meet_at_the_touching_stroke():
    def narrowest(stroke):
        return elastica.shape(stroke, np.linspace(0.3, 1.0, 20_001)).x.min()
    touching = brentq(narrowest, 0.7, 0.95)
    assert touching == pytest.approx(elastica.TOUCHING_STROKE, abs=1e-8)


@pytest.mark.parametrize('value, why', [
    (-1e-9, 'stretched'), (1.0, 'clamps have met'), (np.nan, 'not a number')])
def test_a_stroke_outside_its_range_is_rejected_with_the_reason(value, why):
    for function in (elastica.load, elastica.charge, elastica.parameter_of):
        with pytest.raises(ParameterError, match=f'stroke is {value}.*{why}'):
            function([0.1, value])


def test_charges_and_arc_lengths_outside_their_range_are_rejected():
    for charge in (1e-9, -1.0, np.nan):
        with pytest.raises(ParameterError, match=f'charge over K is {charge}'):
            elastica.stroke_from_charge([-0.1, charge])
    with pytest.raises(ParameterError, match='expected 0 to 1'):
        elastica.shape(0.1, [0.5, 1.1])
