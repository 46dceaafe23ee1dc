# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire drive``: arguments, confirmation, how a drive ends."""

from __future__ import annotations

import io
import os
import signal
from types import SimpleNamespace

import pytest

from smart_tire.cli import _drive_session, drive
from smart_tire.cli._dashboard import Dashboard
from smart_tire.cli._drive_session import Session
from smart_tire.cli._keyboard import DriveKey, StopRequest, Teleoperation
from smart_tire.cli._path_file import extent, length, read_plan
from smart_tire.cli._stack import RobotError
from smart_tire.cli.demo import border_point
from smart_tire.cli.main import main
from smart_tire.control.path_library import PATHS
from smart_tire.control.trajectory_control import PathState
from smart_tire.errors import ParameterError
from smart_tire.samples import NAN, NS_PER_S, PathProgress
from support.ideal_robot import odometry

LINE = ((0.0, 0.0, NAN), (1.0, 0.0, NAN))


class Answer:
    """The answer of a service."""

    def __init__(self, done):
        self.done = lambda: done


class Pilot:
    """A pilot whose robot reports ``states``, one per look, after a path was published."""

    def __init__(self, states=(), answers=True):
        self.odometry = odometry(0, 1.0, 2.0)
        self.wheels = self.slip = self.progress = None
        self.friction, self.crossings, self.health, self.stopped = {}, {}, {}, ''
        self.emergency_stop = False
        self.states, self.answers = list(states), answers
        self.paths, self.commands, self.canceled = [], [], 0

    @property
    def has_path(self):
        return bool(self.paths)

    def listeners(self, topic):
        return 1

    def now_ns(self):
        return NS_PER_S // 2

    def follow(self, poses):
        self.paths.append(poses)

    def cancel(self):
        self.canceled += 1
        return Answer(True) if self.answers else None

    def command(self, *command):
        self.commands.append(command)

    def halt(self):
        if self.commands:
            self.command(0.0, 0.0)


class Runner:
    """Handles messages by taking the next of the pilot's states; no time passes."""

    def __init__(self, pilot):
        self.node, self.spins = pilot, 0

    def spin(self, seconds):
        self.spins += 1
        assert self.spins < 10_000
        if self.node.has_path and self.node.states:
            state = self.node.states.pop(0)
            if isinstance(state, BaseException):
                raise state
            self.node.progress = PathProgress(0, NAN, NAN, int(state))


@pytest.fixture
def dashboard():
    from rich.console import Console
    return Dashboard(Console(file=io.StringIO()))


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Do not wait for standstill, nor for a report that does not come."""
    for name in ('STANDSTILL_TIME', 'REPORT_TIME'):
        monkeypatch.setattr(_drive_session, name, 0.0)


def session_of(pilot, stopped=None):
    return Session(SimpleNamespace(check_alive=lambda: None), Runner(pilot), stopped)


@pytest.mark.parametrize('words, message', [
    (['--path', 'square', '--keyboard'], 'not allowed with'),
    ([], 'is required'),
    (['--path', 'nowhere'], 'nowhere: no such file, and not one of figure_eight, square'),
    (['--path', 'square', '--speed', '-1'], 'invalid'),
    (['--path', 'square', '--robot', '--speed', '0.5'], 'ros2 param set'),
    (['--path', 'square', '--robot', '--params', __file__], '--params is for the simulated'),
    (['--keyboard'], 'standard input is not a terminal')])
def test_wrong_arguments_are_usage_errors(words, message, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr('sys.stdin', io.StringIO())
    try:
        status = main(['drive', '--out', str(tmp_path / 'out'), *words])
    except SystemExit as error:
        status = error.code
    assert status == 2 and message in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('typed', ['', '\n', 'yes\n'])
def test_a_robot_is_not_driven_along_a_path_without_confirmation(
        typed, tmp_path, capsys, monkeypatch):
    pytest.importorskip('rclpy')
    monkeypatch.setattr('sys.stdin', io.StringIO(typed))
    out = tmp_path / 'out'
    assert main(['drive', '--robot', '--path', 'square', '--out', str(out)]) == 2
    printed = capsys.readouterr()
    assert 'square, 8.0 m long, up to 2.8 m from its present pose' in printed.out
    assert 'cancel_path' in printed.out
    assert 'nothing was driven' in printed.err and not out.exists()


@pytest.mark.parametrize('name', PATHS)
def test_paths_begin_ahead_of_the_robot_and_have_a_scale(name):
    path, double = read_plan(name, 1.0), read_plan(name, 2.0)
    assert path[0][:2] == pytest.approx((0.0, 0.0), abs=1e-9)
    assert path[1][0] > 0.0 and abs(path[1][1]) < 0.1 * path[1][0]
    assert length(double) == pytest.approx(2.0 * length(path), rel=1e-3)
    assert 1.0 < extent(path) < 5.0


@pytest.mark.parametrize('end', [PathState.ARRIVED, PathState.STOPPED])
def test_the_end_of_the_path_is_the_state_after_following(end, dashboard):
    pilot = Pilot([PathState.FOLLOWING, PathState.FOLLOWING, end])
    session = session_of(pilot)
    with session.ending():
        assert session.follow('line', LINE, dashboard) == end
    assert pilot.paths == [LINE] and not pilot.canceled


@pytest.mark.parametrize(('end', 'status'), [
    (PathState.ARRIVED, 0), (PathState.STOPPED, 1), (PathState.REFUSED, 1),
    (KeyboardInterrupt(), 130)])
def test_the_exit_status_is_how_a_drive_along_a_path_has_ended(end, status, monkeypatch):
    monkeypatch.setattr(_drive_session, 'REASON_TIME', 0.0)
    session = session_of(Pilot([PathState.FOLLOWING, end]))
    assert drive._follow(SimpleNamespace(path='line', absolute=True), session, LINE) == status


@pytest.mark.parametrize('error', [KeyboardInterrupt(), RobotError('a node died')])
@pytest.mark.parametrize('before', [(), (PathState.FOLLOWING,)])
def test_a_path_is_canceled_if_the_program_ends_before_the_robot_arrives(
        before, error, dashboard):
    pilot = Pilot([*before, error])
    session = session_of(pilot)
    with pytest.raises(type(error)), session.ending():
        session.follow('line', LINE, dashboard)
    assert pilot.canceled == 1


def test_a_path_that_cannot_be_canceled_is_reported(dashboard, capsys):
    pilot = Pilot([PathState.FOLLOWING, KeyboardInterrupt()], answers=False)
    session = session_of(pilot)
    with pytest.raises(KeyboardInterrupt), session.ending():
        session.follow('line', LINE, dashboard)
    assert 'stop the robot by its emergency stop' in capsys.readouterr().out


def test_a_signal_ends_the_drive_at_the_next_look():
    with StopRequest() as stopped:
        session = session_of(Pilot(), stopped)
        session.spin()
        os.kill(os.getpid(), signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            session.spin()


def test_a_robot_that_does_not_listen_is_a_usage_error(monkeypatch):
    monkeypatch.setattr(_drive_session, 'DISCOVERY_TIME', 0.0)
    pilot = Pilot()
    pilot.listeners = lambda topic: 0
    with pytest.raises(ParameterError, match='subscribes to path: start trajectory_controller'):
        session_of(pilot).await_robot('path', 'trajectory_controller')


def test_an_emergency_stop_is_to_be_released_first():
    pilot = Pilot()
    pilot.emergency_stop = True
    with pytest.raises(RobotError, match='emergency stop is active'):
        session_of(pilot).await_robot('path', 'trajectory_controller')


def test_clocks_that_certainly_differ_are_warnings(monkeypatch):
    pytest.importorskip('rclpy')
    offsets = {'/a': (-0.001, 0.0005), '/b': (0.0012, 0.003)}
    monkeypatch.setattr('smart_tire.nodes.compat.node_names', lambda _: offsets)
    monkeypatch.setattr('smart_tire.nodes.clock_offset._trips', lambda _, name: name)
    monkeypatch.setattr('smart_tire.nodes.clock_offset.offset_bounds', offsets.get)
    text, = session_of(Pilot()).clock_warnings()
    assert text.startswith('node /b: its clock is +1.20 to +3.00 ms from that of this host')


def test_the_keyboard_is_refused_while_a_path_is_followed():
    pilot = Pilot()
    session_of(pilot).refuse_other_driver()
    pilot.progress = PathProgress(0, NAN, NAN, int(PathState.FOLLOWING))
    with pytest.raises(RobotError, match='cancel it first'):
        session_of(pilot).refuse_other_driver()


class Keys:
    """A keyboard with keys to come, one list per look; then QUIT."""

    def __init__(self, *looks):
        self._looks = list(looks)

    def pressed(self):
        return self._looks.pop(0) if self._looks else [DriveKey.QUIT]


@pytest.fixture
def clock(monkeypatch):
    """Let 50 ms pass with each look."""
    now = [100.0]

    def monotonic():
        now[0] += 0.025  # two calls per look
        return now[0]

    monkeypatch.setattr(_drive_session.time, 'monotonic', monotonic)


def test_keys_drive_and_nothing_is_commanded_after_they_were_released(clock):
    pilot = Pilot()
    session = session_of(pilot)
    with session.ending():
        session.teleoperate(Keys([], [], [DriveKey.FORWARD], *[[] for _ in range(100)]),
                            Teleoperation(0.3))
    speeds = [speed for speed, _ in pilot.commands]
    assert 0.0 < max(speeds) <= 0.3 and speeds[-1] == 0.0
    assert speeds.count(0.0) >= 3   # standstill is commanded repeatedly, one may be lost
    assert len(speeds) < 60         # then others may drive


def test_the_emergency_stop_ends_the_command(clock):
    pilot = Pilot()
    pilot.emergency_stop = True
    session_of(pilot).teleoperate(Keys(*[[DriveKey.FORWARD]] * 21), Teleoperation(0.3))
    assert set(pilot.commands) == {(0.0, 0.0)}


@pytest.mark.parametrize('pose, side', [((6.3, -2.0), (3.0, None)), ((-7.0, 1.0), (-3.0, None)),
                                        ((1.0, 6.5), (None, 3.0)), ((-2.0, -6.6), (None, -3.0))])
def test_the_eight_of_the_demo_begins_at_the_border_of_both_grounds(pose, side):
    point = border_point(*pose)
    assert all(wanted is None or found == wanted for found, wanted in zip(point, side))
    assert max(map(abs, point)) == 3.0


def test_there_is_no_border_to_cross_on_the_concrete():
    with pytest.raises(RobotError, match='should be on the sand'):
        border_point(1.0, -2.0)
