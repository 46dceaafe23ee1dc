# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Limits of speed and yaw rate: of the robot, of the friction, and of the path ahead."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.control import constants as c
from smart_tire.control.ground_knowledge import allowed_acceleration, MappedGround
from smart_tire.control.path_geometry import Segment
from smart_tire.parameters.control import TrajectoryControllerParams


LONGITUDINAL_SHARE = math.sqrt(1.0 - c.LATERAL_SHARE ** 2)  # of friction, for speed changes


@dataclass(frozen=True)
class MotionLimits:
    """Limits of the commanded motion on the present ground."""

    speed: float             # m/s
    acceleration: float      # m/s2
    deceleration: float      # m/s2
    lateral: float           # m/s2, of speed times yaw rate
    yaw_rate: float          # rad/s
    yaw_acceleration: float  # rad/s2
    mapped: MappedGround | None = None  # friction ahead, which lowers the limits

    def curve_speed(self, curvature: float) -> float:
        """Return the speed [m/s] in a curve with ``curvature`` [1/m]."""
        magnitude = max(abs(curvature), c.TINY)
        return min(self.speed, self.yaw_rate / magnitude, math.sqrt(self.lateral / magnitude))

    def path_speed(self, segment: Segment, distance: float) -> float:
        """
        Return the speed [m/s] at ``distance`` [m] along ``segment``.

        From it the speed limits of all curves ahead and the stop at the end are reached with the
        planned deceleration: v(s)^2 <= v_limit(s')^2 + 2 d (s' - s) for all s' ahead. A map
        lowers d and the limits of curves where its friction permits less.
        """
        lowest = math.inf if self.mapped is None else allowed_acceleration(0.0, self.mapped.params)
        reach = c.PLANNED_SHARE * min(self.deceleration, LONGITUDINAL_SHARE * float(lowest))
        first = segment.index(distance)
        last = segment.index(distance + self.speed ** 2 / (2.0 * reach)) + 1
        allowed = [math.inf] * (last - first) if self.mapped is None else (
            self.mapped.acceleration(*(values[first:last] for values in (
                segment.x, segment.y, segment.heading))).tolist())
        least, braking, at, rate = self.speed ** 2, 0.0, distance, 0.0  # least: squared speed
        for (place, curvature, change), friction in zip(segment.bends[first:last], allowed):
            before, rate = rate, c.PLANNED_SHARE * min(
                self.deceleration, LONGITUDINAL_SHARE * friction)
            braking += 2.0 * min(before, rate) * max(place - at, 0.0)
            squared = 0.0 if place == segment.length else min(
                (self.yaw_rate / curvature) ** 2,
                min(self.lateral, c.LATERAL_SHARE * friction) / curvature,
                c.PLANNED_SHARE * self.yaw_acceleration / change)
            at, least = max(place, at), min(least, braking + squared)
        return math.sqrt(least)

    def next_speed(self, wanted: float, last: float, dt: float) -> float:
        """Return the speed [m/s] towards ``wanted``, ``dt`` [s] after ``last``; both >= 0."""
        low, high = last - self.deceleration * dt, last + self.acceleration * dt
        return max(0.0, min(max(min(wanted, self.speed), low), high))

    def next_yaw_rate(self, wanted: float, last: float, speed: float, dt: float) -> float:
        """Return the yaw rate [rad/s] towards ``wanted``, ``dt`` [s] after ``last``."""
        change = self.yaw_acceleration * dt
        rate = min(max(wanted, last - change), last + change)
        bound = min(self.yaw_rate, self.lateral / max(abs(speed), c.TINY))
        return min(max(rate, -bound), bound)


def motion_limits(params: TrajectoryControllerParams, friction: float,
                  factors: tuple[float, float] = (1.0, 1.0)) -> MotionLimits:
    """
    Return the limits where the body may accelerate with ``friction`` [m/s2].

    ``factors`` are the commanded over the reached speed and yaw rate: what the body can reach
    within the limits of the command.
    """
    limits, longitudinal = params.limits, LONGITUDINAL_SHARE * friction
    speed, yaw_rate = (c.COMMAND_SHARE / max(factor, c.COMMAND_SHARE) for factor in factors)
    return MotionLimits(
        speed * params.max_speed, min(limits.acceleration, longitudinal),
        min(limits.deceleration, longitudinal),
        min(limits.lateral_acceleration, c.LATERAL_SHARE * friction),
        yaw_rate * limits.yaw_rate, limits.yaw_acceleration)


def command_share(command: tuple[float, float], params: TrajectoryControllerParams) -> float:
    """
    Return the factor that brings a command [m/s], [rad/s] into its bounds.

    The factor is the same for both, so that the curvature is kept; 0 if one is not finite. The
    wheels that execute it bound the body, whatever the estimates are.
    """
    if not all(map(math.isfinite, command)):
        return 0.0
    return c.COMMAND_SHARE / max(c.COMMAND_SHARE, abs(command[0]) / params.max_speed,
                                 abs(command[1]) / params.limits.yaw_rate)
