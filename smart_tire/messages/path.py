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
Messages of path following: the path, the goal and the progress.

A path is also read from the bytes of a serialized message, whose number of poses is read first:
rclpy converts all poses of a message, at 20 us each, before it can be refused.
"""

from __future__ import annotations

from importlib import import_module
from math import atan2, cos, hypot, isinf, isnan, sin
import re
import struct
from types import SimpleNamespace
from typing import Any

from smart_tire.errors import MessageError
from smart_tire.messages.cdr import CdrReader
from smart_tire.messages.header import (
    bounded, checked_frame, finite, names_of, not_finite_error, set_header, set_joints, stamp_of)
from smart_tire.samples import GoalPose, MAX_POSITION, NAN, PathProgress, PlannedPath, Vector3

PROGRESS_NAMES = ('remaining_distance', 'cross_track_error', 'state')
STATES = range(5)           # of ``path_progress``: idle, following, arrived, stopped, refused
QUATERNION_TOLERANCE = 0.01  # of the norm; planners publish single precision or rounded values
MIN_COS_TILT = 0.98  # 11 degrees: paths are plane


def path_from_msg(msg: Any) -> PlannedPath:
    """Return the path in a Path; the frame of each pose is that of the path, or empty."""
    frame = checked_frame(msg.header.frame_id, 'path')
    return PlannedPath(stamp_of(msg), frame, tuple(
        _pose_in(frame, item, index) for index, item in enumerate(msg.poses)))


def _pose_in(frame: str, item: Any, index: int) -> Vector3:
    if item.header.frame_id not in ('', frame):
        raise MessageError(f'path: poses[{index}].header.frame_id is '
                           f'{item.header.frame_id!r}, expected {frame!r} or none')
    return _pose(item.pose, 'path', f'poses[{index}].pose')


def path_to_msg(msg: Any, sample: PlannedPath) -> Any:
    """Write ``sample`` into a Path and return it."""
    set_header(msg, sample.stamp_ns, sample.frame)
    msg.poses = [_set_pose(item, sample.stamp_ns, sample.frame, pose)
                 for item, pose in zip(_new_poses(msg, len(sample.poses)), sample.poses)]
    return msg


def goal_from_msg(msg: Any) -> GoalPose:
    """Return the goal in a PoseStamped."""
    return GoalPose(stamp_of(msg), checked_frame(msg.header.frame_id, 'goal_pose'),
                    _pose(msg.pose, 'goal_pose', 'pose'))


def goal_to_msg(msg: Any, sample: GoalPose) -> Any:
    """Write ``sample`` into a PoseStamped and return it."""
    return _set_pose(msg, sample.stamp_ns, sample.frame, sample.pose)


def transform_from_msg(msg: Any) -> Vector3:
    """Return x, y [m] and yaw [rad] of a TransformStamped; yaw is NaN if its frame is tilted."""
    pose = SimpleNamespace(position=msg.transform.translation, orientation=msg.transform.rotation)
    for frame in (msg.header.frame_id, msg.child_frame_id):
        checked_frame(frame, 'transform')
    x, y, yaw = _pose(pose, f'transform of {msg.child_frame_id}', 'transform')
    rotation = pose.orientation
    cos_tilt = 1.0 - 2.0 * (rotation.x**2 + rotation.y**2)
    return x, y, yaw if cos_tilt > MIN_COS_TILT else NAN


def progress_from_msg(msg: Any) -> PathProgress:
    """Return the progress in a JointState; a distance may be NaN."""
    names = names_of(msg, 'path_progress')
    numbers = dict(zip(names, msg.position))
    if any(names.count(name) != 1 for name in PROGRESS_NAMES):
        raise MessageError(f'path_progress: name is {list(names)}, '
                           f'expected each of {", ".join(PROGRESS_NAMES)} once')
    if len(msg.position) != len(names):
        raise MessageError(f'path_progress: position has {len(msg.position)} numbers, '
                           f'expected one for each of {len(names)} names')
    remaining, error, state = (float(numbers[name]) for name in PROGRESS_NAMES)
    if isinf(remaining) or isinf(error):
        raise not_finite_error('path_progress', 'position', msg.position)
    if state not in STATES:
        raise MessageError(f'path_progress: state is {state:g}, expected 0 to {STATES[-1]}')
    return PathProgress(stamp_of(msg), remaining, error, int(state))


def progress_to_msg(msg: Any, sample: PathProgress) -> Any:
    """Write ``sample`` into a JointState and return it."""
    return set_joints(msg, sample.stamp_ns, 'odom', PROGRESS_NAMES, position=(
        sample.remaining_distance, sample.cross_track_error, float(sample.state)))


def _pose(pose: Any, topic: str, field: str) -> Vector3:
    """Return x, y and yaw of a Pose; yaw is NaN if the quaternion is all zero."""
    position = bounded(topic, f'{field}.position', finite(topic, f'{field}.position', (
        pose.position.x, pose.position.y, pose.position.z)), MAX_POSITION, 'm')
    given = pose.orientation
    xyzw = given.x, given.y, given.z, given.w
    norm = hypot(*xyzw)
    if norm == 0.0:
        return position[0], position[1], NAN
    if not abs(norm - 1.0) <= QUATERNION_TOLERANCE:  # also if a number is not finite
        raise MessageError(f'{topic}: {field}.orientation is {list(xyzw)}, expected a unit '
                           'quaternion, or zeros for no orientation')
    x, y, z, w = (number / norm for number in xyzw)
    return position[0], position[1], atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _set_pose(msg: Any, stamp_ns: int, frame: str, pose: Vector3) -> Any:
    """Write a pose into a PoseStamped and return it."""
    set_header(msg, stamp_ns, frame)
    x, y, yaw = pose
    position, rotation = msg.pose.position, msg.pose.orientation
    position.x, position.y, position.z = x, y, 0.0
    rotation.x, rotation.y, rotation.z, rotation.w = (
        (0.0,) * 4 if isnan(yaw) else (0.0, 0.0, sin(0.5 * yaw), cos(0.5 * yaw)))
    return msg


def _new_poses(msg: Any, count: int) -> list[Any]:
    """Return new elements of ``msg.poses``: rclpy accepts those of its own class only."""
    fields = getattr(msg, 'get_fields_and_field_types', None)
    if fields is None:
        return [_empty_pose() for _ in range(count)]
    found = re.fullmatch(r'sequence<(\w+)/(\w+)>', fields()['poses'])
    assert found is not None, 'poses of a Path are a sequence of messages'
    cls = getattr(import_module(f'{found[1]}.msg'), found[2])
    return [cls() for _ in range(count)]


def _empty_pose() -> SimpleNamespace:
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id=''),
        pose=SimpleNamespace(position=SimpleNamespace(), orientation=SimpleNamespace()))


def check_pose_count(count: int, max_poses: int) -> None:
    """Raise MessageError for a path of too many poses."""
    if count > max_poses:
        raise MessageError(f'path: {count} poses, expected at most {max_poses} '
                           '(checks.max_path_poses)')


def path_from_bytes(data: bytes, max_poses: int) -> PlannedPath:
    """Return the path in a serialized Path; raise MessageError if it has too many poses."""
    reader = CdrReader(data, 'path')
    try:
        header, count = reader.header(), reader.count()
        check_pose_count(count, max_poses)
        return path_from_msg(SimpleNamespace(
            header=header, poses=(_stamped_pose(reader) for _ in range(count))))
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f'path: {len(data)} bytes are no nav_msgs/Path: {error}') from error


def _stamped_pose(reader: CdrReader) -> SimpleNamespace:
    """Return the next PoseStamped of a serialized Path."""
    header = reader.header()
    p_x, p_y, p_z, q_x, q_y, q_z, q_w = reader.numbers('7d', 8)
    return SimpleNamespace(header=header, pose=SimpleNamespace(
        position=SimpleNamespace(x=p_x, y=p_y, z=p_z),
        orientation=SimpleNamespace(x=q_x, y=q_y, z=q_z, w=q_w)))
