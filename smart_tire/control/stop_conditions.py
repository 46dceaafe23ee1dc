# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Conditions under which a robot that follows a path stops."""

from __future__ import annotations

import math

from smart_tire.control import constants as c
from smart_tire.control.ground_motion import Motion, Travel, wrap
from smart_tire.control.path_follower import Advance, PathFollower
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.parameters.path_following import ArrivalParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import LEFT, NS_PER_S, RIGHT, Vector3, WheelSample

Distances = tuple[float, ...]  # m: mean of both sides, and half of right - left


class OdometryCheck:
    """
    Compares the motion in ``odom`` with that of the wheels over ``WINDOW_NS``, by their stamps.

    Wheels that roll move the robot in the direction in which they roll or, with opposite sides,
    turn it: on ice with a slip of up to ``max_slip``. A robot that moves rolls at least one side.
    Of a turn in place the angle alone is judged: where tires slide in all directions, a slope
    moves the body ahead of its wheels or against them, but gravity has no moment that turns it.
    """

    def __init__(self, robot: RobotParams, odom: Travel) -> None:
        """``odom`` has the distance forward [m] and the turned angle [rad] of the poses."""
        self._radius, self._arm = robot.wheel_radius, 0.5 * robot.track_width
        self._wheels, self._odom = Travel(), odom

    def clear(self) -> None:
        """Discard the motion so far: the robot may have been moved by hand."""
        self._wheels.clear()

    def add_wheels(self, sample: WheelSample) -> None:
        """Add the mean speeds since the sample before."""
        scale = self._radius * self._wheels.elapsed(sample.stamp_ns)
        sides = ([speed for wheel in side if math.isfinite(speed := sample.velocity[wheel])]
                 for side in (LEFT, RIGHT))
        left, right = (scale * (math.fsum(speeds) / len(speeds)) for speeds in sides)
        self._wheels.extend(sample.stamp_ns, 0.5 * (right + left), 0.5 * (right - left))

    def fault(self, max_slip: float) -> str:
        """Return the contradiction; empty if there is none, or no wheels are measured."""
        if min(len(self._wheels.times), len(self._odom.times)) < 2:
            return ''
        end_ns = min(self._wheels.times[-1], self._odom.times[-1])
        begin_ns = max(self._wheels.times[0], self._odom.times[0], end_ns - c.WINDOW_NS)
        if begin_ns >= end_ns:
            return ''
        forward, turned, *_ = self._odom.between(begin_ns, end_ns)
        wheels, odom = self._wheels.between(begin_ns, end_ns), (forward, self._arm * turned)
        if not contradict(wheels, odom, max_slip):
            return ''
        return (f'odom: {self._described(odom)} in {(end_ns - begin_ns) / NS_PER_S:.1f} s, in '
                f'which the wheels rolled {self._described(wheels)}: the robot slides, or odom is '
                f'wrong; expected at most a slip of {max_slip:g} (checks.max_slip)')

    def _described(self, distances: Distances) -> str:
        return f'{distances[0]:.2f} m and {distances[1] / self._arm:.2f} rad'


def contradict(wheels: Distances, odom: Distances, max_slip: float) -> bool:
    """Return whether wheels rolled these distances [m] while odometry moved by the others."""
    # wheels that roll: the component of the motion in their direction. Resistance to turning
    # makes one of drive and turn slip much more than the other.
    forward, turned = wheels
    if abs(turned) > abs(forward):  # one side rolls back
        forward = 0.0
    rolled = math.hypot(forward, turned)
    moved = (forward * odom[0] + turned * odom[1]) / max(rolled, c.MIN_DISTANCE)
    # wheels that stand: on ground of two kinds, one rolling side can turn and move the robot
    most_rolled, most_moved = (sum(map(abs, distances)) for distances in (wheels, odom))
    return (rolled > c.MIN_DISTANCE and moved < (1.0 - max_slip) * rolled
            or most_moved > c.MIN_DISTANCE and most_rolled < (1.0 - max_slip) * most_moved)


def arrival_error(motion: Motion, end: Vector3, arrival: ArrivalParams) -> str:
    """Return how far the robot is from its ``end`` (x, y, yaw or NaN); empty if it is there."""
    x, y, yaw = end
    for name, off, unit, place in (
            ('xy_tolerance', math.hypot(motion.x - x, motion.y - y), 'm', 'end'),
            ('yaw_tolerance', abs(wrap(motion.yaw - yaw)), 'rad', 'yaw at the end')):
        most = c.ARRIVED_SHARE * getattr(arrival, name)
        if off > most:
            return (f'{off:.3f} {unit} from the {place}, expected at most {most:g} {unit} '
                    f'({c.ARRIVED_SHARE:g} of arrival.{name})')
    return ''


class ProgressMonitor:
    """
    Watches the distance from the path, and the progress along it.

    A path that replaces another one does not excuse a robot that does not move: planners renew
    their paths every second.
    """

    def __init__(self) -> None:
        self._waiting_ns: int | None = None
        self._place: Motion | None = None  # at the latest progress, at ``_progress_ns``
        self._progress_ns = 0
        self.renew()

    def renew(self) -> None:
        """Begin with a path that replaces the one before."""
        self._mark: Advance | None = None  # at the latest progress along it
        self._allowed = math.inf  # m, from the path: the robot may begin off it

    def waiting(self, now_ns: int) -> str:
        """Return the reason to stop while there is no odometry yet; empty if there is none."""
        if self._waiting_ns is None:
            self._waiting_ns = now_ns
        if now_ns - self._waiting_ns <= c.MAX_WAIT * NS_PER_S:
            return ''
        return f'odom: none for {c.MAX_WAIT:g} s, expected poses of the robot'

    def check(self, follower: PathFollower, motion: Motion, now_ns: int,
              params: TrajectoryControllerParams) -> str:
        """Return the reason to stop; empty if there is none."""
        return (self._check_error(follower, params)
                or self._check_progress(follower, motion, now_ns, params))

    def _check_error(self, follower: PathFollower, params: TrajectoryControllerParams) -> str:
        if follower.point is None:
            return ''
        error, limit = follower.point.offset(), params.checks.max_cross_track_error
        self._allowed = max(min(self._allowed, error + 0.5 * limit), limit)
        if error <= self._allowed:
            return ''
        return f'{error:.2f} m from the path, expected at most {self._allowed:g} m'

    def _check_progress(self, follower: PathFollower, motion: Motion, now_ns: int,
                        params: TrajectoryControllerParams) -> str:
        now, place = follower.advance(), self._place
        if self._mark is not None:
            advanced = now.exceeds(self._mark)
        else:  # a new path: its begin is no progress
            self._mark = now
            advanced = place is None or abs(wrap(motion.yaw - place.yaw)) > c.MIN_TURN or (
                math.hypot(motion.x - place.x, motion.y - place.y) > c.MIN_ADVANCE)
        if advanced:
            self._mark, self._place, self._progress_ns = now, motion, now_ns
        if now_ns - self._progress_ns <= params.checks.progress_timeout * NS_PER_S:
            return ''
        return (f'no progress for {params.checks.progress_timeout:g} s: blocked, or the wheels do '
                'not turn')
