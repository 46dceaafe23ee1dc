"""
Brush tire with combined slip and parabolic pressure: B(17) to B(22).

Slip is a vector in the body frame, ``s = (r w - v_x, -v_y) / |r w|`` with the velocity of the
wheel's centre; its magnitude is the total slip, its direction that of the traction on the robot.
Arguments broadcast against each other. The tire is isotropic (C_y = C_x), an assumption.
"""

from __future__ import annotations

import numpy as np

from smart_tire.arrays import Array, ArrayLike


MIN_ROLLING_SPEED = 1e-6  # m/s, keeps the slip of a locked wheel finite; far above critical


def slip_vector(rolling_speed: ArrayLike, v_x: ArrayLike, v_y: ArrayLike, *,
                floor: float = MIN_ROLLING_SPEED) -> tuple[Array, Array]:
    """
    Return the slip (s_x, s_y) [-] of wheels with surface speed r w over ground speed v [m/s].

    The denominator is at least ``floor`` [m/s]: a locked wheel has a huge slip against its
    motion, a wheel at rest none. B(3)'s lambda is ``sign(r w) s_x``.
    """
    rolling = np.asarray(rolling_speed, dtype=float)
    scale = np.maximum(np.abs(rolling), floor)
    return (rolling - np.asarray(v_x)) / scale, -np.asarray(v_y) / scale


def critical_slip(mu: ArrayLike, load: ArrayLike, stiffness: ArrayLike) -> Array:
    """Return the total slip [-] above which the whole patch slides: 3 mu F_z / C_x of B(22)."""
    critical: Array = 3.0 * np.asarray(mu, float) * np.asarray(load) / np.asarray(stiffness)
    return critical


def adhesion_ratio(total_slip: ArrayLike, mu: ArrayLike, load: ArrayLike,
                   stiffness: ArrayLike) -> Array:
    """Return xi_a = L_a / L of B(22), with the slip's magnitude; 0 where all slides."""
    magnitude = np.abs(np.asarray(total_slip, dtype=float))
    critical = critical_slip(mu, load, stiffness)
    with np.errstate(divide='ignore', invalid='ignore'):
        ratio = np.where(magnitude > 0.0, 1.0 - magnitude / critical, 1.0)
    return np.maximum(ratio, 0.0)


def friction_from_adhesion(ratio: ArrayLike, total_slip: ArrayLike, load: ArrayLike,
                           stiffness: ArrayLike) -> Array:
    """
    Return mu [-] from the adhesion ratio: the inverse of B(22).

    NaN where the ratio does not tell: outside (0, 1), or without slip or load.
    """
    ratio, magnitude = np.asarray(ratio, dtype=float), np.abs(np.asarray(total_slip, dtype=float))
    load = np.asarray(load, dtype=float)
    tells = (ratio > 0.0) & (ratio < 1.0) & (magnitude > 0.0) & (load > 0.0)
    with np.errstate(divide='ignore', invalid='ignore'):
        mu = np.asarray(stiffness) * magnitude / (3.0 * load * (1.0 - ratio))
    return np.where(tells, mu, np.nan)


def brush_force(s_x: ArrayLike, s_y: ArrayLike, mu: ArrayLike, load: ArrayLike,
                stiffness: ArrayLike) -> tuple[Array, Array]:
    """
    Return the force (F_x, F_y) [N] of the ground on the robot at a wheel.

    ``C_x s (1 - t + t^2/3)`` with ``t = |s| / critical slip``, ``mu F_z s/|s|`` for t >= 1. It
    never creates energy: ``F . (v_x - r w, v_y) <= 0``.
    """
    s_x, s_y = np.asarray(s_x, dtype=float), np.asarray(s_y, dtype=float)
    # 1 - t + t^2/3 = (1 + xi + xi^2) / 3 with xi = 1 - t
    magnitude = np.hypot(s_x, s_y)
    xi = adhesion_ratio(magnitude, mu, load, stiffness)
    limit = np.asarray(mu, dtype=float) * np.asarray(load)
    with np.errstate(divide='ignore', invalid='ignore'):
        sliding = np.where(magnitude > 0.0, limit / magnitude, 0.0)
    slope = np.where(xi > 0.0, np.asarray(stiffness) * (1.0 + xi + xi * xi) / 3.0, sliding)
    return slope * s_x, slope * s_y
