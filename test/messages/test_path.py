# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages of path following: what is read, from messages and bytes, and what is refused."""

from __future__ import annotations

import math
import struct

from hypothesis import given, settings, strategies as st
import pytest
from smart_tire.bags.cdr import empty
from smart_tire.control.trajectory_control import PathState
from smart_tire.errors import MessageError
from smart_tire.messages.path import (
    goal_from_msg, goal_to_msg, path_from_bytes, path_from_msg, path_to_msg, progress_from_msg,
    progress_to_msg, STATES)
from smart_tire.samples import GoalPose, NAN, PathProgress, PlannedPath

LIMIT = 100  # poses
PATH = PlannedPath(1_000_000_005, 'odom', ((1.0, 2.0, 0.5), (3.0, -4.0, -3.0), (0.0, 0.0, NAN)))


@pytest.fixture
def path():
    """Return a valid message with three poses."""
    return path_to_msg(empty('nav_msgs/msg/Path'), PATH)


def orientation(pose):
    """Return the numbers of the quaternion of a pose."""
    rotation = pose.orientation
    return [rotation.x, rotation.y, rotation.z, rotation.w]


def set_orientation(pose, xyzw):
    """Set the quaternion of a pose."""
    rotation = pose.orientation
    rotation.x, rotation.y, rotation.z, rotation.w = xyzw


def test_position_and_yaw_of_each_pose_are_read(path):
    for found, expected in zip(path_from_msg(path).poses, PATH.poses, strict=True):
        assert found == pytest.approx(expected, nan_ok=True)


def test_a_written_path_has_stamp_and_frame_in_each_pose(path):
    assert [(item.header.stamp.nanosec, item.header.frame_id) for item in path.poses] \
        == [(5, 'odom')] * 3
    assert orientation(path.poses[0].pose) == pytest.approx(
        [0.0, 0.0, math.sin(0.25), math.cos(0.25)])
    assert orientation(path.poses[2].pose) == [0.0] * 4
    assert path.poses[1].pose.position.z == 0.0


def test_a_message_is_reused_for_a_path_of_another_length(path):
    one = PlannedPath(6, 'map', ((1.0, 2.0, 0.0),))
    assert path_from_msg(path_to_msg(path, one)) == one
    none = PlannedPath(6, 'map', ())
    assert path_from_msg(path_to_msg(path, none)) == none


def test_the_frame_of_a_pose_may_be_empty_but_not_another(path):
    path.poses[1].header.frame_id = ''
    assert path_from_msg(path).frame == 'odom'
    path.poses[1].header.frame_id = 'map'
    with pytest.raises(MessageError, match=(
            r"^path: poses\[1\].header.frame_id is 'map', expected 'odom' or none$")):
        path_from_msg(path)


@pytest.mark.parametrize('field', ['x', 'y', 'z'])
@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_a_position_that_is_not_finite_is_refused_with_its_index(path, field, value):
    setattr(path.poses[2].pose.position, field, value)
    with pytest.raises(MessageError, match=r'^path: poses\[2\].pose.position is .*finite'):
        path_from_msg(path)


@pytest.mark.parametrize('xyzw', [
    (0.0, 0.0, 0.0, 1.02), (0.0, 0.0, 0.0, 0.98), (math.nan, 0.0, 0.0, 1.0),
    (0.0, 0.0, math.inf, 0.0), (math.nan,) * 4, (0.0, 0.0, 90.0, 0.0)])
def test_an_orientation_that_is_no_unit_quaternion_is_refused(path, xyzw):
    set_orientation(path.poses[1].pose, xyzw)
    with pytest.raises(MessageError, match=r'^path: poses\[1\].pose.orientation is .* unit'):
        path_from_msg(path)
    goal = goal_to_msg(empty('geometry_msgs/msg/PoseStamped'), GoalPose(1, 'odom', (0., 0., 0.)))
    set_orientation(goal.pose, xyzw)
    with pytest.raises(MessageError, match='^goal_pose: pose.orientation is .* unit'):
        goal_from_msg(goal)


@pytest.mark.parametrize('norm', [0.991, 1.009])
def test_a_rounded_quaternion_is_normalized(path, norm):
    rotation = (0.0, 0.0, math.sin(0.25) * norm, math.cos(0.25) * norm)
    set_orientation(path.poses[1].pose, rotation)
    assert path_from_msg(path).poses[1][2] == pytest.approx(0.5, abs=1e-9)


def progress(**fields):
    """Return a message of the progress, changed by ``fields``."""
    msg = progress_to_msg(empty('sensor_msgs/msg/JointState'), PathProgress(7, 2.5, -0.5, 3))
    vars(msg).update(fields)
    return msg


def test_the_progress_is_found_by_name_in_any_order_among_other_quantities():
    msg = progress(name=['state', 'speed', 'cross_track_error', 'remaining_distance'],
                   position=[2.0, 9.0, -0.5, 2.5])
    assert progress_from_msg(msg) == PathProgress(7, 2.5, -0.5, 2)
    assert progress().header.frame_id == 'odom'


def test_the_distances_may_be_nan():
    read = progress_from_msg(progress(position=[math.nan, math.nan, 0.0]))
    assert math.isnan(read.remaining_distance) and math.isnan(read.cross_track_error)


@pytest.mark.parametrize('fields', [
    {'name': ['state', 'remaining_distance', 'other']}, {'position': [1.0, 2.0]},
    {'name': ['state', 'state', 'remaining_distance', 'cross_track_error'], 'position': [1.0] * 4},
    {'position': [1.0, 0.0, math.nan]}, {'position': [1.0, 0.0, 0.5]},
    {'position': [1.0, 0.0, 5.0]}, {'position': [1.0, 0.0, -1.0]},
    {'position': [math.inf, 0.0, 1.0]}, {'position': [1.0, -math.inf, 1.0]}])
def test_an_invalid_progress_is_refused(fields):
    with pytest.raises(MessageError, match='^path_progress: '):
        progress_from_msg(progress(**fields))


def test_the_states_are_those_of_the_controller():
    assert list(STATES) == [int(state) for state in PathState]


def serialized(poses=PATH.poses, frame='odom', order='<', count=None):
    """Return a Path as CDR, written from the specification."""
    body = b''

    def align(size):
        return bytes(-len(body) % size)

    def header(text):
        data = text.encode() + b'\0'
        return align(4) + struct.pack(order + 'iII', 1, 5, len(data)) + data

    body += header(frame)
    body += align(4) + struct.pack(order + 'I', len(poses) if count is None else count)
    for x, y, yaw in poses:
        body += header(frame)
        turn = (0.0, 0.0) if math.isnan(yaw) else (math.sin(0.5 * yaw), math.cos(0.5 * yaw))
        body += align(8) + struct.pack(order + '7d', x, y, 0.0, 0.0, 0.0, *turn)
    return {'<': b'\0\1\0\0', '>': b'\0\0\0\0'}[order] + body


@pytest.mark.parametrize('order', '<>')
@pytest.mark.parametrize('frame', ['', 'odom', 'a_map', 'robot/odom'])
def test_a_path_is_read_in_both_byte_orders_with_any_alignment(order, frame):
    path = path_from_bytes(serialized(order=order, frame=frame), LIMIT)
    assert (path.stamp_ns, path.frame) == (1_000_000_005, frame)
    for found, expected in zip(path.poses, PATH.poses, strict=True):
        assert found == pytest.approx(expected, nan_ok=True)


def test_the_bytes_of_ros_are_read():
    serialization = pytest.importorskip('rclpy.serialization')
    from smart_tire.nodes.compat import message_class
    message = path_to_msg(message_class('nav_msgs/msg/Path')(), PATH)
    data = serialization.serialize_message(message)
    assert repr(path_from_bytes(data, 3)) == repr(path_from_bytes(serialized(), 3))


@pytest.mark.parametrize('count', [LIMIT + 1, 20_000, 2**32 - 1])
def test_too_many_poses_are_refused_by_their_number_before_they_are_read(count):
    with pytest.raises(MessageError, match=rf'path: {count} poses, expected at most 100 '):
        path_from_bytes(serialized(count=count), LIMIT)


def test_a_field_that_is_not_allowed_is_named():
    with pytest.raises(MessageError, match=r'poses\[1\].pose.position is \[nan'):
        path_from_bytes(serialized(((0.0, 0.0, 0.0), (NAN, 0.0, 0.0))), LIMIT)


def test_every_truncation_is_refused():
    data = serialized()
    for size in range(len(data)):
        with pytest.raises(MessageError, match='path: '):
            path_from_bytes(data[:size], LIMIT)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.lists(st.tuples(st.integers(0, len(serialized()) - 1), st.integers(0, 255)),
                min_size=1, max_size=4))
def test_damaged_bytes_give_a_path_or_are_refused(changes):
    damaged = bytearray(serialized())
    for index, byte in changes:
        damaged[index] = byte
    try:
        assert len(path_from_bytes(bytes(damaged), LIMIT).poses) <= LIMIT
    except MessageError as error:
        assert str(error).startswith('path: ')


@pytest.mark.parametrize('data', [b'', b'\0', b'\0\7\0\0' + bytes(100), b'garbage' * 100])
def test_other_encapsulations_are_refused(data):
    with pytest.raises(MessageError, match='path: begins with .*, expected 00 00 or 00 01'):
        path_from_bytes(data, LIMIT)
