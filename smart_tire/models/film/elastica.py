# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Weightless buckled film in closed form: A(7), A(8) with w = 0.

All quantities are dimensionless as in the paper: lengths over the half length L of the film, the
load f = F_X L^2 / (E I), arc length s from the center of the film (0) to its clamped end (1); y
points from the center towards the clamps. ``stroke`` is the paper's delta, the displacement of one
end of the half film towards the other. With complete elliptic integrals K, E of the parameter
m = k^2: ``delta = 2 - 2 E / K``, ``f = 4 K^2``, ``sin(theta / 2) = k sn(2 K s)``. Arguments
broadcast. Functions of the stroke raise ParameterError unless 0 <= stroke < 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError

EULER_LOAD = np.pi**2           # load of the flat film
TOUCHING_STROKE = 0.8486515096  # from which a weightless film touches itself
MAX_PARAMETER = 0.8261147660  # m of stroke 1, where the clamps meet
MAX_NEWTON_STEPS = 12               # five suffice, see the tests
STEP_TOLERANCE = 1e-8                # relative, of m: the next Newton step would be its square
MAX_SERIES_PARAMETER = 0.02             # m below which differences of the integrals lose digits
ORDERS = np.arange(1, 10)       # of the series; m^10 is below rounding
SQUARES = np.cumprod(((2 * ORDERS - 1) / (2 * ORDERS))**2)
EXCESS_SERIES = SQUARES[::-1]   # (2 K / pi - 1) / m in powers of m, highest first
D_SERIES = np.pi * (SQUARES * ORDERS / (2 * ORDERS - 1))[::-1]


@dataclass(frozen=True)
class Shape:
    """Shape of a half film; all arrays have one shape. The other half is its mirror image."""

    s: Array
    x: Array
    y: Array
    theta: Array      # rad, to the line through the clamps
    curvature: Array  # d theta / d s


def checked_stroke(stroke: ArrayLike) -> Array:
    """
    Return the stroke as an array; raise ParameterError unless 0 <= stroke < 1.

    >>> checked_stroke([0.1, 1.0])
    Traceback (most recent call last):
    ...
    smart_tire.errors.ParameterError: stroke is 1.0, expected 0 <= stroke < 1: the clamps have met
    """
    array = np.asarray(stroke, dtype=float)
    wrong = ~((array >= 0.0) & (array < 1.0))
    if wrong.any():
        value = array[wrong].flat[0]
        why = ('is not a number' if np.isnan(value) else
               'the clamps have met' if value >= 1.0 else
               'a film longer than its own length is stretched, not buckled')
        raise ParameterError(f'stroke is {value}, expected 0 <= stroke < 1: {why}')
    return array


def stroke_of(parameter: ArrayLike) -> Array:
    """
    Return the stroke for the parameter m = k^2 of the elliptic integrals, A(8).

    >>> print(f'{stroke_of(0.5):.4f}')
    0.5431
    """
    m = np.asarray(parameter, dtype=float)
    K, D = _integrals(m)
    stroke: Array = 2.0 * m * D / K
    return stroke


def parameter_of(stroke: ArrayLike) -> Array:
    """
    Return the parameter m = k^2 = sin^2(theta_max / 2) of the elliptic integrals.

    >>> print(f'{2.0 * np.degrees(np.arcsin(np.sqrt(parameter_of(0.1)))):.1f} deg')
    36.6 deg
    """
    target = checked_stroke(stroke)
    return _solved(target * (1.0 - 0.174 * target), target, stroke_of, _stroke_slope)


def load(stroke: ArrayLike) -> Array:
    """
    Return the load f of A(7) that holds the film; pi^2 for the flat film.

    >>> print(f'{load(0.1) / EULER_LOAD:.4f}')
    1.0530
    """
    force: Array = 4.0 * _integrals(parameter_of(stroke))[0]**2
    return force


def shape(stroke: ArrayLike, s: ArrayLike) -> Shape:
    """
    Return the shape of the half film at the arc lengths ``s``; ParameterError outside [0, 1].

    >>> half = shape(0.1, [0.5, 1.0])
    >>> print(half.x.round(4), half.y.round(4))
    [0.45 0.9 ] [0.1949 0.3898]
    """
    s = np.asarray(s, dtype=float)
    if not ((s >= 0.0) & (s <= 1.0)).all():
        raise ParameterError(f's spans {s.min()} to {s.max()}, expected 0 to 1')
    m = parameter_of(stroke)
    s, m = np.broadcast_arrays(s, m)
    root, k = 2.0 * _integrals(m)[0], np.sqrt(m)
    from scipy.special import ellipj, elliprd  # nodes start without
    sn, cn, dn, _ = ellipj(root * s, m)
    # E(u) = u - m sn^3 R_D(cn^2, dn^2, 1) / 3 up to the quarter period, mirrored beyond;
    # scipy's ellipeinc is wrong by a tenth at single points
    lag = 2.0 * m * sn**3 * elliprd(cn**2, dn**2, 1.0) / (3.0 * root)
    x = np.where(s <= 0.5, s - lag, s - stroke_of(m) + lag)
    return Shape(s, x, 2.0 * k * (1.0 - cn) / root, 2.0 * np.arcsin(k * sn), 2.0 * k * root * cn)


def charge(stroke: ArrayLike) -> Array:
    """
    Return Q_en / K of A(9), from the flat film: ``f (1 - delta) / pi^2 - 1``, 0 to -1.

    Its series is ``-delta / 2 - 7 delta^2 / 32 - 15 delta^3 / 128``; A(15) has -1/2 for -7/32.

    >>> print(f'{charge(0.1):.6f}')
    -0.052312
    """
    return _charge_of(parameter_of(stroke))


def charge_slope(stroke: ArrayLike) -> Array:
    """
    Return the derivative of the charge of A(9) by the stroke; -1/2 for the flat film.

    >>> print(charge_slope([0.0, 0.1]).round(4))
    [-0.5    -0.5476]
    """
    m = parameter_of(stroke)
    slope: Array = _charge_slope(m) / _stroke_slope(m)
    return slope


def stroke_from_charge(value: ArrayLike) -> Array:
    """
    Return the stroke for a charge Q_en / K of A(9), the inverse of ``charge``.

    Raises ParameterError unless -1 < charge <= 0.

    >>> print(f'{stroke_from_charge(-0.0523):.4f}')
    0.1000
    """
    q = np.asarray(value, dtype=float)
    wrong = ~((q <= 0.0) & (q > -1.0))
    if wrong.any():
        raise ParameterError(f'charge over K is {q[wrong].flat[0]}, expected -1 < charge <= 0')
    return stroke_of(_solved(-2.0 * q * (1.0 + 0.62 * q + 0.05 * q**2), q, _charge_of,
                             _charge_slope))


def _solved(m: Array, target: Array, function: Callable[[Array], Array],
            slope: Callable[[Array], Array]) -> Array:
    """Return the root m of ``function(m) = target`` by Newton's method, starting at ``m``."""
    for _ in range(MAX_NEWTON_STEPS):
        step = (function(m) - target) / slope(m)
        m = np.clip(m - step, 0.0, MAX_PARAMETER)
        if np.all(np.abs(step) <= STEP_TOLERANCE * m):
            break
    return m


def _integrals(m: Array) -> tuple[Array, Array]:
    """Return K(m) and D(m) = (K - E) / m."""
    from scipy.special import ellipe, ellipk  # nodes start without
    K = ellipk(m)
    large = np.maximum(m, MAX_SERIES_PARAMETER)
    D = np.where(m < MAX_SERIES_PARAMETER, np.polyval(D_SERIES, m), (K - ellipe(m)) / large)
    return K, D


def _slopes(m: Array) -> tuple[Array, Array, Array]:
    """Return K, d K / d m and the derivative of the stroke by m."""
    K, D = _integrals(m)
    K_slope = 0.5 * (K - D) / (1.0 - m)
    return K, K_slope, D / K + 2.0 * (K - m * D) * K_slope / K**2


def _stroke_slope(m: Array) -> Array:
    return _slopes(m)[2]


def _excess(m: Array) -> Array:
    """Return 2 K / pi - 1 without cancellation."""
    K = _integrals(m)[0]
    return np.where(m < MAX_SERIES_PARAMETER, m * np.polyval(EXCESS_SERIES, m),
                    2.0 * K / np.pi - 1.0)


def _charge_of(m: Array) -> Array:
    excess, stroke = _excess(m), stroke_of(m)
    charge: Array = excess * (2.0 + excess) * (1.0 - stroke) - stroke
    return charge


def _charge_slope(m: Array) -> Array:
    K, K_slope, stroke_slope = _slopes(m)
    slope: Array = (8.0 * K * K_slope * (1.0 - stroke_of(m))
                    - 4.0 * K**2 * stroke_slope) / EULER_LOAD
    return slope
