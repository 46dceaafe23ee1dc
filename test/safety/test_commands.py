# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Commands that are old, invalid, queued or of another source: what moves the wheels, and when."""

from __future__ import annotations

import math

import pytest
from smart_tire.samples import MotorCommand, NS_PER_S, VelocityCommand
from support.virtual_robot import (
    COMMANDER, CONTROLLER, DRIVER, FollowingRobot, played, SPEED, STRANGER, VirtualRobot)

HOUR = 3600 * NS_PER_S
TIMEOUT = 0.25  # s, of cmd_vel and of motor_commands, the default
TRANSIT = 0.04  # s, of a message and its effect at the motors
robots = played(lambda: VirtualRobot())
rates = pytest.mark.parametrize('rate', [4.0, 16.0, 200.0])


def silent():
    """Command nothing."""


def driven(robot, speed=SPEED):
    """Let time pass until the wheels turn at the commanded speed."""
    yield from robot.until(lambda: min(robot.state.speeds) > 0.8 * speed / 0.087
                           and min(robot.state.duty) > 0.1)


def stay_stopped(robot, seconds):
    """Let time pass, in which no motor gets a duty."""
    since = robot.now
    yield seconds
    assert not robot.record(since).driven()


def stamped(robot, offset_ns, v_x=SPEED):
    """Return a source of commands whose timestamps are off."""
    return lambda: VelocityCommand(robot.clock.time_ns() + offset_ns, v_x, 0.0)


@played(lambda: VirtualRobot(command_period=0.17))
def test_commands_at_a_low_rate_drive_the_wheels_without_interruption(robot):
    yield from driven(robot)
    since = robot.now
    yield 3.0
    assert robot.record(since).always_driven()
    assert robot.reports == []


@robots
def test_after_commands_ended_the_wheels_stay_stopped_without_a_report(robot):
    yield from driven(robot)
    robot.command = silent
    yield from robot.until(lambda: robot.state.still)
    yield from stay_stopped(robot, 1.0)
    robot.command = robot.velocity
    yield from driven(robot)
    assert robot.reports == []  # the controller commands zero in time


@pytest.mark.parametrize('v_x', [math.nan, math.inf, -math.inf, 1e308, 1e3])
@robots
def test_an_invalid_velocity_is_refused_and_the_previous_command_expires(robot, v_x):
    yield from driven(robot)
    robot.command = stamped(robot, 0, v_x)
    yield from robot.until(lambda: robot.state.still)
    assert 'cmd_vel' in robot.rejected[0]


@pytest.mark.parametrize('offset_ns', [
    -HOUR, HOUR, -600_000_000, 600_000_000, -2_000_000_000 * NS_PER_S])
@robots
def test_a_command_from_the_past_or_future_moves_no_wheel(robot, offset_ns):
    robot.command = stamped(robot, offset_ns)
    yield from stay_stopped(robot, 1.0)
    assert robot.rejected


@pytest.mark.parametrize('offset_ns', [-400_000_000, 400_000_000])
@robots
def test_a_small_clock_offset_of_the_commander_is_accepted(robot, offset_ns):
    robot.command = stamped(robot, offset_ns)
    yield from driven(robot)


@robots
def test_commands_without_a_timestamp_drive_with_one_warning_until_they_expire(robot):
    robot.command = lambda: VelocityCommand(0, SPEED, 0.0)
    yield from driven(robot)
    assert len(robot.warnings) == 1
    assert 'cmd_vel has no timestamp' in robot.warnings[0]
    robot.command = silent
    yield TIMEOUT + 0.05 + TRANSIT
    assert robot.state.still


@pytest.mark.parametrize('length', [0.26, 0.5, 1.5])
@pytest.mark.parametrize('stamp', [True, False])
@robots
def test_commands_queued_while_the_controller_was_stopped_move_no_wheel(robot, stamp, length):
    if not stamp:
        robot.command = lambda: VelocityCommand(0, SPEED, 0.0)
    yield from driven(robot)
    robot.stop(CONTROLLER)
    yield length
    robot.command = silent
    yield 0.6
    assert robot.state.still
    robot.resume(CONTROLLER)
    yield from stay_stopped(robot, 1.0)


@pytest.mark.parametrize('length', [0.26, 0.3, 1.0])
@pytest.mark.parametrize('stamp', [True, False])
@robots
def test_duties_queued_while_the_driver_was_stopped_move_no_wheel(robot, stamp, length):
    robot.stop(CONTROLLER)

    def send():
        robot.publish('motor_commands', MotorCommand(
            robot.clock.time_ns() if stamp else 0, (0.5,) * 4), CONTROLLER)

    sending = [True]
    robot.every(COMMANDER, 0.05, 0.0, lambda: send() if sending[0] else None)
    yield from robot.until(lambda: min(robot.state.duty) > 0.4)
    robot.stop(DRIVER)
    yield length
    sending[0] = False
    yield TIMEOUT
    assert robot.state.still  # by the watchdog of the boards
    robot.resume(DRIVER)
    yield from stay_stopped(robot, 1.0)


@pytest.mark.parametrize('offset_ns', [-HOUR, HOUR, 700_000_000, -700_000_000])
@robots
def test_the_driver_refuses_a_duty_from_the_past_or_future(robot, offset_ns):
    robot.stop(CONTROLLER)
    yield 0.5
    offsets = [offset_ns]
    robot.every(COMMANDER, 0.05, 0.0, lambda: robot.publish('motor_commands', MotorCommand(
        robot.clock.time_ns() + offsets[0], (0.5,) * 4), CONTROLLER))
    yield from stay_stopped(robot, 0.6)
    offsets[0] = 0  # the timestamp was the reason
    yield from robot.until(lambda: min(robot.state.duty) > 0.4)


@pytest.mark.parametrize('age', [0.0, 0.1, 0.2, 0.24, 0.26, 0.3, 0.45])
@robots
def test_the_time_out_of_a_duty_counts_from_its_timestamp(robot, age):
    robot.stop(CONTROLLER)
    yield 1.0
    sent, stamp_ns = robot.now, robot.clock.time_ns() - round(age * NS_PER_S)
    robot.publish('motor_commands', MotorCommand(stamp_ns, (0.5,) * 4), CONTROLLER)
    yield 0.6
    record, end = robot.record(sent), sent + TIMEOUT - age
    assert record.driven() == (age < TIMEOUT)
    if record.driven():
        assert end < record.after(record.first_duty()).first_zero() < end + TRANSIT


@played(lambda: VirtualRobot(controller={
    'cmd_vel_inputs': ['teleop', 'nav'], 'cmd_vel_priorities': [10, 5],
    'cmd_vel_timeouts': [0.5, 0.2]}))
def test_the_input_of_higher_priority_is_used_until_it_expires(robot):
    commands = {'nav': 0.5}
    robot.command = silent
    robot.every(COMMANDER, 0.05, 0.0, lambda: [
        robot.publish(name, stamped(robot, 0, v_x)(), COMMANDER)
        for name, v_x in commands.items()])
    yield from driven(robot, 0.4)
    commands['teleop'] = -0.5
    yield from robot.until(lambda: max(robot.state.speeds) < -3.0)
    del commands['teleop']
    ended = robot.now
    yield from robot.until(lambda: min(robot.state.duty) > 0.0)
    assert robot.now - ended > 0.4
    yield from driven(robot, 0.4)
    commands.clear()
    yield 0.2 + 0.05 + 0.05 + TRANSIT
    assert robot.state.still


@rates
@played(lambda rate: VirtualRobot(rate=rate, control_rate=rate))
def test_after_a_fault_the_robot_drives_again_once_commands_paused(robot, rate):
    yield from driven(robot)
    for faults in ({'frozen': {1}}, {'status': {128: 4}}, {'supply': {129: 90}}):
        robot.fail(**faults)
        yield from robot.until(lambda: robot.state.still)
        robot.fail()
        yield from stay_stopped(robot, 1.5)  # commands were never interrupted
        robot.command = silent
        yield 1.2
        robot.command = robot.velocity
        yield from driven(robot)


@rates
@played(lambda rate: VirtualRobot(rate=rate, control_rate=rate))
def test_after_a_fault_of_the_line_the_robot_drives_again(robot, rate):
    yield from driven(robot)
    for faults in ({'mute': {128, 129}}, {'garbled': {129}}, {'flood': True}, {'deaf': True}):
        robot.fail(**faults)
        yield from robot.until(lambda: robot.state.still)
        yield from stay_stopped(robot, 1.4)
        robot.fail()
        yield from driven(robot)
    robot.port.plugged = False
    yield from robot.until(lambda: robot.state.still)
    yield 1.0
    robot.port.plugged = True
    yield from driven(robot)


@robots
def test_the_emergency_stop_is_latched_and_discards_the_command(robot):
    yield from driven(robot)
    robot.engage()
    yield from robot.until(lambda: robot.state.still)
    yield from stay_stopped(robot, 1.2)
    robot.command = silent
    assert robot.release() == ''
    yield from stay_stopped(robot, 0.5)  # the latest command was given before
    robot.command = robot.velocity
    yield from driven(robot)
    assert 'release refused' in (robot.engage() or robot.release())


@played(lambda: VirtualRobot(controller={'cmd_vel_timeout': 5.0},
                             driver={'release_hold_off': 0.1}))
def test_a_stop_that_is_released_soon_also_discards_a_command_that_is_still_valid(robot):
    yield from driven(robot)
    robot.command = silent
    robot.engage()
    yield 0.11
    assert robot.release() == ''
    yield from stay_stopped(robot, 1.0)


@played(lambda: VirtualRobot(driver={'require_arming': True, 'release_hold_off': 0.1}))
def test_with_require_arming_the_motors_run_only_while_armed(robot):
    output = robot.output
    yield from robot.until(lambda: output.gate.reasons() == ['not armed'])
    yield from stay_stopped(robot, 0.5)
    assert output.arm(True) == []
    yield from driven(robot)
    output.arm(False)
    yield TRANSIT
    yield from stay_stopped(robot, 0.5)
    robot.engage()
    assert output.arm(True) == ['emergency stop']
    yield 0.11
    robot.release()
    yield from stay_stopped(robot, 0.5)  # the stop disarms
    assert output.arm(True) == []
    yield from driven(robot)


@played(lambda: VirtualRobot(driver={'start_stopped': True}))
def test_a_driver_with_start_stopped_starts_with_the_stop_latched(robot):
    yield from stay_stopped(robot, 1.5)
    assert robot.release() == ''
    yield from driven(robot)


@pytest.mark.parametrize('known', ['publisher', 'number', 'nothing'])
@pytest.mark.parametrize('topic', ['motor_commands', 'wheel_states', 'cmd_vel'])
@played(lambda known: VirtualRobot(known=known))
def test_a_second_publisher_stops_the_wheels_until_it_is_silent(robot, topic, known):
    yield from driven(robot)
    robot.sent[topic][STRANGER] = max(robot.sent[topic].values())  # the same numbers
    samples = {'motor_commands': lambda: MotorCommand(robot.clock.time_ns(), (1.0,) * 4),
               'wheel_states': lambda: robot.samples[-1], 'cmd_vel': robot.velocity}
    sending = [True]
    robot.every(COMMANDER, 0.3, 0.1,
                lambda: sending[0] and robot.publish(topic, samples[topic](), STRANGER))
    yield from robot.until(lambda: robot.state.still)
    yield from stay_stopped(robot, 1.0)
    assert any(f'2 publishers on {topic}' in reason for reason in robot.rejected)
    sending[0] = False
    del robot.sent[topic][STRANGER]  # ended
    yield 1.3
    yield from robot.until(lambda: robot.output.gate.enabled)
    yield from driven(robot)


@robots
def test_occasional_messages_of_a_second_publisher_are_never_applied(robot):
    yield from driven(robot)
    since = robot.now
    for _ in range(3):
        robot.publish('motor_commands', MotorCommand(
            robot.clock.time_ns(), (1.0,) * 4), STRANGER)
        yield 2.0
    assert max(max(duty) for _, duty in robot.record(since).duties) < 0.9


SLOPE_LOAD = 0.323  # N m per wheel: 10.9 kg on 8 degrees, a radius of 0.087 m


def arrive(robot):
    """Let the robot follow a path of 0.4 m to its end, on a slope."""
    robot.fail(load=SLOPE_LOAD)
    robot.length = 0.4
    yield from robot.until(lambda: robot.control.state.name == 'ARRIVED')


@played(lambda: FollowingRobot(follower={'hold_on_arrival': True}))
def test_on_a_slope_the_robot_holds_after_arrival_until_the_emergency_stop(robot):
    yield from arrive(robot)
    arrived = robot.x
    yield 3.0
    assert abs(robot.x - arrived) < 0.03
    state, x = robot.state, robot.x
    assert 0.02 < min(state.duty) <= max(state.duty) < 0.1
    yield 1.0
    assert robot.x == pytest.approx(x, abs=0.002)
    assert robot.reports == []  # no wheel is taken for blocked
    robot.engage()
    robot.control.cancel('emergency stop')
    yield 1.2  # longer than release_hold_off
    assert robot.state.still
    assert robot.release() == ''
    yield from stay_stopped(robot, 0.5)  # the hold has ended: a new path is needed


@played(lambda: FollowingRobot())
def test_without_the_hold_the_robot_rolls_away_and_has_not_arrived(robot):
    robot.fail(load=SLOPE_LOAD)
    robot.length = 0.4
    yield from robot.until(lambda: robot.control.state.name == 'STOPPED')
    assert 'm from the end, expected at most 0.045 m' in robot.control.reason
    stopped = robot.x
    yield 2.0
    assert robot.state.still
    assert robot.x < stopped - 0.06


@pytest.mark.parametrize('speed', [0.0, 0.025, -0.3, None])
@played(lambda: FollowingRobot())
def test_after_a_stop_for_its_odometry_the_robot_follows_a_new_path(robot, speed):
    yield from driven(robot, 0.3)
    robot.odom_speed = lambda _: speed
    yield from robot.until(lambda: robot.state.still)
    assert robot.control.reason.startswith('odom: ')
    yield from stay_stopped(robot, 0.5)
    robot.odom_speed = lambda true: true
    yield 1.0
    robot.order(COMMANDER)
    yield from driven(robot, 0.3)
