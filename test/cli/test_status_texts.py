# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Status of robots: levels, ages, rates, safety state, and how they are shown."""

from __future__ import annotations

import io
import json
from types import SimpleNamespace

import pytest
from rich.console import Console

from smart_tire.cli.status import ERROR, OK, STALE, StatusBoard, to_json, view, WARNING
from smart_tire.host_load import EXPLAINED, HostLoad


def status(name, level=OK, message='ok', **values):
    """Return a diagnostic status."""
    return SimpleNamespace(name=name, level=level, message=message, values=values)


def board_with(*statuses, now=0.0):
    """Return a board that has received ``statuses``."""
    board = StatusBoard('own')
    for one in statuses:
        board.add_status(one, now)
    return board


def flag(value):
    """Return a serialized Bool."""
    return bytes((0, 1, 0, 0, value))


@pytest.mark.parametrize('level, exit_status', [(OK, 0), (WARNING, 1), (ERROR, 2), (STALE, 2)])
def test_the_exit_status_is_the_worst_level(level, exit_status):
    board = board_with(status('a'), status('b', level))
    assert board.exit_status(0.0) == exit_status


def test_without_nodes_the_exit_status_is_an_error():
    board = board_with(status('own'))
    board.add_message('/odom', b'', 0.0)
    assert board.exit_status(0.0) == 2


@pytest.mark.parametrize('age, level', [(2.9, WARNING), (3.1, STALE)])
def test_a_silent_node_is_stale_with_its_age(age, level):
    row, = board_with(status('a', WARNING, 'no odom'), now=10.0).robots(10.0 + age)[0].nodes
    assert (row.level, row.age) == (level, pytest.approx(age))
    assert 'no odom' in row.message
    assert ('no diagnostics for 3 s' in row.message) is (level == STALE)


def test_a_node_that_recovers_is_ok_again():
    board = board_with(status('a'))
    assert board.exit_status(5.0) == 2
    board.add_status(status('a'), 5.0)
    assert board.exit_status(5.0) == 0


def test_rates_are_counted_over_the_latest_seconds():
    board = board_with(status('a'), now=8.0)
    for count in range(800):
        board.add_message('/imu/data', b'', 0.01 * count)
    row, = board.robots(8.0)[0].topics
    assert (row.name, row.nominal, row.level) == ('imu/data', 100.0, OK)
    assert row.rate == pytest.approx(100.0, abs=0.5)
    assert board.robots(9.5)[0].topics[0].rate == pytest.approx(50.0, abs=0.5)
    assert board.robots(12.0)[0].topics[0].rate == 0.0


def test_the_rate_of_a_new_topic_is_not_too_low():
    board = StatusBoard()
    for count in range(101):
        board.add_message('/imu/data', b'', 50.0 + 0.01 * count)
    assert board.robots(51.0)[0].topics[0].rate == pytest.approx(101.0)


@pytest.mark.parametrize('topic, age, level', [
    ('imu/data', 1.9, OK), ('imu/data', 2.1, WARNING), ('tire_battery', 2.9, OK),
    ('tire_battery', 3.1, WARNING), ('tire_friction', 60.0, OK), ('cmd_vel', 60.0, OK)])
def test_a_silent_periodic_topic_is_a_warning(topic, age, level):
    board = board_with(status('a'), now=age)
    board.add_message(f'/{topic}', b'', 0.0)
    assert board.robots(age)[0].topics[0].level == level
    assert board.exit_status(age) == level


def test_robots_are_separated_by_namespace():
    board = board_with(status('one/imu_driver', ERROR, 'lost'), status('two/imu_driver'),
                       status('two/motor_driver', supply='12.1'))
    board.add_message('/two/ground_truth/odom', b'', 0.0)
    board.add_message('/two/emergency_stop_active', flag(1), 0.0)
    board.add_message('/two/motors_enabled', flag(0), 0.0)
    one, two = board.robots(0.0)
    assert (one.namespace, one.level, one.emergency_stop, one.motors_enabled) == (
        'one', ERROR, None, None)
    assert (two.namespace, two.level, two.emergency_stop, two.motors_enabled) == (
        'two', OK, True, False)
    assert [row.name for row in two.topics] == ['ground_truth/odom']
    assert (one.supply, two.supply) == ('', '12.1')


def text_of(board, now):
    """Return what a terminal shows."""
    console = Console(file=io.StringIO(), width=120, color_system=None)
    console.print(view(board.robots(now)))
    return console.file.getvalue()


def test_the_screen_shows_nodes_topics_and_safety_state():
    board = board_with(status('r/motor_driver', WARNING, 'motors stopped: [emergency] stop'))
    board.add_message('/r/emergency_stop_active', flag(1), 0.0)
    board.add_message('/r/imu/data', b'', 0.0)
    text = text_of(board, 2.5)
    assert '/r  warning  emergency stop: yes  motors enabled: unknown' in text
    assert 'motors stopped: [emergency] stop' in text and 'silent' in text
    assert 'no diagnostics for 4 s' in text_of(board, 4.0)


def test_a_late_host_is_named_once_for_all_nodes():
    host = HostLoad(0.031, 0.4, 36.0, 2)
    board = board_with(
        status('r/imu_driver', WARNING, str(host), **host.values),
        status('r/slip_estimator', WARNING, '4 dropped; no odom', **{EXPLAINED: '4 dropped'}),
        status('two/slip_estimator', WARNING, '5 dropped', **{EXPLAINED: '5 dropped'}))
    one, two = board.robots(0.0)
    assert [row.message for row in one.nodes] == ['its host is late', 'no odom']
    assert [row.message for row in two.nodes] == ['5 dropped']
    assert (one.level, one.host, two.host) == (WARNING, str(host), '')
    text = text_of(board, 0.0)
    assert text.count('timers late by 31 ms (99%), load 36.0 on 2 cores: end other programs') == 1
    assert text.index('timers late') < text.index('imu_driver')


def test_the_screen_explains_that_no_node_is_heard():
    assert 'no node of smart_tire is heard' in text_of(StatusBoard(), 0.0)


def test_json_contains_levels_by_name():
    board = board_with(status('a', ERROR, 'lost'))
    board.add_message('/imu/data', b'', 0.0)
    tree = json.loads(to_json(board.robots(0.0), 2))
    assert tree['exit_status'] == 2
    robot, = tree['robots']
    assert robot['level'] == robot['nodes'][0]['level'] == 'error'
    assert robot['topics'][0]['level'] == 'ok'
