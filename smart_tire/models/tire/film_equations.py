# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True, infer_types=True, show_performance_hints=False

"""
Output of a film in the tread at one position in the patch, with derivatives: the equations.

``tread_film`` and ``strain_charge`` evaluate them over arrays and say what they mean;
``linearize`` evaluates all of them over the samples of a patch crossing. ``x`` [m] is the travel
of the film's trailing edge past the leading edge of the patch.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.libc.math import cos, exp, fabs, floor, pi, sin, tanh
else:
    from math import cos, exp, fabs, floor, pi, sin, tanh

COMPILED: bool = cython.compiled

BUMP_DISTANCE = 0.5      # film lengths from begin or end of the contact to the center of a bump
BUMP_HALF_WIDTH = 0.45   # film lengths, below the distance: a bump ends before the contact begins
# of the spline, in film lengths outside the patch; they cover the bumps and the begin and end of
# the contact, into which a wide bump extends
KNOT_SPACING = 0.1   # resolves a slope over 3 mm
KNOTS = KNOT_SPACING * np.arange(-4, 16)
PADDING = 3  # B-splines beyond each end, whose coefficients are zero
MAX_DECAY = 700.0        # recovery lengths for which the exponential does not underflow
MAX_LAG_SERIES_H = 0.1   # up to which h - tanh(h) is a series that is exact to rounding

# rows of the output of ``linearize``: by the shared parameters, by those of a film, and others
(BY_SLIP, BY_NORM_SLIP, BY_CHANGE, BY_SCALE, BY_ALPHA, BY_LENGTH, BY_OPPOSITE, BY_LOST,
 BY_CENTER, BY_OFFSET, BY_BENDING, BY_BEFORE, BY_AFTER, BY_GAIN, BY_RECOVERY, VOLTS,
 BY_POSITION, ROWS) = range(18)
# parameters of ``linearize`` that all films share
(SLIP, NORM_SLIP, CHANGE, SCALE, BENDING_ALPHA, CONTACT_LENGTH, FILM_LENGTH, OPPOSITE_WEIGHT,
 LOST_WEIGHT, MIN_NORM_SLIP, SHARED) = range(11)

cython.declare(
    SPACING=cython.double, DISTANCE=cython.double, HALF_WIDTH=cython.double,
    LARGEST_DECAY=cython.double, LARGEST_SERIES_H=cython.double, FIRST_KNOT=cython.double,
    KNOT_COUNT=cython.int)
SPACING, DISTANCE, HALF_WIDTH = KNOT_SPACING, BUMP_DISTANCE, BUMP_HALF_WIDTH
LARGEST_DECAY, LARGEST_SERIES_H = MAX_DECAY, MAX_LAG_SERIES_H
FIRST_KNOT, KNOT_COUNT = PADDING - 1.0 - KNOTS[0] / KNOT_SPACING, len(KNOTS)


def over_arrays(equation: Callable[..., tuple[float, ...]], k: int, *arguments: npt.ArrayLike
                ) -> Array:
    """Return the ``k`` results (k, ...) of an equation over arguments that broadcast."""
    arrays = np.broadcast_arrays(*arguments)
    rows: Any = [equation(*values) for values in zip(
        *(one.ravel().astype(float).tolist() for one in arrays))]
    return np.array(rows, dtype=float).reshape(-1, k).T.reshape(k, *arrays[0].shape)


@cython.cfunc
def _lag(h: cython.double, series: cython.bint) -> cython.double:
    """Return ``h - tanh(h)`` of B(15), also as a ``series``."""
    if not series:
        return h - tanh(h)
    z = h * h
    return h * z * (1.0 / 3.0 + z * (-2.0 / 15.0 + z * (17.0 / 315.0 + z * (-62.0 / 2835.0 + z * (
        1382.0 / 155925.0 + z * (-21844.0 / 6081075.0))))))


@cython.ccall
def bending_shape(u: cython.double, film_length: cython.double, alpha: cython.double
                  ) -> tuple[cython.double, cython.double, cython.double]:
    """Return n(u) of B(15), its derivatives by u, B(16), and by ``alpha``."""
    if u < 0.0:
        return 0.0, 0.0, 0.0
    if u > film_length:
        return 1.0, 0.0, 0.0
    whole = 0.5 * alpha * film_length
    series = whole < LARGEST_SERIES_H
    full = _lag(whole, series)
    end, now = tanh(whole), tanh(0.5 * alpha * u)
    shape = _lag(0.5 * alpha * u, series) / full
    scale = 0.5 / full
    return (shape, scale * alpha * now * now,
            scale * (u * now * now - film_length * end * end * shape))


@cython.ccall
def bending(x: cython.double, film_length: cython.double, patch: cython.double,
            alpha: cython.double, opposite: cython.double, lost: cython.double,
            recovery: cython.double) -> tuple[
                cython.double, cython.double, cython.double, cython.double, cython.double,
                cython.double, cython.double]:
    """
    Return the bending part for a bending peak of 1.

    Its derivatives are those by x, contact length, ``alpha``, recovery length and both weights
    of the release.
    """
    past = (x - patch) / recovery
    entered, by_entered, entered_by_alpha = bending_shape(x + film_length, film_length, alpha)
    left, by_left, left_by_alpha = bending_shape(
        x + film_length - patch, film_length, alpha)
    remaining, by_remaining, remaining_by_alpha = bending_shape(patch - x, film_length, alpha)
    end = opposite + lost - 1.0  # of the contact, minus the output there
    recovered = decay = 0.0
    if past > 0.0:
        decay = exp(-min(past, LARGEST_DECAY))
        recovered = 1.0 - decay
    by_end = opposite * by_left + lost * by_remaining - end * decay / recovery
    return (entered - opposite * left - lost + lost * remaining + end * recovered,
            by_entered - by_end, by_end,
            entered_by_alpha - opposite * left_by_alpha + lost * remaining_by_alpha,
            -end * past * decay / recovery, recovered - left, recovered + remaining - 1.0)


@cython.ccall
def displacement(xi: cython.double, t: cython.double
                 ) -> tuple[cython.double, cython.double, cython.double]:
    """
    Return the displacement of B(21) over L per unit slip, its integral over xi, and the slid part.

    ``min(xi, xi (1 - xi) / t)``: B(17) in the adhesion zone, the friction limit behind it. ``xi``
    from 0 to 1 is the position in the patch over L, from its leading edge, ``t`` > 0 the
    normalized slip. The derivative of the integral by t is minus the slid part over t.
    """
    inverse, behind = 1.0 / t, 1.0 - xi
    sticking = min(xi, max(1.0 - t, 0.0))  # up to xi_a of B(22)
    # behind it the integral of r (1 - r) / t over r = 1 - xi
    sliding = min(behind, t)
    slid = sliding * sliding * (sliding * (1.0 / 3.0) - 0.5) * inverse
    return min(xi, xi * behind * inverse), 0.5 * sticking * sticking + slid, slid


@cython.ccall
def overlap(x: cython.double, t: cython.double, film_length: cython.double, patch: cython.double
            ) -> tuple[cython.double, cython.double, cython.double, cython.double]:
    """Return the overlap integral of B(23) per unit slip, and that by x, by L and by t."""
    begin = min(max(x / patch, 0.0), 1.0)
    end = min(max(x / patch + film_length / patch, 0.0), 1.0)
    low, low_integral, low_slid = displacement(begin, t)
    high, high_integral, high_slid = displacement(end, t)
    area = high_integral - low_integral
    return (patch * area, high - low, area - end * high + begin * low,
            -patch / t * (high_slid - low_slid))


@cython.ccall
def bump(x: cython.double, film_length: cython.double, patch: cython.double
         ) -> tuple[cython.double, cython.double, cython.double]:
    """Return the bump of height 1, its derivative by x, and 1 if it is the one after."""
    past = x - 0.5 * (patch - film_length)
    scale = pi / (HALF_WIDTH * film_length)
    phase = scale * (fabs(past) - 0.5 * (patch + film_length) - DISTANCE * film_length)
    after = 1.0 if past > 0.0 else 0.0
    if fabs(phase) >= pi:
        return 0.0, 0.0, after
    slope = 0.5 * scale * sin(phase)
    return 0.5 + 0.5 * cos(phase), -slope if past > 0.0 else slope, after


@cython.ccall
def spline(outside: cython.double, film_length: cython.double) -> tuple[
        cython.double, cython.double, cython.double, cython.double, cython.double,
        cython.double, cython.double, cython.double, cython.double]:
    """Return index, plus ``PADDING``, of the first of four cubic B-splines, values and slopes."""
    spacing = SPACING * film_length
    position = min(max(outside / spacing + FIRST_KNOT, 0.0), KNOT_COUNT + 3.0)
    first = min(floor(position), KNOT_COUNT + 2.0)
    x = position - first
    rest = 1.0 - x
    scale = 0.5 / spacing
    return (first, rest * rest * rest / 6.0, (4.0 - 6.0 * x * x + 3.0 * x * x * x) / 6.0,
            (4.0 - 6.0 * rest * rest + 3.0 * rest * rest * rest) / 6.0, x * x * x / 6.0,
            -scale * rest * rest, scale * (3.0 * x * x - 4.0 * x),
            scale * (4.0 * rest - 3.0 * rest * rest), scale * x * x)


def linearize(x: cython.double[::1], distance: cython.double[::1], relative: cython.double[::1],
              gain: cython.double[::1], film: cython.Py_ssize_t[::1],
              films: cython.double[:, ::1], shared: cython.double[::1],
              deviations: cython.double[::1], out: cython.double[:, ::1],
              bumps: cython.double[:, ::1]) -> None:
    """
    Compute the output [V] of n samples of the films of a wheel and its derivatives.

    ``x`` [m], ``distance`` [m] from the center of the film, ``relative`` to the reference, in
    contact lengths, and the nominal ``gain`` [V/m] have shape (n,); ``film`` (n,) are rows of
    ``films``, which are the parameters from ``BY_CENTER`` to ``BY_RECOVERY``, the latter in m.
    ``deviations`` (2 * KNOTS,) of the bumps from their nominal shape. ``out`` (ROWS, n) is filled,
    ``bumps`` (2 * KNOTS, n), zero before, receives the derivatives by ``deviations``. Raise
    ValueError where shapes disagree.
    """
    n: cython.Py_ssize_t = x.shape[0]
    if not (distance.shape[0] == n and relative.shape[0] == n and gain.shape[0] == n
            and film.shape[0] == n and films.shape[1] == VOLTS - BY_CENTER
            and shared.shape[0] == SHARED and deviations.shape[0] == 2 * KNOT_COUNT
            and out.shape[0] == ROWS and out.shape[1] == n
            and bumps.shape[0] == 2 * KNOT_COUNT and bumps.shape[1] == n):
        raise ValueError('the shapes of the arrays disagree')
    # parameters SLIP to MIN_NORM_SLIP, and columns of ``films`` from BY_CENTER, by their numbers
    slip: cython.double = shared[0]
    normalized_slip: cython.double = shared[1]
    change: cython.double = shared[2]
    scale: cython.double = shared[3]
    alpha: cython.double = shared[4]
    patch: cython.double = shared[5]
    length: cython.double = shared[6]
    least: cython.double = shared[9]
    padding: cython.Py_ssize_t = PADDING
    i: cython.Py_ssize_t
    k: cython.Py_ssize_t
    for i in range(n):
        own: cython.Py_ssize_t = film[i]
        peak: cython.double = films[own, 2]
        recovery: cython.double = films[own, 6]
        (bend, bend_by_x, bend_by_length, by_alpha, by_recovery, by_opposite, by_lost) = bending(
            x[i], length, patch, alpha, shared[7], shared[8], recovery)
        # strain; linear below the least normalized slip
        growth = 1.0 + change * relative[i]
        normalized = normalized_slip * growth
        limited = max(normalized, least)
        strain, strain_by_x, strain_by_length, strain_by_t = overlap(x[i], limited, length, patch)
        strain += (normalized - limited) * strain_by_t
        by_gain = slip * gain[i] * growth * strain
        factor = gain[i] * growth * (1.0 + films[own, 5])
        by_slip = factor * strain
        factor *= slip
        # bumps
        nominal, nominal_by_x, after = bump(x[i], length, patch)
        outside = x[i] - patch if after else -length - x[i]
        height = films[own, 4] if after else films[own, 3]
        (first, value_0, value_1, value_2, value_3, slope_0, slope_1, slope_2, slope_3) = spline(
            outside, length)
        values: cython.double[4] = [value_0, value_1, value_2, value_3]
        slopes: cython.double[4] = [slope_0, slope_1, slope_2, slope_3]
        begin: cython.Py_ssize_t = int(first) - padding
        shift: cython.Py_ssize_t = KNOT_COUNT if after else 0
        slope = 0.0
        for k in range(4):
            if 0 <= begin + k < KNOT_COUNT:
                bumps[shift + begin + k, i] = -height * values[k]
                nominal += deviations[shift + begin + k] * values[k]
                slope += deviations[shift + begin + k] * slopes[k]
        bump_by_x = nominal_by_x + (slope if after else -slope)
        bump_by_length = -(nominal_by_x + slope) if after else 0.0

        # rows BY_SLIP to BY_POSITION by their numbers: names of the module are slow here
        by_x = peak * bend_by_x + factor * strain_by_x - height * bump_by_x
        out[0, i] = by_slip
        out[1, i] = factor * strain_by_t * growth
        out[2, i] = relative[i] * (slip * by_slip / growth
                                   + normalized_slip * factor * strain_by_t)
        out[3, i] = by_x * distance[i]
        out[4, i] = alpha * peak * by_alpha
        out[5, i] = patch * (peak * bend_by_length + factor * strain_by_length
                             - height * bump_by_length + 0.5 * by_x)
        out[6, i], out[7, i] = peak * by_opposite, peak * by_lost
        out[8, i], out[9, i], out[10, i] = -by_x * (1.0 + scale), 1.0, bend
        out[11, i] = 0.0 if after else -nominal
        out[12, i] = -nominal if after else 0.0
        out[13, i], out[14, i] = by_gain, peak * by_recovery * recovery
        out[15, i] = films[own, 1] + peak * bend + slip * by_slip - height * nominal
        out[16, i] = by_x
