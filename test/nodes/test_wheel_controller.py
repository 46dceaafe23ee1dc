# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wheel controller as a process."""

from __future__ import annotations

import math
import signal
import time

from geometry_msgs.msg import Twist, TwistStamped
import pytest
from smart_tire.nodes.qos import latched
from smart_tire.samples import Odometry, VelocityCommand, WheelSample
from std_msgs.msg import Bool

pytestmark = pytest.mark.processes

NODE = 'wheel_controller'
ZERO = (0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def controller(graph):
    graph.subscribe('wheel_commands', 'motor_commands')
    with graph.start('wheel_controller', wheel_states_timeout=2.0) as node:
        graph.until(lambda: 'wheel_controller' in graph.health)
        yield node
        assert node.end() == 0


def driving(graph, v_x=0.5, yaw_rate=0.0, speed=1.0):
    """Return a function that publishes a command and wheel speeds."""
    def publish():
        graph.publish('cmd_vel', VelocityCommand(time.time_ns(), v_x, yaw_rate))
        graph.publish('wheel_states', WheelSample(time.time_ns(), (speed,) * 4))

    return publish


def latest(graph):
    """Return the latest set points and duties, zero before the first ones."""
    wheels, motors = graph.received['wheel_commands'], graph.received['motor_commands']
    return (graph.samples('wheel_commands')[-1].velocity if wheels else ZERO,
            graph.samples('motor_commands')[-1].duty if motors else ZERO)


def test_a_velocity_command_yields_set_points_and_duties_until_it_expires(graph, controller):
    graph.until(lambda: latest(graph)[1][1] > 0.1, driving(graph, 0.5, 1.0))
    assert latest(graph)[0] == pytest.approx([(0.5 - 0.19) / 0.087, (0.5 + 0.19) / 0.087] * 2)
    graph.until(lambda: latest(graph) == (ZERO, ZERO))
    graph.until(lambda: 'no recent wheel_states: motors disabled'
                in graph.status_message('wheel_controller'))
    assert graph.value('wheel_controller', 'commanded') == 'False'


def test_zero_duty_after_an_expired_command_does_not_wait_for_the_control_step(graph):
    graph.subscribe('motor_commands')
    with graph.start('wheel_controller', rate=1.0, wheel_states_timeout=5.0,
                     cmd_vel_timeout=1.5) as node:
        graph.until(lambda: latest(graph)[1] != ZERO, driving(graph))
        ended, before = time.monotonic(), len(graph.received['motor_commands'])
        graph.until(lambda: latest(graph)[1] == ZERO)
        assert len(graph.received['motor_commands']) - before >= 8  # motor_driver's is 0.25 s
        assert 1.3 < time.monotonic() - ended < 1.5 + 0.15
        assert node.end() == 0


def test_zero_duty_without_wheel_states_does_not_wait_for_the_control_step(graph):
    graph.subscribe('motor_commands')
    with graph.start('wheel_controller', rate=1.0, wheel_states_timeout=1.5,
                     cmd_vel_timeout=9.0) as node:
        graph.until(lambda: latest(graph)[1] != ZERO, driving(graph))
        ended = time.monotonic()
        graph.until(lambda: latest(graph)[1] == ZERO)
        assert 1.3 < time.monotonic() - ended < 1.5 + 0.15
        assert node.end() == 0


def state(graph, topic, value):
    """Publish a state of motor_driver, transient local, and return the publisher."""
    publisher = graph.node.create_publisher(Bool, topic, latched())
    publisher.publish(Bool(data=value))
    return publisher


def test_after_an_emergency_stop_the_controller_needs_a_new_command(graph):
    graph.subscribe('wheel_commands', 'motor_commands')
    with graph.start('wheel_controller', wheel_states_timeout=5.0, cmd_vel_timeout=5.0) as node:
        graph.until(lambda: latest(graph)[1] != ZERO, driving(graph))
        stop = state(graph, 'emergency_stop_active', True)
        graph.until(lambda: latest(graph) == (ZERO, ZERO))
        before = len(graph.received['motor_commands'])
        graph.until(lambda: len(graph.received['motor_commands']) >= before + 8, driving(graph))
        assert {sample.duty for sample in graph.samples('motor_commands')[before:]} == {ZERO}
        graph.until(lambda: 'emergency stop' in graph.status_message('wheel_controller'))
        stop.publish(Bool(data=False))
        before = len(graph.received['motor_commands'])
        graph.until(lambda: len(graph.received['motor_commands']) >= before + 8)
        assert {sample.duty for sample in graph.samples('motor_commands')[before:]} == {ZERO}
        graph.until(lambda: latest(graph)[1] != ZERO, driving(graph))
        assert node.end() == 0


def test_the_integrals_do_not_wind_up_while_the_motors_are_disabled(graph, controller):
    disabled = state(graph, 'motors_enabled', False)
    graph.until(lambda: latest(graph)[1] != ZERO, driving(graph, speed=0.0))
    before = len(graph.received['motor_commands'])
    graph.until(lambda: len(graph.received['motor_commands']) >= before + 24,
                driving(graph, speed=0.0))
    assert max(sample.duty[0] for sample in graph.samples('motor_commands')[before + 8:]) < 0.5
    disabled.publish(Bool(data=True))
    graph.until(lambda: latest(graph)[1][0] > 0.6, driving(graph, speed=0.0))


def test_a_command_that_is_not_finite_is_counted_and_ignored(graph, controller):
    bad = TwistStamped()
    bad.twist.linear.x = math.nan
    graph.publish_message('cmd_vel', bad)
    graph.until(lambda: graph.value('wheel_controller', 'frames_bad') == '1')
    assert graph.value('wheel_controller', 'commanded') == 'False'
    assert 'twist.linear is [nan' in controller.output
    graph.until(lambda: latest(graph)[0] != ZERO, driving(graph))
    graph.until(lambda: graph.value('wheel_controller', 'commanded') == 'True', driving(graph))
    assert graph.value('wheel_controller', 'command_input') == 'cmd_vel'


def test_wheel_states_at_a_low_rate_and_from_another_clock_are_used(graph, controller):
    """Timestamps of wheel_states are not checked; time-outs count from their arrival."""
    def publish():
        graph.publish('cmd_vel', VelocityCommand(time.time_ns(), 0.5, 0.0))
        graph.publish('wheel_states', WheelSample(1, (1.0,) * 4))

    graph.until(lambda: latest(graph)[1] != ZERO, publish)


@pytest.mark.parametrize(('parameters', 'text'), [
    ({'cmd_vel_inputs': '[a, a]'}, 'expected one topic or more, each once'),
    ({'cmd_vel_inputs': '[a, b]'}, 'cmd_vel_priorities: [0], expected one for each of'),
    ({'cmd_vel_types': '[Twist, Twist]'}, "cmd_vel_types: ['Twist', 'Twist'], expected one"),
    ({'cmd_vel_types': '[Pose]'}, 'expected one of TwistStamped, Twist'),
    ({'cmd_vel_timeouts': '[1.0, 2.0]'}, 'cmd_vel_timeouts: [1.0, 2.0], expected one for each'),
])
def test_inconsistent_command_inputs_are_refused(graph, parameters, text):
    with graph.start('wheel_controller', **parameters) as node:
        assert node.ended() == 2
        assert text in node.output


def test_gains_can_be_changed_at_run_time_and_other_parameters_cannot(graph, controller):
    assert graph.set_parameter(NODE, 'pid.limit', 0.0)
    assert not graph.set_parameter(NODE, 'pid.limit', 2.0)
    assert not graph.set_parameter(NODE, 'wheel_radius', 0.1)
    for value in (1e308, 0.0):
        assert not graph.set_parameter(NODE, 'pid.feed_forward', value)
    assert not graph.set_parameter(NODE, 'pid.stall_torque', 0.2)  # less than the friction
    graph.until(lambda: latest(graph)[0] != ZERO, driving(graph))
    before = len(graph.received['motor_commands'])
    graph.until(lambda: len(graph.received['motor_commands']) >= before + 8, driving(graph))
    assert {sample.duty for sample in graph.samples('motor_commands')} == {ZERO}


def twist(v_x, yaw_rate=0.0):
    """Return a message as standard teleoperation sends it."""
    message = Twist()
    message.linear.x, message.angular.z = v_x, yaw_rate
    return message


@pytest.fixture
def unstamped(graph):
    graph.subscribe('wheel_commands', 'motor_commands')
    with graph.start('wheel_controller', wheel_states_timeout=5.0, cmd_vel_timeout=0.5,
                     cmd_vel_inputs='[teleop, nav]', cmd_vel_priorities='[10, 0]',
                     cmd_vel_types='[Twist, TwistStamped]') as node:
        graph.until(lambda: 'wheel_controller' in graph.health)
        yield node
        assert node.end() == 0


def test_plain_twists_drive_until_they_expire(graph, unstamped):
    def publish():
        graph.publish_message('teleop', twist(0.5, 1.0))
        graph.publish_as('nav', 'cmd_vel', VelocityCommand(time.time_ns(), 0.2, 0.0))
        graph.publish('wheel_states', WheelSample(time.time_ns(), (1.0,) * 4))

    wanted = pytest.approx([(0.5 - 0.19) / 0.087, (0.5 + 0.19) / 0.087] * 2)
    # nav may be discovered before teleop
    graph.until(lambda: latest(graph)[0] == wanted and latest(graph)[1][1] > 0.1, publish)
    ended = time.monotonic()
    graph.until(lambda: latest(graph)[1] == ZERO)
    assert 0.3 < time.monotonic() - ended < 0.5 + 0.15
    assert 'no timestamp' not in unstamped.output  # they never have one
    graph.publish_message('teleop', twist(math.nan))
    graph.until(lambda: graph.value('wheel_controller', 'frames_bad') == '1')
    assert graph.value('wheel_controller', 'commanded') == 'False'
    assert 'linear is [nan' in unstamped.output
    graph.until(lambda: latest(graph)[0][0] == pytest.approx(0.2 / 0.087), lambda: (
        graph.publish_as('nav', 'cmd_vel', VelocityCommand(time.time_ns(), 0.2, 0.0))))


def test_plain_twists_that_were_queued_while_the_process_was_stopped_are_refused(graph, unstamped):
    graph.publish_message('teleop', twist(0.5))
    graph.until(lambda: latest(graph)[0] != ZERO)
    unstamped.popen.send_signal(signal.SIGSTOP)
    stopped = time.monotonic()
    graph.until(lambda: time.monotonic() - stopped > 0.6,
                lambda: graph.publish_message('teleop', twist(0.5)))
    before = len(graph.received['wheel_commands'])
    unstamped.popen.send_signal(signal.SIGCONT)
    graph.until(lambda: 'was queued' in unstamped.output)
    graph.until(lambda: len(graph.received['wheel_commands']) >= before + 4)
    assert {sample.velocity for sample in graph.samples('wheel_commands')[before:]} == {ZERO}


def test_parameters_have_ros_descriptions(graph, controller):
    names = ['wheel_radius', 'pid.limit', 'center_of_mass', 'reliability']
    described = {item.name: item for item in graph.call(
        'rcl_interfaces/srv/DescribeParameters', 'wheel_controller/describe_parameters',
        names=names).descriptors}
    radius = described['wheel_radius']
    assert radius.description == 'effective rolling radius [m]'
    assert radius.read_only
    assert radius.floating_point_range[0].from_value == 0.001
    assert not described['pid.limit'].read_only
    assert described['center_of_mass'].additional_constraints == '3 values, -5 to 5 m'
    assert described['reliability'].additional_constraints == 'one of reliable, best_effort'


def test_traction_control_is_switched_on_and_off_at_run_time(graph, controller):
    """On unknown ground at 0.1 m/s set points are limited; without odom they are not."""
    drive = driving(graph, 0.8)

    def drive_with_odometry():
        drive()
        graph.publish('odom', Odometry(
            time.time_ns(), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.1, 0.0, 0.0),
            (0.0, 0.0, 0.0), (0.0,) * 36, (0.0,) * 36))

    wanted = 0.8 / 0.087
    graph.until(lambda: latest(graph)[0][0] == pytest.approx(wanted), drive)
    assert graph.value('wheel_controller', 'traction.active') == 'False'
    assert graph.set_parameter(NODE, 'traction.enabled', True)
    graph.until(lambda: 0.0 < latest(graph)[0][0] < 0.5 * wanted, drive_with_odometry)
    graph.until(lambda: graph.value('wheel_controller', 'traction.limiting') == 'True',
                drive_with_odometry)
    assert graph.value('wheel_controller', 'traction.reason') == ''
    graph.until(lambda: latest(graph)[0][0] == pytest.approx(wanted), drive)
    graph.until(lambda: 'no traction control: odom is' in graph.status_message(
        'wheel_controller'), drive)
    assert graph.set_parameter(NODE, 'traction.enabled', False)
    graph.until(lambda: graph.value('wheel_controller', 'traction.reason') == 'disabled', drive)
    graph.until(lambda: latest(graph)[0][0] == pytest.approx(wanted), drive_with_odometry)


def test_commands_of_another_type_are_reported_once(graph, controller):
    with_stamp = 'expected geometry_msgs/msg/TwistStamped'
    publisher = graph.node.create_publisher(Twist, 'cmd_vel', 1)
    graph.until(lambda: with_stamp in graph.status_message(NODE),
                lambda: publisher.publish(twist(0.5)))
    for _ in range(2):  # of the diagnostics
        graph.health.clear()
        graph.until(lambda: NODE in graph.health)
    assert controller.output.count(
        f'cmd_vel: geometry_msgs/msg/Twist of /test not received, {with_stamp}') == 1
    graph.node.destroy_publisher(publisher)
    graph.until(lambda: with_stamp not in graph.status_message(NODE))
