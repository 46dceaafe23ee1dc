# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A path given to the controller: when it has ended, and when its rest is sent again."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from smart_tire.cli import _drive_session
from smart_tire.cli._drive_session import (
    ANSWER_TIME, EXTRA_TIME, follow_resuming, Following, MAX_RESUMPTIONS, MIN_MEAN_SPEED, MIN_REST,
    note, OLD_REPORT_TIME, remaining_path, Session, SILENCE_TIME)
from smart_tire.cli._stack import RobotError
from smart_tire.control.command_check import check_age
from smart_tire.control.path_library import figure_eight
from smart_tire.control.trajectory_control import PathState
from smart_tire.errors import CommandError, LateCommandError
from smart_tire.host_load import HostLoad
from smart_tire.samples import NAN, NS_PER_S, PathProgress
from support.ideal_robot import distances, odometry, path, Run

BEGIN = 100.0  # s


def report(state):
    return PathProgress(0, NAN, NAN, int(state))


def run(*reports, length=1.0):
    """Return the result of the last of ``reports`` (seconds after the begin, state or None)."""
    following, result = Following(length, BEGIN), None
    for seconds, state in reports:
        result = following.end_state(None if state is None else report(state), BEGIN + seconds)
    return result


@pytest.mark.parametrize(
    'end', [PathState.ARRIVED, PathState.STOPPED, PathState.REFUSED, PathState.IDLE])
def test_the_state_after_following_is_the_result(end):
    assert run((0.1, PathState.FOLLOWING), (0.2, PathState.FOLLOWING)) is None
    assert run((0.1, PathState.FOLLOWING), (0.2, end)) == end


@pytest.mark.parametrize('old', [PathState.ARRIVED, PathState.STOPPED, PathState.REFUSED])
def test_a_report_about_the_path_before_is_no_result(old):
    assert run((OLD_REPORT_TIME - 0.1, old)) is None
    assert run((OLD_REPORT_TIME - 0.1, old), (OLD_REPORT_TIME, PathState.FOLLOWING)) is None
    assert run((OLD_REPORT_TIME + 0.1, old)) == old


def test_on_a_busy_host_all_times_are_longer():
    following = Following(1.0, BEGIN, patience=10.0)
    arrived = report(PathState.ARRIVED)
    assert following.end_state(arrived, BEGIN + 10.0 * OLD_REPORT_TIME - 0.1) is None
    assert following.end_state(arrived, BEGIN + 10.0 * OLD_REPORT_TIME + 0.1) == PathState.ARRIVED
    idle = report(PathState.IDLE)
    assert Following(1.0, BEGIN, patience=10.0).end_state(idle, BEGIN + 10.0 * ANSWER_TIME) is None
    assert following.end_state(report(PathState.FOLLOWING), BEGIN + 15.0) is None
    assert following.end_state(None, BEGIN + 15.0 + 10.0 * SILENCE_TIME) is None
    with pytest.raises(RobotError, match='does not report'):
        following.end_state(None, BEGIN + 15.1 + 10.0 * SILENCE_TIME)


def test_the_latest_distance_that_was_reported_is_kept():
    following = Following(2.0, BEGIN)
    assert following.remaining == 2.0
    for distance, state in ((1.5, PathState.FOLLOWING), (NAN, PathState.FOLLOWING),
                            (NAN, PathState.STOPPED)):
        following.end_state(PathProgress(0, distance, NAN, int(state)), BEGIN + 1.0)
    assert following.remaining == 1.5


def test_a_controller_that_stays_idle_has_not_received_the_path():
    assert run((ANSWER_TIME - 0.1, PathState.IDLE)) is None
    with pytest.raises(RobotError, match='has not received the path'):
        run((1.0, PathState.IDLE), (2.0, PathState.IDLE), (ANSWER_TIME + 0.1, PathState.IDLE))


def test_silence_is_an_error():
    for first in ((), ((0.2, PathState.FOLLOWING),)):
        since = first[0][0] if first else 0.0
        following = Following(1.0, BEGIN)
        latest = report(PathState.FOLLOWING) if first else None
        following.end_state(latest, BEGIN + since)
        assert following.end_state(latest, BEGIN + since + SILENCE_TIME - 0.01) is None
        with pytest.raises(RobotError, match='does not report'):
            following.end_state(latest, BEGIN + since + SILENCE_TIME + 0.01)


def test_the_time_is_limited_by_a_mean_speed():
    limit = EXTRA_TIME + 2.0 / MIN_MEAN_SPEED
    steps = [(float(k), PathState.FOLLOWING) for k in range(int(limit))]
    assert run(*steps, (limit, PathState.FOLLOWING), length=2.0) is None
    with pytest.raises(RobotError, match='not reached within 70 s'):
        run(*steps, (limit + 0.1, PathState.FOLLOWING), length=2.0)


def test_times_are_those_that_a_user_waits():
    assert (ANSWER_TIME, SILENCE_TIME, EXTRA_TIME, MIN_MEAN_SPEED) == (3.0, 3.0, 30.0, 0.05)


def test_the_note_omits_unknown_distances():
    assert note(None) == 'waiting for trajectory_controller'
    assert note(report(PathState.IDLE)) == 'idle'
    assert note(PathProgress(0, 1.234, -0.02, 1)) == (
        'following, 1.23 m left, -0.020 m from the path')


@pytest.mark.parametrize('running, heard', [
    (['/motor_driver'], 'motor_driver'), (['/b/motor_driver', '/others'], ''), ([], '')])
def test_a_second_robot_in_a_domain_is_refused(running, heard, monkeypatch):
    """Its name may be heard late; that of a robot in another namespace is no conflict."""
    from smart_tire.nodes import compat
    waits = iter([[], [], running])
    monkeypatch.setattr(compat, 'node_names', lambda node: next(waits, running))
    monkeypatch.setattr(_drive_session, 'DISCOVERY_TIME', 60.0 if heard else 0.05)
    monkeypatch.setenv('ROS_DOMAIN_ID', '57')
    session = Session(SimpleNamespace(check_alive=lambda: None), SimpleNamespace(
        node=SimpleNamespace(get_namespace=lambda: '/'), spin=lambda seconds: None))
    if heard:
        with pytest.raises(RobotError, match=f'a robot runs in ROS_DOMAIN_ID 57 .{heard}.: end'):
            session.refuse_other_robot(['imu_driver', 'motor_driver'])
    else:
        session.refuse_other_robot(['imu_driver', 'motor_driver'])


LATE_REASON = 'odom: 1.04 s old, expected at most 1 s'
LINE = ((0.0, 0.0, NAN), (2.0, 0.0, NAN), (4.0, 0.0, NAN))


class Drives:
    """A session whose drives end as given: (state, cause, distance left, position)."""

    def __init__(self, *ends):
        self._ends = list(ends)
        self.paths, self.awaited, self.remaining, self.late_host = [], 0, 0.0, ''

    def follow(self, name, poses, dashboard, patience):
        assert patience > 1.0
        self.paths.append(poses)
        state, self._cause, self.remaining, self._position = self._ends.pop(0)
        return state

    def reason(self, state):
        return f'because: {self._cause}', self._cause

    def await_standstill(self):
        self.awaited += 1

    def start_pose(self):
        return (*self._position, 0.0)


def test_after_a_stop_for_late_data_the_rest_of_the_path_is_followed():
    drives = Drives((PathState.STOPPED, 'late', 3.2, (1.1, 0.1)),
                    (PathState.REFUSED, 'late', 2.9, (1.1, 0.1)),
                    (PathState.ARRIVED, '', 0.0, (4.0, 0.0)))
    assert follow_resuming(drives, 'line', LINE, None) == (PathState.ARRIVED, '')
    assert drives.paths[0] == LINE
    for rest in drives.paths[1:]:
        assert rest[0][:2] == (1.1, 0.1)
        assert rest[1:] == LINE[1:]
    assert drives.awaited == 2


@pytest.mark.parametrize('cause', ['motion', 'order', ''])
def test_a_stop_for_another_reason_is_final(cause):
    drives = Drives((PathState.STOPPED, cause, 3.0, (1.0, 0.0)))
    assert follow_resuming(drives, 'line', LINE, None) == (PathState.STOPPED, f'because: {cause}')


@pytest.mark.parametrize('late_host, cause, resumed', [
    ('timers late', 'motion', True), ('', 'motion', False), ('timers late', 'order', False)])
def test_a_stop_for_the_motion_is_caused_by_a_host_that_is_late(late_host, cause, resumed):
    drives = Drives((PathState.STOPPED, cause, 3.0, (1.0, 0.0)),
                    (PathState.ARRIVED, '', 0.0, (4.0, 0.0)))
    drives.late_host = late_host
    assert follow_resuming(drives, 'line', LINE, None)[0] == (
        PathState.ARRIVED if resumed else PathState.STOPPED)


def test_after_too_many_stops_the_reason_counts_them():
    drives = Drives(*[(PathState.STOPPED, 'late', 3.0, (1.0, 0.0))] * (MAX_RESUMPTIONS + 1))
    state, reason = follow_resuming(drives, 'line', LINE, None)
    assert state == PathState.STOPPED
    assert reason == 'because: late; stopped 11 times'


def test_the_causes_of_the_controller_are_those_of_a_resumption():
    run = Run().start(path((0.0, 0.0), (3.0, 0.0))).for_seconds(2.0)
    run.control.step(run.now_ns + round(0.6 * NS_PER_S))
    assert run.control.state == PathState.STOPPED
    assert run.control.cause.value == 'late'
    with pytest.raises(LateCommandError) as error:
        check_age('path', NS_PER_S, 4 * NS_PER_S, 0, 2.0)
    run.control.refuse(error.value)
    assert run.control.cause.value == 'late'
    run.control.cancel('canceled by cancel_path')
    run.control.refuse(CommandError('2 publishers'))
    assert run.control.cause.value == 'order'


def test_the_rest_begins_at_the_nearest_place_within_the_distance_driven_since_the_report():
    eight = figure_eight(0.5).poses  # crosses itself at its beginning
    total = sum(math.dist(one[:2], other[:2]) for one, other in zip(eight, eight[1:]))
    for remaining in (total, 0.5 * total):
        rest = remaining_path(eight, remaining, (eight[0][0], eight[0][1] + 0.001))
        left = sum(math.dist(one[:2], other[:2]) for one, other in zip(rest, rest[1:]))
        assert left == pytest.approx(remaining, abs=0.02)
        assert rest[-1] == eight[-1]


def test_turns_in_place_that_were_not_made_are_kept():
    corner = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 1.5), (1.0, 1.0, 1.5))
    assert remaining_path(corner, 1.5, (0.5, 0.0))[1:] == corner[1:]
    assert remaining_path(corner, 1.0, (1.0, 0.0))[1:] == corner[1:]


def test_a_robot_away_from_the_path_joins_it_further_on():
    line = tuple((0.1 * k, 0.0, NAN) for k in range(41))
    rest = remaining_path(line, 3.0, (1.2, 0.4))
    assert rest[0][:2] == (1.2, 0.4) and rest[1:] == line[20:]
    assert remaining_path(line, 0.5, (3.8, 0.4))[1:] == line[-1:]


@pytest.mark.parametrize('remaining', [0.0, 0.02])
def test_at_the_end_a_short_part_is_left_so_that_it_is_a_path(remaining):
    rest = remaining_path(LINE, remaining, (4.01, 0.0))
    assert rest == ((4.0 - MIN_REST, 0.0, pytest.approx(NAN, nan_ok=True)), LINE[-1])


def test_the_robot_arrives_on_the_path_after_stops_for_late_data():
    planned = figure_eight(0.5)
    poses, rows = planned.poses, []
    run = Run()
    for pause in (4.0, 3.0, 5.0, 60.0):  # s until odom is late
        run.start(path(*poses)).until_end(pause)
        rows += run.rows
        remaining = run.progress[-1].remaining_distance
        run.rows.clear()
        if run.control.state == PathState.FOLLOWING:
            robot = run.robot
            while run.control.state == PathState.FOLLOWING:  # blind, until it stops
                command = run.control.step(run.now_ns)
                robot.drive(command.v_x, command.yaw_rate, 0.05)
                run.now_ns += run.period_ns
            run.for_seconds(1.0)
            poses = remaining_path(poses, remaining, (robot.x, robot.y))
    assert run.control.state == PathState.ARRIVED
    assert distances(planned, np.array(rows)).max() < 0.1


class Controller:
    """A pilot whose controller sends its diagnostics at the third look."""

    def __init__(self, cause='late'):
        self.health = {'trajectory_controller': {
            'state': 'stopped', 'reason': 'of another path', 'cause': 'order'}}
        self.looks, self.state, self.text, self.cause = 0, 'stopped', LATE_REASON, cause

    def refuse(self):
        """Let the next diagnostics be those of a refused path."""
        self.looks, self.state, self.text, self.cause = 0, 'refused', 'too old', 'late'

    def look(self, seconds):
        self.looks += 1
        if self.looks == 3:
            self.health['trajectory_controller'] = {
                'state': self.state, 'reason': self.text, 'cause': self.cause}


class Robot:
    """A pilot that receives odometry (time of measurement [s], speed), one at each look."""

    def __init__(self, *received):
        self._received, self.looks = list(received), 0
        self.odometry = odometry(round(9.9 * NS_PER_S))

    def now_ns(self):
        return 10 * NS_PER_S

    def look(self, seconds):
        self.looks += 1
        time, speed = self._received.pop(0)
        self.odometry = odometry(round(time * NS_PER_S), v_x=speed)


def session_of(pilot):
    return Session(SimpleNamespace(check_alive=lambda: None),
                   SimpleNamespace(node=pilot, spin=pilot.look))


def test_the_reason_is_that_of_the_diagnostics_after_the_stop():
    pilot = Controller()
    assert session_of(pilot).reason(PathState.STOPPED) == (LATE_REASON, 'late')
    assert pilot.looks == 3


@pytest.mark.parametrize('cause, named', [('late', True), ('motion', True), ('order', False)])
def test_a_late_host_is_the_only_reason_but_not_for_orders(cause, named):
    pilot = Controller(cause)
    load = HostLoad(0.031, 0.4, 36.0, 2)
    pilot.health['imu_driver'] = {key: str(value) for key, value in load.values.items()}
    assert session_of(pilot).reason(PathState.STOPPED) == (
        str(load) if named else LATE_REASON, cause)
    pilot.refuse()
    assert session_of(pilot).reason(PathState.REFUSED) == ('too old', 'late')
    pilot.health['imu_driver'] = {}
    assert session_of(pilot).late_host == ''


def test_a_pose_of_the_standing_robot_that_is_measured_from_now_on_is_awaited(monkeypatch):
    pilot = Robot((9.99, 0.0), (10.1, 0.1), (10.2, 0.01), (10.3, 0.0))
    session_of(pilot).await_standstill()
    assert pilot.looks == 3
    monkeypatch.setattr(_drive_session, 'START_TIMEOUT', 0.0)
    with pytest.raises(RobotError, match='no recent odom of a standing robot within 0 s'):
        session_of(Robot(*[(9.99, 0.0)] * 9)).await_standstill()
