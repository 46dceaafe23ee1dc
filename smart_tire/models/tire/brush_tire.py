# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, cdivision=True, infer_types=True, show_performance_hints=False

"""
Brush tire model with combined slip and parabolic pressure: B(17) to B(22).

The slip is a vector in the body frame, ``s = (r w - v_x, -k v_y) / |r w|``, with the velocity of
the wheel center and ``k = C_y / C_x``. Its magnitude is the total slip; the force on the robot has
its direction. With the normalized slip ``t = C_x |s| / (3 mu F_z)`` it is ``C_x s g(t)``::

    g = 1 - t + t^2 / 3 for t < 1, above 1 / (3 t)

All others take it, its derivatives and its inverse from here. Functions of arrays broadcast their
arguments. This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler.
``brush_tire.pxd`` declares what other compiled modules call; a ``Number`` is one of C, or an array
(also in place of numbers, where nothing is compiled).

The prior of the ground is that of the estimators.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.uncertain import Uncertain

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if not cython.compiled:
    from math import sqrt
    Number = TypeVar('Number', float, Array)
    Real = TypeVar('Real', float, Array)
    Derivatives = tuple[float, float, float, float, float, float, float]

COMPILED: bool = cython.compiled

MIN_SLIP = 1e-300  # -, keeps the reciprocal of a normalized slip finite
SQRT_3 = 3.0 ** 0.5  # of the points of a Gauss-Hermite quadrature
MIN_ROLLING_SPEED = 1e-6  # m/s, keeps the slip of a locked wheel finite; far above critical slip
MAX_FORCE_SHARE = 0.995  # of friction times load; closer to the limit, force hardly shows the slip
MAX_ITERATIONS = 30      # of Newton's method, which converges from below
FORCE_TOLERANCE = 1e-9   # relative

# prior of the ground, from ice to rough concrete; tires from C_y = 0.6 C_x (narrow) to isotropic
LN_STIFFNESS = Uncertain(-0.2, 0.4)                 # ln C_x over the nominal one of the tire
LN_FRICTION = Uncertain(math.log(0.4), 0.6)         # ln mu
LN_RESISTANCE = Uncertain(math.log(0.025), 1.0)     # ln of the rolling resistance over the load
# logit of the share of the resistance that acts along the velocity of the wheel, not along x
LATERAL_SHARE = Uncertain(0.0, 1.5)
LN_LATERAL_RATIO = Uncertain(-0.1, 0.15)            # ln C_y / C_x


def slip_vector(rolling_speed: ArrayLike, v_x: ArrayLike, v_y: ArrayLike, *,
                floor: float = MIN_ROLLING_SPEED) -> tuple[Array, Array]:
    """
    Return the slip vector (s_x, s_y) [-] of wheels.

    ``rolling_speed`` is r w [m/s], ``v_x`` and ``v_y`` are the velocity of the wheel center over
    ground [m/s]. The denominator is at least ``floor`` [m/s]: a locked wheel that moves has a
    very large slip, a stationary wheel has none. B(3)'s slip ratio is ``sign(r w) s_x``.

    >>> s_x, s_y = slip_vector(1.0, 0.9, 0.05)
    >>> print(f'{s_x:.2f} {s_y:.2f}')
    0.10 -0.05
    """
    rolling = np.asarray(rolling_speed, dtype=float)
    scale = np.maximum(np.abs(rolling), floor)
    return (rolling - np.asarray(v_x)) / scale, -np.asarray(v_y) / scale


def critical_slip(mu: ArrayLike, load: ArrayLike, stiffness: ArrayLike) -> Array:
    """
    Return the critical slip ``3 mu F_z / C_x`` [-] of B(22).

    From this total slip on the whole patch slides. ``load`` and ``stiffness`` (C_x) are in N.

    >>> print(f'{critical_slip(0.47, 26.7, 52.7):.3f}')
    0.714
    """
    critical: Array = 3.0 * np.asarray(mu, float) * np.asarray(load) / np.asarray(stiffness)
    return critical


def normalized_slip(total_slip: ArrayLike, critical: ArrayLike) -> Array:
    """
    Return the normalized slip t [-]: magnitude of the total slip over the critical slip.

    Zero without slip, infinite for a slip on a surface without friction.

    >>> print(f'{normalized_slip(0.13, 0.7143):.3f}')
    0.182
    """
    magnitude = np.abs(np.asarray(total_slip, dtype=float))
    with np.errstate(divide='ignore', over='ignore', invalid='ignore'):
        return np.where(magnitude > 0.0, magnitude / np.asarray(critical, dtype=float), 0.0)


def adhesion_ratio(total_slip: ArrayLike, mu: ArrayLike, load: ArrayLike,
                   stiffness: ArrayLike) -> Array:
    """
    Return the adhesion ratio xi_a = L_a / L [-] of B(22), from the magnitude of the slip.

    Zero where the whole patch slides. ``load`` and ``stiffness`` (C_x) are in N.

    >>> print(f'{adhesion_ratio(0.13, 0.47, 26.7, 52.7):.3f}')
    0.818
    """
    return np.maximum(
        1.0 - normalized_slip(total_slip, critical_slip(mu, load, stiffness)), 0.0)


def friction_from_adhesion(adhesion: ArrayLike, total_slip: ArrayLike, load: ArrayLike,
                           stiffness: ArrayLike) -> Array:
    """
    Return the friction coefficient mu [-] from the ``adhesion`` ratio: the inverse of B(22).

    ``load`` and ``stiffness`` (C_x) are in N. NaN where the ratio does not determine mu: outside
    (0, 1), without slip, or without load.

    >>> print(f'{friction_from_adhesion(0.818, 0.13, 26.7, 52.7):.2f}')
    0.47
    """
    adhesion, load = np.asarray(adhesion, dtype=float), np.asarray(load, dtype=float)
    magnitude = np.abs(np.asarray(total_slip, dtype=float))
    observable = (adhesion > 0.0) & (adhesion < 1.0) & (magnitude > 0.0) & (load > 0.0)
    with np.errstate(divide='ignore', invalid='ignore'):
        mu = np.asarray(stiffness) * magnitude / (3.0 * load * (1.0 - adhesion))
    return np.where(observable, mu, np.nan)


def friction_share(inverse: Number, fall: Number) -> Number:
    """
    Return the friction [-] over that of a tire that begins to slide.

    ``inverse`` is the reciprocal of the normalized slip, at most 1. For t > 1 the friction falls
    to ``1 - fall`` of its largest value.

    >>> print(f'{friction_share(0.5, 0.2):.2f}')
    0.90
    """
    return 1.0 - fall * (1.0 - inverse)


def secant(t: Number, inverse: Number, fall: Number) -> Number:
    """
    Return the force over ``C_x s`` [-].

    ``t`` is the normalized slip and ``inverse`` its reciprocal, the larger one limited to 1.

    >>> print(f'{secant(0.5, 1.0, 0.2):.3f} {secant(1.0, 0.5, 0.2):.3f}')
    0.583 0.150
    """
    return friction_share(inverse, fall) * inverse * (1.0 - t + t * t * (1.0 / 3.0))


def _share(t: Real) -> Real:
    """Return the force over ``mu F_z`` [-] at the normalized slip ``t``, -1 to 1."""
    return t * (3.0 - 3.0 * abs(t) + t * t)


def force_share(normalized: ArrayLike) -> Array:
    """
    Return the force over that of a sliding wheel, F / (mu F_z) [-], at a normalized slip t >= 0.

    ``1 - (1 - t)^3``; 1 from t = 1 on.

    >>> print(force_share(0.5))
    0.875
    """
    share: Array = _share(np.minimum(np.asarray(normalized, dtype=float), 1.0))
    return share


def normalized_slip_at(force: ArrayLike) -> Array:
    """
    Return the normalized slip t [-] of a force over that of a sliding wheel, 0 to 1.

    >>> print(normalized_slip_at(0.875))
    0.5
    """
    return 1.0 - np.cbrt(1.0 - np.asarray(force, dtype=float))


def slope_at(force: ArrayLike) -> Array:
    """
    Return the derivative of the force by the slip over C_x [-]: ``(1 - t)^2``.

    ``force`` is that over the one of a sliding wheel, 0 to 1.

    >>> print(slope_at(0.875))
    0.25
    """
    return (1.0 - normalized_slip_at(force)) ** 2


def force_over_slip(slip: float, stiffness: float, limit: float) -> float:
    """
    Return ``brush_force`` over the slip [N], of numbers; ``limit`` [N] is mu F_z.

    >>> print(f'{force_over_slip(0.1, 52.7, 0.47 * 26.7):.2f} N')
    45.67 N
    """
    elastic = stiffness * max(slip, MIN_SLIP)
    scale = 1.0 / max(elastic, 3.0 * limit)
    return stiffness * secant(elastic * scale, 3.0 * limit * scale, 0.0)


def force_with_derivatives(s_x: float, s_y: float, stiffness: float, limit: float,
                           spread: float = 0.0) -> Derivatives:
    """
    Return the force with slip (s_x, s_y) [-] and stiffness [N], with its derivatives.

    ``limit`` [N] is mu F_z. The numbers are the force [N] along x and y, its derivatives x by s_x,
    x by s_y (and y by s_x), y by s_y, and those of x and y by ln mu; the remaining part is linear
    in C_x. ``spread`` [-] is the standard deviation of the slip along itself: the force is that of
    a statistical linearization with three points, which beyond the limit is flat.

    >>> print(f'{force_with_derivatives(0.1, 0.0, 52.7, 0.47 * 26.7)[0]:.2f} N')
    4.57 N
    """
    square = max(s_x * s_x + s_y * s_y, 1e-18)
    size, full = sqrt(square), 3.0 * limit
    elastic = stiffness * size
    scale = 1.0 / max(elastic, full)
    t, inverse = elastic * scale, full * scale
    slope: cython.double = stiffness * secant(t, inverse, 0.0)
    bend: cython.double = stiffness * inverse * t * (t / 1.5 - 1.0)
    by_friction = -bend
    if size > spread > 0.0:
        step, scale = SQRT_3 * spread, stiffness / full
        low, high = (_share(max(-1.0, min((size - step) * scale, 1.0))),
                     _share(min((size + step) * scale, 1.0)))
        slope = slope / 1.5 + limit * (low + high) / (6.0 * size)
        bend = limit * (high - low) / (2.0 * step) - slope
    k = bend / square
    return (slope * s_x, slope * s_y, slope + k * s_x * s_x, k * s_x * s_y, slope + k * s_y * s_y,
            by_friction * s_x, by_friction * s_y)


def brush_force(s_x: ArrayLike, s_y: ArrayLike, mu: ArrayLike, load: ArrayLike,
                stiffness: ArrayLike) -> tuple[Array, Array]:
    """
    Return the force (F_x, F_y) [N] of the ground on the robot at a wheel.

    ``load`` and ``stiffness`` (C_x) are in N; the force is positive along the slip vector. It
    dissipates energy: ``F . (v_x - r w, v_y) <= 0``.

    >>> f_x, f_y = brush_force(0.1, -0.05, 0.47, 26.7, 52.7)
    >>> print(f'{f_x:.2f} {f_y:.2f} N')
    4.49 -2.24 N
    """
    s_x, s_y = np.asarray(s_x, dtype=float), np.asarray(s_y, dtype=float)
    inverse = critical_slip(mu, load, stiffness) / np.maximum(np.hypot(s_x, s_y), MIN_SLIP)
    slope = np.asarray(stiffness) * secant(
        1.0 / np.maximum(inverse, 1.0), np.minimum(inverse, 1.0), 0.0)
    return slope * s_x, slope * s_y


def linear_tire_force(force: ArrayLike, limits: Array,
                      most: float = MAX_FORCE_SHARE) -> tuple[Array, Array]:
    """
    Return C_x times the common slip [N] at which tires have the total ``force`` [N].

    Inverse of the sum of ``brush_force`` for longitudinal slip without knowledge of C_x: the force
    that each tire would have without sliding, and its derivative by the total one. ``limits`` [N],
    friction times load, have the shape (tires, ...), where ``force`` has (...); positive when
    driving. The force is limited to ``most`` of the sum of the limits.

    >>> linear, _ = linear_tire_force(20.0, 0.47 * np.array([18.0, 18.0, 35.0, 35.0]))
    >>> print(f'{float(linear):.2f} N')
    6.00 N
    """
    force, limits = np.asarray(force, dtype=float), np.maximum(limits, MIN_SLIP)
    target = np.minimum(np.abs(force), most * limits.sum(axis=0))
    linear = target / len(limits)
    for _ in range(MAX_ITERATIONS):  # the force is concave, so Newton never overshoots
        t = np.minimum(linear / (3.0 * limits), 1.0)
        missing = target - (limits * _share(t)).sum(axis=0)
        slope = np.maximum(((1.0 - t) ** 2).sum(axis=0), 1e-12)
        linear = linear + missing / slope
        if np.all(missing <= FORCE_TOLERANCE * np.maximum(target, FORCE_TOLERANCE)):
            break
    return np.copysign(linear, force), 1.0 / slope
