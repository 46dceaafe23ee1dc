# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire robot``: processes, restarts with growing waits, and the end."""

from __future__ import annotations

import time

import pytest
from smart_tire.cli.main import main
from smart_tire.cli.robot import Supervisor
from smart_tire.errors import ParameterError
from smart_tire.launching import SEPARATE
from smart_tire.nodes.command_line import COMPOSED
from support.graph import Process
from support.stack import children

pytestmark = pytest.mark.processes


class StandIn:
    """Stand-in for the stack: processes that end as planned, and the time."""

    def __init__(self, monkeypatch, *ends):
        self.processes = {}
        self.started = []  # time, name, arguments
        self._now, self._ends = 0.0, list(ends)  # (time, name, status)
        monkeypatch.setattr(time, 'monotonic', lambda: self._now)
        monkeypatch.setattr(time, 'sleep', self._sleep)

    def __bool__(self):
        return not self._ends and self._now > 300.0

    def _sleep(self, seconds):
        self._now += seconds

    def start(self, name, module, *arguments):
        assert module == f'smart_tire.nodes.{name}'
        assert name not in self.processes
        self.processes[name] = object()
        self.started.append((self._now, name, arguments))

    def died(self):
        ended = [end for end in self._ends if end[0] <= self._now and end[1] in self.processes]
        self._ends = [end for end in self._ends if end not in ended]
        return {name: status for _, name, status in ended}

    def starts(self, name):
        return [(now, arguments) for now, other, arguments in self.started if other == name]


def supervised(stand_in):
    Supervisor(stand_in, ['--ros-args', '-p', 'rate:=20']).run(stand_in)


def test_a_process_that_dies_again_and_again_starts_ever_more_rarely(monkeypatch):
    stack = StandIn(monkeypatch, *((end, COMPOSED, -9) for end in (10.0, 13.0, 18.0, 100.0)))
    supervised(stack)
    assert [now for now, _ in stack.starts(COMPOSED)] == pytest.approx(
        [0.0, 12.0, 17.0, 26.0, 102.0], abs=0.3)
    assert {words for _, words in stack.starts(COMPOSED)} == {('--ros-args', '-p', 'rate:=20')}
    assert [len(stack.starts(name)) for name in SEPARATE] == [1, 1]


def test_motor_driver_starts_again_with_the_emergency_stop_engaged(monkeypatch):
    stack = StandIn(monkeypatch, (1.0, 'motor_driver', 1), (5.0, 'motor_driver', -11))
    supervised(stack)
    plain = ('--ros-args', '-p', 'rate:=20')
    assert [words for _, words in stack.starts('motor_driver')] == [
        plain, *[(*plain, '-p', 'start_stopped:=true')] * 2]


def test_a_process_that_is_interrupted_remains_ended(monkeypatch):
    stack = StandIn(monkeypatch, (1.0, 'wheel_controller', 0))
    supervised(stack)
    assert len(stack.starts('wheel_controller')) == 1


@pytest.mark.parametrize('end', [(1.0, COMPOSED, 2), (1.0, 'robot_simulator', 1)])
def test_a_refused_process_and_the_end_of_the_simulator_are_errors(end, monkeypatch):
    stack = StandIn(monkeypatch, end)
    stack.processes['robot_simulator'] = object()
    with pytest.raises(ParameterError, match=f'{end[1]} ended with status {end[2]}'):
        supervised(stack)


def test_a_missing_parameter_file_is_refused(capsys, tmp_path):
    assert main(['robot', '--params', str(tmp_path / 'none.yaml')]) == 2
    assert 'none.yaml' in capsys.readouterr().err


def test_a_wrong_parameter_ends_all_processes(tmp_path):
    with Process(['-m', 'smart_tire.cli.main', 'robot', '--ros-args', '-p',
                  'wheel_controller:rate:=fast'], tmp_path / 'robot.log') as robot:
        assert robot.ended() == 2
        assert 'smart_tire robot: wheel_controller ended with status 2' in robot.output
        assert not children(robot.popen.pid)
