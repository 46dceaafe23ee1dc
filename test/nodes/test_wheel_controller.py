# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wheel controller in virtual time: commands and readings come when the test says."""

from __future__ import annotations

import math

from geometry_msgs.msg import Twist, TwistStamped
import pytest
from smart_tire.control.constants import TICK_PERIOD
from smart_tire.errors import ParameterError
from smart_tire.nodes.wheel_controller import WheelController
from smart_tire.samples import NS_PER_S, VelocityCommand, WheelSample
from std_msgs.msg import Bool
from support.ideal_robot import odometry
from support.virtual_node import virtual

pytestmark = pytest.mark.processes

ZERO = (0.0, 0.0, 0.0, 0.0)
PERIOD = 0.05  # s, of commands and readings
TURNING = [(0.5 - 0.19) / 0.087, (0.5 + 0.19) / 0.087] * 2  # rad/s, of 0.5 m/s and 1 rad/s
PHASES = 50    # of the periods of the node
EXACT = 1e-6   # s, rounding


@pytest.fixture
def controller(isolated_ros):
    with virtual(WheelController) as node:
        yield node


def twist(v_x, yaw_rate=0.0):
    """Return a message as standard teleoperation sends it."""
    message = Twist()
    message.linear.x, message.angular.z = v_x, yaw_rate
    return message


def duty(node):
    """Return the latest duties, zero before the first ones."""
    return node.latest('motor_commands').duty if node.received['motor_commands'] else ZERO


def set_points(node):
    """Return the latest set points."""
    return node.latest('wheel_commands').velocity


def duties(node, before=0):
    """Return the duties sent after those ``before``."""
    return {sample.duty for sample in node.samples('motor_commands')[before:]}


def now(node):
    """Return the time since the start [s]."""
    return node.elapsed_ns / NS_PER_S


def drive(node, seconds=1.0, v_x=0.5, yaw_rate=0.0, speed=1.0, name='cmd_vel', odom=None):
    """Command, and report wheel speeds, for some time; ``odom`` [m/s] is the speed over ground."""
    for _ in range(round(seconds / PERIOD)):
        stamp_ns = node.now_ns()
        node.publish(name, twist(v_x, yaw_rate) if name == 'teleop'
                     else VelocityCommand(stamp_ns, v_x, yaw_rate), topic='cmd_vel')
        node.publish('wheel_states', WheelSample(stamp_ns, (speed,) * 4))
        if odom is not None:
            node.publish('odom', odometry(stamp_ns, v_x=odom))
        node.run(PERIOD)


def test_a_velocity_command_yields_set_points_and_duties_until_it_expires(controller):
    drive(controller, yaw_rate=1.0)
    assert duty(controller)[1] > 0.1
    assert set_points(controller) == pytest.approx(TURNING)
    assert controller.health().values['commanded'] == 'True'
    assert controller.health().values['command_input'] == 'cmd_vel'
    controller.run(3.0)
    assert (set_points(controller), duty(controller)) == (ZERO, ZERO)
    health = controller.health()
    assert 'no recent wheel_states: motors disabled' in health.message
    assert health.values['commanded'] == 'False'


@pytest.mark.parametrize(('silent', 'name', 'timeouts'), [
    ('cmd_vel', 'cmd_vel', {'cmd_vel_timeout': 0.25, 'wheel_states_timeout': 5.0}),
    ('wheel_states', 'cmd_vel', {'cmd_vel_timeout': 9.0, 'wheel_states_timeout': 0.4}),
    ('teleop', 'teleop', {'cmd_vel_timeout': 0.5, 'wheel_states_timeout': 5.0,
                          'cmd_vel_inputs': '[teleop]', 'cmd_vel_types': '[Twist]'})])
@pytest.mark.parametrize('rate', [1.0, 16.0])
def test_zero_duty_after_a_time_out_does_not_wait_for_the_control_step(
        isolated_ros, silent, name, timeouts, rate):
    timeout = timeouts['cmd_vel_timeout' if silent == name else 'wheel_states_timeout']
    with virtual(WheelController, rate=rate, **timeouts) as node:
        for phase in range(PHASES):
            drive(node, 2.0 if rate == 1.0 else 0.5, name=name)
            node.run(phase / PHASES * TICK_PERIOD)
            message = twist(0.5) if name == 'teleop' else VelocityCommand(node.now_ns(), 0.5, 0.0)
            node.publish('wheel_states', WheelSample(node.now_ns(), (1.0,) * 4))
            node.publish(name, message)
            began = now(node)
            assert duty(node) != ZERO
            node.run(2.0, lambda: duty(node) == ZERO)
            assert timeout < now(node) - began <= timeout + TICK_PERIOD + EXACT
        times = node.times['motor_commands']
        assert max(b - a for a, b in zip(times, times[1:])) <= 0.1 + TICK_PERIOD + EXACT


def test_after_an_emergency_stop_the_controller_needs_a_new_command(controller):
    drive(controller)
    controller.publish('emergency_stop_active', Bool(data=True))
    assert (set_points(controller), duty(controller)) == (ZERO, ZERO)  # at once
    count = len(controller.received['motor_commands'])
    drive(controller)
    assert 'emergency stop' in controller.health().message
    controller.publish('emergency_stop_active', Bool(data=False))
    controller.publish('wheel_states', WheelSample(controller.now_ns(), (1.0,) * 4))
    controller.run(0.2)
    assert duties(controller, count) == {ZERO}
    drive(controller)
    assert duty(controller) != ZERO


def test_the_integrals_do_not_wind_up_while_the_motors_are_disabled(controller):
    controller.publish('motors_enabled', Bool(data=False))
    drive(controller, 3.0, speed=0.0)
    assert 0.0 < max(one[0] for one in duties(controller, 8)) < 0.5
    controller.publish('motors_enabled', Bool(data=True))
    drive(controller, 3.0, speed=0.0)
    assert duty(controller)[0] > 0.6


def test_a_command_that_is_not_finite_is_counted_and_ignored(controller):
    bad = TwistStamped()
    bad.twist.linear.x = math.nan
    controller.publish('cmd_vel', bad)
    health = controller.health()
    assert (health.values['frames_bad'], health.values['commanded']) == ('1', 'False')
    assert 'twist.linear is [nan' in controller.log.lines[0]
    drive(controller)
    assert set_points(controller) != ZERO


def test_timestamps_of_wheel_states_are_not_checked(controller):
    for _ in range(20):
        controller.publish('cmd_vel', VelocityCommand(controller.now_ns(), 0.5, 0.0))
        controller.publish('wheel_states', WheelSample(1, (1.0,) * 4))
        controller.run(PERIOD)
    assert duty(controller) != ZERO


@pytest.mark.parametrize(('parameters', 'text'), [
    ({'cmd_vel_inputs': '[a, a]'}, 'expected one topic or more, each once'),
    ({'cmd_vel_inputs': '[a, b]'}, r'cmd_vel_priorities: \[0\], expected one for each of'),
    ({'cmd_vel_types': '[Twist, Twist]'}, r"cmd_vel_types: \['Twist', 'Twist'\], expected one"),
    ({'cmd_vel_types': '[Pose]'}, 'expected one of TwistStamped, Twist'),
    ({'cmd_vel_timeouts': '[1.0, 2.0]'}, r'cmd_vel_timeouts: \[1.0, 2.0\], expected one for each'),
])
def test_inconsistent_command_inputs_are_refused(isolated_ros, parameters, text):
    with pytest.raises(ParameterError, match=text), virtual(WheelController, **parameters):
        pass


def test_gains_can_be_changed_at_run_time_and_other_parameters_cannot(controller):
    assert controller.set_parameter('pid.limit', 0.0)
    assert not controller.set_parameter('pid.limit', 2.0)
    assert not controller.set_parameter('wheel_radius', 0.1)
    for value in (1e308, 0.0):
        assert not controller.set_parameter('pid.feed_forward', value)
    assert not controller.set_parameter('pid.stall_torque', 0.2)  # less than the friction
    drive(controller)
    assert set_points(controller) != ZERO
    assert duties(controller) == {ZERO}


@pytest.fixture
def unstamped(isolated_ros):
    with virtual(WheelController, wheel_states_timeout=5.0, cmd_vel_timeout=0.5,
                 cmd_vel_inputs='[teleop, nav]', cmd_vel_priorities='[10, 0]',
                 cmd_vel_types='[Twist, TwistStamped]') as node:
        yield node


def test_plain_twists_have_their_priority_until_they_expire(unstamped):
    for _ in range(20):
        command = VelocityCommand(unstamped.now_ns(), 0.2, 0.0)
        unstamped.publish('nav', command, topic='cmd_vel')
        drive(unstamped, PERIOD, yaw_rate=1.0, name='teleop')
    assert set_points(unstamped) == pytest.approx(TURNING)
    assert 'no timestamp' not in str(unstamped.log.lines)  # they never have one
    drive(unstamped, 1.0, v_x=0.2, name='nav')
    assert set_points(unstamped) == pytest.approx([0.2 / 0.087] * 4)
    unstamped.publish('teleop', twist(math.nan))
    assert unstamped.health().values['frames_bad'] == '1'
    assert 'linear is [nan' in unstamped.log.lines[-1]


def test_plain_twists_that_were_queued_while_the_process_was_stopped_are_refused(unstamped):
    drive(unstamped, name='teleop')
    unstamped.stall(0.6)
    count = len(unstamped.received['motor_commands'])
    for _ in range(10):
        unstamped.publish('teleop', twist(0.5), sent=0.6)
    unstamped.run(0.5)
    assert 'was queued' in str(unstamped.log.lines)
    assert duties(unstamped, count) == {ZERO}


def test_traction_control_is_switched_on_and_off_at_run_time(controller):
    """On unknown ground at 0.1 m/s set points are limited; without odom they are not."""
    wanted = pytest.approx(0.8 / 0.087)
    drive(controller, 2.0, 0.8)
    assert set_points(controller)[0] == wanted
    assert controller.health().values['traction.active'] == 'False'
    assert controller.set_parameter('traction.enabled', True)
    drive(controller, 2.0, 0.8, odom=0.1)
    assert 0.0 < set_points(controller)[0] < 0.4 / 0.087
    values = controller.health().values
    assert (values['traction.limiting'], values['traction.reason']) == ('True', '')
    drive(controller, 2.0, 0.8)
    assert set_points(controller)[0] == wanted
    assert 'no traction control: odom is' in controller.health().message
    assert controller.set_parameter('traction.enabled', False)
    drive(controller, 2.0, 0.8, odom=0.1)
    assert controller.health().values['traction.reason'] == 'disabled'
    assert set_points(controller)[0] == wanted


def test_motors_that_follow_their_duty_late_are_reported(controller):
    """Torques of 5 N m (duty - 0.045 s/rad speed) of the duty 0.2 s before."""
    for step in range(120):
        stamp_ns = controller.now_ns()
        controller.publish('cmd_vel', VelocityCommand(stamp_ns, 1.2 * (step // 20 % 2), 0.0))
        sent = [ZERO] * 5 + [one.duty for one in controller.samples('motor_commands')
                             if one.stamp_ns <= stamp_ns - 0.2 * NS_PER_S]
        controller.publish('wheel_states', WheelSample(
            stamp_ns, (2.0,) * 4, effort=tuple(5.0 * (one - 0.09) for one in sent[-1])))
        controller.run(PERIOD)
    health = controller.health()
    assert 0.15 < float(health.values['motor_delay']) < 0.25
    assert 'motors follow their duty 0.' in health.message


def test_parameters_have_ros_descriptions(controller):
    radius, limit, center, reliability = controller.describe_parameters(
        ['wheel_radius', 'pid.limit', 'center_of_mass', 'reliability'])
    assert radius.description == 'effective rolling radius [m]'
    assert radius.read_only
    assert radius.floating_point_range[0].from_value == 0.001
    assert not limit.read_only
    assert center.additional_constraints == '3 values, -5 to 5 m'
    assert reliability.additional_constraints == 'one of reliable, best_effort'


def test_commands_of_another_type_are_reported_once(controller):
    text = ('cmd_vel: geometry_msgs/msg/Twist of /teleop not received, expected '
            'geometry_msgs/msg/TwistStamped')
    controller.publishers_of['cmd_vel'] = {b'1': 'teleop'}
    controller.types_of['cmd_vel'] = 'geometry_msgs/msg/Twist'
    controller.run(3.0)
    assert text in controller.health().message
    assert str(controller.log.lines).count(text) == 1
    del controller.publishers_of['cmd_vel']
    assert text not in controller.health().message


@pytest.mark.parametrize('phase', [0.0, 0.2, 0.45, 0.7, 0.95])
def test_a_command_queued_in_a_stall_is_refused_also_after_silence_at_any_phase(controller, phase):
    controller.run(3.0 + phase)
    controller.stall(0.4)
    old = VelocityCommand(controller.now_ns() - 300_000_000, 0.5, 0.0)
    controller.publish('cmd_vel', old, sent=0.3)
    assert controller.inputs['cmd_vel'].bad == 1
    assert 'old, expected at most 0.25 s' in controller.inputs['cmd_vel'].latest
    controller.publish('cmd_vel', VelocityCommand(controller.now_ns(), 0.5, 0.0))
    assert controller.health().values['commanded'] == 'True'


def test_the_first_command_after_silence_is_used_with_and_without_a_timestamp(controller):
    """``ros2 topic pub --once`` sends a TwistStamped without a timestamp."""
    for stamp_ns in (0, controller.now_ns() + round(8.0 * NS_PER_S)):
        controller.run(4.0)
        controller.publish('wheel_states', WheelSample(controller.now_ns(), ZERO))
        controller.publish('cmd_vel', VelocityCommand(stamp_ns, 0.5, 0.0))
        health = controller.health()
        assert controller.inputs['cmd_vel'].bad == controller.inputs['wheel_states'].bad == 0
        assert health.values['commanded'] == 'True'
        assert 'no recent wheel_states' not in health.message


def test_the_control_wakes_up_while_there_is_a_command(controller):
    controller.run(3.0)
    controller.publish('cmd_vel', VelocityCommand(controller.now_ns(), 0.5, 0.0))
    begin = len(controller.times['wheel_commands'])
    controller.run(0.24)
    assert len(controller.times['wheel_commands']) - begin in (3, 4)  # 16 Hz
    controller.run(2.0)  # the command has expired, and there are no readings that wake it
    after = len(controller.times['wheel_commands'])
    controller.run(5.0)  # it looks for stalls ten times a second
    assert len(controller.times['wheel_commands']) == pytest.approx(after + 50, abs=2)
    assert duty(controller) == ZERO
