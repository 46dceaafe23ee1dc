# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The dashboard: a table on a terminal, plain lines otherwise."""

from __future__ import annotations

from dataclasses import replace
import io
from types import SimpleNamespace

from rich.console import Console

from smart_tire.cli._dashboard import _aged, Dashboard
from smart_tire.samples import Friction, NAN, NS_PER_S, Odometry, WheelSample, WheelSlip
from smart_tire.uncertain import Uncertain


def robot_status(**known):
    return SimpleNamespace(**{'odometry': None, 'wheels': None, 'slip': None, 'friction': {},
                              'crossings': {}, 'health': {}, 'stopped': '',
                              'now_ns': lambda: 0, **known})


def moving():
    friction = Friction(0, 'front_left', friction_coefficient=Uncertain(0.47, 0.05))
    return robot_status(
        wheels=WheelSample(0, (12.566, 6.283, 12.566, 6.283)),
        slip=WheelSlip(0, (0.11, -0.1, 0.11, NAN), (0.1,) * 4, (0.01,) * 4),
        friction={'front_left': friction},
        crossings={'front_left': 7}, health={'tire_receiver': {'batches_ok': '99'}})


def shown(status, terminal, note=''):
    text = io.StringIO()
    console = Console(file=text, force_terminal=terminal, width=120, color_system=None)
    with Dashboard(console) as dashboard:
        dashboard.show('concrete', status, note)
    return text.getvalue()


def test_a_terminal_gets_a_table_with_a_row_per_wheel():
    text = shown(moving(), terminal=True)
    assert 'speed, rpm' in text
    assert '+0.47 ± 0.05' in text and '120.0' in text and '+0.11 ± 0.01' in text
    assert '99 received' in text
    assert all(wheel in text for wheel in ('front_left', 'front_right', 'rear_left', 'rear_right'))


def test_without_a_terminal_the_table_is_printed():
    text = shown(moving(), terminal=False)
    assert '\x1b' not in text and 'front_left' in text and '+0.47 ± 0.05' in text


def test_an_old_value_has_its_age_and_is_gray():
    status = moving()
    status.slip = replace(status.slip, stamp_ns=39 * NS_PER_S)
    status.odometry = Odometry(-NS_PER_S, *(4 * [(0.0,) * 4]), (0.0,) * 36, (0.0,) * 36)
    for now, shown_age, gray in ((1.0, False, False), (1.1, True, True), (40.0, True, True)):
        status.now_ns = lambda now=now: round(now * NS_PER_S)
        text = shown(status, terminal=False)
        assert (f'120.0 ({now:.0f} s)' in text) is shown_age
        assert (f' 7 ({now:.0f} s)' in text) is shown_age and '+0.47 ± 0.05' in text
        assert '+0.11 ± 0.01' in text and f'+0.11 ± 0.01 ({now:.0f} s' not in text
        assert f'yaw rate +0.00 rad/s ({now + 1.0:.0f} s)' in text
        (cell,) = {cell.style for cell in (_aged('', status.wheels, status),)}
        assert (cell == 'bright_black') is gray


def test_old_values_fit_into_a_terminal_of_80_characters():
    text = io.StringIO()
    status = moving()
    status.crossings['front_left'] = 123
    status.now_ns = lambda: 9 * NS_PER_S
    with Dashboard(Console(file=text, width=80, color_system=None)) as dashboard:
        dashboard.show('concrete', status)
    (row,) = [line for line in text.getvalue().splitlines() if 'front_left' in line]
    assert row.split('  ')[0] == 'front_left' and row.endswith('123 (9 s)')
    assert '120.0 (9 s) ' in row and '+0.11 ± 0.01 (9 s)' in row and '+0.47 ± 0.05' in row


def test_motors_that_are_stopped_are_shown_with_the_reason():
    assert 'motors' not in shown(robot_status(), terminal=False)
    text = shown(robot_status(stopped='motors stopped: emergency stop'), terminal=False)
    assert 'motors stopped: emergency stop' in text


def test_a_note_is_shown_with_the_phase():
    for terminal in (True, False):
        text = shown(robot_status(), terminal, note='1.20 m left')
        assert 'concrete' in text and '1.20 m left' in text


def test_a_busy_host_is_one_line_above_the_table():
    simulator = {'real_time_factor': '0.62', 'time_passed_without.imu_driver': '2'}
    lines = shown(robot_status(health={'robot_simulator': simulator}), terminal=False).splitlines()
    assert lines[0] == '0.62 x real time: waiting for nodes'
    assert lines[1].startswith('starved: simulated time passed without imu_driver (2 x)')
    idle = shown(robot_status(health={'robot_simulator': {'real_time_factor': '0.99'}}), False)
    assert 'real time' not in idle
