# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A second publisher on a topic of which only one publisher is accepted."""

from __future__ import annotations

import time

import pytest
from smart_tire.samples import MotorCommand, VelocityCommand, WheelSample
from support.robot_rig import RobotRig, Stranger

pytestmark = pytest.mark.safety

SECOND = {
    'motor_commands': lambda: MotorCommand(time.time_ns(), (1.0, 1.0, 1.0, 1.0)),
    'wheel_states': lambda: WheelSample(time.time_ns(), (0.0, 0.0, 0.0, 0.0)),
    'cmd_vel': lambda: VelocityCommand(time.time_ns(), 1.4, 0.0),
}
READER = {'motor_commands': 'motor_driver', 'wheel_states': 'wheel_controller',
          'cmd_vel': 'wheel_controller'}
OWNER = {'motor_commands': '/wheel_controller', 'wheel_states': '/motor_driver',
         'cmd_vel': '/test'}
topics = pytest.mark.parametrize('topic', SECOND)


@pytest.fixture
def robot(tmp_path, isolated_ros):
    with RobotRig(tmp_path) as started:
        started.drive()
        yield started


@topics
def test_a_second_publisher_causes_zero_duty_until_it_is_silent(robot, topic, tmp_path):
    with Stranger(tmp_path, topic) as stranger:
        def both():
            robot.command()
            stranger.publish(SECOND[topic]())

        robot.drive()  # while the other publisher sends nothing
        robot.graph.until(lambda: f'2 publishers exist on {topic}: '
                          in robot.status_message(READER[topic]), robot.command)
        began = time.monotonic()
        both()
        assert robot.until_stopped(began, both) < 0.3
        robot.stay_stopped(1.0, both)
        robot.graph.until(lambda: OWNER[topic] in robot.status_message(READER[topic])
                          and '/stranger' in robot.status_message(READER[topic])
                          and f'2 publishers on {topic}'
                          in robot.status_message(READER[topic]), both)
    robot.drive()


@topics
def test_a_second_publisher_without_messages_is_a_warning(robot, topic, tmp_path):
    with Stranger(tmp_path, topic):
        robot.drive()
        robot.keep_driving(lambda: robot.graph.until(
            lambda: f'2 publishers exist on {topic}: ' in robot.status_message(READER[topic]),
            robot.command))
        assert '/stranger' in robot.status_message(READER[topic])
        robot.drive()


def test_a_restarted_controller_drives(robot):
    robot.processes['wheel_controller'].popen.kill()
    killed = time.monotonic()
    assert robot.until_stopped(killed) < 0.5
    robot.start('wheel_controller')
    robot.drive()
    assert time.monotonic() - killed < 15.0  # the dead publisher stays in the graph for 20 s


def test_occasional_messages_of_a_second_publisher_are_never_applied(robot, tmp_path):
    with Stranger(tmp_path, 'motor_commands') as stranger:
        for _ in range(3):
            robot.drive(0.5)
            since = time.monotonic()
            stranger.publish(SECOND['motor_commands']())
            robot.hold(0.5, lambda: robot.command(0.5))
            assert max(max(duty) for _, duty in robot.rig.record(since).duties) < 0.9
