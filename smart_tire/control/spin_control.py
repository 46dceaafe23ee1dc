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

"""Turning in place."""

from __future__ import annotations

import math

from smart_tire.control.motion_limits import MotionLimits, PLANNED_SHARE
from smart_tire.control.motion_monitor import Motion
from smart_tire.parameters.control import TrajectoryControllerParams

DONE_SHARE = 0.5   # of the yaw tolerance; it is left for the rest of the rotation
BOOST_GAIN = 1.0   # 1/s, of the integral of the yaw rate error
HOLD_GAIN = 3.0    # 1/s, from the distance to the speed that holds the position
MAX_HOLD_SPEED = 0.1  # m/s


class SpinControl:
    """
    Yaw rate of one turn in place; ``done`` once the yaw error is small, and remains so.

    On ground on which the robot turns slower than commanded, an integrator raises the command.
    Wheels that turn in place slide in all directions: the speed keeps the robot at ``hold``
    (x, y) [m], ahead and behind only.
    """

    def __init__(self, hold: tuple[float, float]) -> None:
        self._hold = hold
        self.done = False
        self.error = math.inf  # rad
        self._boost = 0.0      # rad/s
        self._side = 0.0       # sign of the turn

    def step(self, error: float, yaw_rate: float, dt: float, limits: MotionLimits,
             params: TrajectoryControllerParams) -> float:
        """Return the yaw rate [rad/s] to command; ``error`` [rad] is yaw still to turn."""
        if self._side == 0.0:
            self._side = math.copysign(1.0, error)
        elif abs(error) > 0.75 * math.pi:
            error = error % (self._side * math.tau)  # keep the side of the turn
        self.error = error
        if abs(error) <= DONE_SHARE * params.arrival.yaw_tolerance:
            self.done = True
            return 0.0
        follower = params.follower
        highest = min(follower.spin_rate, limits.yaw_rate)
        stopping = math.sqrt(2.0 * PLANNED_SHARE * limits.yaw_acceleration * abs(error))
        if params.slip_compensation:  # its feedback of the reached yaw rate follows with a delay
            stopping = min(stopping, abs(error) / max(follower.actuation_delay, dt))
        wanted = min(highest, max(stopping, follower.min_spin_rate))
        side = math.copysign(1.0, error)
        if not params.slip_compensation:
            self._boost += BOOST_GAIN * dt * (wanted - side * yaw_rate)
            self._boost = min(max(self._boost, 0.0), highest - wanted)
        return side * (wanted + self._boost)

    def holding_speed(self, motion: Motion, last: float, dt: float,
                      limits: MotionLimits) -> float:
        """Return the speed [m/s] towards the position to hold, ``dt`` [s] after ``last``."""
        x, y = self._hold
        ahead = (x - motion.x) * math.cos(motion.yaw) + (y - motion.y) * math.sin(motion.yaw)
        bound = min(MAX_HOLD_SPEED, limits.speed)
        wanted = min(max(HOLD_GAIN * ahead, -bound), bound)
        change = min(limits.acceleration, limits.deceleration) * dt
        return min(max(wanted, last - change), last + change)
