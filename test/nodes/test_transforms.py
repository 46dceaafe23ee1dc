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

"""Pose on /tf, published only if tf2_msgs is installed."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest
import rclpy

from smart_tire.nodes import compat, slip_estimator
from smart_tire.samples import Odometry

pytestmark = pytest.mark.processes

ODOMETRY = Odometry(1_500_000_000, (1.0, 2.0, 0.0), (0.0, 0.0, 0.6, 0.8), (0.0, 0.0, 0.0),
                    (0.0, 0.0, 0.0), (0.0,) * 36, (0.0,) * 36)


class Node(slip_estimator.SlipEstimatorNode):
    """The node with a publisher of /tf that stores its messages."""

    def create_publisher(self, cls, name, qos):
        """Return a real publisher except for /tf."""
        if name != '/tf':
            return super().create_publisher(cls, name, qos)
        self.sent = []
        return SimpleNamespace(publish=self.sent.append)


def test_the_pose_is_published_on_tf(monkeypatch, isolated_ros):
    monkeypatch.setattr(slip_estimator, 'transform_class', lambda: SimpleNamespace)
    rclpy.init(args=[])
    try:
        node = Node()
        node.publish_estimate(ODOMETRY)
    finally:
        rclpy.shutdown()
    ((transform,),) = (message.transforms for message in node.sent)
    assert (transform.header.frame_id, transform.child_frame_id) == ('odom', 'base_link')
    assert (transform.header.stamp.sec, transform.header.stamp.nanosec) == (1, 500_000_000)
    assert transform.transform.translation.y == 2.0
    assert transform.transform.rotation.z == 0.6


def test_tf_is_not_published_without_tf2_msgs(monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_msgs', None)
    assert compat.transform_class() is None
