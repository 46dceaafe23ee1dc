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
Reference of path tracking: three-state filter of the instantaneous centers of rotation (ICR).

With the ICR of the two sides at y_left > 0 > y_right and that of the body at x_icr, all relative
to base_link (Martinez, Mandow et al. 2005), the treads move at V = v_x - y yaw_rate and the body
sideways at v_y = -x_icr yaw_rate. The three are a slow random process (Pentzer et al. 2014).
"""

from __future__ import annotations

import numpy as np
from smart_tire.arrays import Array, ArrayLike
from smart_tire.control.slip_kinematics import (
    Moved, SlipCoefficient, SlipKinematics, Velocity)
from smart_tire.control.trajectory_control import TrajectoryControl
from smart_tire.parameters.control import TrajectoryControllerParams

FADE = 5.0           # s, correlation time of the centers: best of 1, 5 and 30 s on seed 101
SIGMA_Y, SIGMA_X = 0.2, 0.1   # m, of the centers at the start
MAX_WIDENING = 3.5   # of the track, over it
MAX_X = 0.3          # m, ahead and behind


class IcrKinematics(SlipKinematics):
    """Feed-forward of the ICR filter, with the inputs of the slip compensation; no feedback."""

    def reset(self) -> None:
        """Begin with the priors."""
        super().reset()
        half = 0.5 * self._track
        first = half * (1.0 + (self._wheelbase / self._track) ** 2)
        limits = half, MAX_WIDENING * half
        self._left, self._right = (
            SlipCoefficient(sign * first, SIGMA_Y, *sorted(sign * y for y in limits))
            for sign in (1.0, -1.0))
        self._ahead = SlipCoefficient(0.0, SIGMA_X, -MAX_X, MAX_X)

    def command(self, v_x: float, yaw_rate: float, now_ns: int, delay: float,
                params: TrajectoryControllerParams) -> Velocity:
        """Return v_x [m/s] and yaw rate [rad/s] to command for wanted ones of the body."""
        left, right = self._left.value, self._right.value
        return (v_x - 0.5 * (left + right) * yaw_rate,
                (left - right) / self._effective_track * yaw_rate)

    def factors(self, v_x: float, yaw_rate: float, now_ns: int) -> Velocity:
        """Return commanded over reached speed and yaw rate, for wanted ones of the body."""
        return 1.0, (self._left.value - self._right.value) / self._effective_track

    def lateral_speed(self, v_x: float, yaw_rate: float, yaw: ArrayLike) -> Array:
        """Return the lateral speeds [m/s] of the body at yaws (n,)."""
        return np.full(np.shape(yaw), -self._ahead.value * yaw_rate)

    def _correct(self, motion: Moved, left: float, right: float, sigma: float,
                 duration: float) -> None:
        """Correct the centers with motion and slip velocities [m/s] of a window."""
        _, v_y, yaw_rate, *_ = motion
        half, change = 0.5 * self._track * yaw_rate, duration / FADE
        self._left.correct(-yaw_rate, left - half, sigma, change, duration)
        self._right.correct(-yaw_rate, right + half, sigma, change, duration)
        self._ahead.correct(-yaw_rate, v_y, 0.0, change, duration)


class IcrControl(TrajectoryControl):
    """Trajectory control with the ICR filter."""

    def __init__(self, params: TrajectoryControllerParams) -> None:
        super().__init__(params)
        self._kinematics = IcrKinematics(params)
