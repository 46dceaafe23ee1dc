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
Subscribes as ``ros2 bag record`` does by default: reliable, keep last 10.

``python -m support.keep_last COUNT`` ends with status 0 when COUNT consecutive samples of each
wheel have arrived in order, without a gap above 1.5 sampling periods.
"""

from __future__ import annotations

from collections import Counter
import sys

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

DEPTH = 10             # of rclpy's and rosbag2's default profile
MAX_GAP_NS = 3_750_000  # between timestamps, 1.5 sampling periods at 400 Hz


def main(count: int) -> None:
    """Receive until ``count`` consecutive samples of each wheel were complete."""
    rclpy.init()
    node, executor = rclpy.create_node('keep_last'), SingleThreadedExecutor()
    latest: dict[str, int] = {}
    complete: Counter[str] = Counter()  # wheel -> samples since the latest gap

    def on_sample(message: JointState) -> None:
        wheel, stamp = message.header.frame_id, message.header.stamp
        stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
        continuous = 0 < stamp_ns - latest.get(wheel, stamp_ns - 1) <= MAX_GAP_NS
        complete[wheel] = complete[wheel] + 1 if continuous else 1
        latest[wheel] = stamp_ns

    node.create_subscription(JointState, 'tire_samples', on_sample, QoSProfile(depth=DEPTH))
    executor.add_node(node)
    while not complete or min(complete.values()) < count:
        executor.spin_once()
    rclpy.shutdown()


if __name__ == '__main__':
    main(int(sys.argv[1]))
