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
Brush tire model with combined slip and parabolic pressure: B(17) to B(22).

The slip is a vector in the body frame, ``s = (r w - v_x, -v_y) / |r w|``, with the velocity of the
wheel center. Its magnitude is the total slip; the force on the robot has its direction. These
functions assume an isotropic tire (C_y = C_x). Arguments broadcast against each other.

The prior of the ground is that of the estimators, which do estimate C_y / C_x.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.uncertain import Uncertain

MIN_ROLLING_SPEED = 1e-6  # m/s, keeps the slip of a locked wheel finite; far above critical slip
MAX_FORCE_SHARE = 0.995  # of friction times load; closer to the limit, force hardly shows the slip
MAX_ITERATIONS = 30      # of Newton's method, which converges from below
FORCE_TOLERANCE = 1e-9   # relative
AXLE_STEPS, MAX_AXLE_SHARE = 4, 0.9999  # of Newton's method and of friction, of ``axle_slip``

# prior of the ground, from ice to rough concrete; tires from C_y = 0.6 C_x (narrow) to isotropic
LN_STIFFNESS_SIGMA = 0.4                            # ln C_x, about the nominal one
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


def brush_force(s_x: ArrayLike, s_y: ArrayLike, mu: ArrayLike, load: ArrayLike,
                stiffness: ArrayLike) -> tuple[Array, Array]:
    """
    Return the force (F_x, F_y) [N] of the ground on the robot at a wheel.

    ``C_x s (1 - t + t^2 / 3)`` with the normalized slip t of B(22), and ``mu F_z s / |s|`` for
    t >= 1. ``load`` and ``stiffness`` (C_x) are in N; the force is positive along the slip
    vector. It dissipates energy: ``F . (v_x - r w, v_y) <= 0``.

    >>> f_x, f_y = brush_force(0.1, -0.05, 0.47, 26.7, 52.7)
    >>> print(f'{f_x:.2f} {f_y:.2f} N')
    4.49 -2.24 N
    """
    s_x, s_y = np.asarray(s_x, dtype=float), np.asarray(s_y, dtype=float)
    # 1 - t + t^2/3 = (1 + xi + xi^2) / 3 with xi = 1 - t
    magnitude = np.hypot(s_x, s_y)
    xi = adhesion_ratio(magnitude, mu, load, stiffness)
    limit = np.asarray(mu, dtype=float) * np.asarray(load)
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        sliding = np.where(magnitude > 0.0, limit / magnitude, 0.0)
    slope = np.where(xi > 0.0, np.asarray(stiffness) * (1.0 + xi + xi * xi) / 3.0, sliding)
    return slope * s_x, slope * s_y


def linear_tire_force(force: ArrayLike, friction: float, loads: ArrayLike) -> Array:
    """
    Return C_x times the common slip [N] at which the wheels have the total ``force`` [N].

    Inverse of the sum of ``brush_force``, B(22), over the wheels, for longitudinal slip
    and without knowledge of C_x: the force that each wheel would have without sliding. ``loads``
    [N] has the shape (wheels, ...), where ``force`` has (...); positive when driving. The force is
    limited to ``MAX_FORCE_SHARE`` of ``friction`` (mu) times load.

    >>> print(f'{float(linear_tire_force(20.0, 0.47, [18.0, 18.0, 35.0, 35.0])):.2f} N')
    6.00 N
    """
    force = np.asarray(force, dtype=float)
    limits = friction * np.maximum(np.asarray(loads, dtype=float), 0.0)
    target = np.minimum(np.abs(force), MAX_FORCE_SHARE * limits.sum(axis=0))
    # mu F_z (1 - xi^3) with xi = 1 - C_x s / (3 mu F_z): concave, so Newton never overshoots
    slip = target / len(limits)
    for _ in range(MAX_ITERATIONS):
        with np.errstate(divide='ignore', invalid='ignore'):
            share = np.where(limits > 0.0, slip / (3.0 * limits), 1.0)
        xi = np.maximum(1.0 - share, 0.0)
        square = xi * xi  # much faster than a power of three
        missing = target - (limits * (1.0 - square * xi)).sum(axis=0)
        slip = slip + missing / np.maximum(square.sum(axis=0), 1e-12)
        if np.all(missing <= FORCE_TOLERANCE * np.maximum(target, FORCE_TOLERANCE)):
            break
    return np.asarray(np.copysign(slip, force))


def axle_slip(force: Array, limits: Array) -> tuple[Array, Array]:
    """
    Return C_x times the slip [N] of two brush tires at a total ``force`` [N], and its derivative.

    ``limits`` (2, m) are friction times load of the axle with less and with more load. Beyond the
    limit of the first axle, the other one carries the rest; up to there the force is a cubic in
    the slip, which Newton's method inverts from below.

    >>> linear, _ = axle_slip(np.array([1.0, 6.0]), np.array([[3.0, 3.0], [5.0, 5.0]]))
    >>> [round(float(one), 2) for one in linear]
    [0.52, 4.62]
    """
    small, large = limits
    linear = 0.5 * force
    for _ in range(AXLE_STEPS):
        first, second = (np.maximum(1.0 - linear / (3.0 * limit), 0.0) for limit in limits)
        missing = force - small * (1.0 - first ** 3) - large * (1.0 - second ** 3)
        linear = linear + missing / np.maximum(first ** 2 + second ** 2, 1e-3)
    rest = np.clip((force - small) / large, 0.0, MAX_AXLE_SHARE)
    sliding = 3.0 * large * (1.0 - np.cbrt(1.0 - rest))
    linear = np.where(sliding > 3.0 * small, sliding, np.minimum(linear, 3.0 * small))
    first, second = (np.maximum(1.0 - linear / (3.0 * limit), 0.0) for limit in limits)
    least = (1.0 - MAX_AXLE_SHARE) ** (2.0 / 3.0)
    return linear, 1.0 / np.maximum(first ** 2 + second ** 2, least)
