# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Poses on /tf and /tf_static, published only if tf2_msgs is installed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
import math
import sys
from types import SimpleNamespace

from nav_msgs.msg import Odometry as OdometryMsg
import pytest
import rclpy
from rclpy.qos import DurabilityPolicy

from smart_tire.messages import TOPICS
from smart_tire.nodes import compat, slip_estimator
from smart_tire.samples import Odometry

pytestmark = pytest.mark.processes

ODOMETRY = Odometry(1_500_000_000, (1.0, 2.0, 0.0), (0.0, 0.0, 0.6, 0.8), (0.0, 0.0, 0.0),
                    (0.0, 0.0, 0.0), (0.0,) * 36, (0.0,) * 36)


class Node(slip_estimator.SlipEstimatorNode):
    """The node with publishers of transforms that store their messages, with their profile."""

    def create_publisher(self, cls, name, qos):
        """Return a real publisher except for /tf and /tf_static."""
        if not name.startswith('/tf'):
            return super().create_publisher(cls, name, qos)
        if not hasattr(self, 'sent'):
            self.sent, self.profiles = defaultdict(list), {}
        self.profiles[name] = qos
        return SimpleNamespace(publish=self.sent[name].append)


@contextmanager
def started(*parameters: str) -> Iterator[Node]:
    """Yield the node with ROS parameters such as ``name:=value``."""
    words = [word for parameter in parameters for word in ('-p', parameter)]
    rclpy.init(args=['--ros-args', *words])
    try:
        yield Node()
    finally:
        rclpy.shutdown()


@pytest.fixture
def tf2_msgs(monkeypatch, isolated_ros):
    """Replace the message class of tf2_msgs by a stand-in."""
    monkeypatch.setattr(slip_estimator, 'transform_class', lambda: SimpleNamespace)


def only_transform(messages):
    """Return the transform of the only message."""
    ((transform,),) = (message.transforms for message in messages)
    return transform


def test_the_pose_is_published_on_tf(tf2_msgs):
    with started() as node:
        node.publish_estimate(ODOMETRY)
        transform = only_transform(node.sent['/tf'])
    assert (transform.header.frame_id, transform.child_frame_id) == ('odom', 'base_link')
    assert (transform.header.stamp.sec, transform.header.stamp.nanosec) == (1, 500_000_000)
    assert transform.transform.translation.y == 2.0
    assert transform.transform.rotation.z == 0.6


def test_frames_are_named_by_parameters(tf2_msgs):
    with started('odom_frame:=world', 'base_frame:=body', 'frame_prefix:=r1/') as node:
        node.publish_estimate(ODOMETRY)
        pose, imu = (only_transform(node.sent[name]) for name in ('/tf', '/tf_static'))
        odometry = node.in_frames(TOPICS['odom'].to_msg)(OdometryMsg(), ODOMETRY)
    for msg in (pose, odometry):
        assert (msg.header.frame_id, msg.child_frame_id) == ('r1/world', 'r1/body')
    assert (imu.header.frame_id, imu.child_frame_id) == ('r1/body', 'r1/imu_link')


def test_the_pose_is_not_published_on_tf_on_request(tf2_msgs):
    with started('publish_tf:=false') as node:
        node.publish_estimate(ODOMETRY)
    assert node.sent.keys() == {'/tf_static'}


def test_the_mounting_of_the_imu_is_published_once_for_late_subscribers(tf2_msgs):
    with started('imu.position:=[0.1, -0.2, 0.3]', f'imu.rotation:=[{math.pi}, 0.0, 0.0]') as node:
        before_ns = node.now_ns()
        node.publish_estimate(ODOMETRY)
        transform = only_transform(node.sent['/tf_static'])
        assert node.profiles['/tf_static'].durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert (transform.header.frame_id, transform.child_frame_id) == ('base_link', 'imu_link')
    stamp_ns = transform.header.stamp.sec * 10**9 + transform.header.stamp.nanosec
    assert 0 < stamp_ns <= before_ns
    place, turn = transform.transform.translation, transform.transform.rotation
    assert (place.x, place.y, place.z) == (0.1, -0.2, 0.3)
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((1.0, 0.0, 0.0, 0.0))


def test_the_mounting_of_the_imu_is_left_to_robot_state_publisher_on_request(tf2_msgs):
    with started('publish_imu_tf:=false') as node:
        node.publish_estimate(ODOMETRY)
    assert node.sent.keys() == {'/tf'}


def test_nothing_is_published_on_tf_without_tf2_msgs(monkeypatch, isolated_ros):
    monkeypatch.setitem(sys.modules, 'tf2_msgs', None)
    assert compat.transform_class() is None
    with started() as node:
        node.publish_estimate(ODOMETRY)
    assert not hasattr(node, 'sent')
