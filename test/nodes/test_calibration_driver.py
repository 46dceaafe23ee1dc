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

"""Calibration driver: commands only after it is enabled, none after an emergency stop."""

from __future__ import annotations

import pytest
from smart_tire.messages import TOPICS
from smart_tire.nodes.calibration_driver import CalibrationDriver
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.qos import latched, subscriber_qos
from smart_tire.nodes.runner import NodeRunner
from std_msgs.msg import Bool

pytestmark = pytest.mark.processes
MAX_SPINS = 300  # of 0.1 s


def spin_until(runner, condition):
    for _ in range(MAX_SPINS):
        if condition():
            return
        runner.spin(0.1)
    raise AssertionError('the condition was not met in time')


def test_commands_start_with_enable_and_end_with_the_emergency_stop(isolated_ros):
    speeds = []
    with NodeRunner(lambda: CalibrationDriver(lambda sample: None), []) as runner:
        node, topic = runner.node, TOPICS['cmd_vel']
        node.create_subscription(message_class(topic.type), 'cmd_vel', lambda msg: speeds.append(
            topic.from_msg(msg).v_x), subscriber_qos('cmd_vel'))
        stop = node.create_publisher(Bool, 'emergency_stop_active', latched())
        spin_until(runner, node.controlled)
        assert node.count_publishers('cmd_vel') == 0
        node.drive(60.0, 60.0)
        runner.spin(0.2)
        assert not speeds and node.count_publishers('cmd_vel') == 0
        node.enable()
        spin_until(runner, lambda: len(speeds) > 3)
        assert max(speeds) == pytest.approx(2.0 * 3.14159265 * 0.087)
        stop.publish(Bool(data=True))
        spin_until(runner, lambda: node.emergency_stop and speeds[-1] == 0.0)
        count = len(speeds)
        node.drive(60.0, 60.0)
        runner.spin(0.3)
        assert len(speeds) == count
        stop.publish(Bool(data=False))
        spin_until(runner, lambda: not node.emergency_stop)
        node.drive(60.0, 60.0)
        spin_until(runner, lambda: len(speeds) > count)
        node.halt()
        spin_until(runner, lambda: speeds[-1] == 0.0)
