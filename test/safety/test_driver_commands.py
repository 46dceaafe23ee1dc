"""Duties that are old or no duties at all, at a driver without a controller; command inputs."""

from __future__ import annotations

import math
import signal
import time

import pytest
from sensor_msgs.msg import JointState
from support.robot_rig import RobotRig

from smart_tire.samples import MotorCommand, NS_PER_S, WHEELS

HOUR = 3600 * NS_PER_S


@pytest.mark.parametrize('duty', [math.nan, math.inf, 1e308, 1.5])
def test_a_duty_that_is_none_is_refused_by_the_driver(tmp_path, isolated_ros, duty):
    with RobotRig(tmp_path, controller=False) as robot:
        bad = JointState(name=list(WHEELS), effort=[0.5, duty, 0.5, 0.5])
        robot.stay_stopped(0.6, lambda: robot.graph.say_message('motor_commands', bad))
        robot.graph.until(lambda: int(robot.graph.value(
            'motor_driver', 'motor_commands.rejected') or 0) > 0)
        # one that is good drives, so that it was the number
        robot.graph.until(lambda: min(robot.rig.state().duty) > 0.4,
                          lambda: duties(robot, 0.5))


def duties(robot, value, stamp_ns=0):
    """Publish motor_commands as wheel_controller would."""
    robot.graph.say('motor_commands', MotorCommand(stamp_ns, (value,) * 4))


@pytest.mark.parametrize('age_ns', [-HOUR, HOUR, 700_000_000])
def test_a_duty_from_another_time_is_refused_by_the_driver(tmp_path, isolated_ros, age_ns):
    with RobotRig(tmp_path, controller=False) as robot:
        robot.stay_stopped(0.6, lambda: duties(robot, 0.5, time.time_ns() - age_ns))
        robot.graph.until(lambda: min(robot.rig.state().duty) > 0.4,
                          lambda: duties(robot, 0.5, time.time_ns()))


def test_duties_queued_while_the_driver_was_stopped_move_nothing(tmp_path, isolated_ros):
    with RobotRig(tmp_path, controller=False) as robot:
        robot.graph.until(lambda: min(robot.rig.state().duty) > 0.4, lambda: duties(robot, 0.5))
        driver = robot.processes['motor_driver'].popen
        driver.send_signal(signal.SIGSTOP)
        stopped = time.monotonic()
        assert robot.until_stopped(stopped, lambda: duties(robot, 0.5)) < 0.5
        robot.hold(1.0, lambda: duties(robot, 0.5))
        robot.hold(0.6)
        driver.send_signal(signal.SIGCONT)
        robot.stay_stopped(0.8, lambda: None)


def test_the_input_of_higher_priority_wins_while_it_is_fresh(tmp_path, isolated_ros):
    with RobotRig(tmp_path, controller=False) as robot:
        robot.start('wheel_controller', cmd_vel_inputs='[teleop/cmd_vel, nav/cmd_vel]',
                    cmd_vel_priorities='[10, 5]', cmd_vel_timeouts='[0.5, 0.2]')
        graph = robot.graph

        def both(teleop, nav):
            if teleop is not None:
                graph.say_on('teleop/cmd_vel', 'cmd_vel', robot.velocity(teleop))
            graph.say_on('nav/cmd_vel', 'cmd_vel', robot.velocity(nav))

        graph.until(lambda: min(robot.rig.state().speeds) > 3.0, lambda: both(None, 0.5))
        graph.until(lambda: max(robot.rig.state().speeds) < -3.0, lambda: both(-0.5, 0.5))
        ended = time.monotonic()
        graph.until(lambda: min(robot.rig.state().speeds) > 3.0, lambda: both(None, 0.5))
        assert time.monotonic() - ended > 0.5
        ended = time.monotonic()
        assert robot.until_stopped(ended, lambda: None) < 0.2 + 0.1
