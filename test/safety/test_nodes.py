# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Real nodes with emulated boards: what stops the motors stays stopped, whoever sends what."""

from __future__ import annotations

from collections.abc import Iterator
import math
import signal
import time

import pytest
from sensor_msgs.msg import JointState
from smart_tire.protocol.roboclaw import SET_DUTY
from smart_tire.samples import MotorCommand, VelocityCommand, WHEELS, WheelSample
from support.hazards import HAZARDS
from support.robot_rig import RobotRig, Stranger
from support.verdict import assert_within

pytestmark = pytest.mark.safety

HOLD_OFF = 0.1  # s, so that a release may follow while the latest velocity command is valid
SECOND = {  # topic -> sample of a second publisher, the node that reads it, the first publisher
    'motor_commands': (lambda: MotorCommand(time.time_ns(), (1.0, 1.0, 1.0, 1.0)),
                       'motor_driver', '/wheel_controller'),
    'wheel_states': (lambda: WheelSample(time.time_ns(), (0.0, 0.0, 0.0, 0.0)),
                     'wheel_controller', '/motor_driver'),
    'cmd_vel': (lambda: VelocityCommand(time.time_ns(), 1.4, 0.0), 'wheel_controller', '/test'),
}


@pytest.fixture(scope='module')
def started(tmp_path_factory, isolated_ros) -> Iterator[RobotRig]:
    with RobotRig(tmp_path_factory.mktemp('nodes'), release_hold_off=HOLD_OFF) as robot:
        yield robot


@pytest.fixture
def robot(started) -> RobotRig:
    started.rig.fail()
    release(started)
    return started


def stop(robot):
    """Engage the emergency stop, again while a board that got no core does not acknowledge."""
    robot.graph.until(lambda: robot.emergency_stop(True).success, robot.command)


def release(robot):
    """Release the emergency stop, and drive."""
    while not robot.emergency_stop(False).success:
        robot.hold(1.1 * HOLD_OFF)
    robot.drive()


def test_the_emergency_stop_is_confirmed_latched_and_shown(robot):
    asked = time.monotonic()
    stop(robot)
    answered = time.monotonic()
    record = robot.rig.record(asked)
    assert record.first_zero() < answered
    for address in (128, 129):
        assert len(record.times(SET_DUTY, address)) >= 2
    robot.stay_stopped(0.6)
    for node in ('motor_driver', 'wheel_controller'):
        robot.graph.until(lambda: 'emergency stop' in robot.status_message(node),  # noqa: B023
                          robot.command)
    states = robot.listen_state()
    robot.graph.until(lambda: len(states) >= 2)  # also the one from before
    assert states[0]
    release(robot)
    robot.graph.until(lambda: not states[-1])


@pytest.mark.parametrize('mute', [{128}, {129}])
def test_a_stop_that_a_board_does_not_acknowledge_reports_failure_and_is_latched(robot, mute):
    robot.rig.fail(mute=mute)
    response = robot.emergency_stop(True)
    assert not response.success
    for address, name in ((128, 'front board 128'), (129, 'rear board 129')):
        assert name in response.message or address not in mute
    robot.rig.fail()
    robot.stay_stopped(1.0)
    release(robot)


def test_a_stop_without_a_port_reports_failure_and_is_latched(robot):
    robot.rig.unplug()
    robot.graph.until(lambda: 'no such port' in robot.status_message(), robot.command)
    assert not robot.emergency_stop(True).success
    plugged = robot.rig.plug_in()
    robot.graph.until(lambda: robot.rig.record(plugged).times(SET_DUTY, 129), robot.command)
    robot.stay_stopped(0.6)
    release(robot)


@pytest.mark.parametrize('topic', SECOND)
def test_a_second_publisher_causes_zero_duty_until_it_is_silent(robot, topic, tmp_path):
    make, reader, owner = SECOND[topic]
    with Stranger(tmp_path, topic) as stranger:
        published = []

        def both():
            published.append(time.monotonic())
            robot.command()
            stranger.publish(make())

        robot.graph.until(lambda: f'2 publishers exist on {topic}: '
                          in robot.status_message(reader), robot.command)
        assert '/stranger' in robot.status_message(reader)
        robot.drive()  # while the other publisher sends nothing
        while True:
            robot.graph.until(lambda: robot.rig.state().still, both)
            since, published[:] = time.monotonic(), published[-1:]
            robot.hold(0.6, both)
            if max(after - before for before, after in zip(published, published[1:])) < 0.2:
                break  # else both were silent, and the first one was alone for a moment
        assert not robot.rig.record(since).driven()
        for text in (owner, '/stranger', f'2 publishers on {topic}'):
            robot.graph.until(lambda: text in robot.status_message(reader), both)  # noqa: B023
    robot.drive()


@pytest.mark.parametrize('duty', [math.nan, 1.5])
def test_the_driver_refuses_an_invalid_duty(robot, duty):
    def rejected():
        return int(robot.graph.value('motor_driver', 'motor_commands.rejected') or 0)

    before = rejected()
    bad = JointState(name=list(WHEELS), effort=[0.9, duty, 0.9, 0.9])
    since = time.monotonic()
    robot.graph.until(lambda: rejected() > before, lambda: robot.graph.publish_message(
        'motor_commands', bad))
    assert max(max(given) for _, given in robot.rig.record(since).duties) < 0.9


def test_a_stop_survives_a_restart_of_the_controller_and_other_publishers(robot, tmp_path):
    stop(robot)
    robot.processes['wheel_controller'].popen.kill()
    with Stranger(tmp_path, 'motor_commands') as stranger:
        robot.stay_stopped(0.6, lambda: stranger.publish(SECOND['motor_commands'][0]()))
    robot.start('wheel_controller')
    robot.graph.until(lambda: 'receiving wheel_states'
                      in robot.processes['wheel_controller'].output, robot.command)
    robot.stay_stopped(0.6)
    release(robot)


def test_a_restarted_driver_waits_for_the_release_and_for_arming(robot):
    assert robot.processes['motor_driver'].end() == 0
    assert robot.rig.state().still
    robot.start('motor_driver', start_stopped=True, require_arming=True)
    states = robot.listen_state()
    robot.graph.until(lambda: states and states[-1], robot.command)
    robot.stay_stopped(0.6)
    assert not robot.arm(True).success
    robot.graph.until(lambda: robot.emergency_stop(False).success)
    robot.stay_stopped(0.6)
    robot.graph.until(lambda: robot.arm(True).success, robot.command)
    robot.drive()
    assert robot.arm(False).success
    robot.graph.until(lambda: robot.rig.state().still, robot.command)
    robot.stay_stopped(0.3)
    robot.processes['motor_driver'].end()
    robot.start('motor_driver')
    robot.drive()


@pytest.mark.parametrize('name', ['wheel_controller', 'motor_driver'])
def test_the_wheels_stop_when_a_process_is_interrupted(robot, name):
    assert robot.processes[name].end() == 0
    robot.graph.until(lambda: robot.rig.state().still, robot.command)
    robot.stay_stopped(0.3)
    robot.start(name)
    robot.drive()


def signals(number, *names):
    """Return what happens to processes, and how they return."""
    def happen(robot):
        for name in names:
            robot.processes[name].popen.send_signal(number)

    def undo(robot):
        for name in names:
            if number == signal.SIGSTOP:
                robot.processes[name].popen.send_signal(signal.SIGCONT)
            else:
                robot.processes[name].ended()
                robot.start(name)

    return happen, undo


CASES = {
    'motor_driver killed or stopped': [signals(number, 'motor_driver')
                                       for number in (signal.SIGKILL, signal.SIGSTOP)],
    'wheel_controller killed or stopped': [signals(number, 'wheel_controller')
                                           for number in (signal.SIGKILL, signal.SIGSTOP)],
    'host frozen': [signals(signal.SIGSTOP, 'motor_driver', 'wheel_controller')],
    'cable unplugged': [(lambda robot: robot.rig.unplug(), lambda robot: robot.rig.plug_in())],
}


@pytest.mark.parametrize(('hazard', 'happen', 'undo'), [
    (hazard, *case) for hazard, cases in CASES.items() for case in cases])
def test_the_wheels_stop_within_the_bound_in_real_time(robot, hazard, happen, undo):
    def scenario():
        robot.drive()
        queues, began = robot.run_queues(), time.monotonic()
        happen(robot)
        seconds = robot.until_stopped(began)
        waited = queues.seconds()
        robot.stay_stopped(0.3)
        undo(robot)
        return seconds, waited

    assert_within(HAZARDS[hazard].bound, scenario)
