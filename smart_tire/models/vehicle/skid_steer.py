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
Kinematics and wheel loads of a four-wheel skid-steer robot: B(1) to B(8) in REP-103 axes.

Velocities are those of ``base_link``, the center of the four wheel centers. Arrays over the wheels
have them on the last axis, in the order of ``samples.WHEELS``; arguments broadcast.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GRAVITY

SLIP_FLOOR = 0.05   # m/s, smallest denominator of a slip in force balances; near standstill
MIN_LOAD = 0.1      # N, least load that a tire force is computed with, of a lifted wheel
SIDE_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])  # +1 for left wheels
AXLE_SIGNS = np.array([1.0, 1.0, -1.0, -1.0])   # +1 for front wheels


def slip_ratio(rolling_speed: ArrayLike, ground_speed: ArrayLike,
               standstill_speed: float) -> Array:
    """
    Return the slip ratio [-] of B(3) in [-1, 1], positive when driving, in both directions.

    ``rolling_speed`` is r w [m/s], ``ground_speed`` v_x of the wheel center [m/s]. NaN if and only
    if both are below ``standstill_speed`` [m/s]. A wheel below it that is stationary or turns
    against the motion counts as locked: -1.

    >>> print(slip_ratio([1.0, -1.0, 0.0, 0.0], [0.9, -1.2, 0.5, 0.0], 0.05))
    [ 0.1 -0.2 -1.   nan]
    """
    rolling = np.asarray(rolling_speed, dtype=float)
    ground = np.asarray(ground_speed, dtype=float)
    slow = np.abs(rolling) < standstill_speed
    locked = slow & (rolling * ground <= 0.0)
    ratio = np.minimum(np.maximum(1.0 - ground / np.where(locked, 1.0, rolling), -1.0), 1.0)
    still = slow & (np.abs(ground) < standstill_speed)
    return np.where(still, np.nan, np.where(locked, -1.0, ratio))


def wheel_velocities(v_x: ArrayLike, v_y: ArrayLike, yaw_rate: ArrayLike, wheelbase: float,
                     track: float) -> tuple[Array, Array]:
    """
    Return the velocities (v_x, v_y) [m/s] of the wheel centers, each (..., 4): B(2).

    Body velocities in m/s and rad/s (...), ``wheelbase`` and ``track`` in m.

    >>> v_x, v_y = wheel_velocities(1.0, 0.0, 0.5, 0.26, 0.38)
    >>> print(v_x, v_y)
    [0.905 1.095 0.905 1.095] [ 0.065  0.065 -0.065 -0.065]
    """
    rate = np.asarray(yaw_rate, dtype=float)[..., np.newaxis]
    return (np.asarray(v_x)[..., np.newaxis] - 0.5 * track * SIDE_SIGNS * rate,
            np.asarray(v_y)[..., np.newaxis] + 0.5 * wheelbase * AXLE_SIGNS * rate)


def linear_loads(robot: RobotParams, com: Sequence[float] = ()) -> tuple[Array, Array, Array]:
    """
    Return the wheel loads [N] (4,) at rest on level ground, and their derivatives [kg] (4,).

    These are by the acceleration of the center of mass along x and y in body axes. ``com`` [m] is
    its position in ``base_link``, where it is not the one of the parameters; it lies
    ``com[2] + wheel_radius`` above the ground. Four springs of equal stiffness resolve the
    statically indeterminate case.

    >>> from smart_tire.parameters.robot import RobotParams
    >>> print(linear_loads(RobotParams())[1].round(2))
    [-2.31 -2.31  2.31  2.31]
    """
    com_x, com_y, com_z = com or robot.center_of_mass
    by_x, by_y = (0.5 * robot.mass / robot.wheelbase * AXLE_SIGNS,
                  0.5 * robot.mass / robot.track_width * SIDE_SIGNS)
    height = com_z + robot.wheel_radius
    return (GRAVITY * (0.25 * robot.mass + com_x * by_x + com_y * by_y),
            -height * by_x, -height * by_y)


def normal_loads(robot: RobotParams, a_x: ArrayLike, a_y: ArrayLike) -> Array:
    """
    Return the wheel loads F_z [N] (..., 4) at accelerations [m/s2] (...) as in ``linear_loads``.

    The load of a lifted wheel is 0.

    >>> from smart_tire.parameters.robot import RobotParams
    >>> print(normal_loads(RobotParams(), 1.0, 0.0).round(1))
    [24.4 24.4 29.  29. ]
    """
    rest, by_x, by_y = linear_loads(robot)
    carried: Array = np.maximum(
        rest + np.multiply.outer(a_x, by_x) + np.multiply.outer(a_y, by_y), 0.0)
    return carried


def icr(v_x: ArrayLike, v_y: ArrayLike, yaw_rate: ArrayLike) -> tuple[Array, Array]:
    """
    Return the instantaneous center of rotation (x = S, y) [m] in ``base_link``, B(4).

    Velocities are in m/s and rad/s. NaN for a yaw rate of zero.

    >>> x, y = icr(0.6, -0.03, 0.5)
    >>> print(f'{x:.2f} {y:.2f} m')
    0.06 1.20 m
    """
    rate = np.asarray(yaw_rate, dtype=float)
    safe = np.where(rate == 0.0, np.nan, rate)
    return -np.asarray(v_y) / safe, np.asarray(v_x) / safe
