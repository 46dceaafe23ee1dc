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

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.pilot import Pilot
from smart_tire.nodes.qos import subscriber_qos
from smart_tire.nodes.runner import NodeRunner
from smart_tire.samples import Friction, ImuSample, NAN, PathProgress
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from support.virtual_node import virtual
from support.waiting import wait_for

pytestmark = pytest.mark.processes
LINE = ((0.0, 0.0, NAN), (1.0, 0.5, NAN))
IMU = ImuSample(10 ** 9, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0))


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

    def until(condition):
        wait_for(condition, lambda: runner.spin(0.1))

    with NodeRunner(Pilot, []) as runner:
        node = runner.node
        paths = listen(node, 'path')
        assert node.cancel() is None and not node.has_path  # nothing offers the service
        node.create_service(Trigger, 'cancel_path', answer)
        report = node.make_publisher('path_progress')
        until(lambda: node.listeners('path') > 0)
        assert node.count_publishers('path') == 0
        before_ns = node.now_ns()
        node.follow(LINE)
        until(lambda: paths)
        assert paths[0].frame == 'odom' and node.has_path
        assert [pose[:2] for pose in paths[0].poses] == [pose[:2] for pose in LINE]
        assert all(math.isnan(pose[2]) for pose in paths[0].poses)
        assert before_ns <= paths[0].stamp_ns <= node.now_ns()
        until(lambda: report(PathProgress(1, 0.5, 0.1, 1)) or node.progress)
        assert (node.progress.remaining_distance, node.progress.state) == (0.5, 1)
        node.follow(LINE)
        assert node.progress is None  # that was of the path before
        futures = []
        until(lambda: futures.append(node.cancel()) or futures[-1])
        future = futures[-1]
        until(future.done)
        assert calls and future.result().success


def has_publisher(node):
    return '/cmd_vel' in [one.topic_name for one in node.publishers]


def test_commands_begin_with_the_first_one_and_end_with_release(isolated_ros):
    with virtual(Pilot) as node:
        node.publish('emergency_stop_active', Bool(data=True))
        node.halt()  # has commanded nothing
        assert node.emergency_stop and not has_publisher(node)
        node.command(0.3, -0.2)
        command = node.latest('cmd_vel')
        assert (command.v_x, command.yaw_rate) == (0.3, -0.2)
        node.halt()
        assert node.latest('cmd_vel').v_x == 0.0
        node.release()
        assert not has_publisher(node)


def test_the_crossings_of_each_wheel_are_counted(isolated_ros):
    with virtual(partial(Pilot, 'driver', print)) as node:
        for wheel in ('rear_left', 'front_left', 'rear_left'):
            node.publish('tire_friction', Friction(node.now_ns(), wheel))
        assert node.crossings == {'rear_left': 2, 'front_left': 1}
        assert set(node.friction) == {'rear_left', 'front_left'}


def test_wheel_speeds_are_commanded_until_the_emergency_stop_or_the_release(isolated_ros):
    def assert_silent():
        count = len(node.received['cmd_vel'])
        node.run(1.0)
        assert len(node.received['cmd_vel']) == count
        assert node.latest('cmd_vel').v_x == 0.0

    samples = []
    with virtual(partial(Pilot, 'driver', samples.append)) as node:
        node.run(1.0)
        assert not has_publisher(node)  # without a command it cannot drive
        node.drive(60.0, 120.0)
        node.run(1.0)
        assert len(node.received['cmd_vel']) == 21  # repeated
        command = node.latest('cmd_vel')
        radius, track = node.params.robot.wheel_radius, node.params.effective_track
        assert command.v_x == pytest.approx(3.0 * math.pi * radius)
        assert command.yaw_rate == pytest.approx(2.0 * math.pi * radius / track)
        node.publish('emergency_stop_active', Bool(data=True))
        assert_silent()
        node.drive(60.0, 60.0)
        assert_silent()
        node.publish('emergency_stop_active', Bool(data=False))
        assert_silent()  # a stop ends the command for good
        node.drive(60.0, 60.0)
        assert node.latest('cmd_vel').v_x > 0.0
        node.halt()
        assert_silent()
        node.drive(60.0, 60.0)
        node.publish('imu/data', IMU)
        node.release()
        assert_silent()
        assert samples == [IMU] and not has_publisher(node)


def test_what_motor_driver_says_is_kept_while_it_stops_the_motors(isolated_ros):
    def report(name, message):
        node._on_diagnostics(DiagnosticArray(status=[DiagnosticStatus(
            name=f'/robot/{name}', message=message)]))

    with NodeRunner(Pilot, []) as runner:
        node = runner.node
        report('motor_driver', 'motors stopped: no motor command for 0.25 s')
        report('wheel_controller', 'ok')  # says nothing of it
        assert node.stopped == 'motors stopped: no motor command for 0.25 s'
        report('motor_driver', 'its host is late')
        assert node.stopped == ''
