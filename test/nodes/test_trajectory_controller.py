# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Trajectory controller: in virtual time, with a robot that moves as commanded, and over DDS."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from smart_tire.control.trajectory_control import PathState
from smart_tire.errors import ParameterError
from smart_tire.mapping.raster import Raster, write_raster
from smart_tire.messages.path import path_to_msg
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.qos import latched
from smart_tire.nodes.trajectory_controller import TrajectoryController
from smart_tire.samples import GoalPose, NAN, PlannedPath
from std_msgs.msg import Bool
from support.graph import Graph
from support.moving_robot import LONG, Robot, SHORT
from support.robot_rig import Stranger
from support.virtual_node import TEST, virtual

pytestmark = pytest.mark.processes

NODE = 'trajectory_controller'
PATH = message_class('nav_msgs/msg/Path')
PERIOD_NS = 50_000_000  # of the control
POLL_NS = 1_000_000     # of the robot
PHASES = 10             # of the control; test/control/test_following_time.py has more


@pytest.fixture
def node(isolated_ros):
    """Return a node in virtual time."""
    with virtual(TrajectoryController, follow_path='false') as made:
        yield made


@pytest.fixture
def robot(node):
    """Return a robot at rest, whose odometry is received."""
    made = Robot(node)
    made.log = lambda: '\n'.join(node.log.lines)
    made.until(lambda: 'receiving odom' in made.log())
    return made


def goal(robot, distance):
    """Return a goal straight ahead."""
    return GoalPose(robot.graph.now_ns(), 'odom', (robot.x + distance, 0.0, NAN))


def test_a_path_is_followed_to_its_end_and_then_nothing_is_commanded(node, robot):
    assert math.isnan(robot.progress.remaining_distance)
    robot.follow(robot.path(SHORT))
    robot.until(lambda: 0.0 < robot.progress.remaining_distance <= SHORT)
    assert robot.progress.state == PathState.FOLLOWING
    robot.until_state(PathState.ARRIVED)
    assert robot.x == pytest.approx(SHORT, abs=0.1)
    assert robot.speed == 0.0
    count = len(robot.commands)
    node.run(2.0)
    assert (len(robot.commands), robot.progress.state) == (count, PathState.ARRIVED)
    followed, warning, arrived = node.log.lines[-3:]
    assert followed == 'following path: 7 poses, 0.30 m to drive'
    assert 'no wheel_states: odom is not compared' in warning
    assert arrived.startswith('arrived 0.0')


def test_progress_is_published_at_4_hz_or_1_hz_without_input_with_names_and_frame(node, robot):
    robot.until(lambda: node.elapsed_ns >= 10_000_000_000)
    times = [*node.times['path_progress']]
    assert times == pytest.approx([0.25 * (k + 1) for k in range(40)], abs=0.03)  # by messages
    robot.is_silent = True
    node.run(10.0)
    assert len(node.times['path_progress']) == len(times) + 10
    message = node.received['path_progress'][-1]
    assert list(message.name) == ['remaining_distance', 'cross_track_error', 'state']
    assert message.header.frame_id == 'odom'


def test_a_path_of_one_pose_where_the_robot_is_ends_at_once_and_farther_away_is_driven_to(
        node, robot):
    robot.follow(robot.path(0.0))
    robot.until_state(PathState.ARRIVED)
    assert robot.x == 0.0
    assert 'following path: one pose, 0.00 m to drive' in robot.log()
    robot.follow(PlannedPath(node.now_ns(), 'odom', ((SHORT, 0.0, NAN),)))
    robot.until_state(PathState.ARRIVED)
    assert robot.x == pytest.approx(SHORT, abs=0.1)


@pytest.mark.parametrize('publisher', [TEST, b'another'])
def test_a_goal_is_driven_to_and_replaces_the_path(node, robot, publisher):
    robot.drive()
    order = goal(robot, SHORT)
    node.publish('goal_pose', order, publisher=publisher)
    robot.until_state(PathState.ARRIVED)
    assert robot.x == pytest.approx(order.pose[0], abs=0.1)
    assert re.search(rf'following goal_pose: x {order.pose[0]:.2f} m, y 0.00 m, 0.[23]. m to dri',
                     robot.log())
    assert 'publishers' not in robot.log()


@pytest.mark.parametrize(('change', 'reason'), [
    ({'frame': 'map'}, "refused: path: frame 'map', expected odom"),
    ({'length': -0.05}, 'refused: path: 0 poses, expected 1 to 5000'),
    ({'length': 251.0}, 'refused: path: 5021 poses, expected at most 5000'),
    ({'age': 2.01}, 'refused: path: 2.01 s old, expected at most 2 s'),
    ({'age': -2.01}, 'refused: path: 2.01 s ahead, expected at most 2 s')],
    ids=['frame', 'length', 'poses', 'age', 'ahead'])
def test_an_invalid_path_ends_following_with_its_reason(node, robot, change, reason):
    robot.drive()
    age = change.pop('age', 0.0)
    robot.follow(robot.path(stamp_ns=node.now_ns() - round(age * 1e9), **change))
    robot.assert_stopped(PathState.REFUSED, reason)
    robot.drive()


def test_bytes_that_are_no_path_are_refused_and_the_node_lives(node, robot):
    data = serialize_message(message(0))
    for bad, reason in ((data[:50], 'bytes are no nav_msgs/Path'), (data[:4] + b'\xff' * 60, ''),
                        (b'\0\7' + data[2:], 'path: begins with 00 07 00 00'),
                        (message(0, NAN), 'poses[1].pose.position is [nan')):
        robot.drive()
        node.publish('path', bad)
        robot.assert_stopped(PathState.REFUSED, reason)


def test_cancel_path_stops_the_robot_and_says_whether_it_followed(node, robot):
    robot.drive()
    answer = node.call('cancel_path')
    assert (answer.success, answer.message) == (True, 'stopped')
    robot.assert_stopped(PathState.STOPPED, 'canceled by cancel_path')
    answer = node.call('cancel_path')
    assert (answer.success, answer.message) == (False, 'no path is followed')


@pytest.mark.parametrize('rate', [4.0, 50.0, 200.0])
def test_the_robot_stops_when_odom_is_older_than_its_time_out_at_any_phase(node, robot, rate):
    for phase in range(PHASES):
        robot = Robot(node, rate)
        robot.log = lambda: node.log.lines[-1]
        robot.until(lambda: robot.sent_ns)  # noqa: B023
        node.run(phase * PERIOD_NS / PHASES * 1e-9)
        robot.drive()
        robot.is_silent = True
        robot.until(lambda: robot.speed == 0.0)  # noqa: B023
        late_ns = node.now_ns() - robot.sent_ns - 500_000_000  # checks.odom_timeout
        assert 0 < late_ns <= PERIOD_NS + POLL_NS
    robot.assert_stopped(PathState.STOPPED, 'stopped: odom: ')
    health = node.health()
    assert 'stopped: odom' in health.message
    assert health.values['state'] == 'stopped'
    assert any(health.values['reason'] in line for line in node.log.lines[-2:])
    robot.is_silent = False
    robot.until_more_progress()
    assert robot.progress.state == PathState.STOPPED  # also when odom is back


def test_a_stop_for_late_odom_on_a_late_host_names_the_host_only(node, robot):
    robot.drive()
    node.starve(0.7)
    node.run(0.1)
    assert robot.speed == 0.0
    robot.until_more_progress()
    assert robot.progress.state == PathState.STOPPED
    line, = (line for line in node.log.lines if 'stopped' in line)
    assert re.fullmatch(r'warning: stopped: timers late by [4-7]\d\d ms \(99%\), load \S+ on \S+ '
                        'cores: end other programs', line)
    health = node.health()
    assert health.message.startswith('timers late by') and ';' not in health.message
    assert (health.values['state'], health.values['cause']) == ('stopped', 'late')
    node.run(15.0)  # the host is no longer late
    assert node.health().message.startswith('no odom; stopped: timers late by')
    assert node.health().values['reason'].startswith('timers late by')


@pytest.mark.parametrize('waited', [0.0, 0.4])
def test_a_stop_without_waiting_for_a_core_or_by_order_is_not_that_of_the_host(
        node, robot, waited):
    robot.drive()
    node.stall(0.7)
    node.run(0.1)
    assert node.log.lines[-1].startswith('warning: stopped: odom: 0.')
    robot.until_more_progress()
    robot.drive()
    node.starve(waited)
    assert node.call('cancel_path').success
    assert node.log.lines[-1] == 'warning: stopped: canceled by cancel_path'
    assert node.health().values['reason'] == 'canceled by cancel_path'
    assert node.health().message.endswith('stopped: canceled by cancel_path')
    assert node.health().message.startswith('timers late by') is bool(waited)


def test_an_emergency_stop_ends_following_until_a_new_path_after_its_release(node, robot):
    robot.drive()
    node.publish('emergency_stop_active', Bool(data=True))
    assert robot.speed == 0.0  # at once
    robot.assert_stopped(PathState.STOPPED, 'emergency stop')
    robot.follow()
    robot.assert_stopped(PathState.REFUSED, 'the emergency stop is active')
    node.publish('emergency_stop_active', Bool(data=False))
    robot.until_more_progress()
    assert robot.progress.state == PathState.REFUSED
    robot.drive()


def test_the_maximum_speed_can_be_changed_while_driving(node, robot):
    robot.drive()
    assert node.set_parameter('max_speed', 0.05)
    robot.until(lambda: robot.speed <= 0.06)
    robot.until_more_progress()
    assert (robot.progress.state, robot.speed) == (
        PathState.FOLLOWING, pytest.approx(0.05, abs=0.01))


def test_the_same_path_again_is_no_new_begin(robot):
    path = robot.path()
    for _ in range(4):
        robot.follow(path)
        robot.until_more_progress()
    assert robot.log().count('following path') == 1
    robot.follow()
    assert robot.log().count('following path') == 2


@pytest.mark.parametrize('rate', [4.0, 50.0])
def test_odometry_that_contradicts_the_wheels_stops_the_robot_within_1_s(node, rate):
    robot = Robot(node, rate)
    robot.log, robot.has_wheels = (lambda: node.log.lines[-1]), True
    for speed in (0.0, 0.025):
        robot.drive()
        robot.until_more_progress()
        robot.odom_speed, began_ns = speed, node.now_ns()
        robot.until(lambda: robot.speed == 0.0)
        assert node.now_ns() - began_ns < 1_000_000_000
        robot.assert_stopped(PathState.STOPPED, 'in which the wheels rolled')
        robot.odom_speed, robot.x = None, robot.shown_x


@pytest.mark.parametrize('topic', ['path', 'goal_pose'])
def test_a_second_publisher_of_orders_stops_the_robot_and_both_are_named(node, robot, topic):
    def order(publisher=TEST):
        node.publish(topic, robot.path() if topic == 'path' else goal(robot, LONG),
                     publisher=publisher)

    node.publishers_of[topic] = {TEST: 'test', b'other': 'stranger'}
    order()
    robot.until(lambda: robot.speed > 0.1)
    order(b'other')
    robot.assert_stopped(PathState.REFUSED, f'refused: 2 publishers on {topic}: /stranger, /test')
    order()  # also refused
    robot.until_more_progress()
    assert (robot.progress.state, robot.speed) == (PathState.REFUSED, 0.0)
    node.run(5.0)
    robot.until_more_progress()
    order()
    robot.until(lambda: robot.speed > 0.1)


def test_refusals_of_a_fast_publisher_are_logged_once_a_second(node, robot):
    for number in range(30):
        robot.follow(robot.path(frame=f'map{number}'))
        node.run(0.1)
    assert [line.partition(': path')[0] for line in node.log.lines if 'refused' in line] == [
        'warning: refused', *['warning: again refused'] * 3]


@pytest.mark.parametrize('end', ['cancel', 'emergency stop'])
def test_after_arrival_the_robot_is_held_by_commands_of_zero_until_a_stop(node, robot, end):
    assert node.set_parameter('hold_on_arrival', True)
    robot.follow(robot.path(SHORT))
    robot.until_state(PathState.ARRIVED)
    count = len(robot.commands)
    node.run(5.0)
    assert robot.commands[count:] == [(0.0, 0.0)] * 100
    if end == 'cancel':
        assert node.call('cancel_path').success
    else:
        node.publish('emergency_stop_active', Bool(data=True))
    assert robot.progress.state == PathState.STOPPED
    count = len(robot.commands)
    node.run(1.0)
    assert len(robot.commands) == count


@pytest.mark.parametrize(('age', 'line'), [
    (1.99, 'following path: 2 poses'), (2.01, 'refused: path: 2.01 s old, expected at most 2 s')])
def test_the_age_of_a_path_without_timestamp_is_counted_from_its_publication(
        node, robot, age, line):
    node.publish('path', message(0), sent=age)
    assert line in robot.log()


def message(stamp_ns, length=5.0):
    """Return a path as a message."""
    poses = (0.0, 0.0, NAN), (length, 0.0, NAN)
    return path_to_msg(PATH(), PlannedPath(stamp_ns, 'odom', poses))


@pytest.fixture(scope='module')
def process(tmp_path_factory, isolated_ros):
    """
    Return a robot with a process that the tests share; it ends while it follows.

    Before it starts, a path without timestamp is published: its age counts from there.
    """
    with Graph(tmp_path_factory.mktemp('graph')) as graph:
        robot = Robot(graph)
        publisher = graph.node.create_publisher(PATH, 'path', latched())
        publisher.publish(message(0))
        with graph.start(NODE, path_max_age=60.0) as robot.node:
            graph.until(lambda: 'following path: 2 poses, without odom' in robot.log())
            graph.node.destroy_publisher(publisher)
            yield robot
            robot.until(lambda: robot.speed > 0.1, robot.follow)
            assert robot.node.end() == 0
            robot.until(lambda: robot.commands[-1] == (0.0, 0.0))


@pytest.mark.parametrize('profile', [latched(), QoSProfile(depth=1)], ids=['latched', 'volatile'])
def test_a_path_of_any_publisher_is_handled_once_without_warning_of_its_durability(
        process, profile):
    def handled():
        return int(process.graph.value(NODE, 'frames_bad') or 0)

    process.until_more_health(NODE)
    before, incompatible = handled(), []
    publisher = process.graph.node.create_publisher(
        PATH, 'path', profile,
        event_callbacks=PublisherEventCallbacks(incompatible_qos=incompatible.append))
    publisher.publish(message(1))  # not matched yet: only a latched one is received
    process.until(lambda: handled() > before, lambda: (
        profile.durability == DurabilityPolicy.VOLATILE and publisher.publish(message(1))))
    process.until(lambda: publisher.get_subscription_count() == 1)
    process.until_more_health(NODE)
    before = handled()
    for number in (1, 2):
        publisher.publish(message(1))
        process.until(lambda: handled() >= before + number)  # noqa: B023
    process.until_more_health(NODE)
    assert handled() == before + 2
    assert not incompatible
    process.graph.node.destroy_publisher(publisher)


def test_publishers_of_goals_get_no_warning_of_their_durability(process):
    incompatible = []
    publisher = process.graph.node.create_publisher(
        message_class('geometry_msgs/msg/PoseStamped'), 'goal_pose', QoSProfile(depth=1),
        event_callbacks=PublisherEventCallbacks(incompatible_qos=incompatible.append))
    process.until(lambda: publisher.get_subscription_count() == 1)
    process.until_more_health(NODE)
    assert not incompatible
    process.graph.node.destroy_publisher(publisher)


def test_publishers_of_paths_in_two_nodes_are_named(process, tmp_path):
    with Stranger(tmp_path, 'path') as stranger:
        process.until(lambda: '2 publishers on path: /stranger, /test' in process.log(),
                      lambda: (process.follow(), stranger.publish(process.path())))
        process.until(lambda: process.speed == 0.0)


@pytest.fixture
def slippery(tmp_path):
    """Return the file of a map with ice everywhere around the path."""
    ice = np.full((40, 80), 0.05)
    write_raster(tmp_path / 'ice.yaml', Raster('odom', 0.1, (-2.0, -2.0), ice, 0.1 * ice))
    return tmp_path / 'ice.yaml'


def fastest(file, **params):
    """Return the largest speed that is commanded on a path, and the health of the node."""
    with virtual(TrajectoryController, follow_path='false', friction_map=str(file),
                 **params) as node:
        robot = Robot(node)
        robot.until(lambda: 'receiving odom' in '\n'.join(node.log.lines))
        robot.follow(robot.path(LONG))
        end_ns = node.elapsed_ns + 2_000_000_000
        robot.until(lambda: node.elapsed_ns > end_ns)
        assert robot.progress.state == PathState.FOLLOWING
        return max(speed for speed, _ in robot.commands), node.health()


def test_a_friction_map_lowers_the_acceleration_on_it(isolated_ros, slippery):
    speed, health = fastest(slippery)
    # 0.7 of the friction 0.05 less two sigma, of which 0.6 are for changes of speed
    assert 0.2 < speed <= 2.0 * 0.6 * 0.7 * 0.04 * 9.81 + 0.01
    assert 'friction map' not in health.message


def test_unknown_cells_within_the_margin_are_as_slippery(isolated_ros, slippery):
    slippery.write_text(slippery.read_text().replace('[-2.0, -2.0', '[-2.0, 0.8'))
    near, off = (fastest(slippery, friction_map_margin=margin)[0] for margin in (1.0, 0.3))
    assert 0.2 < near < 0.35 and off > 0.5


def test_a_map_in_a_frame_that_is_not_connected_is_not_used(isolated_ros, slippery):
    slippery.write_text(slippery.read_text().replace('frame_id: odom', 'frame_id: map'))
    speed, health = fastest(slippery)
    assert speed > 0.5
    assert "not used: friction map: frame 'map'" in health.message


@pytest.mark.parametrize('damage', ['missing', 'damaged'])
def test_a_friction_map_that_cannot_be_read_refuses_the_start(isolated_ros, slippery, damage):
    if damage == 'damaged':
        slippery.with_suffix('.png').write_bytes(b'')
    else:
        slippery.unlink()
    with pytest.raises(ParameterError, match='ice.yaml: ') as error, virtual(
            TrajectoryController, friction_map=str(slippery)):
        pass
    assert len(str(error.value).splitlines()) == 1
