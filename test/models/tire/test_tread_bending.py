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

"""Bending of the tread: beam of B(11) to B(14), its charge, and the printed formulas."""

from dataclasses import replace

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest
from scipy.integrate import fixed_quad, quad, solve_bvp
from smart_tire.models.tire import tread_bending
from smart_tire.models.tire.tread_bending import CONVENTIONS, Laminate

FILM = 0.02              # m, paper B, Table I
LOAD = 26.7 / 0.046      # N/m, p_0 = F_z / L
LAMINATE = Laminate()
THIN = Laminate(film_thickness=1e-9)  # the limit in which the paper's approximations are exact

lengths = st.floats(1e-4, 0.5)
laminates = st.builds(Laminate, film_thickness=st.floats(1e-6, 1e-3),
                      tread_thickness=st.floats(1e-3, 0.02), tread_modulus=st.floats(1e5, 1e9),
                      radius=st.floats(0.03, 1.0))


def test_the_stiffnesses_are_the_moments_of_the_modulus_over_the_layers():
    t_T, t_S = LAMINATE.tread_thickness, LAMINATE.film_thickness
    for power, found in enumerate(LAMINATE.stiffness()):
        moment = sum(modulus * fixed_quad(np.power, low, high, args=(power,))[0]
                     for modulus, low, high in (
                         (LAMINATE.tread_modulus, -t_T / 2, t_T / 2),
                         (LAMINATE.film_modulus, t_T / 2, t_T / 2 + t_S)))
        assert found == pytest.approx(LAMINATE.width * moment, rel=1e-9)


def test_b12_is_the_limit_of_a_thin_film():
    assert THIN.stiffness('printed') == pytest.approx(THIN.stiffness(), rel=1e-6)
    thick = [LAMINATE.stiffness('printed')[k] / LAMINATE.stiffness()[k] - 1.0 for k in range(3)]
    assert thick[0] == 0.0 and -0.02 < thick[1] < 0.0 and -0.02 < thick[2] < 0.0


def test_bending_about_the_neutral_axis_needs_no_force():
    A_1, A_2, A_3 = LAMINATE.stiffness()
    neutral = LAMINATE.stiffness('neutral')
    shift = LAMINATE.neutral_axis
    assert A_2 - shift * A_1 == pytest.approx(0.0, abs=1e-9 * A_2)
    assert neutral == pytest.approx((A_1, 0.0, A_3 - 2.0 * shift * A_2 + shift**2 * A_1))
    # 84 kN/m of film against 25 kN/m of tread: not at the center of the tread, as in the paper
    assert shift == pytest.approx(0.5 * 5.028e-3 * 84.0 / (84.0 + 25.0), rel=1e-9)
    assert LAMINATE.alpha('neutral') == 0.0


@given(laminates, st.sampled_from(['exact', 'printed']))
def test_alpha_stays_below_that_of_a_film_alone(laminate, convention):
    lever = laminate.tread_thickness / 2.0
    assert 0.0 < laminate.alpha(convention) < 1.0 / np.sqrt(laminate.radius * lever)


@pytest.mark.parametrize('convention', CONVENTIONS)
@pytest.mark.parametrize('length', [0.002, FILM, 0.3])
def test_the_deflection_solves_the_beam_equation(convention, length):
    A_2, A_3 = LAMINATE.stiffness(convention)[1:]
    alpha_2, unit = (LAMINATE.alpha(convention) * length)**2, LOAD * length**4 / A_3
    # w'''' - (alpha l)^2 w'' = 1 over xi, from B(11) with u' = -w / r, and not from B(14)
    solution = solve_bvp(
        lambda xi, y: np.array([y[1], y[2], y[3], alpha_2 * y[2] + 1.0]),
        lambda a, b: np.array([a[0], a[2], b[0], b[2]]),
        np.linspace(0.0, 1.0, 50), np.zeros((4, 50)), tol=1e-8, max_nodes=20_000)
    assert solution.success
    xi = np.linspace(0.0, 1.0, 31)
    w, tangent = solution.sol(xi)[:2]
    found = tread_bending.deflection(xi * length, length, LOAD, LAMINATE, convention)
    np.testing.assert_allclose(found / unit, w, atol=1e-7 * w.max())
    slope = tread_bending.slope(xi * length, length, LOAD, LAMINATE, convention)
    np.testing.assert_allclose(slope * length / unit, tangent, atol=1e-7 * tangent.max())


def test_b14_as_printed_is_the_deflection():
    A_2 = LAMINATE.stiffness('printed').A_2
    alpha, x = LAMINATE.alpha('printed'), np.linspace(0.0, FILM, 41)
    ratio = (np.cosh(alpha * FILM) - 1.0) / np.sinh(alpha * FILM)
    printed = LOAD * LAMINATE.radius / A_2 * (
        np.cosh(alpha * x) / alpha**2 - ratio * np.sinh(alpha * x) / alpha**2 - 1.0 / alpha**2
        + FILM * x / 2.0 - x**2 / 2.0)
    found = tread_bending.deflection(x, FILM, LOAD, LAMINATE, 'printed')
    np.testing.assert_allclose(found, printed, atol=1e-12 * printed.max())


def test_b15_and_b16_as_printed_are_twice_the_charge():
    alpha, flat = LAMINATE.alpha('printed'), np.linspace(0.004, FILM, 9)
    grown = (np.exp(alpha * flat) - 1.0) / (np.exp(alpha * flat) + 1.0)
    factor = 2.0 * LAMINATE.d31 * LOAD * LAMINATE.radius / LAMINATE.film_thickness
    np.testing.assert_allclose(tread_bending.charge(flat, LOAD, LAMINATE, 'printed'),
                               factor * (flat - 2.0 / alpha * grown), rtol=1e-9)
    np.testing.assert_allclose(tread_bending.charge_slope(flat, LOAD, LAMINATE, 'printed'),
                               factor * grown**2, rtol=1e-9)
    twice = (tread_bending.charge(flat, LOAD, THIN, 'printed')
             / tread_bending.charge(flat, LOAD, THIN))
    np.testing.assert_allclose(twice, 2.0, rtol=1e-6)


@pytest.mark.parametrize('convention', CONVENTIONS)
def test_the_charge_is_the_integral_of_the_film_strain_over_the_electrode(convention):
    def curvature(x):
        step = 1e-5
        ahead, back = tread_bending.slope([x + step, x - step], FILM, LOAD, LAMINATE, convention)
        return -(ahead - back) / (2.0 * step)
    inner = quad(curvature, 1e-5, FILM - 1e-5, epsabs=0.0, epsrel=1e-8)[0]
    strained = LAMINATE.lever(convention) * inner
    expected = LAMINATE.width * LAMINATE.d31 * LAMINATE.film_modulus * strained
    found = tread_bending.charge(FILM, LOAD, LAMINATE, convention)
    assert float(found) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize('convention', CONVENTIONS)
@given(laminate=laminates, length=lengths)
@settings(max_examples=50)
def test_the_deflection_is_symmetric_largest_at_the_center_and_zero_at_the_ends(
        convention, laminate, length):
    x = length * np.linspace(0.0, 1.0, 41)
    w = tread_bending.deflection(x, length, LOAD, laminate, convention)
    tangent = tread_bending.slope(x, length, LOAD, laminate, convention)
    top = tread_bending.largest_deflection(length, LOAD, laminate, convention)
    assert w[0] == w[-1] == 0.0 and np.all(w[1:-1] > 0.0) and w.argmax() == 20
    assert float(top) == pytest.approx(w[20], rel=1e-12)
    np.testing.assert_allclose(w, w[::-1], rtol=1e-9, atol=1e-13 * w[20])
    np.testing.assert_allclose(tangent, -tangent[::-1], rtol=1e-9, atol=1e-13 * tangent[0])
    assert np.all(np.diff(tangent) <= 1e-12 * tangent[0])
    # the tension of the strip reduces the deflection: at most 5 p l^4 / (384 A_3)
    beam = 5.0 * LOAD * length**4 / (384.0 * laminate.stiffness(convention).A_3)
    assert 0.0 < float(top) <= beam * (1.0 + 1e-12)


@given(laminates, lengths, st.sampled_from(CONVENTIONS))
def test_the_charge_slope_is_the_derivative_of_the_charge(
        laminate, length, convention):
    step = 1e-4 * length
    low, here, high = tread_bending.charge(length + step * np.array([-1.0, 0.0, 1.0]), LOAD,
                                           laminate, convention)
    growth = float(tread_bending.charge_slope(length, LOAD, laminate, convention))
    assert 0.0 <= low <= here <= high
    assert (high - low) / (2.0 * step) == pytest.approx(growth, rel=1e-5)


@given(laminates, st.floats(1e-3, 0.1), st.floats(0.0, 1.0))
def test_the_bending_shape_is_the_normalized_charge(laminate, length, share):
    flat = np.array([share * length, length])
    part, whole = tread_bending.charge(flat, LOAD, laminate)
    shape = tread_bending.bending_shape(flat, length, laminate.alpha())
    growth = tread_bending.charge_slope(flat, LOAD, laminate)
    assert part / whole == pytest.approx(float(shape.value[0]), rel=1e-6, abs=1e-12)
    np.testing.assert_allclose(shape.by_flat_length, growth / whole, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize('alpha', [1e-3, 1.0, 67.0, 5e3])
def test_the_bending_shape_increases_from_zero_to_one(alpha):
    shape = tread_bending.bending_shape(np.linspace(-0.01, FILM + 0.01, 301), FILM, alpha).value
    assert shape[0] == 0.0 and shape[-1] == 1.0 and np.all(np.diff(shape) >= 0.0)


def test_the_bending_shape_is_b15_and_for_a_stiff_tread_a_cube():
    u = np.linspace(0.002, FILM, 50)
    grown, whole = np.exp(67.0 * u), FILM - 2.0 / 67.0 * np.tanh(0.5 * 67.0 * FILM)
    printed = u - 2.0 / 67.0 * (grown - 1.0) / (grown + 1.0)
    np.testing.assert_allclose(tread_bending.bending_shape(u, FILM, 67.0).value, printed / whole,
                               rtol=1e-9)
    np.testing.assert_allclose(tread_bending.bending_shape(u, FILM, 0.01).value, (u / FILM)**3,
                               rtol=1e-7)


@pytest.mark.parametrize('alpha', [3.0, 9.9, 10.1, 67.0, 300.0])
def test_derivatives_of_the_bending_shape_agree_with_finite_differences(alpha):
    u, step = np.linspace(-0.0047, FILM + 0.0049, 60), 1e-7

    def value(u, alpha):
        return tread_bending.bending_shape(u, FILM, alpha).value
    part = tread_bending.bending_shape(u, FILM, alpha)
    by_u = (value(u + step, alpha) - value(u - step, alpha)) / (2.0 * step)
    np.testing.assert_allclose(part.by_flat_length, by_u, atol=1e-4)
    step = 1e-3 * alpha
    by_alpha = (value(u, alpha + step) - value(u, alpha - step)) / (2.0 * step)
    np.testing.assert_allclose(part.by_alpha, by_alpha, atol=1e-7)


def test_no_digits_are_lost_for_a_stiff_tread():
    x = np.linspace(0.0, FILM, 21)
    beam = LOAD * x * (FILM**3 - 2.0 * FILM * x**2 + x**3) / 24.0
    for modulus in (1e12, 1e15, 1e20):
        stiff = replace(LAMINATE, tread_modulus=modulus)
        A_3 = stiff.stiffness().A_3
        found = tread_bending.deflection(x, FILM, LOAD, stiff)
        np.testing.assert_allclose(found, beam / A_3, rtol=1e7 / modulus + 1e-13,
                                   atol=1e-14 * found.max())
        charge = float(tread_bending.charge(FILM, LOAD, stiff))
        scale = stiff.width * stiff.d31 * stiff.film_modulus * stiff.lever()
        assert charge == pytest.approx(scale * LOAD * FILM**3 / (12.0 * A_3),
                                       rel=1e7 / modulus + 1e-13)


def test_the_forms_for_small_and_large_lengths_agree_at_their_border_without_overflow():
    edge = 2.0 * tread_bending.MAX_SERIES_H / LAMINATE.alpha()
    around = edge * (1.0 + np.array([-1e-9, 1e-9]))
    for function in (tread_bending.largest_deflection, tread_bending.charge):
        below, above = function(around, LOAD, LAMINATE)
        assert below == pytest.approx(above, rel=1e-7)
    below, above = tread_bending.slope(0.0, around, LOAD, LAMINATE)
    assert below == pytest.approx(above, rel=1e-7)
    huge = 1e6
    w = tread_bending.largest_deflection(huge, LOAD, LAMINATE)
    cable = LOAD * LAMINATE.radius / LAMINATE.stiffness().A_2 * huge**2 / 8.0
    assert float(w) == pytest.approx(cable, rel=1e-6)


def test_inputs_broadcast_and_a_film_outside_the_patch_has_no_charge():
    lengths, loads = np.array([[0.0], [0.01], [0.02]]), np.array([0.0, 1.0, 2.0, -1.0])
    q = tread_bending.charge(lengths, loads, LAMINATE)
    assert q.shape == (3, 4)
    np.testing.assert_array_equal(q[0], 0.0)
    np.testing.assert_allclose(q[:, 2], 2.0 * q[:, 1])
    assert tread_bending.deflection(0.0, 0.0, 1.0, LAMINATE) == 0.0


@pytest.mark.parametrize('call, message', [
    (lambda: tread_bending.charge(-0.01, 1.0, LAMINATE), 'flat_length is -0.01, expected zero'),
    (lambda: tread_bending.charge([0.01, np.nan], 1.0, LAMINATE), r'flat_length\[1\] is nan'),
    (lambda: tread_bending.charge(0.01, np.inf, LAMINATE), 'line_load is inf'),
    (lambda: tread_bending.charge([1.0, 2.0], [1.0, 2.0, 3.0], LAMINATE),
     r'flat_length \(2,\), line_load \(3,\)'),
    (lambda: tread_bending.deflection(0.03, 0.02, 1.0, LAMINATE), 'x is 0.03, expected within'),
    (lambda: tread_bending.deflection([0.0, -0.01], 0.02, 1.0, LAMINATE), r'x\[1\] is -0.01'),
    (lambda: tread_bending.slope([0.0, 0.1], [0.2, 0.2, 0.2], 1.0, LAMINATE), r'x \(2,\)'),
    (lambda: tread_bending.charge(0.01, 'heavy', LAMINATE), 'line_load is not numeric'),
    (lambda: tread_bending.charge(0.01, 1.0, LAMINATE, 'guess'), "convention is 'guess'"),
    (lambda: Laminate(width=0.0), 'width is 0.0, expected above zero'),
    (lambda: Laminate(radius=np.nan), 'radius is nan'),
    (lambda: Laminate(d31=np.ones(2)), r'd31 is \[1. 1.\], expected one number')])
def test_invalid_arguments_are_rejected_with_name_and_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()
