# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Overlap integral of the strained film: quadrature, derivatives, peak and limits."""

from hypothesis import given, strategies as st
import numpy as np
import pytest
from scipy.integrate import quad

from smart_tire.models.tire import strain_charge
from support.derivatives import derivative

C_X, MU, LOAD, L, FILM = 52.7, 0.47, 26.7, 0.046, 0.02  # paper B, Table I
CRITICAL = 3.0 * MU * LOAD / C_X

criticals = st.floats(0.05, 1.5)
shares = st.floats(0.01, 1.4)  # of the critical slip


def positions(film=FILM):
    """Return positions over the whole crossing, none of them at a kink."""
    return np.linspace(-film - 0.0313, L + 0.0417, 400)


def adhesion(slip, critical=CRITICAL):
    return max(0.0, 1.0 - slip / critical) * L


def by_quadrature(x, slip, total, critical, film):
    def displacement(zeta):
        return min(total * zeta, critical * zeta * (1.0 - zeta / L)) * slip / total / L
    low, high, edge = max(x, 0.0), min(x + film, L), adhesion(total, critical)
    if high <= low:
        return 0.0
    return quad(displacement, low, high, points=[edge] if low < edge < high else None,
                epsabs=1e-13)[0]


@pytest.mark.parametrize('film', [FILM, 0.045, 0.07])
def test_the_overlap_integral_agrees_with_quadrature_at_any_position(film):
    rng = np.random.default_rng(3)
    for _ in range(100):
        critical = rng.uniform(0.05, 1.0)
        total = rng.uniform(0.01, 1.5) * critical
        slip, x = rng.uniform(-total, total), rng.uniform(-film - 0.01, L + 0.01)
        exact = strain_charge.overlap_integral(x, slip, total, critical, film, L)
        assert float(exact) == pytest.approx(by_quadrature(x, slip, total, critical, film),
                                             abs=1e-12)


@pytest.mark.parametrize('film', [FILM, 0.06])
@pytest.mark.parametrize('t', [0.05, 0.3, 0.72, 0.97, 1.6])
def test_derivatives_of_the_overlap_agree_with_finite_differences(film, t):
    x = positions(film)

    def value(x=x, length=L, t=t):
        return strain_charge.overlap(x, t, film, length).value

    part = strain_charge.overlap(x, t, film, L)
    np.testing.assert_allclose(part.by_position, derivative(lambda x: value(x=x), x), atol=2e-6)
    np.testing.assert_allclose(part.by_contact_length,
                               derivative(lambda v: value(length=v), L), atol=2e-6)
    np.testing.assert_allclose(part.by_normalized_slip, derivative(lambda v: value(t=v), t),
                               atol=1e-8)


def test_the_normalized_slip_may_differ_from_sample_to_sample():
    x, t = positions(), np.linspace(0.1, 1.7, 400)
    together = strain_charge.overlap(x, t, FILM, L)
    for i in (150, 200, 260):
        one = strain_charge.overlap(x[i:i + 1], float(t[i]), FILM, L)
        for a, b in zip(together, one):
            assert a[i] == pytest.approx(b[0], abs=1e-15)


def test_only_slip_over_normalized_slip_is_observable_under_full_sliding():
    x = positions()
    one, other = (strain_charge.overlap(x, t, FILM, L) for t in (1.2, 2.4))
    np.testing.assert_allclose(one.value, 2.0 * other.value, atol=1e-15)
    np.testing.assert_allclose(one.by_normalized_slip, -one.value / 1.2, atol=1e-15)


def test_no_limit_means_no_sliding_and_no_slip_means_no_strain():
    free = strain_charge.overlap_integral(0.01, 0.2, 0.2, np.inf, FILM, L)
    assert float(free) == pytest.approx(0.2 * (0.03**2 - 0.01**2) / (2.0 * L))
    for total, critical in ((0.0, CRITICAL), (0.3, CRITICAL), (0.0, 0.0), (0.0, np.inf)):
        assert strain_charge.overlap_integral(0.01, 0.0, total, critical, FILM, L) == 0.0
    assert strain_charge.overlap_integral(0.01, 0.2, 0.2, 0.0, FILM, L) == 0.0


def test_adhesion_length_and_peak_position_are_inverse_to_each_other():
    lengths = np.linspace(0.5 * (L - FILM) + 1e-6, L, 200)
    peaks = strain_charge.peak_position(lengths, FILM, L)
    assert np.all(np.diff(peaks) > 0.0)
    np.testing.assert_allclose(strain_charge.adhesion_length(peaks, FILM, L), lengths, rtol=1e-9)


def test_the_adhesion_length_is_nan_where_the_film_slides_at_its_peak():
    peaks = strain_charge.peak_position([0.0, 0.005, 0.5 * (L - FILM)], FILM, L)
    np.testing.assert_array_equal(peaks, 0.5 * (L - FILM))
    assert np.isnan(strain_charge.adhesion_length(peaks, FILM, L)).all()
    assert np.isnan(strain_charge.adhesion_length(np.nan, FILM, L))


@given(st.floats(0.002, 0.045), criticals, shares, st.floats(-1.0, 1.0))
def test_no_position_of_the_film_has_more_charge_than_the_peak(film, critical, share, direction):
    total = share * critical
    slip = direction * total

    def charge(x, slip=slip):
        return strain_charge.overlap_integral(x, slip, total, critical, film, L)
    x_m = float(strain_charge.peak_position(adhesion(total, critical), film, L))
    top, x = float(charge(x_m)), np.linspace(-film, L, 1501)
    assert np.abs(charge(x)).max() <= abs(top) * (1.0 + 1e-9)
    assert np.sign(top) == np.sign(slip)
    np.testing.assert_array_equal(charge(x, -slip), -charge(x))  # braking mirrors driving
    if share > 1.0:  # more than the critical slip changes nothing
        least = strain_charge.overlap_integral(
            x, direction * critical, critical, critical, film, L)
        np.testing.assert_allclose(charge(x), least, rtol=1e-9, atol=1e-15)


def test_a_film_that_is_not_shorter_than_the_patch_has_no_peak():
    for function in (strain_charge.peak_position, strain_charge.adhesion_length):
        for film in (L, 0.05, 0.0):
            with pytest.raises(ValueError, match='no peak'):
                function(0.02, film, L)
