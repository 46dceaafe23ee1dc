# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A path given to the controller: when it has ended, and why it has stopped."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from smart_tire.cli import _drive_session
from smart_tire.cli._drive_session import (
    ANSWER_TIME, EXTRA_TIME, Following, MIN_MEAN_SPEED, note, OLD_REPORT_TIME, Session,
    SILENCE_TIME)
from smart_tire.cli._stack import RobotError
from smart_tire.control.trajectory_control import PathState
from smart_tire.host_load import HostLoad
from smart_tire.samples import NAN, NS_PER_S, PathProgress
from support.ideal_robot import odometry

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
    assert session_of(pilot).reason(PathState.STOPPED) == LATE_REASON
    assert pilot.looks == 3


@pytest.mark.parametrize('cause, named', [('late', True), ('motion', True), ('order', False)])
def test_a_late_host_is_the_only_reason_but_not_for_orders(cause, named):
    pilot = Controller(cause)
    load = HostLoad(0.031, 0.4, 36.0, 2)
    pilot.health['imu_driver'] = {key: str(value) for key, value in load.values.items()}
    assert session_of(pilot).reason(PathState.STOPPED) == (str(load) if named else LATE_REASON)
    pilot.refuse()
    assert session_of(pilot).reason(PathState.REFUSED) == 'too old'
    pilot.health['imu_driver'] = {}
    assert session_of(pilot).late_host == ''


def test_a_recording_begins_when_all_awaited_topics_are_received(monkeypatch):
    received = ['/r1/ground_truth/odom', '/r1/imu/data_raw', '/r1/imu/data', '/r1/odom']
    log = []
    stack = SimpleNamespace(
        check_alive=lambda: None, start=lambda *words: log.clear(),
        log=lambda name: ''.join(f'[recorder]: recording {topic}\n' for topic in log))
    pilot = SimpleNamespace(resolve_topic_name=lambda topic: f'/r1/{topic}')
    session = Session(stack, SimpleNamespace(
        node=pilot, spin=lambda seconds: log.append(received[len(log)])))
    session.record(Path('bag'), ('imu/data', 'odom'))
    assert log == received
    session.record(Path('bag'), ('imu/data',))
    assert log == received[:3]
    monkeypatch.setattr(_drive_session, 'START_TIMEOUT', 0.0)
    with pytest.raises(RobotError, match='the recorder does not receive odom$'):
        session.record(Path('bag'), ('odom',))


def test_a_pose_of_the_standing_robot_that_is_measured_from_now_on_is_awaited(monkeypatch):
    pilot = Robot((9.99, 0.0), (10.1, 0.1), (10.2, 0.01), (10.3, 0.0))
    session_of(pilot).await_standstill()
    assert pilot.looks == 3
    monkeypatch.setattr(_drive_session, 'START_TIMEOUT', 0.0)
    with pytest.raises(RobotError, match='no recent odom of a standing robot within 0 s'):
        session_of(Robot(*[(9.99, 0.0)] * 9)).await_standstill()


def test_a_simulated_time_that_stands_for_long_is_an_error(monkeypatch):
    real, simulated = [0.0], [0]
    monkeypatch.setattr(_drive_session.SYSTEM, 'now_ns', lambda: simulated[0])
    monkeypatch.setattr(_drive_session.time, 'monotonic', lambda: real[0])
    session = session_of(SimpleNamespace(look=lambda seconds: None))
    for passed in (0, 1, 0):
        real[0] += 119.0
        simulated[0] += passed
        session.spin()
    real[0] += 2.0
    with pytest.raises(RobotError, match='simulated time has stood for 120 s'):
        session.spin()
