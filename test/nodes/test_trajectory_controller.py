# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Trajectory controller as a process, with a robot in the test that moves as commanded."""

from __future__ import annotations

import math
import re
import time

import pytest
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from smart_tire.control.trajectory_control import State
from smart_tire.messages.path import path_to_msg
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.qos import latched
from smart_tire.samples import GoalPose, NAN, NS_PER_S, PlannedPath
from std_msgs.msg import Bool
from support.graph import Graph, node_arguments, Process
from support.moving_robot import LONG, Robot, SHORT
from support.robot_rig import Stranger

pytestmark = pytest.mark.processes

NODE = 'trajectory_controller'
PATH = message_class('nav_msgs/msg/Path')


@pytest.fixture(scope='module')
def running(tmp_path_factory, isolated_ros):
    """Return a robot with a node that the tests share; the node ends while it follows."""
    with Graph(tmp_path_factory.mktemp('graph')) as graph:
        robot = Robot(graph)
        with graph.start(NODE) as robot.node:
            robot.until_state(State.IDLE)
            assert math.isnan(robot.progress.remaining_distance)
            assert math.isnan(robot.progress.cross_track_error)
            yield robot
            robot.until_more_progress()  # the latest odom may be old
            robot.drive()
            assert robot.node.end() == 0
            robot.until(lambda: robot.commands[-1] == (0.0, 0.0))


@pytest.fixture
def robot(running):
    """Return the robot at rest; its log begins with the test."""
    running.is_silent, running.odom_speed = False, None
    before = running.node.output
    running.graph.received['cmd_vel'].clear()
    running.log = lambda: running.node.output.removeprefix(before)
    yield running
    running.graph.call('std_srvs/srv/Trigger', 'cancel_path')


def test_a_path_is_followed_to_its_end_and_then_nothing_is_commanded(robot):
    start = robot.x
    robot.follow(robot.path(SHORT))
    robot.until(lambda: 0.0 < robot.progress.remaining_distance <= SHORT)
    assert robot.progress.state == State.FOLLOWING
    robot.until_state(State.ARRIVED)
    assert robot.x - start == pytest.approx(SHORT, abs=0.1)
    robot.until(lambda: robot.commands[-1] == (0.0, 0.0))
    count = len(robot.commands)
    robot.until_more_progress()
    assert (len(robot.commands), robot.progress.state) == (count, State.ARRIVED)
    assert 'following path: 7 poses' in robot.log()
    assert 'arrived 0.0' in robot.log()


def test_progress_is_published_at_4_hz_with_names_and_frame(robot):
    received = robot.graph.received['path_progress']
    count = len(received)
    robot.until(lambda: len(received) == count + 5)
    first, last = (sample.stamp_ns for sample in robot.graph.samples('path_progress')[-5::4])
    assert (last - first) / NS_PER_S == pytest.approx(1.0, rel=0.2)  # on a busy machine
    assert list(received[-1].name) == ['remaining_distance', 'cross_track_error', 'state']
    assert received[-1].header.frame_id == 'odom'


def test_a_goal_is_driven_to_and_replaces_the_path(robot):
    robot.drive()
    goal = robot.x + SHORT
    robot.graph.publish('goal_pose', GoalPose(time.time_ns(), 'odom', (goal, 0.0, NAN)))
    robot.until_state(State.ARRIVED)
    assert robot.x == pytest.approx(goal, abs=0.1)
    assert re.search(rf'following goal_pose: x {goal:.2f} m, y 0.00 m, 0.[23]. m to drive',
                     robot.log())


@pytest.mark.parametrize(('change', 'reason'), [
    ({'frame': 'map'}, "frame 'map', expected odom"),
    ({'length': 0.0}, '1 poses'),
    ({'length': math.inf}, 'poses[1].pose.position is [nan'),
    ({'stamp_ns': 1}, 's old, expected at most 2 s')], ids=['frame', 'length', 'nan', 'age'])
def test_an_invalid_path_ends_following_with_its_reason(robot, change, reason):
    robot.drive()
    if change.get('length') == math.inf:
        robot.follow(PlannedPath(time.time_ns(), 'odom', ((0.0, 0.0, 0.0), (NAN, 0.0, 0.0))))
    else:
        robot.follow(robot.path(**change))
    robot.assert_stopped(State.REFUSED, f'refused: path: {reason}' if 'old' not in reason
                         else reason)


def test_cancel_path_stops_the_robot_and_says_whether_it_followed(robot):
    cancel = 'std_srvs/srv/Trigger', 'cancel_path'
    robot.drive()
    answer = robot.graph.call(*cancel)
    assert (answer.success, answer.message) == (True, 'stopped')
    robot.assert_stopped(State.STOPPED, 'canceled by cancel_path')
    answer = robot.graph.call(*cancel)
    assert (answer.success, answer.message) == (False, 'no path is followed')


def test_the_robot_stops_soon_when_odom_ends_and_the_diagnostics_have_the_reason(robot):
    robot.drive()
    robot.is_silent, ended = True, time.monotonic()
    robot.until(lambda: robot.speed == 0.0)
    assert 0.3 < time.monotonic() - ended < 0.8  # checks.odom_timeout is 0.5 s
    robot.assert_stopped(State.STOPPED, 'odom')
    robot.until(lambda: robot.graph.value(NODE, 'state') == 'stopped')
    assert robot.graph.status_message(NODE).startswith('stopped: odom')
    assert robot.graph.value(NODE, 'reason') in robot.log()
    robot.is_silent = False
    robot.until_more_progress()
    assert robot.progress.state == State.STOPPED  # also when odom is back


def test_an_emergency_stop_ends_following_until_a_new_path_after_its_release(robot):
    robot.drive()
    stop = robot.graph.node.create_publisher(Bool, 'emergency_stop_active', latched())
    stop.publish(Bool(data=True))
    robot.assert_stopped(State.STOPPED, 'emergency stop')
    robot.follow(robot.path())
    robot.assert_stopped(State.REFUSED, 'the emergency stop is active')
    stop.publish(Bool(data=False))
    robot.until_more_progress()
    assert robot.progress.state == State.REFUSED
    robot.drive()


def test_the_maximum_speed_can_be_changed_while_driving(robot):
    robot.drive()
    assert robot.graph.set_parameter(NODE, 'max_speed', 0.05)
    robot.until(lambda: robot.speed <= 0.06)
    robot.until_more_progress()
    assert (robot.progress.state, robot.speed) == (State.FOLLOWING, pytest.approx(0.05, abs=0.01))
    assert robot.graph.set_parameter(NODE, 'max_speed', 0.6)


def test_the_same_path_again_is_no_new_begin(robot):
    path = robot.path()
    robot.follow(path)
    robot.until(lambda: robot.speed > 0.1)
    for _ in range(3):
        robot.follow(path)
    robot.until_more_progress()
    assert robot.log().count('following path') == 1
    robot.follow(robot.path())
    robot.until(lambda: robot.log().count('following path') == 2)


def test_odometry_that_contradicts_the_wheels_stops_the_robot_within_1_s(robot):
    assert robot.node.output.count('no wheel_states: odom is not compared') == 1
    robot.has_wheels = True
    for speed in (0.0, 0.025):
        robot.drive()
        robot.odom_speed, began = speed, time.monotonic()
        robot.until(lambda: robot.speed == 0.0)
        assert time.monotonic() - began < 1.0
        robot.assert_stopped(State.STOPPED, 'in which the wheels rolled')
        robot.odom_speed, robot.x = None, robot.shown_x
    robot.has_wheels = False
    robot.graph.received['cmd_vel'].clear()


def test_a_path_of_too_many_poses_is_refused_with_their_number_before_it_is_read(robot):
    long = path_to_msg(PATH(), PlannedPath(0, 'odom', tuple(
        (robot.x + 0.005 * index, 0.0, 0.0) for index in range(20_000))))
    robot.until_more_progress()  # the latest odom may be old
    robot.drive()
    robot.graph.publish_message('path', long)
    robot.assert_stopped(State.REFUSED, 'refused: path: 20000 poses, expected at most 5000')
    robot.drive()


def test_bytes_that_are_no_path_are_refused_and_the_node_lives(robot):
    publisher = robot.graph.node.create_publisher(PATH, 'path', latched())
    robot.until(lambda: publisher.get_subscription_count() == 2)
    data = serialize_message(message(0))
    for bad in (data[:50], data[:4] + b'\xff' * 60, b'\0\7' + data[2:]):
        robot.drive()
        robot.graph.received['cmd_vel'].clear()
        publisher.publish(bad)
        robot.until_state(State.REFUSED)
    assert 'bytes are no nav_msgs/Path' in robot.log()
    assert 'path: begins with 00 07 00 00' in robot.log()
    robot.graph.node.destroy_publisher(publisher)


def test_a_goal_of_another_node_takes_over_from_a_path(robot, tmp_path):
    with Stranger(tmp_path, 'goal_pose') as stranger:
        robot.until_more_progress()  # the latest odom may be old
        robot.drive()
        stranger.publish(GoalPose(time.time_ns(), 'odom', (robot.x + SHORT, 0.0, NAN)))
        robot.until_state(State.ARRIVED)
    assert 'publishers' not in robot.log()


@pytest.mark.parametrize('topic', ['path', 'goal_pose'])
def test_a_second_publisher_of_orders_stops_the_robot_and_both_are_named(robot, topic, tmp_path):
    def order():
        return robot.path() if topic == 'path' else GoalPose(
            time.time_ns(), 'odom', (robot.x + LONG, 0.0, NAN))

    with Stranger(tmp_path, topic) as stranger:
        robot.until_more_progress()  # the latest odom may be old
        robot.graph.publish(topic, order())
        robot.until(lambda: robot.speed > 0.1)
        stranger.publish(order())
        robot.assert_stopped(State.REFUSED, f'refused: 2 publishers on {topic}: ')
        both = f'2 publishers on {topic}: /stranger, /test'  # once the name is discovered
        robot.until(lambda: both in robot.log() or stranger.publish(order()))
        robot.graph.publish(topic, order())  # also refused
        robot.until_more_progress()
        assert (robot.progress.state, robot.speed) == (State.REFUSED, 0.0)
    robot.until(lambda: not robot.graph.publish(topic, order()) and robot.speed > 0.1)


def test_after_arrival_the_robot_is_held_by_commands_of_zero_until_a_stop(robot):
    assert robot.graph.set_parameter(NODE, 'hold_on_arrival', True)
    stop = robot.graph.node.create_publisher(Bool, 'emergency_stop_active', latched())
    ends = (lambda: robot.graph.call('std_srvs/srv/Trigger', 'cancel_path'),
            lambda: stop.publish(Bool(data=True)))
    for end in ends:
        robot.follow(robot.path(SHORT))
        robot.until_state(State.ARRIVED)
        count = len(robot.commands)
        robot.until_more_progress()
        assert len(robot.commands) > count + 4
        assert set(robot.commands[count:]) == {(0.0, 0.0)}
        end()
        robot.until_state(State.STOPPED)
        count = len(robot.commands)
        robot.until_more_progress()
        assert len(robot.commands) <= count + 1  # one was on its way
    stop.publish(Bool(data=False))
    assert robot.graph.set_parameter(NODE, 'hold_on_arrival', False)
    robot.until_more_progress()


def message(stamp_ns):
    """Return a path as a message."""
    return path_to_msg(PATH(), PlannedPath(stamp_ns, 'odom', ((0.0, 0.0, NAN), (5.0, 0.0, NAN))))


@pytest.mark.parametrize(('profile', 'matches'), [(latched(), 2), (QoSProfile(depth=1), 1)],
                         ids=['latched', 'volatile'])
def test_a_path_of_any_publisher_is_handled_once(robot, profile, matches):
    publisher = robot.graph.node.create_publisher(PATH, 'path', profile)
    robot.until(lambda: publisher.get_subscription_count() == matches)
    publisher.publish(message(1))
    robot.until(lambda: 'refused: path: ' in robot.log())
    robot.drive()
    assert robot.log().count('refused: path: ') == 1
    robot.graph.node.destroy_publisher(publisher)


def test_a_path_from_before_the_start_is_followed_only_if_it_is_recent(graph, tmp_path):
    """Without a timestamp, its age is counted from its publication."""
    publisher = graph.node.create_publisher(PATH, 'path', latched())
    publisher.publish(message(0))
    nodes = [Process([*node_arguments(NODE), '-p', f'path_max_age:={limit}', '-r',
                      f'__ns:=/{space}', '-r', 'path:=/path'], tmp_path / space)
             for space, limit in (('patient', 60.0), ('strict', 0.1))]
    with nodes[0] as patient, nodes[1] as strict:
        graph.until(lambda: 'following path: 2 poses, without odom' in patient.output)
        graph.until(lambda: 'refused: path: ' in strict.output)
        assert 's old, expected at most 0.1 s' in strict.output
        assert (patient.end(), strict.end()) == (0, 0)
