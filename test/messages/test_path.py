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

"""Messages of path following: what is read, and what is refused with which field."""

from __future__ import annotations

import math

import pytest
from smart_tire.bags.cdr import empty
from smart_tire.control.trajectory_control import State
from smart_tire.errors import MessageError
from smart_tire.messages.path import (
    goal_from_msg, goal_to_msg, path_from_msg, path_to_msg, progress_from_msg, progress_to_msg,
    STATES)
from smart_tire.samples import GoalPose, NAN, PathProgress, PlannedPath

PATH = PlannedPath(5, 'odom', ((1.0, 2.0, 0.5), (3.0, -4.0, -3.0), (0.0, 0.0, NAN)))


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
    assert path_from_msg(path).poses[0] == pytest.approx((1.0, 2.0, 0.5))
    assert path_from_msg(path).poses[1] == pytest.approx((3.0, -4.0, -3.0))
    assert path_from_msg(path).poses[2][:2] == (0.0, 0.0)
    assert math.isnan(path_from_msg(path).poses[2][2])


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
    assert list(STATES) == [int(state) for state in State]
