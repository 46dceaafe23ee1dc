# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Follows maneuvers: look-ahead pursuit with curvature feed-forward, and turns in place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.control import constants as c
from smart_tire.control.ground_motion import Motion, wrap
from smart_tire.control.motion_limits import MotionLimits
from smart_tire.control.path_geometry import FORWARD, Maneuver, PathPoint, Segment, Spin
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.samples import Vector3


class SpinControl:
    """
    Yaw rate of one turn in place; ``done`` once the yaw error is small, and remains so.

    Wheels that turn in place slide in all directions: the speed leads the robot to ``hold`` (x, y)
    [m], but not while it slides away faster.
    """

    def __init__(self, hold: tuple[float, float]) -> None:
        self._hold = hold
        self.done = False
        self.error = math.inf  # rad
        self._side = 0.0       # sign of the turn

    def step(self, error: float, now: Conditions) -> float:
        """Return the yaw rate [rad/s] to command; ``error`` [rad] is yaw still to turn."""
        limits, params = now.limits, now.params
        if self._side == 0.0:
            self._side = math.copysign(1.0, error)
        elif abs(error) > 0.75 * math.pi:
            error = error % (self._side * math.tau)  # keep the side of the turn
        self.error = error
        if abs(error) <= c.DONE_SHARE * params.arrival.yaw_tolerance:
            self.done = True
            return 0.0
        follower = params.follower
        highest = min(follower.spin_rate, limits.yaw_rate)
        stopping = math.sqrt(2.0 * c.PLANNED_SHARE * limits.yaw_acceleration * abs(error))
        if params.slip_compensation:  # its feedback of the reached yaw rate follows with a delay
            stopping = min(stopping, abs(error) / max(now.delay, now.dt))
        wanted = min(highest, max(stopping, follower.min_spin_rate))
        return math.copysign(wanted, error)

    def holding_speed(self, last: float, now: Conditions) -> float:
        """
        Return the speed [m/s] that leads to the position to hold, a period after ``last``.

        The wheels only drive along the yaw: of all speeds over the rest of the turn, those with
        the least sum of squares of the distance left at its end, with the expected slide, and of
        the distances per angle.
        """
        motion, step = now.motion, self.error / c.HOLD_STEPS
        yaw = motion.yaw + step * (np.arange(c.HOLD_STEPS) + 0.5)
        ahead = np.stack([np.cos(yaw), np.sin(yaw)])
        rate = math.copysign(max(abs(motion.yaw_rate), now.params.follower.min_spin_rate), step)
        slide = step / rate * now.lateral_speed(0.0, rate, yaw)  # m to the left, of each step
        left = np.array(self._hold) - (motion.x, motion.y) - (-ahead[1] @ slide, ahead[0] @ slide)
        per_angle = np.array([math.cos(motion.yaw), math.sin(motion.yaw)]) @ np.linalg.solve(
            abs(step) * ahead @ ahead.T + c.HOLD_ANGLE * np.eye(2), left)
        bound = min(c.MAX_HOLD_SPEED, now.limits.speed)
        wanted = min(max(abs(rate) * float(per_angle), -bound), bound)
        if motion.speed() > bound:
            wanted = 0.0
        change = min(now.limits.acceleration, now.limits.deceleration) * now.dt
        return min(max(wanted, last - change), last + change)


@dataclass(frozen=True)
class Conditions:
    """What one step depends on; ``motion`` is predicted for the time of effect of the command."""

    motion: Motion
    dt: float  # s, until the next step
    limits: MotionLimits
    params: TrajectoryControllerParams
    # m/s, lateral speeds with v_x and yaw rate at yaws
    lateral_speed: Callable[[float, float, ArrayLike], Array]
    delay: float  # s, from a command to the motion


def no_lateral_speed(v_x: float, yaw_rate: float, yaw: ArrayLike) -> Array:
    """Return 0: without compensation of slip, the direction of travel is the x axis."""
    return np.zeros_like(yaw, dtype=float)


class Advance(NamedTuple):
    """How far a path has been driven; each number grows."""

    number: int      # of the maneuver
    distance: float  # m along the path from its end, so it is negative
    turn: float      # rad from the end of a turn in place, so it is negative; -inf outside of one

    def exceeds(self, other: Advance) -> bool:
        """Return whether this is farther than the ``other``, by more than a robot that stands."""
        return (self.number > other.number or self.distance > other.distance + c.MIN_ADVANCE
                or self.turn > other.turn + c.MIN_TURN)


class PathFollower:
    """
    Drives along ``maneuvers``; they begin at standstill, except the first one. None: stops.

    ``point`` is the position relative to the path, None in turns in place.
    """

    def __init__(self, maneuvers: tuple[Maneuver, ...], v_x: float, yaw_rate: float) -> None:
        self.maneuvers, self._number = maneuvers, 0
        self._distance: float | None = None  # m, arc length reached in the segment
        self._spin: SpinControl | None = None
        self._hold: tuple[float, float] | None = None  # m, where the robot turns in place
        # s, since the command of zero at the end
        self._settling: float | None = None if maneuvers else 0.0
        self._v_x, self._yaw_rate = v_x, yaw_rate  # last command
        self.point: PathPoint | None = None

    @property
    def finished(self) -> bool:
        """Whether all maneuvers have been driven, and the robot is at rest."""
        return self._number >= len(self.maneuvers) and self._settling is None

    @property
    def end(self) -> Vector3:
        """End of the last segment, x and y [m], and the yaw [rad] after it; NaN if it is any."""
        *_, segment = (one for one in self.maneuvers if isinstance(one, Segment))
        last = self.maneuvers[-1]
        return (*segment.end, last.yaw if isinstance(last, Spin) else math.nan)

    def remaining_distance(self) -> float:
        """Return the distance [m] along the path to its end."""
        ahead = sum(one.length for one in self.maneuvers[self._number:])
        return max(ahead - (self._distance or 0.0), 0.0)

    def advance(self) -> Advance:
        """Return how far the path has been driven."""
        spin = self._spin
        before = min(self.point.along, 0.0) if self.point is not None else 0.0
        return Advance(self._number, before - self.remaining_distance(),
                       -abs(spin.error) if spin is not None else -math.inf)

    def step(self, now: Conditions) -> tuple[float, float]:
        """Return forward speed [m/s] and yaw rate [rad/s] to command until the next step."""
        if self._settling is not None:
            self._settle(now)
        if self.finished:
            command = (0.0, 0.0)
        elif self._settling is not None:
            command = self._stop(now)
        else:
            command = self._drive(now, self.maneuvers[self._number])
        self._v_x, self._yaw_rate = command
        return command

    def _settle(self, now: Conditions) -> None:
        """Wait for standstill, then go on; a turn that misses its yaw is repeated."""
        if self._v_x != 0.0 or self._yaw_rate != 0.0:
            return
        self._settling = (self._settling or 0.0) + now.dt
        if not now.motion.at_rest() and self._settling <= c.RELEASE_TIME:
            return
        self._settling, self._spin, self._distance, self.point = None, None, None, None
        if not self.maneuvers:
            return
        maneuver, tolerance = self.maneuvers[self._number], now.params.arrival.yaw_tolerance
        if isinstance(maneuver, Segment):
            self._hold = maneuver.end
        if isinstance(maneuver, Segment) or abs(wrap(maneuver.yaw - now.motion.yaw)) <= tolerance:
            self._number += 1

    def _stop(self, now: Conditions) -> tuple[float, float]:
        speed = now.limits.next_speed(0.0, abs(self._v_x), now.dt)
        v_x = math.copysign(speed, self._v_x) if speed > 0.0 else 0.0
        return v_x, now.limits.next_yaw_rate(0.0, self._yaw_rate, speed, now.dt)

    def _drive(self, now: Conditions, maneuver: Maneuver) -> tuple[float, float]:
        if isinstance(maneuver, Spin):
            return self._turn(now, maneuver.yaw, ends=True)
        self.point = self._project(now, maneuver)
        self._distance = self.point.distance
        # beyond its end the path continues straight, so that the robot does not turn to the end
        remaining = maneuver.length - self._distance or -self.point.along
        if remaining <= 0.5 * now.params.arrival.approach_speed * now.dt:
            self._settling = 0.0
            return self._stop(now)
        return self._follow(now, maneuver, self.point)

    def _turn(self, now: Conditions, yaw: float, *, ends: bool) -> tuple[float, float]:
        """Turn in place; at its end settle, or follow the segment if it does not end there."""
        motion = now.motion
        if abs(self._v_x) > c.MAX_HOLD_SPEED:
            return self._stop(now)
        if self._spin is None:
            self._spin = SpinControl(self._hold or (motion.x, motion.y))
        rate = self._spin.step(wrap(yaw - motion.yaw), now)
        speed = self._spin.holding_speed(self._v_x, now)
        if self._spin.done and ends:
            self._settling = 0.0
        elif self._spin.done:
            self._spin, self._hold = None, None
        return speed, now.limits.next_yaw_rate(rate, self._yaw_rate, speed, now.dt)

    def _project(self, now: Conditions, segment: Segment) -> PathPoint:
        """Return the projection of the robot, within a window along the segment."""
        x, y = now.motion.x, now.motion.y
        if self._distance is None:
            low, reach = 0.0, segment.point(0.0, x, y).offset()
        else:
            low, reach = self._distance, 2.0 * now.motion.speed() * now.dt
        return segment.project(x, y, low, min(low + c.PROJECTION_WINDOW + reach, segment.length))

    def _follow(self, now: Conditions, segment: Segment, point: PathPoint) -> tuple[float, float]:
        """Pursue a point on the tangent, and add the curvature of the path."""
        follower, limits = now.params.follower, now.limits
        look_ahead = min(max(abs(self._v_x) * follower.look_ahead_time,
                             follower.min_look_ahead), follower.max_look_ahead)
        # with the yaw rate of the path where the yaw will have followed, half the look-ahead on,
        # not the last one, which depends on the drift itself
        speed = max(abs(self._v_x), c.STANDSTILL_SPEED)
        ahead = min(point.distance + 0.5 * look_ahead, segment.length)
        v_x = segment.direction * speed
        drift = math.atan(float(now.lateral_speed(v_x, speed * segment.point(
            ahead, *segment.end).curvature, now.motion.yaw)) / v_x)
        yaw = (point.heading - math.atan2(point.lateral, look_ahead)
               - drift - (0.0 if segment.direction == FORWARD else math.pi))
        error = wrap(yaw - now.motion.yaw)
        if self._must_align(error, follower.align_angle):
            return self._turn(now, yaw, ends=False)
        if self._v_x * segment.direction < 0.0:  # a new path in the other direction: stop first
            return self._stop(now)
        pursuit = 2.0 * math.sin(error) / math.hypot(look_ahead, point.lateral)
        curvature = point.curvature + pursuit
        wanted = max(min(limits.path_speed(segment, point.distance),
                         limits.curve_speed(curvature)), now.params.arrival.approach_speed)
        speed = limits.next_speed(wanted, abs(self._v_x), now.dt)
        yaw_rate = limits.next_yaw_rate(speed * curvature, self._yaw_rate, speed, now.dt)
        return segment.direction * speed, yaw_rate

    def _must_align(self, error: float, limit: float) -> bool:
        """Return whether the direction of travel is corrected by turning in place."""
        if self._spin is not None:
            return True
        return abs(error) > limit * (1.0 if self._v_x == 0.0 else c.MAX_ALIGN_FACTOR)
