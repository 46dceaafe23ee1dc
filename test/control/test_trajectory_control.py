# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""States of the trajectory controller: what it refuses, and what makes it stop."""

from __future__ import annotations

from dataclasses import replace
import math
from unittest import mock

import numpy as np
import pytest

from smart_tire.control.constants import MAX_WAIT, MIN_ADVANCE, RELEASE_TIME
from smart_tire.control.path_library import figure_eight, line
from smart_tire.control.path_plan import plan_goal
from smart_tire.control.trajectory_control import PathState, TrajectoryControl
from smart_tire.errors import CommandError
from smart_tire.parameters.path_following import PathCheckParams
from smart_tire.samples import GoalPose, NAN, NS_PER_S, WheelSlip
from support.ideal_robot import distances, IDEAL, IdealRobot, odometry, path, Run

FAR = line(3.0)
HOLDING = replace(IDEAL, hold_on_arrival=True)


def under_way(planned=FAR, seconds=1.5, params=IDEAL, **robot):
    """Return a run that has followed a path for some time."""
    run = Run(params, **robot).start(planned).for_seconds(seconds)
    assert run.control.state == PathState.FOLLOWING, run.control.reason
    return run


def assert_stopped(run, reason, state=PathState.STOPPED):
    """Check that the next commands are zero, once, and then none."""
    command = run.control.step(run.now_ns)
    assert (command.stamp_ns, command.v_x, command.yaw_rate) == (run.now_ns, 0.0, 0.0)
    assert run.control.state == state
    assert reason in run.control.reason
    run.now_ns += 1
    assert run.control.step(run.now_ns) is None
    assert math.isnan(run.control.progress(run.now_ns).remaining_distance)


def test_nothing_is_published_without_path():
    run = Run()
    assert run.step() is None
    progress = run.control.progress(5)
    assert (progress.stamp_ns, progress.state) == (5, 0)
    assert math.isnan(progress.remaining_distance)
    assert math.isnan(progress.cross_track_error)


def test_following_ends_with_one_command_of_zero():
    run = Run().start(line(0.5))
    commands = []
    while run.control.state == PathState.FOLLOWING:
        commands.append(run.step())
    released = commands.index(None)
    assert set(commands[released:]) == {None}
    assert len(commands) - released == round(RELEASE_TIME * run.params.rate)
    commands = commands[:released]
    assert [one.stamp_ns for one in commands] == sorted({one.stamp_ns for one in commands})
    assert (commands[-1].v_x, commands[-1].yaw_rate) == (0.0, 0.0)
    assert (run.control.state, run.control.reason) == (PathState.ARRIVED, '')
    assert run.step() is None
    assert run.control.progress(0).state == 2


def test_progress_is_measured_along_the_path_and_to_the_left():
    run = Run(y=0.1).start(FAR)
    run.step()
    progress = run.control.progress(run.now_ns)
    assert progress.state == 1
    assert progress.remaining_distance == pytest.approx(3.0, abs=0.01)
    assert progress.cross_track_error == pytest.approx(0.1, abs=0.01)
    assert under_way(seconds=2.0).progress[-1].remaining_distance < 2.6


def test_the_frame_of_paths_and_goals_is_a_parameter():
    params = replace(IDEAL, robot=replace(IDEAL.robot, frame_prefix='r1/', odom_frame='world'))
    for frame, state in (('r1/world', PathState.FOLLOWING), ('world', PathState.REFUSED),
                         ('odom', PathState.REFUSED)):
        for order in (path((0, 0), (1, 0), frame=frame), GoalPose(0, frame, (1.0, 0.0, NAN))):
            assert Run(params).start(order).control.state == state


@pytest.mark.parametrize(('planned', 'reason'), [
    (path((0, 0), (1, 0), frame='map'), "path: frame 'map', expected odom"),
    (path(), 'path: 0 poses, expected 1 to'),
    (path(*((0, 0),) * 5001), '5001 poses, expected 1 to 5000'),
    (path((0, 0), frame='map'), "path: frame 'map', expected odom"),
    (path((0, NAN)), 'path: pose 0: position (0, nan) m, expected finite'),
    (path((0, 0, math.inf)), 'path: pose 0: yaw inf rad'),
    (path((-1001.0, 0)), 'goal_pose: 1001.'),
    (path((0, 0), (math.nan, 0), (1, 0)), 'path: pose 1: position (nan, 0) m, expected finite'),
    (path((0, 0), (1, math.inf)), 'path: pose 1: position (1, inf) m'),
    (path((0, 0), (1.1e5, 0)), 'path: 110000.0 m long, expected at most 1000 m'),
    (path((0, 0), (0, -9e4)), 'path: 90000.0 m long, expected at most 1000 m'),
    (path((0, 0), (1, 0, math.inf)), 'path: pose 1: yaw inf rad'),
    (path((0, 0), (900, 0), (700, 0)), 'path: 1100.0 m long, expected at most 1000 m'),
    (path((-1.01, 0), (2, 0)), 'm from the robot, expected at most 1 m (checks.max_start_dist'),
    (GoalPose(0, 'map', (1.0, 0.0, 0.0)), "goal_pose: frame 'map', expected odom"),
    (GoalPose(0, 'odom', (1.0, NAN, 0.0)), 'goal_pose: position (1, nan) m'),
    (GoalPose(0, 'odom', (1.0, 0.0, math.inf)), 'goal_pose: yaw inf rad'),
    (GoalPose(0, 'odom', (-1001.0, 0.0, 0.0)), 'm from the robot, expected at most 1000 m (che'),
])
def test_an_invalid_target_is_refused_and_stops_the_robot(planned, reason):
    idle = Run().start(planned)
    assert idle.control.state == PathState.REFUSED
    assert reason in idle.control.reason
    assert idle.step() is None
    run = under_way(seconds=0.5)
    run.start(planned)
    assert_stopped(run, reason, PathState.REFUSED)
    run.start(line(1.0))
    assert (run.control.state, run.control.reason) == (PathState.FOLLOWING, '')


@pytest.mark.parametrize(('planned', 'start', 'state'), [
    (path((0.99, 0), (2, 0)), (0.0, 0.0), PathState.FOLLOWING),
    (path((0, 0), (1000, 0)), (0.0, 0.0), PathState.FOLLOWING),
    (path((5.0, -4.9), (6, -4)), (5.0, -4.0), PathState.FOLLOWING),
    (path((5.0, -5.1), (6, -4)), (5.0, -4.0), PathState.REFUSED)])
def test_a_path_may_begin_within_a_distance_from_the_robot_and_be_long(planned, start, state):
    assert Run(x=start[0], y=start[1]).start(planned).control.state == state


def assert_turned(run, yaw):
    """Check the yaw that is reached."""
    tolerance = run.params.arrival.yaw_tolerance
    assert math.remainder(run.robot.yaw - yaw, math.tau) == pytest.approx(0.0, abs=tolerance)


@pytest.mark.parametrize('poses', [1, 3])
@pytest.mark.parametrize(('distance', 'yaw'), [
    (0.0, 1.0), (0.044, -3.0), (0.044, NAN), (0.046, 1.0), (-0.3, 0.0), (3.0, NAN), (3.0, 2.0)])
def test_a_path_at_one_position_is_a_goal(poses, distance, yaw):
    order = path(*((distance, 0.0, yaw),) * poses)
    run, goal = (Run().start(one).until_end() for one in (
        order, GoalPose(0, 'odom', (distance, 0.0, yaw))))
    assert run.rows == goal.rows
    assert run.control.state == PathState.ARRIVED
    assert run.robot.x == pytest.approx(distance if abs(distance) > 0.045 else 0.0, abs=0.01)
    assert_turned(run, 0.0 if math.isnan(yaw) else yaw)


def test_the_last_yaw_that_is_given_counts_at_one_position():
    run = Run().start(path((0, 0, 2.0), (0, 0.0019, 1.0), (0, 0, NAN))).until_end()
    assert_turned(run, 1.0)
    assert run.robot.x == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize('yaw', [1.0, NAN])
@pytest.mark.parametrize('ahead', [-0.1, 0.0, 0.04, 0.2, 0.4])
def test_a_goal_nearer_than_the_robot_can_stop_is_reached_after_a_stop(ahead, yaw):
    run = under_way(seconds=2.0, lag=0.1, dead_time=2)
    x = run.robot.x + ahead
    begin = len(run.rows)
    run.start(path((x, 0.0, yaw))).until_end()
    assert (run.control.state, run.control.reason) == (PathState.ARRIVED, '')
    assert run.robot.x == pytest.approx(x, abs=0.02)
    assert_turned(run, 0.0 if math.isnan(yaw) else yaw)
    speeds = run.log[begin:, 6]
    assert speeds[0] > 0.5  # no jump of the command
    assert abs(speeds[1:] - speeds[:-1]).max() <= 0.5 / 20 + 1e-9
    assert abs(run.robot.v_x) < 0.02


@pytest.mark.parametrize('period', [10, 20])  # steps; nav2 renews at 1 Hz
@pytest.mark.parametrize('phase', range(0, 10, 3))
@pytest.mark.parametrize('begin', [0.5, 0.93])  # m, at high and at low speed
def test_a_goal_renewed_where_the_robot_is_is_reached(begin, phase, period):
    run, near = Run(lag=0.1, dead_time=2).start(line(1.0)), -phase  # steps
    for _ in range(400):
        near += run.robot.x > begin or near > -phase
        if near > 0 and near % period == 1 and run.control.state == PathState.FOLLOWING:
            run.start(path((run.robot.x, 0.0, 1.0)))
        run.step()
    assert (run.control.state, run.control.reason) == (PathState.ARRIVED, '')
    assert_turned(run, 1.0)


@pytest.mark.parametrize(('x', 'yaw', 'renewed'), [
    (1.049, 1.0, True), (1.051, 1.0, False), (0.949, 1.0, False), (1.0, 1.079, True),
    (1.0, 1.081, False), (1.0, 0.919, False), (1.0, 1.0 + math.tau, True), (1.0, NAN, False)])
def test_a_goal_within_the_tolerances_is_no_new_begin(x, yaw, renewed):
    first = GoalPose(0, 'odom', (1.0, 0.0, 1.0))
    run = Run().start(first).for_seconds(1.0)
    run.start(GoalPose(0, 'odom', (x, 0.0, yaw))).until_end()
    assert (run.rows == Run().start(first).until_end().rows) == renewed
    assert run.control.state == PathState.ARRIVED
    assert math.isnan(yaw) or math.remainder(run.robot.yaw - yaw, math.tau) == pytest.approx(
        0.0, abs=2.0 * run.params.arrival.yaw_tolerance)


def test_a_goal_without_yaw_is_renewed_by_one_without_yaw_only():
    first = GoalPose(0, 'odom', (1.0, 0.0, NAN))
    run = Run().start(first).for_seconds(1.0)
    run.start(GoalPose(0, 'odom', (1.01, 0.0, NAN))).until_end()
    assert run.rows == Run().start(first).until_end().rows
    run = Run().start(first).for_seconds(1.0)
    run.start(GoalPose(0, 'odom', (1.0, 0.0, 2.0))).until_end()
    assert_turned(run, 2.0)


def test_a_goal_that_has_ended_is_no_longer_renewed():
    goal = GoalPose(0, 'odom', (1.0, 0.0, 1.0))
    run = Run().start(goal).for_seconds(1.0)
    run.control.cancel('canceled')
    run.for_seconds(1.0).start(goal).until_end()
    assert run.control.state == PathState.ARRIVED
    assert_turned(run, 1.0)


def test_a_goal_behind_the_braking_distance_is_driven_to_without_a_stop():
    run = under_way(seconds=2.0)
    x = run.robot.x + 0.8
    run.start(GoalPose(0, 'odom', (x, 0.0, NAN))).until_end()
    assert run.control.state == PathState.ARRIVED
    assert run.log[run.log[:, 1] < x - 0.1, 6][1:].min() > 0.0


@pytest.mark.parametrize('order', [FAR, GoalPose(0, 'odom', (0.9, 0.0, 1.0))])
def test_an_order_replaces_a_goal_that_waits_for_the_stop(order):
    run = under_way(seconds=2.0)
    run.start(GoalPose(0, 'odom', (run.robot.x, 0.0, 3.0))).for_seconds(0.2)
    run.start(order).until_end()
    assert run.control.state == PathState.ARRIVED
    end = order.pose if isinstance(order, GoalPose) else order.poses[-1]
    assert run.robot.x == pytest.approx(end[0], abs=0.03)


def test_a_robot_that_slides_on_is_not_waited_for():
    run = under_way(seconds=2.0)
    run.robot.drive = lambda *_: setattr(run.robot, 'x', run.robot.x + 0.5 / 20)
    run.start(GoalPose(0, 'odom', (run.robot.x, 0.0, NAN))).until_end()
    assert run.control.state == PathState.STOPPED
    assert 'm from the path' in run.control.reason
    run = under_way(seconds=2.0)
    run.robot.drive = lambda *_: None  # as on a treadmill
    run.start(GoalPose(0, 'odom', (run.robot.x + 0.2, 0.0, NAN))).until_end()
    assert 'no progress' in run.control.reason


@pytest.mark.parametrize('period', [0.1, 1.0])
@pytest.mark.parametrize('speed', [0.0, 0.012])
def test_a_path_that_is_renewed_does_not_excuse_a_robot_that_is_blocked(period, speed):
    run = blocked(0.0)
    run.robot.drive = lambda *_: setattr(run.robot, 'x', run.robot.x + speed / 20)
    for _ in range(round(4.0 / period)):
        if run.control.state == PathState.FOLLOWING:
            run.start(path((run.robot.x, 0.0), (5.0 + run.robot.x, 0.0))).for_seconds(period)
    moves = speed * 2.0 > MIN_ADVANCE
    assert run.control.state == (PathState.FOLLOWING if moves else PathState.STOPPED)
    assert moves or 'no progress for 2 s' in run.control.reason


@pytest.mark.parametrize('yaw_rate, state', [
    (0.03, PathState.FOLLOWING), (0.0, PathState.STOPPED)])
def test_a_slow_turn_to_a_renewed_goal_is_progress(yaw_rate, state):
    run = blocked(0.0)
    run.robot.drive = lambda *_: setattr(run.robot, 'yaw', run.robot.yaw + yaw_rate / 20)
    for number in range(20):
        goal = GoalPose(0, 'odom', (run.robot.x, 0.0, 2.0 + 0.1 * (number % 2)))
        if run.control.state == PathState.FOLLOWING:
            run.start(goal).for_seconds(0.2)
    assert run.control.state == state


def test_the_time_without_odom_is_not_renewed_with_the_path():
    control = TrajectoryControl(IDEAL)
    for tick in range(int(MAX_WAIT) + 2):
        control.follow(FAR, tick * NS_PER_S)
        control.step(tick * NS_PER_S)
        if control.state != PathState.FOLLOWING:
            break
    assert control.reason.startswith('odom: none for') and tick == int(MAX_WAIT) + 1


def test_cancel_stops_and_does_nothing_otherwise():
    run = under_way()
    run.control.cancel('canceled by the user')
    assert_stopped(run, 'canceled by the user')
    run.control.cancel('again')
    assert run.control.reason == 'canceled by the user'
    assert run.control.step(run.now_ns + 2) is None


def test_old_odometry_stops():
    run = under_way()
    last_ns = run.now_ns - run.period_ns
    assert run.control.step(last_ns + NS_PER_S // 2).v_x > 0.1
    run.now_ns = last_ns + NS_PER_S // 2 + 1_000_000
    assert_stopped(run, 'odom: 0.50 s old, expected at most 0.5 s')


def test_odometry_of_the_future_stops():
    run = under_way()
    run.control.add_odometry(
        replace(run.robot.odometry(run.now_ns + 6 * NS_PER_S // 10)), run.now_ns)
    assert_stopped(run, 'odom: -0.60 s old')


@pytest.mark.parametrize(('change', 'reason'), [
    ({'x': 0.0, 'y': 0.0}, 'odom: position jumped by'),
    ({'yaw': 1.0}, 'odom: yaw jumped by'),
    ({'v_x': math.nan}, 'odom: pose or twist is not plausible')])
def test_a_jump_of_odometry_stops_until_the_next_path(change, reason):
    run = under_way()
    for name, value in change.items():
        setattr(run.robot, name, value)
    run.observe()
    assert_stopped(run, reason)
    run.robot.v_x = 0.0
    run.observe()
    run.start(line(1.0))
    assert run.step() is not None
    assert run.control.state == PathState.FOLLOWING


def test_time_that_runs_back_stops():
    run = under_way()
    run.now_ns -= 2 * run.period_ns
    assert_stopped(run, 'time runs back')
    run = under_way()
    run.control.add_odometry(run.robot.odometry(run.now_ns - NS_PER_S // 10), run.now_ns)
    assert_stopped(run, 'odom: time runs back')


def test_a_robot_that_is_pushed_off_the_path_stops():
    run = under_way()
    for _ in range(40):
        run.robot.y += 0.04
        run.step()
        if run.control.state != PathState.FOLLOWING:
            break
    assert 'm from the path, expected at most 0.5 m' in run.control.reason
    assert 0.5 < run.robot.y < 0.6


def blocked(seconds, planned=FAR, timeout=2.0):
    """Return a run whose robot does not move any more."""
    params = replace(IDEAL, checks=PathCheckParams(progress_timeout=timeout))
    run = Run(params).start(planned).for_seconds(1.0)
    run.robot.v_x = run.robot.yaw_rate = 0.0
    run.robot.drive = lambda *_: None
    return run.for_seconds(seconds)


@pytest.mark.parametrize('planned', [FAR, GoalPose(0, 'odom', (0.0, 0.0, 3.0))])
def test_a_blocked_robot_stops(planned):
    assert blocked(1.8, planned).control.state == PathState.FOLLOWING
    run = blocked(2.3, planned)
    assert run.control.state == PathState.STOPPED
    assert 'no progress for 2 s' in run.control.reason
    assert run.step() is None


def test_the_wait_after_the_last_command_is_no_lack_of_progress():
    checks = replace(IDEAL.checks, progress_timeout=0.5)
    run = Run(replace(IDEAL, checks=checks)).start(line(0.5)).until_end()
    assert (run.control.state, run.control.reason) == (PathState.ARRIVED, '')


def test_an_end_that_is_missed_is_approached_again():
    run = Run(y=0.3).start(path((0.0, 0.0), (0.05, 0.0))).until_end()
    assert (run.control.state, run.control.reason) == (PathState.ARRIVED, '')
    assert math.hypot(run.robot.x - 0.05, run.robot.y) < 0.05


@pytest.mark.parametrize('target', [
    GoalPose(0, 'odom', (0.5, 0.0, 2.0)), path((0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.0, 2.0))])
def test_after_two_repeated_approaches_a_missed_end_is_a_stop_with_the_distance(target):
    run, released = Run().start(target), set()
    with mock.patch('smart_tire.control.trajectory_control.plan_goal', wraps=plan_goal) as plan:
        while run.control.state == PathState.FOLLOWING:
            run.step()
            if run.control._released_ns not in {None, *released}:  # it slides at each end
                released.add(run.control._released_ns)
                run.robot.y += 0.08
    assert len(released) == 3
    assert {call.args[1] for call in plan.call_args_list} == {(0.5, 0.0, 2.0)}
    assert run.control.state == PathState.STOPPED
    assert 'm from the end, expected at most 0.045 m' in run.control.reason


def test_twisted_tires_that_unwind_after_the_last_command_are_seen():
    run = Run(HOLDING).start(GoalPose(0, 'odom', (0.5, 0.0, 2.0)))
    held = Run(IDEAL).start(GoalPose(0, 'odom', (0.5, 0.0, 2.0)))
    for one in (run, held):
        while one.control._released_ns is None:
            one.step()
        one.for_seconds(0.5)
        one.robot.yaw -= 0.2
        one.until_end()
        assert one.control.state == PathState.ARRIVED
        assert one.robot.yaw == pytest.approx(2.0, abs=0.08)


@pytest.mark.parametrize('seeds', [
    range(10), pytest.param(range(10, 200), marks=pytest.mark.long)])
def test_no_robot_that_turns_about_another_point_arrives_outside_of_the_tolerance(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        distance, bearing, yaw = rng.uniform([0.3, -3.0, -3.0], [3.0, 3.0, 3.0])
        x, y = distance * math.cos(bearing), distance * math.sin(bearing)
        run = Run(pivot=float(rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.06))).start(
            GoalPose(0, 'odom', (x, y, yaw))).until_end()
        assert run.control.state == PathState.ARRIVED, run.control.reason
        assert math.hypot(run.robot.x - x, run.robot.y - y) < 0.0501


def test_a_new_path_replaces_the_old_one_without_stop():
    run = under_way()
    x = run.robot.x
    run.start(path((x, 0.0), (x + 1.0, 0.0), (x + 2.0, 0.3)))
    speeds = [run.step().v_x for _ in range(20)]
    assert min(speeds) > 0.5
    run.until_end()
    assert run.robot.y == pytest.approx(0.3, abs=0.01)
    assert (run.log[1:, 6] - run.log[:-1, 6]).max() <= 0.5 / 20 + 1e-9


def test_a_new_path_backward_first_stops_the_robot():
    run = under_way()
    x = run.robot.x
    run.start(path((x, 0.0, 0.0), (x - 0.5, 0.0, 0.0))).until_end()
    assert run.control.state == PathState.ARRIVED
    assert abs(run.log[1:, 6] - run.log[:-1, 6]).max() <= 0.5 / 20 + 1e-9
    assert run.robot.x == pytest.approx(x - 0.5, abs=0.01)


@pytest.fixture
def waiting():
    """Return a controller with a path and without odometry."""
    control = TrajectoryControl(IDEAL)
    control.follow(line(1.0), 0)
    return control


def test_a_path_before_the_first_odometry_waits_for_it(waiting):
    control = waiting
    assert control.state == PathState.FOLLOWING
    assert control.step(NS_PER_S) is None
    assert math.isnan(control.progress(0).remaining_distance)
    control.add_odometry(odometry(2 * NS_PER_S), 2 * NS_PER_S)
    assert control.step(2 * NS_PER_S).v_x > 0.0


def test_without_odometry_waiting_ends(waiting):
    control = waiting
    assert control.step(NS_PER_S) is None
    assert control.step(11 * NS_PER_S) is None
    assert control.state == PathState.FOLLOWING
    assert control.step(11 * NS_PER_S + 1).v_x == 0.0
    assert control.state == PathState.STOPPED
    assert 'odom: none for 10 s' in control.reason


def test_a_path_that_waited_is_refused_if_it_begins_too_far_away(waiting):
    control = waiting
    control.add_odometry(odometry(0, x=3.0), 0)
    assert control.step(0).v_x == 0.0
    assert control.state == PathState.REFUSED
    assert 'begins 3.00 m from the robot' in control.reason


def test_a_path_that_waited_for_recent_odometry_replaces_the_one_before():
    run = under_way()
    run.now_ns += NS_PER_S
    run.start(path((run.robot.x, 0.0), (run.robot.x + 0.7, 0.0)))
    assert run.step().v_x > 0.1
    assert run.progress[-1].remaining_distance == pytest.approx(0.6, abs=0.1)


def test_with_old_odometry_a_path_is_not_followed():
    run = Run()
    run.now_ns += NS_PER_S
    run.start(line(1.0))
    assert_stopped(run, 'odom: 1.00 s old')


def test_parameters_may_be_changed_while_following():
    run = under_way()
    run.control.params = replace(run.params, max_speed=0.2)
    run.for_seconds(1.5)
    assert run.log[-1, 6] == pytest.approx(0.2)


def test_late_steps_do_not_accelerate_more():
    run = Run().start(FAR)
    run.step()
    run.now_ns += 10 * run.period_ns
    run.observe()
    assert run.control.step(run.now_ns).v_x == pytest.approx(5 * 0.5 / 20)


def test_the_first_step_of_a_path_is_one_period_however_long_the_robot_has_waited():
    run = Run().start(line(0.5))
    while run.control.state == PathState.FOLLOWING:
        run.step()
    run.now_ns += NS_PER_S
    run.observe()
    run.start(FAR)
    assert run.step().v_x == pytest.approx(0.5 / 20)


TOP = IDEAL.max_speed


@pytest.mark.parametrize(('limit', 'percentage', 'speed'), [
    (0.2, False, 0.2), (40.0, True, 0.4 * TOP), (0.0, False, TOP), (0.0, True, TOP),
    (1.01 * TOP, False, TOP), (101.0, True, TOP), (0.5, True, 0.005 * TOP)])
def test_a_speed_limit_is_that_of_nav2_until_the_next_one(limit, percentage, speed):
    run = under_way(seconds=0.5)
    run.control.limit_speed(0.1, percentage=False)
    run.for_seconds(0.5)
    run.control.limit_speed(limit, percentage=percentage)
    assert run.control.max_speed == pytest.approx(speed)
    assert run.for_seconds(1.5).step().v_x == pytest.approx(speed)
    run.control.params = replace(run.control.params, max_speed=0.5 * TOP)
    assert run.control.max_speed == pytest.approx(
        0.5 * speed if percentage else min(speed, 0.5 * TOP))


def test_a_new_speed_limit_is_reached_with_the_deceleration():
    run = under_way(seconds=2.0)
    speeds = [run.step().v_x]
    run.control.limit_speed(0.2, percentage=False)
    speeds += [run.step().v_x for _ in range(20)]
    assert (speeds[0], speeds[-1]) == (pytest.approx(TOP), pytest.approx(0.2))
    change = IDEAL.limits.deceleration / IDEAL.rate
    assert max(-np.diff(speeds)) == pytest.approx(change)


@pytest.mark.parametrize('limit', [-0.1, math.nan, math.inf])
def test_a_speed_limit_that_is_no_speed_is_refused_and_the_last_one_remains(limit):
    run = under_way()
    run.control.limit_speed(0.2, percentage=False)
    with pytest.raises(CommandError, match='speed_limit: '):
        run.control.limit_speed(limit, percentage=True)
    assert run.control.max_speed == 0.2


def compensated(enabled, offset=0.0, **robot):
    """Return a run, and its kinematics, which command more than is wanted."""
    run, more = Run(replace(IDEAL, slip_compensation=enabled), **robot), mock.Mock()
    more.command.side_effect = lambda v_x, yaw_rate, *_: (1.5 * v_x, 2.0 * yaw_rate)
    more.factors.return_value = (1.5, 2.0)
    more.lateral_speed.side_effect = lambda v_x, _, yaw: np.full(np.shape(yaw), offset * v_x)
    run.control._kinematics = more
    return run, more


def test_wanted_velocities_are_compensated_for_slip():
    run, kinematics = compensated(True, y=0.05)
    command = run.start(FAR).step()
    v_x, yaw_rate, now_ns, delay, _ = kinematics.command.call_args.args
    assert (command.v_x, command.yaw_rate) == (1.5 * v_x, 2.0 * yaw_rate)
    assert now_ns == command.stamp_ns == run.now_ns - run.period_ns
    assert delay == IDEAL.follower.actuation_delay
    slip = WheelSlip(0, (0.0,) * 4, (0.0,) * 4, (0.0,) * 4)
    run.control.add_slip(slip)
    kinematics.add_slip.assert_called_once_with(slip)
    assert kinematics.add_motion.call_args.args[0].y == 0.05


def test_without_compensation_the_wanted_velocity_is_commanded():
    run, kinematics = compensated(False, offset=0.3)
    assert run.start(FAR).for_seconds(1.0).robot.y == 0.0
    assert not kinematics.command.called


@pytest.mark.parametrize('length', [3.0, -3.0])
def test_the_velocity_points_along_the_path_not_the_body(length):
    """A velocity to the left of the body makes the body point to the right of the path."""
    run, kinematics = compensated(True, 0.1)
    run.start(line(length)).for_seconds(0.2)
    assert kinematics.command.call_args.args[1] < -0.005


def arrived():
    """Return a run that holds after its arrival."""
    run = Run(HOLDING).start(line(0.5)).until_end()
    assert (run.control.state, run.control.active) == (PathState.ARRIVED, True)
    return run


def stands(command):
    """Return whether a command is one of zero."""
    return command is not None and (command.v_x, command.yaw_rate) == (0.0, 0.0)


def test_the_robot_is_held_after_arrival_until_cancelled():
    run = arrived()
    assert all(stands(run.step()) for _ in range(50))
    run.control.cancel('canceled by the user')
    assert run.step() is None
    assert (run.control.state, run.control.reason) == (PathState.STOPPED, 'canceled by the user')


def test_the_hold_goes_on_without_odometry_and_when_an_order_is_refused():
    run = arrived()
    run.now_ns += 10 * NS_PER_S
    assert stands(run.control.step(run.now_ns))
    run.start(path((0, 0), (1, 0), frame='map'))
    assert run.control.state == PathState.REFUSED
    assert stands(run.control.step(run.now_ns + 1))


def test_a_new_path_ends_the_hold():
    run = arrived()
    run.start(path((0.5, 0), (1.0, 0)))
    assert run.for_seconds(0.5).robot.v_x > 0.05
    run.control.cancel('canceled')
    assert stands(run.step())
    assert run.step() is None


@pytest.mark.parametrize('params', [IDEAL, HOLDING])
def test_only_arrival_begins_a_hold(params):
    run = under_way(params=params)
    run.control.cancel('canceled')
    assert_stopped(run, 'canceled')


@pytest.mark.parametrize('factors', [(0.0, 0.0), (-1.0, 1.0), (1.0, 57.3)])
def test_a_path_is_followed_with_a_twist_that_contradicts_the_poses(factors, monkeypatch):
    true = IdealRobot.odometry

    def wrong(robot, now_ns):
        one = true(robot, now_ns)
        return replace(one, linear=(factors[0] * one.linear[0], 0.0, 0.0),
                       angular=(0.0, 0.0, factors[1] * one.angular[2]))
    monkeypatch.setattr(IdealRobot, 'odometry', wrong)
    run = Run().start(figure_eight(0.5)).for_seconds(3.0)
    assert 'contradicts its poses' in run.control.twist_fault
    run.until_end()
    assert run.control.state == PathState.ARRIVED, run.control.reason
    assert distances(figure_eight(0.5), run.log).max() < 0.08
