# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Live table of the estimates of the robot; without a terminal now and then."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from smart_tire.drivers.clock import SYSTEM
from smart_tire.host_load import pace_lines, worst_of
from smart_tire.samples import NS_PER_S, Sample, WHEELS

if TYPE_CHECKING:
    from smart_tire.nodes.pilot import Pilot

RPM = 60.0 / math.tau
TABLE_PERIOD = 10.0  # s between two tables without a terminal
MAX_AGE = 1.0        # s; older values are gray, with their age
# Characters of each column; with ages they fill a terminal of 80.
COLUMNS = {'speed, rpm': 11, 'slip': 18, 'friction': 12, 'one crossing': 12, 'crossings': 9}


class Dashboard:
    """Shows the status of the robot, with the time since the recording began."""

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console()
        self._live = Live(console=self._console, auto_refresh=False)
        self._start = SYSTEM.now()
        self._last = -math.inf

    def __enter__(self) -> Dashboard:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._console.is_terminal:
            self._live.stop()

    def show(self, phase: str, status: Pilot, note: str = '') -> None:
        """Show ``status``, the name of the current ``phase`` of the drive, and a ``note``."""
        now = SYSTEM.now() - self._start
        if not self._console.is_terminal and now < self._last + TABLE_PERIOD:
            return
        shown = Group(*_warnings(status), _header(now, phase, status, note), _table(status),
                      _radio_line(status))
        if self._console.is_terminal:
            self._live.update(shown, refresh=True)
        else:
            self._last = now
            self._console.print(shown)


def _header(now: float, phase: str, status: Pilot, note: str) -> Text:
    text = Text(f'{now:5.1f} s  {phase:16}', style='bold')
    if status.odometry is not None:
        v, W = status.odometry.linear[0], status.odometry.angular[2]
        text.append('  ')
        text.append(_aged(f'v {v:+.2f} m/s  yaw rate {W:+.2f} rad/s', status.odometry, status))
    if note:
        text.append(f'\n{note}', style='not bold')
    return text


def _table(status: Pilot) -> Table:
    table = Table('wheel', box=None, pad_edge=False, collapse_padding=True)
    for column, width in COLUMNS.items():
        table.add_column(column, justify='right', min_width=width, no_wrap=True)
    for index, wheel in enumerate(WHEELS):
        table.add_row(wheel, *_row(index, wheel, status))
    return table


def _row(index: int, wheel: str, status: Pilot) -> tuple[Text | str, ...]:
    speed = '' if status.wheels is None else _aged(
        f'{status.wheels.velocity[index] * RPM:.1f}', status.wheels, status)
    slip = '' if status.slip is None else _aged(_value(
        status.slip.ratio[index], status.slip.sigma[index]), status.slip, status)
    friction = status.friction.get(wheel)
    if friction is None:
        return speed, slip, '', '', ''
    count = _aged(str(status.crossings[wheel]), friction, status)
    return speed, slip, *(Text(_value(*quantity), style=count.style) for quantity in (
        friction.friction_coefficient, friction.friction_coefficient_single)), count


def _aged(text: str, sample: Sample, status: Pilot) -> Text:
    """Return ``text``; gray, with its age, if the sample it is from is old."""
    age = (status.now_ns() - sample.stamp_ns) / NS_PER_S
    return Text(f'{text} ({age:.0f} s)' if age > MAX_AGE else text,
                style='bright_black' if age > MAX_AGE else 'not bold')


def _value(value: float, sigma: float) -> str:
    return '-' if math.isnan(value) else f'{value:+.2f} ± {sigma:.2f}'


def _radio_line(status: Pilot) -> Text:
    receiver = status.health.get('tire_receiver', {})
    simulator = status.health.get('robot_simulator', {})
    return Text(f'radio batches: {receiver.get("batches_ok", "-")} received, '
                f'{receiver.get("batches_lost", "-")} lost, '
                f'{simulator.get("batches_dropped", "-")} dropped by the simulator', style='dim')


def _warnings(status: Pilot) -> list[Text]:
    """Return lines if this host is busy or late, and one if the motors are stopped."""
    host = worst_of(status.health.values())
    lines = list(pace_lines([status.health.get('robot_simulator', {})])) or (
        [f'host late: {host}'] if host is not None and host.late else [])
    return [Text(line, style='yellow') for line in [*lines, status.stopped] if line]
