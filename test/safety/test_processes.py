# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Killed or frozen processes and an unplugged cable: stop times at the boards."""

from __future__ import annotations

import signal
import time

import pytest
from support.robot_rig import RobotRig

pytestmark = pytest.mark.safety

nodes = pytest.mark.parametrize('name', ['motor_driver', 'wheel_controller'])


@pytest.fixture
def robot(tmp_path, isolated_ros):
    with RobotRig(tmp_path) as started:
        started.drive()
        yield started


@nodes
@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSTOP])
def test_the_wheels_stop_when_a_process_is_killed_or_frozen(robot, name, number):
    stopped = time.monotonic()
    robot.processes[name].popen.send_signal(number)
    assert robot.until_stopped(stopped) < 0.5
    robot.stay_stopped(1.0)


@nodes
def test_the_wheels_stop_when_a_process_is_interrupted(robot, name):
    ended = time.monotonic()
    robot.processes[name].popen.send_signal(signal.SIGINT)
    assert robot.until_stopped(ended) < 0.5
    assert robot.processes[name].ended() == 0


def test_the_wheels_stop_when_all_processes_freeze(robot):
    stopped = time.monotonic()
    for process in robot.processes.values():
        process.popen.send_signal(signal.SIGSTOP)
    assert robot.until_stopped(stopped, lambda: None) < 0.5


def test_the_wheels_stop_when_the_cable_is_unplugged_and_then_need_a_new_command(robot):
    unplugged = robot.rig.unplug()
    assert robot.until_stopped(unplugged) < 0.5
    robot.graph.until(lambda: 'no such port' in robot.status_message())
    robot.pause()
    readings = robot.graph.received['wheel_states']
    readings.clear()
    robot.rig.plug_in()
    plugged_in = time.monotonic()
    robot.graph.until(lambda: readings)
    assert time.monotonic() - plugged_in < 2.0
    robot.stay_stopped(1.0, lambda: None)
    robot.drive()


def test_the_reason_of_a_stop_is_logged_once_per_event(robot):
    robot.hold(1.0)
    assert robot.rig.state().still
    robot.drive()
    robot.hold(1.0)
    output = robot.processes['motor_driver'].output
    assert output.count('motors stopped') == 0  # the controller commands zero in time
    robot.drive()
    robot.processes['wheel_controller'].popen.kill()
    robot.hold(1.0)
    assert robot.processes['motor_driver'].output.count('motors stopped') == 1
