"""
Kinematics and loads of a four-wheeled skid-steered robot: B(1) to B(8) in the axes of REP-103.

Velocities are those of ``base_link``, the centre of the four wheel centres. What belongs to the
four wheels has them on the last axis, in the order of ``samples.WHEELS``; arguments broadcast.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike


GRAVITY = 9.80665  # m/s2, standard
SIDE = np.array([1.0, -1.0, 1.0, -1.0])  # +1 for the wheels on the left
END = np.array([1.0, 1.0, -1.0, -1.0])   # +1 for the wheels in front


def slip_ratio(rolling_speed: ArrayLike, ground_speed: ArrayLike,
               standstill_speed: float) -> Array:
    """
    Return B(3)'s slip ratio [-] in [-1, 1], positive when driving, in both directions.

    ``rolling_speed`` is r w, ``ground_speed`` the wheel centre's v_x, in m/s. NaN if and only if
    both are below ``standstill_speed``; a wheel below it that turns against the motion, or not
    at all, counts as locked: -1.
    """
    rolling = np.asarray(rolling_speed, dtype=float)
    ground = np.asarray(ground_speed, dtype=float)
    slow = np.abs(rolling) < standstill_speed
    locked = slow & (rolling * ground <= 0.0)
    ratio = np.minimum(np.maximum(1.0 - ground / np.where(locked, 1.0, rolling), -1.0), 1.0)
    still = slow & (np.abs(ground) < standstill_speed)
    return np.where(still, np.nan, np.where(locked, -1.0, ratio))


def wheel_slip_ratio(rolling: float, ground: float, standstill_speed: float) -> float:
    """Return ``slip_ratio`` of one wheel, ten times faster: a filter asks 125 times a second."""
    if abs(rolling) < standstill_speed:
        if abs(ground) < standstill_speed:
            return math.nan
        if rolling * ground <= 0.0:
            return -1.0
    return min(max(1.0 - ground / rolling, -1.0), 1.0)


def wheel_velocities(v_x: ArrayLike, v_y: ArrayLike, yaw_rate: ArrayLike, wheelbase: float,
                     track: float) -> tuple[Array, Array]:
    """Return the velocities (v_x, v_y) [m/s] of the wheel centres, each (..., 4): B(2)."""
    rate = np.asarray(yaw_rate, dtype=float)[..., np.newaxis]
    return (np.asarray(v_x)[..., np.newaxis] - 0.5 * track * SIDE * rate,
            np.asarray(v_y)[..., np.newaxis] + 0.5 * wheelbase * END * rate)


def wheel_speeds(v_x: ArrayLike, yaw_rate: ArrayLike, radius: float,
                 effective_track: float) -> Array:
    """
    Return the wheel speeds [rad/s] (..., 4) for a body velocity, without longitudinal slip.

    ``effective_track`` [m] is the track of the differential drive that turns alike; a
    skid-steered robot slips in every turn, so it is larger than the geometric track.
    """
    speed = np.asarray(v_x, dtype=float)[..., np.newaxis]
    rate = np.asarray(yaw_rate, dtype=float)[..., np.newaxis]
    speeds: Array = (speed - 0.5 * effective_track * SIDE * rate) / radius
    return speeds


def normal_loads(mass: float, com: Sequence[float], wheelbase: float, track: float,
                 a_x: ArrayLike, a_y: ArrayLike, *, radius: float) -> Array:
    """
    Return the wheel loads F_z [N] (..., 4) on level ground.

    ``com`` [m] is the centre of mass in ``base_link``, so it lies ``com[2] + radius`` above the
    ground; ``a_x``, ``a_y`` [m/s2] its horizontal acceleration in body axes. Four springs of
    equal stiffness settle what statics leaves open. A lifted wheel carries 0.
    """
    height = com[2] + radius
    pitch = (GRAVITY * com[0] - height * np.asarray(a_x, dtype=float)) / wheelbase
    roll = (GRAVITY * com[1] - height * np.asarray(a_y, dtype=float)) / track
    loads = mass * (0.25 * GRAVITY + 0.5 * pitch[..., np.newaxis] * END
                    + 0.5 * roll[..., np.newaxis] * SIDE)
    carried: Array = np.maximum(loads, 0.0)
    return carried


def icr(v_x: ArrayLike, v_y: ArrayLike, yaw_rate: ArrayLike) -> tuple[Array, Array]:
    """Return the centre of rotation (x = S, y) [m] in ``base_link``: B(4); NaN if not turning."""
    rate = np.asarray(yaw_rate, dtype=float)
    safe = np.where(rate == 0.0, np.nan, rate)
    return -np.asarray(v_y) / safe, np.asarray(v_x) / safe
