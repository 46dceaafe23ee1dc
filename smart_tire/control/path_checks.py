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

"""Paths and goals that are refused."""

from __future__ import annotations

from itertools import pairwise
import math

from smart_tire.control.motion_monitor import Motion
from smart_tire.control.path_geometry import Maneuver
from smart_tire.errors import CommandError
from smart_tire.parameters.path_following import PathCheckParams
from smart_tire.samples import GoalPose, PlannedPath, Vector3

FRAME = 'odom'
MAX_POSES = 1_000_000
MAX_COORDINATE = 1e5  # m


def check_path(path: PlannedPath, params: PathCheckParams) -> None:
    """Raise CommandError if ``path`` cannot be followed, whereever the robot is."""
    _check_frame('path', path.frame)
    if not 2 <= len(path.poses) <= MAX_POSES:
        raise CommandError(f'path: {len(path.poses)} poses, expected 2 to {MAX_POSES}')
    for number, pose in enumerate(path.poses):
        _check_pose(f'path: pose {number}', pose)
    length = math.fsum(math.dist(one[:2], other[:2]) for one, other in pairwise(path.poses))
    if length > params.max_path_length:
        raise CommandError(f'path: {length:.1f} m long, expected at most '
                           f'{params.max_path_length:g} m (checks.max_path_length)')


def check_goal(goal: GoalPose) -> None:
    """Raise CommandError if ``goal`` is not a valid pose."""
    _check_frame('goal_pose', goal.frame)
    _check_pose('goal_pose', goal.pose)


def check_start(target: PlannedPath | GoalPose, motion: Motion, params: PathCheckParams) -> None:
    """Raise CommandError if a path begins, or a goal is, too far from the robot."""
    if isinstance(target, PlannedPath):
        what, pose, name = 'path: begins', target.poses[0], 'max_start_distance'
    else:
        what, pose, name = 'goal_pose:', target.pose, 'max_path_length'
    distance = math.hypot(pose[0] - motion.x, pose[1] - motion.y)
    limit: float = getattr(params, name)
    if distance > limit:
        raise CommandError(f'{what} {distance:.2f} m from the robot, expected at most '
                           f'{limit:g} m (checks.{name})')


def check_maneuvers(maneuvers: tuple[Maneuver, ...]) -> None:
    """Raise CommandError if there is nothing to drive along a path."""
    if not maneuvers:
        raise CommandError('path: all poses at one position, expected some distance or a yaw')


def _check_frame(what: str, frame: str) -> None:
    if frame != FRAME:
        raise CommandError(f'{what}: frame {frame!r}, expected {FRAME}')


def _check_pose(what: str, pose: Vector3) -> None:
    x, y, yaw = pose
    if not (abs(x) <= MAX_COORDINATE and abs(y) <= MAX_COORDINATE):
        raise CommandError(f'{what}: position ({x:g}, {y:g}) m, expected finite numbers up to '
                           f'{MAX_COORDINATE:g} m')
    if math.isinf(yaw):
        raise CommandError(f'{what}: yaw {yaw:g} rad, expected a finite number, or NaN for any')
