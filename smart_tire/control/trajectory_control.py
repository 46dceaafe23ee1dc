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

"""Upper level of the control: follows a path with commands of the body velocity."""

from __future__ import annotations

from enum import IntEnum
import math

from smart_tire.errors import CommandError
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.samples import (
    Friction, GoalPose, NAN, Odometry, PathProgress, PlannedPath, VelocityCommand, WheelSlip)


class State(IntEnum):
    """State of the controller, as in ``path_progress``."""

    IDLE = 0
    FOLLOWING = 1
    ARRIVED = 2
    STOPPED = 3
    REFUSED = 4


class TrajectoryControl:
    """
    Follows one path or drives to one goal; all times are nanoseconds of the message clock.

    ``reason`` is the text for the present state: why it was stopped or refused.
    """

    def __init__(self, params: TrajectoryControllerParams) -> None:
        self.params = params  # may be replaced at run time
        self.state = State.IDLE
        self.reason = ''
        self._path: PlannedPath | None = None
        self._index = 0
        self._odometry: Odometry | None = None

    def set_path(self, path: PlannedPath, now_ns: int) -> None:
        """Follow ``path`` from now on; the state is REFUSED, with the reason, if it is invalid."""
        try:
            self._accept(path)
        except CommandError as error:
            self.state, self.reason, self._path = State.REFUSED, str(error), None

    def set_goal(self, goal: GoalPose, now_ns: int) -> None:
        """Drive to ``goal`` from now on; the state is REFUSED if it is invalid."""
        self.set_path(PlannedPath(goal.stamp_ns, goal.frame, (goal.pose,)), now_ns)

    def cancel(self, reason: str) -> None:
        """Stop following; nothing happens if no path is followed."""
        if self.state == State.FOLLOWING:
            self.state, self.reason, self._path = State.STOPPED, reason, None

    def update_odometry(self, odometry: Odometry, now_ns: int) -> None:
        """Add the latest pose and velocity."""
        self._odometry = odometry

    def update_slip(self, slip: WheelSlip) -> None:
        """Add the latest slips of the wheels."""

    def update_friction(self, friction: Friction) -> None:
        """Add the friction of one patch crossing."""

    def step(self, now_ns: int) -> VelocityCommand | None:
        """
        Return the next ``cmd_vel``; None if nothing is to be published.

        After following has ended, the first result is a command of zero, then None.
        """
        if self._path is None or self._odometry is None:
            return None
        x, y, _ = self._odometry.position
        q = self._odometry.orientation
        yaw = math.atan2(2.0 * q[3] * q[2], 1.0 - 2.0 * q[2] ** 2)
        poses = self._path.poses
        while (self._index < len(poses) - 1
               and math.hypot(poses[self._index][0] - x, poses[self._index][1] - y) < 0.3):
            self._index += 1
        to_x, to_y, _ = poses[self._index]
        distance = math.hypot(to_x - x, to_y - y)
        if self._index == len(poses) - 1 and distance < 0.05:
            self.state, self._path = State.ARRIVED, None
            return VelocityCommand(now_ns, 0.0, 0.0)
        error = math.remainder(math.atan2(to_y - y, to_x - x) - yaw, math.tau)
        if abs(error) > 1.0:
            return VelocityCommand(now_ns, 0.0, math.copysign(0.8, error))
        speed = min(self.params.max_speed, distance + 0.05)
        return VelocityCommand(now_ns, speed, 2.0 * speed * math.sin(error) / distance)

    def progress(self, now_ns: int) -> PathProgress:
        """Return the progress for ``path_progress``."""
        return PathProgress(now_ns, NAN, NAN, int(self.state))

    def _accept(self, path: PlannedPath) -> None:
        if path.frame != 'odom':
            raise CommandError(f'path: frame {path.frame!r}, expected odom')
        if not path.poses:
            raise CommandError('path: no poses')
        self._path, self._index, self.state, self.reason = path, 0, State.FOLLOWING, ''
