# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Transforms: published, and used for orders in other frames, only if tf2_msgs is installed."""

from __future__ import annotations

import math
import sys
from types import SimpleNamespace
from typing import Any

from hypothesis import given, HealthCheck, settings, strategies as st
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile

from smart_tire.errors import CommandError, LateCommandError, MessageError
from smart_tire.nodes import compat, slip_estimator, transforms
from smart_tire.nodes.diagnostics import InputCounter
from smart_tire.nodes.slip_estimator import SlipEstimatorNode
from smart_tire.nodes.transforms import Transforms
from smart_tire.rotation import quaternion
from smart_tire.samples import GoalPose, Odometry, PlannedPath
from support.virtual_node import virtual

pytestmark = pytest.mark.processes

ODOMETRY = Odometry(1_500_000_000, (1.0, 2.0, 0.0), (0.0, 0.0, 0.6, 0.8), (0.0, 0.0, 0.0),
                    (0.0, 0.0, 0.0), (0.0,) * 36, (0.0,) * 36)


@pytest.fixture
def tf2_msgs(monkeypatch, isolated_ros):
    """Use the message classes that are installed in place of those of tf2_msgs."""
    monkeypatch.setattr(slip_estimator, 'installed_class', lambda _: transforms_class)


def transforms_class(transforms):
    """Return the only transform of a message, which has a type that is installed."""
    (transform,) = transforms
    return transform


def started(*parameters):
    """Return the context of the node with ROS parameters such as ``name:=value``."""
    return virtual(SlipEstimatorNode, *(
        word for parameter in parameters for word in ('-p', parameter)))


def transform_on(node, name):
    """Return the only transform published on ``name``."""
    (transform,) = node.received[name]
    return transform


def test_the_pose_is_published_on_tf(tf2_msgs):
    with started() as node:
        node.publish_estimate(ODOMETRY)
        transform = transform_on(node, '/tf')
    assert (transform.header.frame_id, transform.child_frame_id) == ('odom', 'base_link')
    assert (transform.header.stamp.sec, transform.header.stamp.nanosec) == (1, 500_000_000)
    assert transform.transform.translation.y == 2.0
    assert transform.transform.rotation.z == 0.6


def test_frames_are_named_by_parameters(tf2_msgs):
    with started('odom_frame:=world', 'base_frame:=body', 'frame_prefix:=r1/') as node:
        node.publish_estimate(ODOMETRY)
        pose, imu = (transform_on(node, name) for name in ('/tf', '/tf_static'))
        (odometry,) = node.received['odom']
    for msg in (pose, odometry):
        assert (msg.header.frame_id, msg.child_frame_id) == ('r1/world', 'r1/body')
    assert (imu.header.frame_id, imu.child_frame_id) == ('r1/body', 'r1/imu_link')


def test_the_mounting_of_the_imu_is_published_once_for_late_subscribers(tf2_msgs):
    with started('imu.position:=[0.1, -0.2, 0.3]', f'imu.rotation:=[{math.pi}, 0.0, 0.0]') as node:
        node.publish_estimate(ODOMETRY)
        transform = transform_on(node, '/tf_static')
        assert node.profiles['/tf_static'].durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert (transform.header.frame_id, transform.child_frame_id) == ('base_link', 'imu_link')
    stamp_ns = transform.header.stamp.sec * 10**9 + transform.header.stamp.nanosec
    assert stamp_ns == node.now_ns()
    place, turn = transform.transform.translation, transform.transform.rotation
    assert (place.x, place.y, place.z) == (0.1, -0.2, 0.3)
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((1.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(('parameter', 'left'), [
    ('publish_tf:=false', '/tf_static'), ('publish_imu_tf:=false', '/tf')])
def test_each_transform_is_left_to_other_nodes_on_request(tf2_msgs, parameter, left):
    with started(parameter) as node:
        node.publish_estimate(ODOMETRY)
    assert [name for name in node.received if name.startswith('/tf')] == [left]


def test_nothing_is_published_on_tf_without_tf2_msgs(monkeypatch, isolated_ros):
    monkeypatch.setitem(sys.modules, 'tf2_msgs', None)
    assert compat.installed_class('tf2_msgs/msg/TFMessage') is None
    with started() as node:
        node.publish_estimate(ODOMETRY)
    assert not [name for name in node.received if name.startswith('/tf')]


class Listener:
    """A stand-in of the node that follows orders; its clocks show ``now``."""

    def __init__(self) -> None:
        self.now = 100.0  # s
        self.inputs: dict[str, InputCounter] = {}
        self.profiles: dict[str, QoSProfile] = {}
        self.rejected: list[str] = []
        self.transforms = Transforms(self)

    def create_subscription(self, cls, name, callback, profile):
        """Keep the profile."""
        self.profiles[name] = profile

    def now_ns(self) -> int:
        """Return the time."""
        return round(self.now * 1e9)

    steady_ns = now_ns

    def guarded(self, name, counter, action):
        """Keep the reason of a rejection."""
        try:
            action()
        except MessageError as error:
            self.rejected.append(f'{name}: {error}')
        else:
            counter.accept(self.steady_ns())

    def add(self, parent, child, x, y, yaw, *, tilt=0.0, age=0.0, name='/tf'):
        """Receive a transform."""
        sec, nanosec = divmod(round((self.now - age) * 1e9), 10**9)
        stamp = SimpleNamespace(sec=sec, nanosec=nanosec)
        turn = quaternion(tilt, 0.0, yaw)
        self.transforms.add(name, SimpleNamespace(transforms=[SimpleNamespace(
            header=SimpleNamespace(stamp=stamp, frame_id=parent), child_frame_id=child,
            transform=SimpleNamespace(
                translation=SimpleNamespace(x=x, y=y, z=0.0),
                rotation=SimpleNamespace(**dict(zip('xyzw', turn)))))]))

    def odom(self, frame, *pose):
        """Return a pose of ``frame`` in odom."""
        goal = self.transforms.in_frame('odom', 'goal_pose', GoalPose(1, frame, pose), 2.0)
        assert (goal.stamp_ns, goal.frame) == (1, 'odom')
        return goal.pose


@pytest.fixture
def listener(monkeypatch):
    """Return a node that receives transforms."""
    monkeypatch.setattr(transforms, 'installed_class', lambda _: SimpleNamespace)
    return Listener()


numbers = st.floats(-50.0, 50.0)
places = st.tuples(numbers, numbers, st.floats(-math.pi, math.pi))


def as_matrix(x: float, y: float, yaw: float) -> Any:
    """Return the homogeneous matrix of a pose in the plane."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, x], [sin, cos, y], [0.0, 0.0, 1.0]])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(odom=places, field=places, dock=places, pose=places)
def test_a_pose_is_converted_through_all_frames_up_to_the_common_one(
        listener, odom, field, dock, pose):
    listener.add('earth', 'map', 1.0, 2.0, 3.0)
    listener.add('map', 'odom', *odom)
    listener.add('odom', 'base_link', 3.0, 2.0, 1.0)
    listener.add('map', 'field', *field, name='/tf_static')
    listener.add('field', 'dock', *dock, name='/tf_static')
    expected = np.linalg.inv(as_matrix(*odom)) @ as_matrix(*field) @ as_matrix(
        *dock) @ as_matrix(*pose)
    assert as_matrix(*listener.odom('dock', *pose)) == pytest.approx(expected, abs=1e-9)


def test_a_path_keeps_poses_without_yaw_and_one_in_odom_is_left_as_it_is(listener):
    listener.add('map', 'odom', 1.0, 0.0, math.pi / 2.0)
    path = PlannedPath(7, 'map', ((1.0, 0.0, math.nan), (1.0, 2.0, math.pi / 2.0)))
    found = listener.transforms.in_frame('odom', 'path', path, 2.0)
    assert (found.stamp_ns, found.frame) == (7, 'odom')
    assert np.array(found.poses) == pytest.approx(
        np.array([[0.0, 0.0, math.nan], [2.0, 0.0, 0.0]]), nan_ok=True)
    for frame in ('odom', ''):
        order = PlannedPath(7, frame, ())
        assert listener.transforms.in_frame('odom', 'path', order, 2.0) is order


def test_old_transforms_are_late_but_static_ones_are_not(listener):
    listener.add('map', 'odom', 0.0, 0.0, 0.0)
    listener.add('map', 'dock', 1.0, 0.0, 0.0, name='/tf_static')
    assert listener.odom('dock', 0.0, 0.0, 0.0) == (1.0, 0.0, 0.0)
    listener.now += 2.1
    with pytest.raises(LateCommandError, match='/tf from map to odom: 2.1 s old'):
        listener.odom('dock', 0.0, 0.0, 0.0)
    listener.add('map', 'odom', 0.0, 0.0, 0.0, age=2.1)  # from another clock, or delayed
    with pytest.raises(LateCommandError):
        listener.odom('map', 0.0, 0.0, 0.0)
    listener.add('map', 'odom', 0.0, 0.0, 0.0, age=listener.now)  # a stamp of 0 is not static
    with pytest.raises(LateCommandError):
        listener.odom('map', 0.0, 0.0, 0.0)
    listener.add('map', 'odom', 0.0, 0.0, 0.0, age=-1.0)  # as amcl, which stamps in the future
    assert listener.odom('map', 0.0, 0.0, 0.0) == (0.0, 0.0, 0.0)
    listener.now += 2.1  # amcl has ended
    with pytest.raises(LateCommandError):
        listener.odom('map', 0.0, 0.0, 0.0)


def test_frames_without_connection_are_late_and_loops_end(listener):
    for parent, child in (('map', 'camera'), ('one', 'two'), ('two', 'one'), ('odom', 'odom')):
        listener.add(parent, child, 0.0, 0.0, 0.0)
    for frame in ('map', 'camera', 'one', 'nowhere'):
        with pytest.raises(LateCommandError, match=f"frame '{frame}', expected odom: /tf does"):
            listener.odom(frame, 0.0, 0.0, 0.0)


def test_frames_that_move_with_the_robot_or_are_tilted_are_refused(listener):
    listener.add('odom', 'base_link', 1.0, 0.0, 0.0)
    listener.add('base_link', 'laser', 0.1, 0.0, 0.0)
    for frame in ('base_link', 'laser'):
        with pytest.raises(CommandError, match='or a frame that does not move') as found:
            listener.odom(frame, 1.0, 0.0, 0.0)
        assert not isinstance(found.value, LateCommandError)
    listener.add('map', 'odom', 0.0, 0.0, 0.0, tilt=0.1)
    assert listener.odom('map', 1.0, 0.0, 0.0)[0] == pytest.approx(1.0)
    listener.add('map', 'odom', 0.0, 0.0, 0.0, tilt=0.3)
    with pytest.raises(CommandError, match='tilted'):
        listener.odom('map', 1.0, 0.0, 0.0)


def test_invalid_transforms_are_counted_and_their_number_is_bounded(listener):
    listener.add('map', 'odom', 0.0, 0.0, 0.0)
    listener.add('map', 'odom', math.nan, 0.0, 0.0)
    assert 'transform of odom' in listener.rejected[0]
    for index in range(1010):
        listener.add('map', f'frame {index}', 1.0, 0.0, 0.0)
    assert listener.odom('frame 998', 1.0, 0.0, 0.0)[0] == 2.0
    with pytest.raises(LateCommandError):
        listener.odom('frame 999', 0.0, 0.0, 0.0)
    listener.add('map', 'odom', 1.0, 0.0, 0.0)  # known ones are still renewed
    assert listener.odom('map', 1.0, 0.0, 0.0)[0] == 0.0


def test_static_transforms_of_many_publishers_from_before_are_received(listener):
    static = listener.profiles['/tf_static']
    assert (static.durability, static.depth) == (DurabilityPolicy.TRANSIENT_LOCAL, 100)
    assert listener.profiles['/tf'].depth == 100


def test_orders_are_not_converted_without_tf2_msgs(monkeypatch):
    monkeypatch.setattr(transforms, 'installed_class', lambda _: None)
    order = PlannedPath(0, 'map', ())
    assert Listener().transforms.in_frame('odom', 'path', order, 2.0) is order
