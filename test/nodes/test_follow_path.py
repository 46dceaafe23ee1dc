# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Action ``follow_path``, with a robot in the test, and paths in frames that /tf connects."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
import math
import signal
import time
from typing import Any

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import TransformStamped
import pytest
import rclpy
from rclpy.action import ActionClient, ActionServer, GoalResponse
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from smart_tire.control.trajectory_control import PathState
from smart_tire.host_load import PREFIX
from smart_tire.messages.path import path_to_msg
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.follow_path import REPLACED
from smart_tire.nodes.qos import latched
from smart_tire.nodes.trajectory_controller import TrajectoryController
from smart_tire.rotation import quaternion
from smart_tire.samples import GoalPose, NAN, NS_PER_S, PlannedPath
from std_msgs.msg import Bool
from support.graph import Graph
from support.moving_robot import Robot, SHORT
from support.ros_classes import importable, missing
from support.virtual_node import virtual
from support.waiting import wait_for

pytestmark = [pytest.mark.processes, pytest.mark.skipif(bool(missing()), reason=missing())]

NODE = 'trajectory_controller'
PATH = message_class('nav_msgs/msg/Path')


class Client:
    """A client of the action, in a node of its own, spun by ``until`` of the robot."""

    def __init__(self, name: str, robot: Robot) -> None:
        self._robot, self._context = robot, Context()
        rclpy.init(args=[], context=self._context)
        self._node = rclpy.create_node(name, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.action = message_class('nav2_msgs/action/FollowPath')
        self._client = ActionClient(self._node, self.action, 'follow_path')
        self.feedback: list[Any] = []
        self.until(self._client.server_is_ready)
        self.until(lambda: self.servers() == 1)

    def until(self, condition: Callable[[], object]) -> None:
        """Drive and handle the replies until ``condition``."""
        self._robot.graph.until(condition, lambda: (
            self._robot.step(), self._executor.spin_once(timeout_sec=0.0)))

    def servers(self) -> int:
        """Return how many servers are discovered."""
        return self._node.count_publishers('follow_path/_action/feedback')

    def offer(self, path: PlannedPath) -> Any:
        """Send a goal; return its handle once it is answered."""
        goal = self.action.Goal(path=path_to_msg(PATH(), path), controller_id='FollowPath')
        future = self._client.send_goal_async(
            goal, feedback_callback=lambda msg: self.feedback.append(msg.feedback))
        self.until(future.done)
        return future.result()

    def send(self, path: PlannedPath) -> Any:
        """Offer a goal, again if a server that has ended is still known; return its handle."""
        handles: list[Any] = []
        wait_for(lambda: handles.append(self.offer(path)) or handles[-1].accepted)
        return handles[-1]

    def drive(self, **given: Any) -> Any:
        """Send a path, again if it is refused; return the handle when the robot moves."""
        goals: list[Any] = []

        def moves() -> bool:
            goals.append(self.send(self._robot.path(**given)))
            ended = goals[-1].get_result_async()
            self.until(lambda: self._robot.speed > 0.1 or ended.done())
            return not ended.done()

        wait_for(moves)
        return goals[-1]

    def arrive(self) -> None:
        """Send a short path until one is followed: a client that has ended may still be known."""
        wait_for(lambda: self.result(
            self.send(self._robot.path(SHORT)))[0] == GoalStatus.STATUS_SUCCEEDED)

    def result(self, goal: Any) -> tuple[int, str, str]:
        """Return status, name of the error and message of a goal that ends."""
        future = goal.get_result_async()
        self.until(future.done)
        result = future.result().result
        names = [name for name in dir(type(result)) if name.isupper()
                 and getattr(type(result), name) == result.error_code]
        return future.result().status, names[0], result.error_msg

    def close(self) -> None:
        """End the node, as a process that ends orderly."""
        self._client.destroy()
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.shutdown()


@pytest.fixture(scope='module')
def nav2_msgs(isolated_ros: None) -> Iterator[None]:
    """Make the classes importable, here and in processes."""
    with importable():
        yield


class VirtualGoal:
    """A goal of the action for a node in virtual time, as rclpy's handle of the server."""

    def __init__(self, path: PlannedPath) -> None:
        self.request = message_class('nav2_msgs/action/FollowPath').Goal(
            path=path_to_msg(PATH(), path))
        self.is_cancel_requested, self.status = False, 'accepted'
        self.result: Any = None
        for name in ('execute', 'succeed', 'canceled', 'abort'):
            setattr(self, name, partial(setattr, self, 'status', name))
        self.feedback: list[Any] = []
        self.publish_feedback = self.feedback.append


@pytest.fixture
def node(nav2_msgs: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Return a node in virtual time, whose goals are those of the test."""
    monkeypatch.setattr(ActionServer, 'notify_execute', lambda _, goal, callback: setattr(
        goal, 'result', callback(goal)))
    with virtual(TrajectoryController) as made:
        yield made


@pytest.fixture
def rig(node: Any) -> Robot:
    """Return a robot at rest, whose odometry the node in virtual time receives."""
    made = Robot(node)
    made.log = lambda: '\n'.join(node.log.lines)
    made.until(lambda: 'receiving odom' in made.log())
    return made


def give(node: Any, path: PlannedPath) -> VirtualGoal:
    """Let a node in virtual time accept a goal."""
    goal = VirtualGoal(path)
    node._server._accept(goal)
    return goal


def test_no_timer_runs_at_the_rate_of_the_control_while_no_goal_is_followed(node, rig):
    def calls(seconds: float) -> int:
        with pytest.MonkeyPatch.context() as patch:
            step, count = node._control.step, []
            patch.setattr(node._control, 'step', lambda now: (count.append(now), step(now))[1])
            node.run(seconds)
        return len(count)

    assert calls(10.0) == 0
    rig.until_more_progress()  # with recent odom again
    goal = give(node, rig.path(SHORT))
    rig.until(lambda: rig.speed > 0.1)
    assert calls(0.3) == 6  # odom is recent for 0.5 s
    rig.until(lambda: goal.status == 'succeed')
    assert calls(10.0) == 0
    assert max(feedback.speed for feedback in goal.feedback) > 0.1


def test_a_cancellation_stops_the_robot_within_a_period_of_the_control(node, rig):
    goal = give(node, rig.path())
    rig.until(lambda: rig.speed > 0.1)
    goal.is_cancel_requested, began_ns = True, node.now_ns()
    rig.until(lambda: rig.speed == 0.0)
    assert node.now_ns() - began_ns <= 51_000_000
    assert goal.status == 'canceled'


def test_the_newest_of_goals_paths_and_poses_is_followed_and_ends_the_one_before(node, rig):
    first, second = give(node, rig.path()), give(node, rig.path(stamp_ns=0))
    assert (first.status, first.result.error_msg) == ('abort', REPLACED)
    assert second.status == 'execute'
    rig.until(lambda: rig.speed > 0.1)
    node.publish('goal_pose', GoalPose(node.now_ns(), 'odom', (rig.x + 5.0, 0.0, NAN)))
    assert (second.status, second.result.error_msg) == ('abort', REPLACED)
    third = give(node, rig.path())
    rig.until_more_progress()
    assert (third.status, rig.speed > 0.1) == ('execute', True)
    rig.follow()
    assert (third.status, third.result.error_msg) == ('abort', REPLACED)
    assert rig.speed > 0.1
    refused = give(node, rig.path(frame='nowhere'))  # stops, whoever sent the one before
    assert (refused.status, rig.speed) == ('abort', 0.0)


@pytest.mark.parametrize(('change', 'error', 'reason'), [
    ({'length': -0.05}, 'INVALID_PATH', '0 poses'),
    ({'length': 300.0}, 'INVALID_PATH', '6001 poses, expected at most 5000'),
    ({'stamp_ns': 1}, 'TF_ERROR', 's old, expected at most 2 s'),
    ({'frame': 'nowhere'}, 'TF_ERROR', "frame 'nowhere', expected odom: /tf does not connect"),
    ({'frame': ''}, 'INVALID_PATH', "frame '', expected odom")],
    ids=['empty', 'long', 'old', 'frame', 'no frame'])
def test_an_invalid_goal_stops_the_robot_and_its_result_has_the_reason(
        node, rig, change, error, reason):
    first = give(node, rig.path())
    rig.until(lambda: rig.speed > 0.1)
    invalid = give(node, rig.path(**change))
    for goal in (first, invalid):
        assert goal.status == 'abort'
        assert goal.result.error_code == getattr(type(goal.result), error)
    assert reason in invalid.result.error_msg
    assert rig.speed == 0.0
    rig.assert_stopped(PathState.REFUSED, reason)


@pytest.mark.parametrize(('stall', 'later', 'follows'), [
    (2.1, 0.0, False),   # older than path_max_age, and handled before any timer
    (2.1, 0.1, False),
    (2.1, 3.2, False),   # lost, and repeated with the next heartbeat
    (2.1, 5.2, True),    # of the time after the stall
    (1.2, 0.1, True),    # not older
    (1.2, 1.0, False),
    (0.9, 3.0, True)],   # too short to make a goal too old
    ids=str)
def test_a_goal_without_timestamp_is_as_old_as_the_stall_in_which_it_may_have_been_sent(
        node, rig, stall, later, follows):
    node.stall(stall)
    end_ns = node.now_ns() + round(later * NS_PER_S)
    if later:
        node.run(0.0)
    rig.until(lambda: node.now_ns() >= end_ns)
    goal = give(node, rig.path(stamp_ns=0))
    assert (goal.status == 'execute') == follows
    assert follows or goal.result.error_code == goal.result.TF_ERROR
    assert follows or 'expected at most 2 s' in goal.result.error_msg
    rig.until_more_progress()
    stamped = give(node, rig.path())
    assert stamped.status == 'execute'


def test_the_speed_limit_of_nav2_is_used_and_an_invalid_one_is_named(node, rig):
    limit = message_class('nav2_msgs/msg/SpeedLimit')
    top = node.params.max_speed
    for given, percentage, expected in (
            (25.0, True, 0.25 * top), (0.1, False, 0.1), (-1.0, False, 0.1), (0.0, False, top)):
        node.publish('speed_limit', limit(percentage=percentage, speed_limit=given))
        assert float(node.health().values['max_speed']) == pytest.approx(expected)
    assert 'speed_limit: 1 messages rejected, latest: -1, expected a finite' in rig.log()


@pytest.fixture(scope='module')
def running(tmp_path_factory: pytest.TempPathFactory, nav2_msgs: None) -> Iterator[Robot]:
    """Return a robot with a node that the tests share."""
    with Graph(tmp_path_factory.mktemp('graph')) as graph:
        robot = Robot(graph)
        # DDS repeats a lost message, and holds back those after it, within 3 s; commands may be
        # late, too. The limits themselves are those of tests in virtual time.
        with graph.start(NODE, checks__odom_timeout=8.0, checks__progress_timeout=30.0,
                         transform_max_age=30.0, arrival__xy_tolerance=0.5) as robot.node:
            robot.until_state(PathState.IDLE)
            yield robot
            robot.until_more_progress()  # the latest odom may be old
            client = Client('last', robot)
            future = client.drive().get_result_async()
            robot.until_more_progress()
            robot.node.popen.send_signal(signal.SIGSTOP)
            stopped = time.monotonic()
            client.until(lambda: time.monotonic() - stopped > 0.3)
            robot.follow(robot.path())  # still queued when the node ends
            for number in (signal.SIGINT, signal.SIGCONT):
                robot.node.popen.send_signal(number)
            client.until(future.done)
            assert future.result().status == GoalStatus.STATUS_ABORTED
            assert future.result().result.error_msg == 'node ended'
            client.close()
            assert robot.node.ended() == 0
            robot.until(lambda: robot.commands[-1] == (0.0, 0.0))


@pytest.fixture
def robot(running: Robot) -> Iterator[Robot]:
    """Return the robot at rest; its log begins with the test."""
    running.is_silent = False
    before = running.node.output
    running.graph.received['cmd_vel'].clear()
    running.log = lambda: running.node.output.removeprefix(before)
    running.until_more_progress()  # the latest odom may be old
    yield running
    running.graph.call('std_srvs/srv/Trigger', 'cancel_path')


@pytest.fixture(scope='module')
def navigator(running: Robot) -> Iterator[Client]:
    """Return a client of the action that the tests share."""
    made = Client('navigator', running)
    yield made
    made.close()


@pytest.fixture
def client(robot: Robot, navigator: Client) -> Client:
    """Return the client without feedback."""
    navigator.feedback.clear()
    return navigator


def test_a_goal_without_timestamp_is_followed_with_feedback_and_succeeds(robot, client):
    start = robot.x
    goal = client.drive(length=3.0 * SHORT, stamp_ns=0)
    client.until(lambda: len(client.feedback) >= 2 and client.feedback[-1].speed > 0.1)
    assert goal.status == GoalStatus.STATUS_EXECUTING
    assert client.result(goal) == (GoalStatus.STATUS_SUCCEEDED, 'NONE', '')
    assert robot.x > start
    distances = [feedback.distance_to_goal for feedback in client.feedback]
    assert 3.0 * SHORT + 0.01 > distances[0] > distances[-1] >= 0.0
    robot.until(lambda: robot.commands[-1] == (0.0, 0.0))
    robot.until(lambda: robot.progress.state == PathState.ARRIVED)


def test_a_path_of_one_pose_succeeds_where_the_robot_is(robot, client):
    assert client.result(client.send(robot.path(0.0))) == (
        GoalStatus.STATUS_SUCCEEDED, 'NONE', '')
    assert robot.speed == 0.0


def test_a_canceled_goal_stops_the_robot_at_once(robot, client):
    goal = client.drive()
    cancel = goal.cancel_goal_async()
    client.until(lambda: robot.speed == 0.0)
    client.until(cancel.done)
    assert len(cancel.result().goals_canceling) == 1
    assert client.result(goal) == (GoalStatus.STATUS_CANCELED, 'NONE', '')
    robot.assert_stopped(PathState.STOPPED, 'canceled by the client of follow_path')


def test_a_newer_goal_of_the_same_client_replaces_the_path_without_a_stop(robot, client):
    first = client.drive()
    robot.graph.received['cmd_vel'].clear()
    second = client.send(robot.path(2.0))
    assert client.result(first) == (
        GoalStatus.STATUS_ABORTED, 'INVALID_CONTROLLER', REPLACED)
    robot.until_more_progress()
    assert min(robot.commands)[0] > 0.1
    assert robot.progress.remaining_distance < 2.0
    assert client.result(second)[0] == GoalStatus.STATUS_SUCCEEDED


def test_the_same_path_in_a_newer_goal_is_no_new_begin(robot, client):
    path = robot.path(2.0)
    first = client.send(path)
    client.until(lambda: robot.speed > 0.1)
    second = client.send(path)
    assert client.result(first)[2] == REPLACED
    assert client.result(second)[0] == GoalStatus.STATUS_SUCCEEDED
    assert robot.log().count('following path') == 1


def test_the_newer_of_a_goal_and_a_path_is_followed(robot, client):
    goal = client.drive()
    robot.follow(robot.path())
    assert client.result(goal)[2] == REPLACED
    robot.until_more_progress()
    assert (robot.progress.state, robot.speed > 0.1) == (PathState.FOLLOWING, True)
    assert client.result(client.send(robot.path(SHORT)))[0] == GoalStatus.STATUS_SUCCEEDED


def test_an_emergency_stop_aborts_the_goal_and_refuses_the_next_one(robot, client):
    stop = robot.graph.node.create_publisher(Bool, 'emergency_stop_active', latched())
    goal = client.drive()
    stop.publish(Bool(data=True))
    assert client.result(goal) == (
        GoalStatus.STATUS_ABORTED, 'INVALID_CONTROLLER', 'emergency stop')
    refused = client.result(client.send(robot.path()))
    assert refused == (GoalStatus.STATUS_ABORTED, 'INVALID_PATH',
                       'follow_path: the emergency stop is active')
    assert robot.speed == 0.0
    stop.publish(Bool(data=False))
    client.drive()  # the release has arrived
    robot.graph.node.destroy_publisher(stop)


def jump(robot: Robot) -> None:
    """Let the position jump."""
    robot.x += 1.0


@pytest.mark.parametrize(('end', 'error', 'reason'), [
    (lambda robot: robot.graph.call('std_srvs/srv/Trigger', 'cancel_path'), 'INVALID_CONTROLLER',
     'canceled by cancel_path'),
    (lambda robot: setattr(robot, 'is_silent', True), 'TF_ERROR', 'odom: '),
    (jump, 'FAILED_TO_MAKE_PROGRESS', 'odom: position jumped')], ids=['cancel', 'silent', 'jump'])
def test_what_stops_the_robot_aborts_the_goal_with_its_reason(robot, client, end, error, reason):
    goal = client.drive()
    end(robot)
    status, name, text = client.result(goal)
    assert (status, name) == (GoalStatus.STATUS_ABORTED, error)
    assert text.startswith((reason, PREFIX))  # of a test host that is late


def test_a_goal_that_was_queued_while_the_node_was_stopped_is_not_followed(robot, client):
    """It has no timestamp: its age is unknown, but at most the duration of the stop."""
    robot.node.popen.send_signal(signal.SIGSTOP)
    stopped = time.monotonic()
    future = client._client.send_goal_async(
        client.action.Goal(path=path_to_msg(PATH(), robot.path(SHORT, stamp_ns=0))))
    client.until(lambda: time.monotonic() - stopped > 2.5)
    robot.node.popen.send_signal(signal.SIGCONT)
    client.until(future.done)
    status, error, text = client.result(future.result())
    assert (status, error) == (GoalStatus.STATUS_ABORTED, 'TF_ERROR')
    assert 's old, expected at most 2 s' in text
    robot.until_more_progress()
    assert robot.speed == 0.0
    client.drive()  # with recent odom again


def test_a_goal_of_a_second_client_replaces_the_first_without_a_stop(robot, client):
    other = Client('stranger', robot)
    first = client.drive()
    robot.graph.received['cmd_vel'].clear()
    second = other.send(robot.path())
    assert client.result(first) == (
        GoalStatus.STATUS_ABORTED, 'INVALID_CONTROLLER', REPLACED)
    robot.until_more_progress()
    third = client.send(robot.path(2.0))
    assert other.result(second)[1:] == ('INVALID_CONTROLLER', REPLACED)
    robot.until_more_progress()
    assert min(robot.commands)[0] > 0.1
    assert client.result(third)[0] == GoalStatus.STATUS_SUCCEEDED
    other.drive()
    other.close()
    robot.until_more_progress()  # the path is followed to its end if the client ends
    assert (robot.progress.state, robot.speed > 0.1) == (PathState.FOLLOWING, True)


def transform(parent: str, child: str, x: float, y: float, yaw: float,
              stamp_ns: int) -> TransformStamped:
    """Return a transform as a message."""
    msg = TransformStamped(child_frame_id=child)
    msg.header.frame_id = parent
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
    msg.transform.translation.x, msg.transform.translation.y = x, y
    rotation = msg.transform.rotation
    rotation.x, rotation.y, rotation.z, rotation.w = quaternion(0.0, 0.0, yaw)
    return msg


def test_a_path_in_map_is_followed_where_tf_leads_to_odom(robot, client):
    """The frame odom is turned by a quarter in map: ahead is along its y axis."""
    tf_message = message_class('tf2_msgs/msg/TFMessage')

    def localize(age: float = 0.0) -> None:
        robot.graph.publish_message('/tf', tf_message(transforms=[transform(
            'map', 'odom', 5.0, -2.0, math.pi / 2.0, time.time_ns() - round(age * NS_PER_S))]))

    def ahead(stamp_ns: int) -> PlannedPath:
        return PlannedPath(stamp_ns, 'map', tuple(
            (5.0, -2.0 + robot.x + step, math.pi / 2.0) for step in (0.0, 0.5 * SHORT, SHORT)))

    text = ''
    while '/tf from map to odom' not in text:  # once it is received
        localize(age=60.0)
        status, error, text = client.result(client.send(ahead(time.time_ns())))
        assert (status, error) == (GoalStatus.STATUS_ABORTED, 'TF_ERROR')
    localize()
    robot.until_more_progress()
    start = robot.x
    assert client.result(client.send(ahead(time.time_ns()))) == (
        GoalStatus.STATUS_SUCCEEDED, 'NONE', '')
    assert robot.x > start
    robot.follow(ahead(time.time_ns()))  # on the topic, too
    robot.until_state(PathState.FOLLOWING)
    robot.until_state(PathState.ARRIVED)


def test_goals_are_rejected_while_another_node_serves_the_action(robot, client):
    server = ActionServer(robot.graph.node, client.action, 'follow_path',
                          lambda goal: client.action.Result(),
                          goal_callback=lambda goal: GoalResponse.REJECT)
    text = 'goal rejected: 2 servers of follow_path: /test, /trajectory_controller'

    def until_rejected():
        before = robot.log().count(text)
        while robot.log().count(text) == before:
            client.offer(robot.path())

    until_rejected()  # before that, the node may not know the other server, and drive
    robot.graph.call('std_srvs/srv/Trigger', 'cancel_path')
    robot.until(lambda: robot.speed == 0.0)
    until_rejected()
    robot.until_more_progress()
    assert (robot.speed, robot.progress.state == PathState.FOLLOWING) == (0.0, False)
    server.destroy()
    client.until(lambda: client.servers() == 1)  # a new client may send its goal to the other one
    client.arrive()
