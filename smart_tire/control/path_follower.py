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

"""Follows maneuvers: look-ahead pursuit with curvature feed-forward, and turns in place."""

from __future__ import annotations

from collections.abc import Callable
import math

from smart_tire.control.motion_limits import MotionLimits
from smart_tire.control.motion_monitor import Motion
from smart_tire.control.path_geometry import FORWARD, Maneuver, PathPoint, Segment, Spin, wrap
from smart_tire.control.spin_control import SpinControl
from smart_tire.parameters.control import TrajectoryControllerParams

PROJECTION_WINDOW = 0.2   # m, in addition to twice the distance driven since the last step
STANDSTILL_SPEED = 0.02   # m/s
STANDSTILL_RATE = 0.05    # rad/s
MAX_SETTLING = 1.0        # s, wait for standstill between maneuvers
MIN_HEADING_SPEED = 0.05  # m/s; direction of the velocity at lower speeds is not defined
MAX_ALIGN_FACTOR = 2.0    # of align_angle, while driving

# v_x [m/s], yaw rate [rad/s] -> angle [rad] from the x axis to the velocity, modulo pi
HeadingOffset = Callable[[float, float], float]


class PathFollower:
    """
    Drives along ``maneuvers``; they begin at standstill, except the first one.

    ``point`` is the position relative to the path, None in turns in place.
    """

    def __init__(self, maneuvers: tuple[Maneuver, ...], v_x: float, yaw_rate: float) -> None:
        self._maneuvers, self._number = maneuvers, 0
        self._distance: float | None = None  # m, arc length reached in the segment
        self._spin: SpinControl | None = None
        self._settling: float | None = None  # s, since the zero command at the end
        self._v_x, self._yaw_rate = v_x, yaw_rate  # last command
        self.point: PathPoint | None = None

    @property
    def finished(self) -> bool:
        """Whether all maneuvers have been driven, and the robot is at rest."""
        return self._number >= len(self._maneuvers)

    @property
    def segment(self) -> Segment | None:
        """Segment that is followed; None in turns in place."""
        if self.finished:
            return None
        maneuver = self._maneuvers[self._number]
        return maneuver if isinstance(maneuver, Segment) else None

    @property
    def end_segment(self) -> Segment | None:
        """Last segment."""
        segments = [one for one in self._maneuvers if isinstance(one, Segment)]
        return segments[-1] if segments else None

    @property
    def on_last_segment(self) -> bool:
        """Whether no segment comes after the present maneuver."""
        return all(isinstance(one, Spin) for one in self._maneuvers[self._number + 1:])

    def remaining_distance(self) -> float:
        """Return the distance [m] along the path to its end."""
        ahead = sum(one.length for one in self._maneuvers[self._number:])
        return max(ahead - (self._distance or 0.0), 0.0)

    def advance(self) -> tuple[float, float]:
        """Return numbers that grow with progress: along the path [m], of a turn [rad]."""
        spin = self._spin
        before = min(self.point.along, 0.0) if self.point is not None else 0.0
        return (self._number - self.remaining_distance() + before,
                -abs(spin.error) if spin is not None else -math.inf)

    def step(self, motion: Motion, dt: float, limits: MotionLimits,
             params: TrajectoryControllerParams,
             heading_offset: HeadingOffset) -> tuple[float, float]:
        """
        Return forward speed [m/s] and yaw rate [rad/s] for the next ``dt`` [s].

        ``motion`` is the one predicted for the time when the command takes effect.
        """
        if self._settling is not None:
            self._settle(motion, dt, params.arrival.yaw_tolerance)
        if self.finished:
            wanted = (0.0, 0.0)
        elif self._settling is not None:
            wanted = self._stop(dt, limits)
        else:
            wanted = self._drive(motion, dt, limits, params, heading_offset)
        self._v_x, self._yaw_rate = wanted
        return wanted

    def _settle(self, motion: Motion, dt: float, tolerance: float) -> None:
        """Wait for standstill, then go on; a turn that misses its yaw is repeated."""
        self._settling = (self._settling or 0.0) + dt
        at_rest = (motion.speed() < STANDSTILL_SPEED and abs(motion.yaw_rate) < STANDSTILL_RATE
                   and self._v_x == self._yaw_rate == 0.0)
        if at_rest or self._settling > MAX_SETTLING:
            self._settling, self._spin, self._distance, self.point = None, None, None, None
            maneuver = self._maneuvers[self._number]
            if not isinstance(maneuver, Spin) or abs(wrap(maneuver.yaw - motion.yaw)) <= tolerance:
                self._number += 1

    def _stop(self, dt: float, limits: MotionLimits) -> tuple[float, float]:
        speed = limits.next_speed(0.0, abs(self._v_x), dt)
        v_x = math.copysign(speed, self._v_x) if speed > 0.0 else 0.0
        return v_x, limits.next_yaw_rate(0.0, self._yaw_rate, speed, dt)

    def _drive(self, motion: Motion, dt: float, limits: MotionLimits,
               params: TrajectoryControllerParams,
               heading_offset: HeadingOffset) -> tuple[float, float]:
        maneuver = self._maneuvers[self._number]
        if isinstance(maneuver, Spin):
            return self._turn(maneuver.yaw, motion, dt, limits, params, ends=True)
        self._project(maneuver, motion, dt)
        return self._follow(maneuver, motion, dt, limits, params, heading_offset)

    def _turn(self, yaw: float, motion: Motion, dt: float, limits: MotionLimits,
              params: TrajectoryControllerParams, *, ends: bool) -> tuple[float, float]:
        """Turn in place; at its end settle, or follow the segment if it does not end there."""
        if self._v_x != 0.0:
            return self._stop(dt, limits)
        if self._spin is None:
            self._spin = SpinControl()
        rate = self._spin.step(wrap(yaw - motion.yaw), motion.yaw_rate, dt, limits, params)
        if self._spin.done:
            if ends:
                self._settling = 0.0
            else:
                self._spin = None
        return 0.0, limits.next_yaw_rate(rate, self._yaw_rate, 0.0, dt)

    def _project(self, segment: Segment, motion: Motion, dt: float) -> None:
        """Advance the projection of the robot, within a window along the segment."""
        if self._distance is None:
            low = 0.0
            start = segment.point(0.0, motion.x, motion.y)
            high = start.offset() + PROJECTION_WINDOW
        else:
            low = self._distance
            high = low + PROJECTION_WINDOW + 2.0 * motion.speed() * dt
        self.point = segment.project(motion.x, motion.y, low, min(high, segment.length))
        self._distance = self.point.distance

    def _follow(self, segment: Segment, motion: Motion, dt: float, limits: MotionLimits,
                params: TrajectoryControllerParams,
                heading_offset: HeadingOffset) -> tuple[float, float]:
        point, follower = self.point, params.follower
        assert point is not None
        # beyond the end the path continues straight, so that the end is not missed
        remaining = segment.length - point.distance or -point.along
        if remaining <= 0.5 * params.arrival.approach_speed * dt:
            self._settling = 0.0
            return self._stop(dt, limits)
        offset = self._heading_offset(segment, heading_offset)
        look_ahead = min(max(abs(self._v_x) * follower.look_ahead_time,
                             follower.min_look_ahead), follower.max_look_ahead)
        bearing = point.heading - math.atan2(point.lateral, look_ahead)
        error = wrap(bearing - motion.yaw - offset)
        if self._must_align(error, params):
            return self._turn(bearing - offset, motion, dt, limits, params, ends=False)
        curvature = point.curvature + 2.0 * math.sin(error) / math.hypot(
            look_ahead, point.lateral)
        speed = limits.next_speed(
            self._wanted_speed(segment, point, curvature, limits, params), abs(self._v_x), dt)
        if self._v_x * segment.direction < 0.0:  # a new path in the other direction: stop first
            return self._stop(dt, limits)
        yaw_rate = limits.next_yaw_rate(speed * curvature, self._yaw_rate, speed, dt)
        return segment.direction * speed, yaw_rate

    def _heading_offset(self, segment: Segment, heading_offset: HeadingOffset) -> float:
        v_x = segment.direction * max(abs(self._v_x), MIN_HEADING_SPEED)
        rate = self._yaw_rate if abs(self._v_x) > MIN_HEADING_SPEED else 0.0
        drift = math.remainder(heading_offset(v_x, rate), math.pi)
        return drift if segment.direction == FORWARD else drift + math.pi

    def _must_align(self, error: float, params: TrajectoryControllerParams) -> bool:
        """Return whether the direction of travel is corrected by turning in place."""
        if self._spin is not None:
            return True
        at_rest = self._v_x == 0.0
        limit = params.follower.align_angle * (1.0 if at_rest else MAX_ALIGN_FACTOR)
        return abs(error) > limit

    def _wanted_speed(self, segment: Segment, point: PathPoint, curvature: float,
                      limits: MotionLimits, params: TrajectoryControllerParams) -> float:
        wanted = min(limits.path_speed(segment, point.distance), limits.curve_speed(curvature))
        return max(wanted, min(params.arrival.approach_speed, limits.speed))
