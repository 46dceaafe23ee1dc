"""
A process that subscribes as ``ros2 bag record`` does by default: reliable, keep-last 10.

``python -m support.keep_last COUNT`` ends, with status 0, when the last COUNT samples of each
wheel came without a gap of more than one and a half sampling periods, in their order.
"""

from __future__ import annotations

from collections import Counter
import sys

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

DEPTH = 10             # of rclpy's and rosbag2's default profile
LONGEST = 3_750_000    # ns from one stamp to the next one, at 400 Hz


def main(count: int) -> None:
    """Listen until nothing was lost for long enough."""
    rclpy.init()
    node, executor = rclpy.create_node('keep_last'), SingleThreadedExecutor()
    latest: dict[str, int] = {}
    unbroken: Counter[str] = Counter()  # samples since the latest gap, by wheel

    def on_sample(message: JointState) -> None:
        wheel, stamp = message.header.frame_id, message.header.stamp
        stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
        whole = 0 < stamp_ns - latest.get(wheel, stamp_ns - 1) <= LONGEST
        unbroken[wheel] = unbroken[wheel] + 1 if whole else 1
        latest[wheel] = stamp_ns

    node.create_subscription(JointState, 'tire_samples', on_sample, QoSProfile(depth=DEPTH))
    executor.add_node(node)
    while not unbroken or min(unbroken.values()) < count:
        executor.spin_once()
    rclpy.shutdown()


if __name__ == '__main__':
    main(int(sys.argv[1]))
