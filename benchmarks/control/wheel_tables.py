# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Tables of the wheel speed steps and of the line of the motor boards."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.control.wheel_steps import BAND, NEW, Row, SET_POINTS, STEP_TIME
from benchmarks.tables import new_table, number
from rich.table import Table

from smart_tire.drivers.roboclaw_line import BOARDS, POLL

BAUD_RATES = (38400, 115200, 230400, 460800)
BITS_PER_BYTE = 10  # with start and stop bit


def wheel_steps_table(rows: Sequence[Row]) -> Table:
    """Return rise, overshoot and settling of all rows."""
    steps = ', '.join(f'{speed:g}' for speed in (0.0, *SET_POINTS))
    table = new_table(
        f'Wheel speed steps ({steps} rad/s; true speeds of all wheels; settled within '
        f'{BAND:.0%} of the step; {STEP_TIME:g} s per step)', 'ground, readings',
        'control\n[Hz]', '\ncontroller', 'rise [s]\nmean', 'overshoot [%]\nmean', '\nworst',
        'settling [s]\nmean', '\nworst', 'settled\n[%]')
    for row in rows:
        table.add_row(
            f'{row.ground}, {row.readings}', number(row.readings.control_rate, 0), row.controller,
            number(row.mean('rise'), 2),
            *(number(100.0 * value, 1) for value in (row.mean('overshoot'),
                                                     row.worst('overshoot'))),
            *(number(value, 2) for value in (row.mean('settling'), row.worst('settling'))),
            number(100.0 * row.mean('settled'), 0),
            style='bold' if row.controller == NEW else None)
    return table


def line_table() -> Table:
    """Return the least time of one poll of both motor boards, from its bytes."""
    table = new_table(
        'Line of two motor boards: encoders, currents and duty of both, bytes only (motor_driver '
        'measures the rest and reports line_rate_limit)', 'baud rate', 'one poll\n[ms]',
        'at most\n[Hz]')
    size = BOARDS * sum(command.request_size + command.reply_size for command in POLL)
    for baud_rate in BAUD_RATES:
        seconds = size * BITS_PER_BYTE / baud_rate
        table.add_row(str(baud_rate), number(1e3 * seconds, 1), number(1.0 / seconds, 0))
    return table
