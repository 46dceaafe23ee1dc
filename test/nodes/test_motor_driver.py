# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The motor driver in virtual time without boards: services, states, what its diagnostics say."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from smart_tire.nodes.motor_driver import MotorDriver
from smart_tire.protocol.roboclaw import READ_CURRENTS, READ_ENCODERS, SET_DUTY
from smart_tire.samples import MotorCommand, NS_PER_S
from support.virtual_node import virtual

pytestmark = pytest.mark.processes

BOARDS = ('front board 128 (0x80)', 'rear board 129 (0x81)')
LINE_HOLD = 'motor boards are not ready'


@pytest.fixture
def made(isolated_ros, tmp_path, monkeypatch):
    """Return the maker of a node whose port is never opened."""
    from smart_tire.drivers.serial_port import SerialPort
    monkeypatch.setattr(SerialPort, 'start', lambda port: None)
    monkeypatch.setattr(SerialPort, 'stop', lambda port: None)
    return lambda **given: virtual(MotorDriver, port=str(tmp_path / 'none'), **given)


def states(node):
    """Return the latest state of the emergency stop and of the motors."""
    return [node.received[name][-1].data for name in ('emergency_stop_active', 'motors_enabled')]


def acknowledge(node, *, all_boards=True):
    """Let the boards acknowledge zero duty at once, or all but the second one never."""
    boards = node._output.boards
    boards.await_zero = lambda seconds: [] if all_boards else [BOARDS[1]]


def test_a_stop_is_latched_until_it_is_released_and_says_who_did_not_confirm(made):
    with made(release_hold_off=0.1) as node:
        node._output._clock = SimpleNamespace(now_ns=node.steady_ns)
        node._gate.clear('line')
        acknowledge(node, all_boards=False)
        answer = node.call('emergency_stop', data=True)
        assert (answer.success, answer.message) == (
            False, f'stopped until released; zero duty not acknowledged by {BOARDS[1]}')
        assert states(node) == [True, False]
        acknowledge(node)
        assert node.call('emergency_stop', data=True).success
        node.run(0.1)
        answer = node.call('emergency_stop', data=False)
        assert (answer.success, answer.message) == (True, 'released')
        assert states(node)[0] is False
        assert node.log.lines[-2:] == ['warning: emergency stop: stopped until released',
                                       'warning: emergency stop: released']


def test_refused_releases_are_logged_the_first_second_and_fourth_time(made):
    with made(release_hold_off=60.0) as node:
        acknowledge(node)
        node.call('emergency_stop', data=True)
        assert not any(node.call('emergency_stop', data=False).success for _ in range(5))
        assert sum('release refused' in line for line in node.log.lines) == 3
        assert states(node)[0] is True
        assert node.health().values['releases_refused'] == '5'


@pytest.mark.parametrize('latched', [False, True])
def test_the_emergency_stop_may_be_latched_at_the_start(made, latched):
    with made(start_stopped=latched) as node:
        assert states(node)[0] is latched
        assert node.health().values['emergency_stop'] == str(latched)
        assert ('warning: emergency stop: latched at start, until released'
                in node.log.lines) is latched


def test_arming_names_what_prevents_it(made):
    with made(require_arming=True) as node:
        answer = node.call('arm', data=True)
        assert (answer.success, answer.message) == (False, LINE_HOLD)
        node._gate.clear('line')
        for armed in (True, False):
            answer = node.call('arm', data=armed)
            assert (answer.success, answer.message) == (True, 'armed' if armed else 'disarmed')
            assert node.log.lines[-1] == f'arm: {answer.message}'
            assert node.health().values['armed'] == str(armed)
    with made() as node:
        assert 'arm' not in node._answers and node.health().values['armed'] == 'True'


def test_the_states_are_repeated_and_sent_with_each_change(made):
    with made() as node:
        assert [len(node.received[name]) for name in (
            'emergency_stop_active', 'motors_enabled')] == [1, 1]
        assert node.profiles['emergency_stop'].depth == 1000
        node.run(0.5)
        node._gate.clear('line')
        node.publish('motor_commands', MotorCommand(node.now_ns(), (0.1,) * 4))
        enabled = node._gate.enabled
        node._output.boards._watch()  # as the thread of the boards does after each exchange
        assert states(node) == [False, enabled] and enabled
        count = len(node.received['motors_enabled'])
        assert count == 2
        node.run(2.0)
        assert len(node.received['motors_enabled']) == count + 2


def test_the_diagnostics_name_what_stops_the_motors_or_is_missing(made):
    with made() as node:
        boards = node._output.boards
        boards._since_ns = boards._clock.now_ns() - 10 * NS_PER_S
        node._port.problem = ''
        health = node.health()
        assert f'motors stopped: {LINE_HOLD}' in health.message
        for board in BOARDS:
            assert f'wheel_states stopped: {board} does not respond' in health.message
        assert math.isnan(float(health.values['supply']))
        node._port.problem = 'no such port'
        assert 'does not respond' not in node.health().message
        boards.currents.rejected, boards.currents.missing = 3, 4
        boards._boards[1].missing_currents = 4
        node._gate.clear('line')
        for board, volts in zip(boards._boards, (12.0, 11.5)):
            board.supply_voltage = volts
        health = node.health()
        assert '3 motor currents beyond 30 A rejected' in health.message
        assert f'no motor torques: {BOARDS[1]} does not report currents' in health.message
        assert 'motors stopped' not in health.message
        assert {name: health.values[name] for name in (
            'supply', 'currents_missing', 'currents_rejected', 'board_faults',
            'command_timeouts', 'motor_commands.rejected')} == {
            'supply': '11.5', 'currents_missing': '4', 'currents_rejected': '3',
            'board_faults': '0', 'command_timeouts': '0', 'motor_commands.rejected': '0'}
        assert 'motor currents' not in node.health().message  # reported once


@pytest.mark.parametrize('rate, warns', [(16.0, False), (100.0, True)])
def test_a_rate_that_the_line_does_not_permit_is_logged_once_and_a_warning(made, rate, warns):
    with made(rate=rate) as node:
        assert node.profiles['wheel_states'].depth == 2 * rate  # 2 s
        assert 'line_rate_limit' not in node.health().values
        for _ in range(20):
            for command in (READ_ENCODERS, READ_CURRENTS, SET_DUTY):
                node._output.boards.line.timing.record(command, 4_000_000)
        for _ in range(2):
            health = node.health()
            assert float(health.values['line_rate_limit']) == pytest.approx(1.0 / 0.024, rel=1e-3)
            assert ('rate is 100 Hz' in health.message) is warns
        found = [line for line in node.log.lines if 'boards on the line' in line]
        assert len(found) == 1 + warns and found[0].startswith('2 boards on the line')


def test_an_unforeseen_error_in_a_command_is_answered_by_zero(made):
    with made() as node:
        given = []
        node._output.set_command = lambda command, now_ns: given.append((command.duty, now_ns))
        node.recover()
        assert given == [((0.0,) * 4, node.steady_ns())]
