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

"""Pressure, traction and strain in the patch: integrals compared with closed forms."""

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest
from scipy.integrate import quad
from smart_tire.models.tire import brush_tire, contact_strain, strain_charge

C_X, MU, LOAD, L, B = 52.7, 0.47, 26.7, 0.046, 0.089  # N, -, N, m, m: paper B, Table I
CRITICAL = 3.0 * MU * LOAD / C_X
PATCH = (MU, LOAD, C_X, L, B)

slips = st.floats(-1.5, 1.5)


def over_the_patch(function, edge):
    """Return the integral over xi from 0 to 1 of a function with a corner at ``edge``."""
    inner = [edge] if 0.0 < edge < 1.0 else []
    ends = [0.0, *inner, 1.0]
    return sum(quad(function, low, high, epsabs=1e-12)[0] for low, high in zip(ends, ends[1:]))


def test_the_integral_of_the_pressure_is_the_load_and_its_maximum_is_at_the_center():
    carried = quad(lambda z: float(contact_strain.pressure(z, LOAD, L, B)), 0.0, L)[0] * B
    assert carried == pytest.approx(LOAD, rel=1e-9)
    assert contact_strain.pressure(L / 2, LOAD, L, B) == pytest.approx(1.5 * LOAD / (B * L))
    outside = contact_strain.pressure([-0.01, 0.0, L, 0.05], LOAD, L, B)
    np.testing.assert_array_equal(outside, 0.0)


def test_k_x_yields_c_x_for_a_patch_without_sliding():
    k_x = float(contact_strain.tread_stiffness(C_X, L, B))
    assert 0.5 * k_x * B * L**2 * 0.01 == pytest.approx(C_X * 0.01)  # B(18)


@given(slips, slips, st.floats(0.05, 1.2), st.floats(1.0, 60.0))
@settings(max_examples=60, deadline=None)
def test_the_integral_of_the_traction_is_the_brush_force(s_x, s_y, mu, load):
    edge = float(brush_tire.adhesion_ratio(np.hypot(s_x, s_y), mu, load, C_X))
    expected = brush_tire.brush_force(s_x, s_y, mu, load, C_X)
    for axis in (0, 1):
        force = B * L * over_the_patch(lambda xi, axis=axis: float(contact_strain.traction(
            xi * L, s_x, s_y, mu, load, C_X, L, B)[axis]), edge)
        assert force == pytest.approx(float(expected[axis]), rel=1e-7, abs=1e-9)


@given(slips, slips, st.floats(0.0, 1.2), st.floats(0.0, 60.0), st.floats(-0.2, 1.2))
def test_traction_never_exceeds_friction_and_mirrors_with_the_slip(s_x, s_y, mu, load, xi):
    patch = (mu, load, C_X, L, B)
    x, y = contact_strain.traction(xi * L, s_x, s_y, *patch)
    grip = mu * contact_strain.pressure(xi * L, load, L, B)
    assert np.hypot(x, y) <= grip * (1.0 + 1e-9) + 1e-9
    assert (-x, -y) == contact_strain.traction(xi * L, -s_x, -s_y, *patch)
    assert (y, x) == contact_strain.traction(xi * L, s_y, s_x, *patch)


@pytest.mark.parametrize('slip', [0.02, 0.1, 0.3, 0.7, 0.72, 1.0])
def test_the_printed_stress_is_exact_for_driving_straight(slip):
    xi = np.linspace(0.0, 1.0, 401)
    exact, _ = contact_strain.traction(xi * L, slip, 0.0, *PATCH)
    printed, none = contact_strain.traction(xi * L, slip, 0.0, *PATCH, method='printed')
    np.testing.assert_allclose(printed, exact, atol=1e-9 * exact.max())
    assert not none.any()
    k_x = 2.0 * C_X / (B * L**2)
    np.testing.assert_allclose(exact, k_x * L * contact_strain.strain(xi, slip, slip, CRITICAL),
                               rtol=1e-12)
    by_hand = np.minimum(k_x * slip * xi * L, 4.0 * 1.5 * LOAD / (B * L) * MU * xi * (1.0 - xi))
    np.testing.assert_allclose(exact, by_hand, rtol=1e-9, atol=1e-9)


def test_the_printed_stress_exceeds_friction_when_braking():
    xi = np.linspace(0.0, 1.0, 101)
    exact, _ = contact_strain.traction(xi * L, -0.3, 0.0, *PATCH)
    printed, _ = contact_strain.traction(xi * L, -0.3, 0.0, *PATCH, method='printed')
    grip = MU * contact_strain.pressure(xi * L, LOAD, L, B)
    assert np.all(np.abs(exact) <= grip * (1.0 + 1e-12))
    assert np.all(np.abs(printed[-30:-1]) > grip[-30:-1])


def test_the_strain_is_continuous_where_sliding_begins():
    edge = 1.0 - 0.3 / CRITICAL
    before, after = contact_strain.strain(edge + np.array([-1e-12, 1e-12]), 0.3, 0.3, CRITICAL)
    assert before == pytest.approx(after, rel=1e-9) == pytest.approx(0.3 * edge, rel=1e-9)


@given(slips, st.floats(0.0, 2.0), st.one_of(st.floats(0.01, 2.0), st.just(np.inf)),
       st.floats(-0.1, 0.15), st.floats(0.001, 0.12))
@settings(max_examples=60, deadline=None)
def test_its_integral_under_a_film_is_the_overlap_integral(slip, total, critical, x, film):
    magnitude = max(abs(slip), total)
    edge = max(0.0, 1.0 - magnitude / critical)
    ends = np.unique(np.clip([x / L, edge, (x + film) / L], x / L, (x + film) / L))
    ends = np.unique(np.clip(ends, 0.0, 1.0))
    summed = L * sum(
        quad(lambda xi: float(contact_strain.strain(xi, slip, total, critical)), low, high)[0]
        for low, high in zip(ends, ends[1:]))
    exact = strain_charge.overlap_integral(x, slip, total, critical, film, L)
    assert float(exact) == pytest.approx(summed, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize('slip, total', [(0.1, 0.1), (-0.3, 0.5), (0.9, 0.9)])
def test_the_gradient_is_the_derivative_of_the_displacement_with_zero_integral(slip, total):
    edge = max(0.0, 1.0 - total / CRITICAL)
    sum_ = over_the_patch(lambda xi: float(contact_strain.displacement_gradient(
        xi, slip, total, CRITICAL)), edge)
    assert sum_ == pytest.approx(0.0, abs=1e-9)
    xi = np.array([0.05, 0.2, 0.4, 0.7, 0.95])
    ahead, back = (contact_strain.strain(xi + step, slip, total, CRITICAL)
                   for step in (1e-6, -1e-6))
    np.testing.assert_allclose(
        contact_strain.displacement_gradient(xi, slip, total, CRITICAL), (ahead - back) / 2e-6,
        rtol=1e-6)


def test_limits_without_slip_without_friction_and_without_sliding():
    xi = np.linspace(-0.5, 1.5, 9)
    for method in contact_strain.METHODS:
        still = contact_strain.strain(xi, 0.0, 0.0, CRITICAL, method=method)
        ice = contact_strain.strain(xi, 0.2, 0.2, 0.0, method=method)
        stuck = contact_strain.strain(xi, 0.2, 0.2, np.inf, method=method)
        np.testing.assert_array_equal([still, ice], 0.0)
        np.testing.assert_allclose(stuck, np.where((xi >= 0.0) & (xi <= 1.0), 0.2 * xi, 0.0))
    np.testing.assert_array_equal(
        contact_strain.displacement_gradient([0.0, 0.5, 1.0], 0.2, 0.2, np.inf), 0.2)


def test_inputs_broadcast():
    along, across = contact_strain.traction(
        np.linspace(0.0, L, 7)[:, None, None], np.array([0.1, 0.2])[:, None], 0.05,
        np.array([0.3, 0.5, 0.7]), LOAD, C_X, L, B)
    assert along.shape == across.shape == (7, 2, 3)


@pytest.mark.parametrize('call, message', [
    (lambda: contact_strain.pressure(0.0, -1.0, L, B), 'load is -1.0, expected zero or more'),
    (lambda: contact_strain.pressure(0.0, 1.0, -L, B), 'contact_length is -0.046'),
    (lambda: contact_strain.pressure([0.0, np.nan], 1.0, L, B), r'zeta\[1\] is nan'),
    (lambda: contact_strain.tread_stiffness(0.0, L, B), 'stiffness is 0.0, expected above zero'),
    (lambda: contact_strain.tread_stiffness(1.0, L, [[0.1, np.inf]]),
     r'contact_width\[0, 1\] is inf'),
    (lambda: contact_strain.traction(0.0, np.nan, 0.0, *PATCH), 's_x is nan'),
    (lambda: contact_strain.traction(0.0, 0.1, 0.0, -0.1, LOAD, C_X, L, B), 'mu is -0.1'),
    (lambda: contact_strain.traction([0.0, 0.1], [0.1] * 3, 0.0, *PATCH),
     r'zeta \(2,\), s_x \(3,\)'),
    (lambda: contact_strain.strain(0.5, 0.1, 0.1, -1.0), 'critical_slip is -1.0'),
    (lambda: contact_strain.strain(0.5, 0.1, 0.1, np.nan), 'critical_slip is nan'),
    (lambda: contact_strain.strain(0.5, 0.1, np.inf, 1.0), 'total_slip is inf'),
    (lambda: contact_strain.strain(0.5, 0.1, 0.1, 1.0, method='guess'), "method is 'guess'")])
def test_invalid_arguments_are_rejected_with_name_and_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()
