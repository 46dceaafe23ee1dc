# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pilot: paths, cancellation, commands from the first one on until they are released."""

from __future__ import annotations

from functools import partial
import math

import pytest
from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.pilot import Pilot
from smart_tire.nodes.qos import latched, subscriber_qos
from smart_tire.nodes.runner import NodeRunner
from smart_tire.samples import ImuSample, NAN, PathProgress
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

pytestmark = pytest.mark.processes
MAX_SPINS = 300  # of 0.1 s
LINE = ((0.0, 0.0, NAN), (1.0, 0.5, NAN))
IMU = ImuSample(10 ** 9, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0))


def spin_until(runner, condition):
    for _ in range(MAX_SPINS):
        if condition():
            return
        runner.spin(0.1)
    raise AssertionError('the condition was not met in time')


def listen(node, name):
    """Return the list of the samples that will be received on ``name``."""
    topic, received = TOPICS[name], []
    node.create_subscription(message_class(topic.type), name,
                             lambda msg: received.append(topic.from_msg(msg)),
                             subscriber_qos(name))
    return received


def test_a_path_is_published_and_canceled(isolated_ros):
    calls = []

    def answer(_, response):
        calls.append(True)
        response.success = True
        return response

    with NodeRunner(Pilot, []) as runner:
        node = runner.node
        paths = listen(node, 'path')
        assert node.cancel() is None and not node.has_path  # nothing offers the service
        node.create_service(Trigger, 'cancel_path', answer)
        report = node.make_publisher('path_progress')
        spin_until(runner, lambda: node.listeners('path') > 0)
        assert node.count_publishers('path') == 0
        node.follow(LINE)
        spin_until(runner, lambda: paths)
        assert paths[0].frame == 'odom' and node.has_path
        assert [pose[:2] for pose in paths[0].poses] == [pose[:2] for pose in LINE]
        assert all(math.isnan(pose[2]) for pose in paths[0].poses)
        assert abs(paths[0].stamp_ns - node.now_ns()) < 10e9
        spin_until(runner, lambda: report(PathProgress(1, 0.5, 0.1, 1)) or node.progress)
        assert (node.progress.remaining_distance, node.progress.state) == (0.5, 1)
        node.follow(LINE)
        assert node.progress is None  # that was of the path before
        futures = []
        spin_until(runner, lambda: futures.append(node.cancel()) or futures[-1])
        future = futures[-1]
        spin_until(runner, future.done)
        assert calls and future.result().success


def test_commands_begin_with_the_first_one_and_end_with_release(isolated_ros):
    with NodeRunner(Pilot, []) as runner:
        node = runner.node
        commands = listen(node, 'cmd_vel')
        stop = node.create_publisher(Bool, 'emergency_stop_active', latched())
        stop.publish(Bool(data=True))
        spin_until(runner, lambda: node.emergency_stop and node.listeners('cmd_vel'))
        node.halt()  # has commanded nothing
        assert node.count_publishers('cmd_vel') == 0
        spin_until(runner, lambda: node.command(0.3, -0.2) or commands)
        assert (commands[0].v_x, commands[0].yaw_rate) == (0.3, -0.2)
        node.halt()
        spin_until(runner, lambda: commands[-1].v_x == 0.0)
        node.release()
        assert not [one for one in node.publishers if one.topic_name.endswith('cmd_vel')]


def assert_silent(runner, commands):
    """Check that nothing more is commanded."""
    runner.spin(0.2)
    count = len(commands)
    runner.spin(0.3)
    assert len(commands) == count


def test_wheel_speeds_are_commanded_until_the_emergency_stop_or_the_release(isolated_ros):
    samples = []
    with NodeRunner(partial(Pilot, 'driver', samples.append), []) as runner:
        node = runner.node
        commands = listen(node, 'cmd_vel')
        report = node.make_publisher('imu/data')
        stop = node.create_publisher(Bool, 'emergency_stop_active', latched())
        spin_until(runner, lambda: node.listeners('cmd_vel'))
        runner.spin(0.2)
        assert node.count_publishers('cmd_vel') == 0  # without a command it cannot drive
        node.drive(60.0, 120.0)
        spin_until(runner, lambda: len(commands) > 3)  # repeated
        radius, track = node.params.robot.wheel_radius, node.params.effective_track
        assert commands[-1].v_x == pytest.approx(3.0 * math.pi * radius)
        assert commands[-1].yaw_rate == pytest.approx(2.0 * math.pi * radius / track)
        stop.publish(Bool(data=True))
        spin_until(runner, lambda: node.emergency_stop and commands[-1].v_x == 0.0)
        node.drive(60.0, 60.0)
        assert_silent(runner, commands)
        stop.publish(Bool(data=False))
        spin_until(runner, lambda: not node.emergency_stop)
        assert_silent(runner, commands)  # a stop ends the command for good
        node.drive(60.0, 60.0)
        spin_until(runner, lambda: commands[-1].v_x > 0.0)
        node.halt()
        spin_until(runner, lambda: commands[-1].v_x == 0.0)
        assert_silent(runner, commands)
        node.drive(60.0, 60.0)
        spin_until(runner, lambda: report(IMU) or samples)
        node.release()
        assert_silent(runner, commands)
        assert IMU in samples and not [
            one for one in node.publishers if one.topic_name.endswith('cmd_vel')]
