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

"""B(23) to B(26) as printed, compared with the exact strain charge."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.models.tire import brush_tire, printed_strain_charge, strain_charge

C_X, MU, LOAD, L, FILM = 52.7, 0.47, 26.7, 0.046, 0.02  # paper B, Table I
CRITICAL = 3.0 * MU * LOAD / C_X


def adhesion(slip):
    return (1.0 - slip / CRITICAL) * L


@pytest.mark.parametrize('slip', [0.05, 0.1, 0.2, 0.3])
def test_b23_is_the_exact_integral_and_b24_its_derivative(slip):
    stuck = adhesion(slip)
    x = np.linspace(stuck - FILM, L - FILM, 30)
    printed = printed_strain_charge.integral(x, slip, stuck, FILM, L)
    exact = strain_charge.overlap_integral(x, slip, slip, CRITICAL, FILM, L)
    np.testing.assert_allclose(printed, exact, rtol=1e-10)
    slope = printed_strain_charge.slope(x, slip, stuck, FILM, L)
    part = strain_charge.overlap(x, slip / CRITICAL, FILM, L)
    np.testing.assert_allclose(slip * part.by_position, slope, atol=1e-12)
    x_m = strain_charge.peak(slip, slip, CRITICAL, FILM, L).position
    root = printed_strain_charge.slope(x_m, slip, stuck, FILM, L)
    assert float(root) == pytest.approx(0.0, abs=1e-12)


def test_b25_is_5_percent_low_at_a_slip_of_0_1_and_25_percent_at_0_3():
    slip = np.array([0.1, 0.3])
    exact = strain_charge.peak(slip, slip, CRITICAL, FILM, L)
    printed = printed_strain_charge.peak(slip, CRITICAL, FILM, L)
    np.testing.assert_allclose(1.0 - printed.integral / exact.integral, [0.05, 0.25], atol=0.01)


def test_b25_is_the_charge_at_the_printed_position():
    slip = np.array([0.05, 0.1, 0.3])
    stuck = adhesion(slip)
    printed = printed_strain_charge.peak(slip, CRITICAL, FILM, L)
    np.testing.assert_allclose(printed.position, stuck - FILM)
    there = strain_charge.overlap_integral(stuck - FILM, slip, slip, CRITICAL, FILM, L)
    np.testing.assert_allclose(printed.integral, there, rtol=1e-9)
    np.testing.assert_allclose(printed.integral / slip, printed_strain_charge.gain(stuck, FILM, L))
    assert printed.observable.all()


def test_the_printed_peak_is_flagged_where_it_does_not_hold():
    peak = printed_strain_charge.peak(np.array([-0.1, 0.0, 0.1, 0.5, 0.9]), CRITICAL, FILM, L)
    np.testing.assert_array_equal(peak.observable, [False, False, True, False, False])


def test_exact_and_printed_peak_agree_for_a_small_slip():
    exact = strain_charge.peak(1e-6, 1e-6, CRITICAL, FILM, L)
    printed = printed_strain_charge.peak(1e-6, CRITICAL, FILM, L)
    assert float(exact.position) == pytest.approx(float(printed.position), rel=1e-5)
    assert float(exact.integral) == pytest.approx(float(printed.integral), rel=1e-5)


def test_the_printed_map_gives_1_8_to_2_2_times_the_friction():
    slip = np.array([0.02, 0.1, 0.2, 0.3])
    x_m = strain_charge.peak(slip, slip, CRITICAL, FILM, L).position
    for method, low, high in (('exact', 0.999999, 1.000001), ('printed', 1.75, 2.25)):
        ratio = strain_charge.adhesion_length(x_m, FILM, L, method) / L
        factor = brush_tire.friction_from_adhesion(ratio, slip, LOAD, C_X) / MU
        assert np.all((low < factor) & (factor < high)), (method, factor)


def test_for_a_small_slip_the_printed_map_is_off_by_the_relative_length_of_the_film():
    x_m = strain_charge.peak(1e-5, 1e-5, CRITICAL, FILM, L).position
    ratio = strain_charge.adhesion_length(x_m, FILM, L, 'printed') / L
    found = brush_tire.friction_from_adhesion(ratio, 1e-5, LOAD, C_X) / MU
    assert float(found) == pytest.approx(L / (L - FILM), rel=1e-4)


@pytest.mark.parametrize('call, message', [
    (lambda: printed_strain_charge.peak(0.1, 0.0, FILM, L), 'critical_slip is 0'),
    (lambda: printed_strain_charge.peak(0.1, 1.0, -FILM, L), 'film_length is -0.02'),
    (lambda: printed_strain_charge.integral(0.0, 0.1, 0.04, FILM, L),
     'x is 0.0, where B.23. is not valid: expected 0.02 to 0.026'),
    (lambda: printed_strain_charge.slope(0.01, 0.1, 0.046, FILM, L), 'adhesion_length is 0.046'),
    (lambda: printed_strain_charge.slope(0.01, 0.1, [0.04, 0.05, 0.06], [0.1, 0.2], L),
     r'adhesion_length \(3,\), film_length \(2,\)'),
    (lambda: printed_strain_charge.gain(-0.01, FILM, L), 'adhesion_length is -0.01')])
def test_invalid_arguments_are_rejected_with_name_and_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()
