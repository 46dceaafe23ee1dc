# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Emergency stop of the output stage: latched, confirmed by the boards, never bypassed."""

from __future__ import annotations

import time

import pytest
from smart_tire.protocol.roboclaw import SET_DUTY
from smart_tire.samples import MotorCommand
from support.robot_rig import Releases, RobotRig, Stranger

pytestmark = pytest.mark.safety

HOLD_OFF = 0.1  # s, so that a release may follow while the latest velocity command is valid


@pytest.fixture
def robot(tmp_path, isolated_ros):
    with RobotRig(tmp_path, release_hold_off=HOLD_OFF) as started:
        started.drive()
        yield started


def test_the_emergency_stop_is_immediate_confirmed_and_latched(robot):
    asked = time.monotonic()
    response = robot.emergency_stop(True)
    answered = time.monotonic()
    assert response.success
    record = robot.rig.record(asked)
    assert record.first_zero() < answered
    assert record.first_zero() - asked < 0.1
    for address in (128, 129):
        assert len(record.times(SET_DUTY, address)) >= 2
    robot.stay_stopped(1.0)
    robot.graph.until(lambda: 'emergency stop' in robot.status_message(), robot.command)
    robot.graph.until(lambda: 'emergency stop' in robot.status_message('wheel_controller'),
                      robot.command)


def test_after_the_release_a_new_velocity_command_is_needed(robot):
    assert robot.emergency_stop(True).success
    robot.hold(0.1, robot.command)
    robot.hold(0.06)
    robot.command()
    assert robot.emergency_stop(False).success
    robot.stay_stopped(0.5, lambda: None)
    robot.drive()


def test_a_stop_that_is_released_at_once_also_discards_the_command(robot):
    robot.processes['wheel_controller'].end()
    with robot.start('wheel_controller', cmd_vel_timeout=5.0):
        robot.drive()
        assert robot.emergency_stop(True).success
        robot.hold(1.1 * HOLD_OFF)
        assert robot.emergency_stop(False).success
        robot.stay_stopped(1.0, lambda: None)


def test_repeated_releases_do_not_undo_an_emergency_stop(tmp_path, isolated_ros):
    with RobotRig(tmp_path) as robot:
        robot.drive()
        with Releases(robot) as releases:
            robot.graph.until(lambda: releases.answered > 100, robot.command)
            asked = time.monotonic()
            assert robot.emergency_stop(True).success
            assert robot.rig.record(asked).first_zero() - asked < 0.3
            robot.stay_stopped(1.5)
            assert releases.granted <= 1  # the first one, before the stop
        robot.hold(1.1)
        assert robot.emergency_stop(False).success
        robot.drive()


def test_the_state_reaches_late_subscribers_and_is_repeated(robot):
    assert robot.emergency_stop(True).success
    states = robot.listen_state()
    robot.graph.until(lambda: states)
    assert states == [True]
    robot.graph.until(lambda: len(states) >= 2)
    robot.hold(1.1 * HOLD_OFF)
    robot.emergency_stop(False)
    robot.graph.until(lambda: not states[-1])


def test_the_stop_survives_a_restart_of_the_controller(robot):
    assert robot.emergency_stop(True).success
    robot.processes['wheel_controller'].popen.kill()
    robot.start('wheel_controller')
    robot.stay_stopped(2.0)
    assert robot.emergency_stop(False).success
    robot.drive()


def test_another_publisher_of_duties_does_not_bypass_the_stop(robot, tmp_path):
    robot.processes['wheel_controller'].popen.kill()
    assert robot.emergency_stop(True).success
    with Stranger(tmp_path, 'motor_commands') as stranger:
        robot.stay_stopped(1.0, lambda: stranger.publish(
            MotorCommand(time.time_ns(), (1.0, 1.0, 1.0, 1.0))))


@pytest.mark.parametrize('mute', [{128}, {129}, {128, 129}])
def test_a_stop_that_a_board_does_not_acknowledge_reports_failure_and_is_latched(robot, mute):
    robot.rig.fail(mute=mute)
    response = robot.emergency_stop(True)
    assert not response.success
    for address, name in ((128, 'front board 128'), (129, 'rear board 129')):
        assert (name in response.message) == (address in mute)
    robot.rig.fail()
    robot.stay_stopped(2.0)


def test_a_stop_without_a_port_reports_failure_and_is_latched(robot):
    robot.rig.unplug()
    robot.graph.until(lambda: 'no such port' in robot.status_message(), robot.command)
    assert not robot.emergency_stop(True).success
    plugged = robot.rig.plug_in()
    robot.graph.until(lambda: robot.rig.record(plugged).times(SET_DUTY, 129), robot.command)
    robot.stay_stopped(1.0)


def test_a_driver_with_start_stopped_starts_with_the_stop_latched(robot):
    robot.processes['motor_driver'].popen.kill()
    robot.start('motor_driver', start_stopped=True)
    states = robot.listen_state()
    robot.graph.until(lambda: states and states[-1], robot.command)
    robot.stay_stopped(1.5)
    assert robot.emergency_stop(False).success
    robot.drive()


def test_with_require_arming_the_motors_run_only_while_armed(tmp_path, isolated_ros):
    with RobotRig(tmp_path, require_arming=True, release_hold_off=HOLD_OFF) as robot:
        robot.stay_stopped(0.5)
        assert robot.arm(True).success
        asked = robot.drive()
        assert robot.arm(False).success
        assert robot.until_stopped(asked) < 0.2
        robot.stay_stopped(0.5)
        assert robot.emergency_stop(True).success
        response = robot.arm(True)
        assert not response.success
        assert 'emergency stop' in response.message
        robot.hold(1.1 * HOLD_OFF)
        assert robot.emergency_stop(False).success
        robot.stay_stopped(0.5)  # the stop disarms
        assert robot.arm(True).success
        robot.drive()
