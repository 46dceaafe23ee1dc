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

from benchmarks.control.requirements import max_error, met
from benchmarks.control.scenarios import IDEAL, KINEMATICS, OURS, title
from benchmarks.control.tracking_results import Rows
from benchmarks.grounds import CONCRETE
from benchmarks.tables import new_table, number
from rich.table import Table
from rich.text import Text

TRACKING_NOTES = """\
Path tracking: distance of the true position of base_link from the wanted path, in millimeters, rms
and maximum from the start to the end of following. The same path follower and gains for all but
the last kinematics. ideal: r w = v -+ track / 2 * yaw rate; fixed: with the effective track
calibrated on concrete; ours: slip-compensated; short: ideal, with the shorter look-ahead that is
best for them. allowed: half the error of the ideal kinematics plus that of the localization where
it is estimated, on concrete the error of the ideal kinematics.
! requirement missed, or not arrived (benchmarks/control/requirements.py).
"""


def is_concrete(name: str) -> bool:
    """Return whether all ground of a case is concrete."""
    return f'_{CONCRETE}_' in name


def tracking_table(rows: Rows) -> Table:
    """Return the errors of all kinematics on all runs."""
    table = new_table(
        'Path tracking [mm]', '', 'rms:\nideal', '\nfixed', '\nours', '\nshort', '\nallowed',
        'ours over\nideal', 'maximum:\nideal', '\nfixed', '\nours', '\nshort', 'locali-\nzation')
    for name, row in rows.items():
        allowed = max_error(row, concrete=is_concrete(name))
        ok = met(row, concrete=is_concrete(name))
        ours = Text(_mm(row[OURS].rms)) if ok else Text(f'{_mm(row[OURS].rms)} !', style='red')
        table.add_row(
            title(name),
            *(ours if one == OURS else _mm(row[one].rms) for one in KINEMATICS), _mm(allowed),
            number(row[OURS].rms / row[IDEAL].rms, 2),
            *(_mm(row[one].maximum) for one in KINEMATICS), _mm(row[OURS].localization))
    return table


def duration_table(rows: Rows) -> Table:
    """Return times and shares of arrival of all kinematics on all runs."""
    table = new_table('Path tracking: time and arrival', '', 'time [s]:\nideal', '\nfixed',
                      '\nours', '\nshort', 'arrived:\nideal', '\nfixed', '\nours', '\nshort')
    for name, row in rows.items():
        table.add_row(title(name), *(number(row[one].duration, 1) for one in KINEMATICS),
                      *(f'{row[one].arrived:.0%}' for one in KINEMATICS))
    return table


def _mm(value: float) -> str:
    return number(1e3 * value, 1)
