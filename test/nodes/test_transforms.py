"""The pose on /tf, which exists only where tf2_msgs is installed."""

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
    """The node with a /tf that keeps what is published."""

    def create_publisher(self, cls, name, qos):
        """Return a real publisher, but for /tf."""
        if name != '/tf':
            return super().create_publisher(cls, name, qos)
        self.sent = []
        return SimpleNamespace(publish=self.sent.append)


def test_the_pose_is_a_transform_where_tf_exists(monkeypatch, isolated_ros):
    monkeypatch.setattr(slip_estimator, 'transforms', lambda: SimpleNamespace)
    rclpy.init(args=[])
    try:
        node = Node()
        node.put_out(ODOMETRY)
    finally:
        rclpy.shutdown()
    ((transform,),) = (message.transforms for message in node.sent)
    assert (transform.header.frame_id, transform.child_frame_id) == ('odom', 'base_link')
    assert (transform.header.stamp.sec, transform.header.stamp.nanosec) == (1, 500_000_000)
    assert transform.transform.translation.y == 2.0
    assert transform.transform.rotation.z == 0.6


def test_without_tf2_msgs_there_is_no_tf(monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_msgs', None)
    assert compat.transforms() is None
