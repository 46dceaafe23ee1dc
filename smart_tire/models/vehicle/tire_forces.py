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

"""
Forces of the ground on the four wheels by the brush model, B(17) to B(22), with derivatives.

The friction coefficient enters as ``friction_ratio`` kappa = mu / C_x [1/N]: that is what a film
determines, and the normalized slip depends on it alone, ``t = |s| / (3 kappa F_z)``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array

MIN_TOTAL_SLIP = 1e-9  # -, below which the direction of the slip is of no importance


class WheelForces(NamedTuple):
    """Forces of the ground on n wheels and their derivatives; all have shape (n,)."""

    x: Array                  # N, F_x
    y: Array                  # N, F_y
    x_by_rolling: Array       # N s/m, by r w at constant velocity of the wheel center
    y_by_rolling: Array
    x_by_v_x: Array           # N s/m, by v_x of the wheel center at constant r w
    y_by_v_x: Array
    x_by_v_y: Array           # N s/m
    y_by_v_y: Array
    x_by_log_ratio: Array     # N, by ln(kappa F_z)
    y_by_log_ratio: Array


def wheel_forces(rolling: Array, v_x: Array, v_y: Array, load: Array, stiffness: float,
                 friction_ratio: float, *, floor: float) -> WheelForces:
    """
    Return the forces on wheels that roll with ``rolling`` = r w [m/s]; arrays have shape (n,).

    ``v_x``, ``v_y`` [m/s] are the velocities of the wheel centers, ``load`` [N] the normal loads,
    ``stiffness`` C_x [N], ``friction_ratio`` mu / C_x [1/N]. Slips are relative to |r w|, at
    least ``floor`` [m/s]. Forces are linear in the stiffness.

    >>> one = np.ones(1)
    >>> force = wheel_forces(one, 0.9 * one, 0.05 * one, 26.7 * one, 52.7, 0.47 / 52.7, floor=0.05)
    >>> print(f'{force.x[0]:.2f} {force.y[0]:.2f} N')
    4.49 -2.24 N
    """
    inverse = 1.0 / np.maximum(np.abs(rolling), floor)
    sign = np.where(np.abs(rolling) > floor, np.sign(rolling), 0.0)
    s_x, s_y = (rolling - v_x) * inverse, -v_y * inverse
    square = np.maximum(s_x * s_x + s_y * s_y, MIN_TOTAL_SLIP ** 2)
    t = np.sqrt(square) / (3.0 * friction_ratio * np.maximum(load, 1e-6))
    partial = t < 1.0
    late = np.maximum(t, 1.0)
    slope = stiffness * np.where(partial, 1.0 - t + t * t / 3.0, 1.0 / (3.0 * late))
    # t d(slope)/dt
    bend = stiffness * np.where(partial, -t + t * t / 1.5, -1.0 / (3.0 * late))
    # dF/ds = slope I + bend s s' / |s|^2
    k = bend / square
    xx, xy, yy = slope + k * s_x * s_x, k * s_x * s_y, slope + k * s_y * s_y
    d_x, d_y = inverse * (1.0 - sign * s_x), -inverse * sign * s_y  # ds/d(r w)
    return WheelForces(
        slope * s_x, slope * s_y, xx * d_x + xy * d_y, xy * d_x + yy * d_y,
        -inverse * xx, -inverse * xy, -inverse * xy, -inverse * yy, -bend * s_x, -bend * s_y)
