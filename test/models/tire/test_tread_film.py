# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Waveform of one patch crossing: bending, bumps, their derivatives, and the sum of all parts."""

import numpy as np
import pytest

from smart_tire.models.tire import film_equations, tread_film
from smart_tire.models.tire.film_equations import (
    bending, bending_shape, KNOTS, over_arrays, PADDING, spline)
from smart_tire.simulation.films import bump, BUMP_HALF_WIDTHS
from support.derivatives import derivative

L, FILM, ALPHA = 0.046, 0.020, 67.0  # m, m, 1/m: paper B, Table I
CRITICAL = 3.0 * 0.47 * 26.7 / 52.7
CROSSING = {'film_length': FILM, 'contact_length': L, 'bending_peak': 0.83,
            'bending_alpha': ALPHA, 'stretch_gain': 307.5, 'critical_slip': CRITICAL}
RESULTS = {bending: 7, bending_shape: 3, film_equations.bump: 3}  # of the equations


def positions(film=FILM):
    """Return positions over the whole crossing, none of them at a kink."""
    return np.linspace(-film - 0.0313, L + 0.0417, 400)


def equation(number, function, *arguments):
    """Return a result of an equation over arrays: its value, or a derivative."""
    return over_arrays(function, RESULTS[function], *arguments)[number]


def assert_derivatives(function, arguments, derivatives, **close):
    """Compare derivatives, number of the argument -> number of the result, with differences."""
    for argument, result in derivatives.items():
        def value(changed, argument=argument):
            return equation(0, function, *arguments[:argument], changed, *arguments[argument + 1:])
        np.testing.assert_allclose(equation(result, function, *arguments),
                                   derivative(value, arguments[argument]), **close)


@pytest.mark.parametrize('weights', [*tread_film.RELEASE_WEIGHTS.values(), (1.2, 0.3)])
@pytest.mark.parametrize('film', [FILM, 0.06])
def test_derivatives_of_the_bending_part_agree_with_finite_differences(weights, film):
    arguments = (positions(film), film, L, ALPHA, *weights, 0.005)
    assert_derivatives(bending, arguments, {0: 1, 2: 2, 6: 4}, rtol=1e-5, atol=1e-4)
    assert_derivatives(bending, arguments, {3: 3}, atol=1e-7)
    assert_derivatives(bending, arguments, {4: 5, 5: 6}, atol=1e-8)


def test_derivatives_of_the_bumps_agree_with_finite_differences():
    assert_derivatives(film_equations.bump, (positions(), FILM, L), {0: 1}, atol=2e-3)


@pytest.mark.parametrize('release', tread_film.RELEASES)
@pytest.mark.parametrize('film', [FILM, 0.07])
@pytest.mark.parametrize('slip, total', [(0.1, 0.13), (-0.2, 0.25), (0.9, 1.2)])
def test_a_crossing_is_continuous_and_starts_and_ends_at_rest(release, film, slip, total):
    def volts(x):
        return tread_film.crossing_voltage(x, slip=slip, total_slip=total, release=release,
                                           **{**CROSSING, 'film_length': film})
    adhesion = max(0.0, 1.0 - total / CRITICAL) * L
    edges = np.array([edge - end for edge in (0.0, adhesion, L) for end in (0.0, film)])
    np.testing.assert_allclose(volts(edges - 1e-10), volts(edges + 1e-10), atol=1e-6)
    x = np.linspace(-film - 0.02, L + 20.0 * tread_film.RECOVERY * film, 3001)
    assert np.abs(np.diff(volts(x))).max() < 0.07
    assert abs(volts(x[0])) < 1e-15 and abs(volts(x[-1])) < 1e-6


def test_the_releases_differ_only_after_the_film_begins_to_leave():
    x = np.linspace(-FILM, L - FILM, 100)
    both = [tread_film.crossing_voltage(x, slip=0.1, total_slip=0.1, release=name, **CROSSING)
            for name in tread_film.RELEASES]
    np.testing.assert_allclose(both[0], both[1], atol=1e-15)
    at_release = [float(tread_film.crossing_voltage(L, slip=0.1, total_slip=0.1, release=name,
                                                    **CROSSING)) for name in ('fig8', 'state')]
    assert at_release == pytest.approx([-0.83, 0.0])


def test_the_fig8_release_decays_by_e_within_the_recovery_length():
    bent = tread_film.bending(L + np.array([0.0, 0.004]), FILM, L, ALPHA, 'fig8', 0.004)
    np.testing.assert_allclose(bent, [-1.0, -np.exp(-1.0)])


def test_a_release_between_the_conventions_is_given_by_weights():
    x = np.linspace(-FILM - 0.01, L + 0.05, 400)
    fig8, state = (tread_film.bending(x, FILM, L, ALPHA, name)
                   for name in tread_film.RELEASES)
    half = tread_film.bending(x, FILM, L, ALPHA, (1.0, 0.5))
    np.testing.assert_allclose(half, 0.5 * (fig8 + state), atol=1e-12)
    end = tread_film.bending(np.array([L]), FILM, L, ALPHA, (1.6, 0.0))
    np.testing.assert_allclose(end, -0.6)


def test_a_flat_film_without_slip_shows_the_bending_peak():
    x = np.linspace(0.0, L - FILM, 10)
    volts = tread_film.crossing_voltage(x, slip=0.0, total_slip=0.0, **CROSSING)
    np.testing.assert_allclose(volts, 0.83)


def test_reverse_mirrors_the_position_and_so_repeats_the_signal_in_time():
    x = np.linspace(-0.05, 0.09, 300)
    options = {'slip': 0.1, 'total_slip': 0.12, **CROSSING}
    back = tread_film.crossing_voltage(L - FILM - x, reverse=True, **options)
    np.testing.assert_allclose(back, tread_film.crossing_voltage(x, **options), atol=1e-12)


def test_bumps_peak_one_centimeter_outside_and_vanish_during_the_contact():
    x = np.linspace(-0.06, 0.09, 1501)
    bumps, after = tread_film.bumps(x, FILM, L)
    before = x < 0.5 * (L - FILM)
    np.testing.assert_array_equal(after, x > 0.5 * (L - FILM))
    assert np.all(bumps[(x >= -FILM) & (x <= L)] == 0.0)
    assert x[before][bumps[before].argmax()] == pytest.approx(-FILM - 0.01, abs=1e-4)
    assert x[~before][bumps[~before].argmax()] == pytest.approx(L + 0.01, abs=1e-4)
    assert bumps.max() == pytest.approx(1.0, abs=1e-3) and bumps.min() >= 0.0


def test_an_unknown_release_is_rejected():
    with pytest.raises(ValueError, match='fig9'):
        tread_film.bending(positions(), FILM, L, ALPHA, 'fig9')
    with pytest.raises(ValueError, match='fig9'):
        tread_film.crossing_voltage(0.0, slip=0.1, total_slip=0.1, release='fig9', **CROSSING)


@pytest.mark.parametrize('alpha', [1e-3, 1.0, 67.0, 5e3])
def test_the_bending_shape_increases_from_zero_to_one(alpha):
    shape = equation(0, bending_shape, np.linspace(-0.01, FILM + 0.01, 301), FILM, alpha)
    assert shape[0] == 0.0 and shape[-1] == 1.0 and np.all(np.diff(shape) >= 0.0)


def test_the_bending_shape_is_b15_and_for_a_stiff_tread_a_cube():
    u = np.linspace(0.002, FILM, 50)
    grown, whole = np.exp(67.0 * u), FILM - 2.0 / 67.0 * np.tanh(0.5 * 67.0 * FILM)
    printed = u - 2.0 / 67.0 * (grown - 1.0) / (grown + 1.0)
    np.testing.assert_allclose(equation(0, bending_shape, u, FILM, 67.0), printed / whole,
                               rtol=1e-9)
    np.testing.assert_allclose(equation(0, bending_shape, u, FILM, 0.01), (u / FILM)**3, rtol=1e-7)


@pytest.mark.parametrize('alpha', [3.0, 9.9, 10.1, 67.0, 300.0])
def test_derivatives_of_the_bending_shape_agree_with_finite_differences(alpha):
    u = np.linspace(-0.0047, FILM + 0.0049, 60)
    assert_derivatives(bending_shape, (u, FILM, alpha), {0: 1}, atol=1e-4)
    by_alpha = derivative(
        lambda alpha: equation(0, bending_shape, u, FILM, alpha), alpha, 1e-3 * alpha)
    np.testing.assert_allclose(equation(2, bending_shape, u, FILM, alpha), by_alpha, atol=1e-7)


def evaluated(coefficients, outside):
    """Return the spline with ``coefficients`` (knots,) and its derivative."""
    first, *parts = over_arrays(spline, 9, outside, FILM)
    own = np.pad(coefficients, PADDING)[first.astype(int) + np.arange(4)[:, np.newaxis]]
    return tuple((own * part).sum(axis=0) for part in (parts[:4], parts[4:]))


def test_the_splines_add_up_to_1_between_the_knots_and_vanish_far_outside():
    between = np.linspace(FILM * KNOTS[1],
                          FILM * KNOTS[-2], 333)
    value, slope = evaluated(np.ones(len(KNOTS)), between)
    np.testing.assert_allclose(value, 1.0, atol=1e-12)
    np.testing.assert_allclose(slope, 0.0, atol=1e-9)
    far = np.array([-10.0, FILM * KNOTS[0] - 0.0041, FILM * KNOTS[-1] + 0.0041, 10.0])
    assert np.all(evaluated(np.ones(len(KNOTS)), far)[0] == 0.0)


def test_the_derivatives_of_the_splines_agree_with_finite_differences():
    coefficients, outside = np.sin(np.arange(len(KNOTS))), np.linspace(-0.015, 0.04, 1001)
    np.testing.assert_allclose(evaluated(coefficients, outside)[1], derivative(
        lambda x: evaluated(coefficients, x)[0], outside), atol=1e-2)


@pytest.mark.parametrize('shape', BUMP_HALF_WIDTHS)
@pytest.mark.parametrize('width, error', [(0.0055, 0.07), (0.009, 0.03), (0.0145, 0.01)])
def test_bumps_of_all_shapes_are_represented(shape, width, error):
    outside = np.linspace(FILM * KNOTS[0], FILM * KNOTS[-1], 500)
    expected = bump(outside - 0.012, width, shape)
    basis = np.array([evaluated(row, outside)[0] for row in np.eye(len(KNOTS))])
    coefficients = np.linalg.lstsq(basis.T, expected, rcond=None)[0]
    # no spline is exact at the cusp of the exponential shape, and at the last knot
    smooth = (np.abs(outside - 0.012) > 0.003) | (shape != 'exponential')
    inner = outside < FILM * KNOTS[-3]
    difference = np.abs(evaluated(coefficients, outside)[0] - expected)
    assert difference[smooth & inner].max() < error


def test_all_lengths_of_the_model_scale_with_the_film():
    x = positions()
    for scale in (0.5, 3.0):
        np.testing.assert_allclose(
            tread_film.bumps(scale * x, scale * FILM, scale * L)[0],
            tread_film.bumps(x, FILM, L)[0], atol=1e-9)
        np.testing.assert_allclose(
            tread_film.bending(scale * x, scale * FILM, scale * L, ALPHA / scale),
            tread_film.bending(x, FILM, L, ALPHA), atol=1e-9)
        np.testing.assert_allclose(over_arrays(spline, 9, scale * x, scale * FILM)[:5],
                                   over_arrays(spline, 9, x, FILM)[:5], atol=1e-9)
