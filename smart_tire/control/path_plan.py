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
Poses of a path to maneuvers: segments without stop, and turns in place.

The path is split at corners sharper than ``corner_angle`` (so also at cusps), where the direction
of travel changes, and where two poses have the same position and different yaw, which is a turn
in place. Orientations count as given if the yaw of the poses agrees, modulo pi, with the path
within ``YAW_AGREEMENT`` on ``MIN_AGREEING_SHARE`` of its length; where they agree modulo 2 pi the
robot drives forward, else in reverse, and the last yaw is that of arrival. Otherwise (yaw NaN,
or the same yaw everywhere on a path that is not straight, as in messages with the identity for
all orientations) the robot drives forward and arrives with the direction of the path.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.control import constants as c
from smart_tire.control.ground_motion import Motion, wrap
from smart_tire.control.path_geometry import FORWARD, Maneuver, REVERSE, Segment, Spin
from smart_tire.errors import CommandError
from smart_tire.parameters.path_following import ArrivalParams, PathCheckParams
from smart_tire.rotation import wrapped
from smart_tire.samples import GoalPose, PlannedPath, Vector3


def plan_path(poses: Sequence[Vector3], corner_angle: float) -> tuple[Maneuver, ...]:
    """
    Return the maneuvers along ``poses`` (x [m], y [m], yaw [rad], NaN: not given).

    They are not all at one position. ``corner_angle`` [rad] is the sharpest corner that is driven
    without stop.
    """
    points, spins = _distinct(poses)
    directions = _directions(points)
    if directions is None:
        spins, directions = {}, np.full(len(points) - 1, FORWARD)
        final = math.nan
    else:
        final = spins.pop(len(points) - 1, float(points[-1, 2]))
    ends = _split(points, directions, spins, corner_angle)
    maneuvers: list[Maneuver] = [Spin(spins[0])] if 0 in spins else []
    for first, last in zip(ends, ends[1:]):
        part = points[first:last + 1]
        maneuvers.append(Segment(part[:, 0], part[:, 1], int(directions[first])))
        if last in spins:
            maneuvers.append(Spin(spins[last]))
    return (*maneuvers, *([] if math.isnan(final) else [Spin(final)]))


def plan_goal(start: Motion, goal: Vector3, arrival: ArrivalParams) -> tuple[Maneuver, ...]:
    """
    Return the maneuvers from ``start`` to ``goal`` (x [m], y [m], yaw [rad]): straight, then turn.

    A goal behind within ``reverse_distance`` is reached in reverse. There is no way to drive if
    the robot would arrive where it is. A yaw of NaN is any.
    """
    x, y, yaw = goal
    distance = math.hypot(x - start.x, y - start.y)
    bearing = wrap(math.atan2(y - start.y, x - start.x) - start.yaw)
    maneuvers: list[Maneuver] = [] if math.isnan(yaw) else [Spin(yaw)]
    if distance > c.ARRIVED_SHARE * arrival.xy_tolerance:
        behind = abs(bearing) > 0.5 * math.pi and distance <= arrival.reverse_distance
        maneuvers.insert(0, Segment(np.array([start.x, x]), np.array([start.y, y]),
                                    REVERSE if behind else FORWARD))
    return tuple(maneuvers)


def _distinct(poses: Sequence[Vector3]) -> tuple[Array, dict[int, float]]:
    """Return the poses at distinct positions (n, 3), and the yaw of turns in place by index."""
    kept = [poses[0]]
    spins: dict[int, float] = {}
    for pose in poses[1:]:
        if math.hypot(pose[0] - kept[-1][0], pose[1] - kept[-1][1]) >= c.MIN_SPACING:
            kept.append(pose)
        elif (abs(wrap(pose[2] - kept[-1][2])) > c.MIN_SPIN
              or len(kept) - 1 in spins and not math.isnan(pose[2])):
            spins[len(kept) - 1] = pose[2]
    if len(kept) > 1 and len(kept) - 1 not in spins:
        kept[-1] = poses[-1]
    return np.array(kept, dtype=np.float64), spins


def _directions(points: Array) -> Array | None:
    """Return FORWARD or REVERSE (n-1,) of each edge; None if orientations are not given."""
    dx, dy, yaw = np.diff(points[:, 0]), np.diff(points[:, 1]), points[:, 2]
    heading, lengths = np.arctan2(dy, dx), np.hypot(dx, dy)
    ends = np.cos(np.stack([yaw[:-1] - heading, yaw[1:] - heading]))
    agreement = np.where(np.abs(ends[0]) >= np.abs(ends[1]), ends[0], ends[1])
    agrees = np.abs(agreement) >= math.cos(c.YAW_AGREEMENT)
    if lengths[agrees].sum() < c.MIN_AGREEING_SHARE * lengths.sum():
        return None
    if np.ptp(yaw) == 0.0 and not agrees.all():
        return None
    # an edge that does not agree has the direction of the last one that does
    known = np.maximum.accumulate(np.where(agrees, np.arange(agrees.size), -1))
    known[known < 0] = int(np.argmax(agrees))
    directions: Array = np.where(agreement[known] > 0.0, FORWARD, REVERSE)
    return directions


def _split(points: Array, directions: Array, spins: dict[int, float],
           corner_angle: float) -> list[int]:
    """Return the indices of the points at which segments begin and end."""
    changes = (np.flatnonzero(np.diff(directions)) + 1).tolist()
    ends = sorted({0, len(points) - 1, *spins, *changes})
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T))])
    # noise next to an end, or a cusp found one point too late, is not a segment of its own
    corners = [corner for corner in _corners(points, arc, corner_angle)
               if np.abs(arc[ends] - arc[corner]).min() >= c.CHORD_LENGTH]
    return sorted([*ends, *corners])


def _corners(points: Array, arc: Array, corner_angle: float) -> list[int]:
    """Return the indices of corners sharper than ``corner_angle`` [rad]."""
    x, y = points[:, 0], points[:, 1]
    inner = arc[1:-1]
    # chords of dense points are longer than their edges; those of coarse ones are the edges
    before, after = inner - c.CHORD_LENGTH, inner + c.CHORD_LENGTH
    into = np.arctan2(y[1:-1] - np.interp(before, arc, y), x[1:-1] - np.interp(before, arc, x))
    out = np.arctan2(np.interp(after, arc, y) - y[1:-1], np.interp(after, arc, x) - x[1:-1])
    turn = np.abs(wrapped(out - into))
    return _peaks(turn, inner, corner_angle)


def _peaks(turn: Array, arc: Array, limit: float) -> list[int]:
    """Return the indices of points (inner ones from 1 on) with the largest turn of each run."""
    corners: list[int] = []
    for index in np.flatnonzero(turn > limit).tolist():
        if corners and arc[index] - arc[corners[-1] - 1] < c.CHORD_LENGTH:
            if turn[index] > turn[corners[-1] - 1]:
                corners[-1] = index + 1
        else:
            corners.append(index + 1)
    return corners


def checked(target: PlannedPath | GoalPose, params: PathCheckParams, frame: str
            ) -> PlannedPath | GoalPose:
    """
    Return ``target``, and the goal in a path whose poses are all at one position.

    nav2's planners send such a path where the robot and its goal share a cell. Its yaw is the last
    one given. Raise CommandError if ``target`` is not in ``frame``, or can be followed from
    nowhere.
    """
    if isinstance(target, GoalPose):
        _check_frame('goal_pose', target.frame, frame)
        _check_pose('goal_pose', target.pose)
        return target
    poses = target.poses
    _check_frame('path', target.frame, frame)
    if not 1 <= len(poses) <= params.max_path_poses:
        raise CommandError(f'path: {len(poses)} poses, expected 1 to {params.max_path_poses}')
    for number, pose in enumerate(poses):
        _check_pose(f'path: pose {number}', pose)
    length = math.fsum(math.dist(one[:2], other[:2]) for one, other in pairwise(poses))
    if length > params.max_path_length:
        raise CommandError(f'path: {length:.1f} m long, expected at most '
                           f'{params.max_path_length:g} m (checks.max_path_length)')
    (x, y, _), yaws = poses[0], [pose[2] for pose in poses if not math.isnan(pose[2])]
    if any(math.dist(pose[:2], (x, y)) >= c.MIN_SPACING for pose in poses):
        return target
    return GoalPose(target.stamp_ns, target.frame, (x, y, yaws[-1] if yaws else math.nan))


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


def _check_frame(what: str, given: str, frame: str) -> None:
    if given != frame:
        raise CommandError(f'{what}: frame {given!r}, expected {frame}')


def _check_pose(what: str, pose: Vector3) -> None:
    x, y, yaw = pose
    if not (math.isfinite(x) and math.isfinite(y)):
        raise CommandError(f'{what}: position ({x:g}, {y:g}) m, expected finite numbers')
    if math.isinf(yaw):
        raise CommandError(f'{what}: yaw {yaw:g} rad, expected a finite number, or NaN for any')
