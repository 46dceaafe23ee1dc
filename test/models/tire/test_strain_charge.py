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

"""Overlap integral of the strained film: quadrature, derivatives, peak and limits."""

from __future__ import annotations

from hypothesis import assume, given, settings, strategies as st
import numpy as np
import pytest
from scipy.integrate import quad

from smart_tire.models.film.signal_chain import SignalChain
from smart_tire.models.tire import brush_tire, strain_charge

C_X, MU, LOAD, L, FILM = 52.7, 0.47, 26.7, 0.046, 0.02  # paper B, Table I
CRITICAL = 3.0 * MU * LOAD / C_X
STEP = 1e-7

films = st.floats(0.002, 0.09)
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


def derivative(function, at):
    """Return the derivative of an array-valued ``function`` by central differences."""
    return (function(at + STEP) - function(at - STEP)) / (2.0 * STEP)


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


def test_above_the_critical_slip_more_slip_changes_nothing():
    x = np.linspace(-FILM, L, 50)
    some = strain_charge.overlap_integral(x, CRITICAL, CRITICAL, CRITICAL, FILM, L)
    more = strain_charge.overlap_integral(x, 9.0, 9.0, CRITICAL, FILM, L)
    np.testing.assert_allclose(more, some, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize('share', [0.01, 0.1, 0.3, 0.5, 0.7, 0.72, 0.95, 1.5])
def test_the_charge_is_largest_at_the_peak_position(share):
    total = share * CRITICAL
    x_m = float(strain_charge.peak_position(adhesion(total), FILM, L))
    near = x_m + np.array([-1e-4, 0.0, 1e-4])
    left, top, right = strain_charge.overlap_integral(near, total, total, CRITICAL, FILM, L)
    assert top > left and top > right
    x = np.linspace(-FILM, L, 2001)
    assert strain_charge.overlap_integral(x, total, total, CRITICAL, FILM, L).max() <= top
    if share < 0.7:
        slope = strain_charge.overlap(np.array([x_m]), share, FILM, L).by_position
        assert slope == pytest.approx(0.0, abs=1e-12)


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


@given(films, criticals, shares, st.floats(-1.0, 1.0))
def test_no_position_of_the_film_has_more_charge_than_the_peak(film, critical, share, direction):
    total = share * critical
    slip = direction * total
    peak = strain_charge.peak(slip, total, critical, film, L)
    x = np.linspace(-film, L, 1501)
    q = strain_charge.overlap_integral(x, slip, total, critical, film, L)
    assert np.abs(q).max() <= abs(peak.integral) * (1.0 + 1e-9)
    assert np.abs(q).max() >= abs(peak.integral) * (1.0 - 1e-3)
    assert np.sign(peak.integral) == np.sign(slip)


@given(films, criticals, shares, st.floats(0.1, 1.0))
def test_braking_and_driving_peak_at_the_same_position_with_opposite_charge(
        film, critical, share, direction):
    total = share * critical
    drive = strain_charge.peak(direction * total, total, critical, film, L)
    brake = strain_charge.peak(-direction * total, total, critical, film, L)
    assert drive.position == brake.position and drive.integral == -brake.integral
    assert drive.observable == brake.observable


@given(st.floats(0.002, 0.045), criticals, shares)
def test_the_peak_determines_the_adhesion_length_where_it_is_flagged_observable(
        film, critical, share):
    assume(abs((1.0 - share) * L - 0.5 * (L - film)) > 1e-6)
    slip = share * critical
    peak = strain_charge.peak(slip, slip, critical, film, L)
    found = float(strain_charge.adhesion_length(peak.position, film, L))
    if peak.observable:
        assert found == pytest.approx((1.0 - share) * L, rel=1e-6)
    else:
        assert np.isnan(found) and (1.0 - share) * L < 0.5 * (L - film)


def test_a_peak_in_the_sliding_zone_has_a_fixed_position_and_charge():
    slip = CRITICAL * np.array([0.72, 0.8, 0.95, 1.0, 2.0])
    peak = strain_charge.peak(slip, slip, CRITICAL, FILM, L)
    assert not peak.observable.any()
    np.testing.assert_array_equal(peak.position, 0.5 * (L - FILM))
    low, high = 0.013, 0.033
    parabola = (high**2 - low**2) / (2.0 * L) - (high**3 - low**3) / (3.0 * L**2)
    np.testing.assert_allclose(peak.integral, CRITICAL * parabola, rtol=1e-9)


def test_without_slip_there_is_no_peak():
    for total in (0.0, 0.2):
        peak = strain_charge.peak(0.0, total, CRITICAL, FILM, L)
        assert peak.integral == 0.0 and not peak.observable


@given(st.floats(L, 0.2), shares, st.floats(-1.0, 1.0))
def test_a_film_longer_than_the_patch_measures_the_force(film, share, direction):
    total = share * CRITICAL
    s_x, s_y = direction * total, np.sqrt(max(0.0, 1.0 - direction**2)) * total
    peak = strain_charge.peak(s_x, np.hypot(s_x, s_y), CRITICAL, film, L)
    force, _ = brush_tire.brush_force(s_x, s_y, MU, LOAD, C_X)
    assert float(peak.integral) == pytest.approx(L * float(force) / (2.0 * C_X), rel=1e-9,
                                                 abs=1e-15)
    assert not peak.observable
    edges = strain_charge.overlap_integral([L - film, 0.0], s_x, np.hypot(s_x, s_y), CRITICAL,
                                           film, L)
    np.testing.assert_allclose(edges, peak.integral, rtol=1e-9, atol=1e-15)


def test_the_exact_peak_agrees_with_quadrature():
    slip = np.array([0.1, 0.3])
    exact = strain_charge.peak(slip, slip, CRITICAL, FILM, L)
    summed = [by_quadrature(x, s, s, CRITICAL, FILM) for s, x in zip(slip, exact.position)]
    np.testing.assert_allclose(exact.integral, summed, rtol=1e-9)


def test_the_papers_constants_would_exceed_the_converter_range_a_hundredfold():
    charge = strain_charge.transfer(0.003, 23e-12, 3e9) * strain_charge.peak(
        0.1, 0.1, CRITICAL, FILM, L).integral
    chain = SignalChain()
    volts = chain.amplified(charge)
    assert 50.0 < float(volts) / chain.rest_voltage < 200.0
    assert chain.saturated(chain.counts(volts))


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=4), criticals)
@settings(max_examples=30)
def test_arrays_are_evaluated_element_by_element(slips, critical):
    whole = strain_charge.peak(np.array(slips)[:, None], 0.1, [critical, np.inf], FILM, L)
    assert whole.integral.shape == whole.position.shape == (len(slips), 2)
    assert whole.observable.shape == (len(slips), 2)
    for row, slip in enumerate(slips):
        one = strain_charge.peak(slip, 0.1, critical, FILM, L)
        assert [float(v) for v in one] == pytest.approx([float(v[row, 0]) for v in whole])


@pytest.mark.parametrize('call, message', [
    (lambda: strain_charge.peak(np.nan, 0.1, 1.0, FILM, L), 'slip is nan'),
    (lambda: strain_charge.peak([0.1, 0.2], [0.1] * 3, 1.0, FILM, L),
     r'slip \(2,\), total_slip \(3,\)'),
    (lambda: strain_charge.peak(0.1, 0.1, -1.0, FILM, L), 'critical_slip is -1.0'),
    (lambda: strain_charge.peak(0.1, 0.1, 1.0, -FILM, L), 'film_length is -0.02, expected above'),
    (lambda: strain_charge.peak(0.1, 0.1, 1.0, FILM, np.ones(2)), r'contact_length has shape'),
    (lambda: strain_charge.peak_position(0.04, 0.05, L), 'no peak'),
    (lambda: strain_charge.adhesion_length(0.02, FILM, L, 'guess'), "method is 'guess'"),
    (lambda: strain_charge.transfer(0.003, 0.0, 3e9), 'd31 is 0.0')])
def test_invalid_arguments_are_rejected_with_name_and_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()
