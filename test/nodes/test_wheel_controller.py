"""The wheel controller as a process."""

from __future__ import annotations

import math

from geometry_msgs.msg import TwistStamped
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue

from smart_tire.samples import VelocityCommand, WheelSample

NOTHING = (0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def controller(graph):
    graph.listen('wheel_commands', 'motor_commands')
    with graph.start('wheel_controller', cmd_vel_timeout=2.0, wheel_states_timeout=2.0) as node:
        graph.until(lambda: 'wheel_controller' in graph.health)
        yield node
        assert node.end() == 0


def driving(graph, v_x=0.5, yaw_rate=0.0):
    """Return what keeps the robot driving: a command and wheel speeds."""
    def say():
        graph.say('cmd_vel', VelocityCommand(1, v_x, yaw_rate))
        graph.say('wheel_states', WheelSample(1, (1.0, 1.0, 1.0, 1.0)))

    return say


def latest(graph):
    """Return the newest set points and duties, as if nothing was commanded before any came."""
    wheels, motors = graph.heard['wheel_commands'], graph.heard['motor_commands']
    return (graph.samples('wheel_commands')[-1].velocity if wheels else NOTHING,
            graph.samples('motor_commands')[-1].duty if motors else NOTHING)


def test_a_velocity_becomes_set_points_and_duties_until_it_ceases(graph, controller):
    graph.until(lambda: latest(graph)[1][1] > 0.1, driving(graph, 0.5, 1.0))
    assert latest(graph)[0] == pytest.approx([(0.5 - 0.19) / 0.087, (0.5 + 0.19) / 0.087] * 2)
    graph.until(lambda: latest(graph) == (NOTHING, NOTHING))
    graph.until(lambda: 'wheel speeds are unknown' in graph.complaint('wheel_controller'))


def test_the_emergency_stop_holds_until_it_is_released(graph, controller):
    graph.until(lambda: latest(graph)[0] != NOTHING, driving(graph))
    assert graph.call('std_srvs/srv/SetBool', 'emergency_stop', data=True).success
    graph.until(lambda: latest(graph) == (NOTHING, NOTHING))
    seen = len(graph.heard['motor_commands'])
    graph.until(lambda: len(graph.heard['motor_commands']) >= seen + 8, driving(graph))
    assert {sample.duty for sample in graph.samples('motor_commands')[seen:]} == {NOTHING}
    graph.until(lambda: 'emergency stop' in graph.complaint('wheel_controller'))
    assert graph.call('std_srvs/srv/SetBool', 'emergency_stop', data=False).success
    graph.until(lambda: latest(graph)[0] != NOTHING, driving(graph))


def test_a_command_that_is_no_number_is_counted_and_ignored(graph, controller):
    bad = TwistStamped()
    bad.twist.linear.x = math.nan
    graph.say_message('cmd_vel', bad)
    graph.until(lambda: graph.value('wheel_controller', 'frames_bad') == '1')
    assert graph.value('wheel_controller', 'commanded') == 'False'
    assert 'twist.linear is [nan' in controller.output
    graph.until(lambda: latest(graph)[0] != NOTHING, driving(graph))


def set_parameter(graph, name, value):
    """Set a number of the controller by the service that ``ros2 param set`` uses."""
    parameter = Parameter(name=name, value=ParameterValue(
        type=ParameterType.PARAMETER_DOUBLE, double_value=value))
    (result,) = graph.call('rcl_interfaces/srv/SetParameters', 'wheel_controller/set_parameters',
                           parameters=[parameter]).results
    return result


def test_gains_change_while_running_and_what_is_fixed_does_not(graph, controller):
    assert set_parameter(graph, 'pid.limit', 0.0).successful
    assert not set_parameter(graph, 'pid.limit', 2.0).successful
    assert not set_parameter(graph, 'wheel_radius', 0.1).successful
    graph.until(lambda: latest(graph)[0] != NOTHING, driving(graph))
    seen = len(graph.heard['motor_commands'])
    graph.until(lambda: len(graph.heard['motor_commands']) >= seen + 8, driving(graph))
    assert {sample.duty for sample in graph.samples('motor_commands')} == {NOTHING}


def test_parameters_describe_themselves(graph, controller):
    names = ['wheel_radius', 'pid.limit', 'center_of_mass', 'reliability']
    described = {item.name: item for item in graph.call(
        'rcl_interfaces/srv/DescribeParameters', 'wheel_controller/describe_parameters',
        names=names).descriptors}
    radius = described['wheel_radius']
    assert radius.description == 'effective rolling radius [m]'
    assert radius.read_only
    assert radius.floating_point_range[0].from_value == 0.001
    assert not described['pid.limit'].read_only
    assert described['center_of_mass'].additional_constraints == '3 values'
    assert described['reliability'].additional_constraints == 'one of reliable, best_effort'
