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

"""Tables of path tracking."""

from __future__ import annotations

from benchmarks.control.requirements import max_error, missed
from benchmarks.control.scenarios import KINEMATICS, OURS, title
from benchmarks.control.tracking_results import Rows
from benchmarks.tables import new_table, number
from rich.table import Table
from rich.text import Text

TRACKING_NOTES = """\
Path tracking, in millimeters. Control error: distance of the pose that the controller was given
from the wanted path, rms from the start to the end of following. Localization: rms distance of
that pose from the true one. ideal: r w = v -+ track / 2 * yaw rate, look-ahead 0.35 s and at least
0.18 m; best: with the best look-ahead of each path; fixed: with the effective track calibrated on
concrete; ICR: filter of the instantaneous centers of rotation; ours: slip-compensated. Poses and
slips are true or estimated, both. missed: benchmarks/control/requirements.py.
"""


def tracking_table(rows: Rows) -> Table:
    """Return the errors of all kinematics on all runs."""
    table = new_table(
        'Path tracking [mm]', '', *_columns('control:'), 'allowed', *_columns('maximum:'),
        'locali-\nzation', 'true:\nours', 'missed')
    for name, row in rows.items():
        reasons = missed(row)
        table.add_row(
            title(name), *(_mm(row[one].rms) for one in KINEMATICS), _mm(max_error(row)),
            *(_mm(row[one].maximum) for one in KINEMATICS), _mm(row[OURS].localization),
            _mm(row[OURS].true_rms), Text(' '.join(reasons), style='red'))
    return table


def duration_table(rows: Rows) -> Table:
    """Return times, yaw accelerations and shares of arrival of all kinematics on all runs."""
    table = new_table('Path tracking: time, yaw acceleration and arrival', '',
                      *_columns('time [s]:'), *_columns('yaw [rad/s2]:'), *_columns('arrived:'))
    for name, row in rows.items():
        table.add_row(title(name), *(number(row[one].duration, 1) for one in KINEMATICS),
                      *(number(row[one].yaw_acceleration, 2) for one in KINEMATICS),
                      *(f'{row[one].arrived:.0%}' for one in KINEMATICS))
    return table


def _columns(heading: str) -> list[str]:
    return [f'{heading}\nideal', '\nbest', '\nfixed', '\nICR', '\nours']


def _mm(value: float) -> str:
    return number(1e3 * value, 1)
