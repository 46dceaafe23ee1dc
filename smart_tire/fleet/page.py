# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The page over all drives of a data set, in the style of the report of one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from smart_tire.analysis.html_report.page import html_page, Report, Section
from smart_tire.analysis.tables import cells, Columns, Table, UNKNOWN
from smart_tire.findings import counted
from smart_tire.fleet.dataset import Dataset, PAGE

MAX_FINDINGS = 3  # of a drive that are listed
FIGURES: Columns = (
    ('duration [s]', 'duration', '.0f'), ('distance [m]', 'distance', '.1f'),
    ('friction [-]', 'friction', '.2f'), ('position [m]', 'position_end', '.2f'),
    ('heading [rad]', 'yaw_end', '.3f'), ('slip [-]', 'slip_rms', '.3f'))
ABOUT = (
    'One row per bag that "smart_tire analyze --dataset" was given, in all its runs. The name '
    'leads to the report of the bag, if --reports was given. Findings are those of '
    '"smart_tire doctor", errors first. Errors are against ground truth or the overhead camera, '
    'where a bag has one; a dash is unknown.',)


def write_page(dataset: Dataset) -> None:
    """Write the page of ``dataset``; raise OutputError if it cannot be written."""
    text = html_page(fleet_report(dataset.folder.resolve().name, dataset.drives()))
    dataset.replace(PAGE, lambda file: file.write(text.encode()))


def fleet_report(name: str, drives: Sequence[Mapping[str, Any]]) -> Report:
    """Return the page over ``drives``, rows of the table of drives."""
    robots = {row['robot'] for row in drives if row['robot']}
    total = {key: sum(row[key] or 0.0 for row in drives) for key in ('duration', 'distance')}
    failed = sum(row['distance'] is None for row in drives)
    tiles = [('bags', str(len(drives)), f'{failed} without estimates' if failed else ''),
             ('robots', str(len(robots)), ''),
             ('duration', f'{total["duration"] / 3600.0:.1f} h', ''),
             ('distance', f'{total["distance"] / 1000.0:.2f} km', 'estimated')]
    table = Table(
        'All bags, by robot and time',
        ['drive', 'robot', 'date', 'findings', *(heading for heading, _, _ in FIGURES)],
        [[row['drive'], row['robot'] or UNKNOWN, row['date'] or UNKNOWN, findings(row),
          *cells(dict(row), FIGURES)] for row in drives], 4,
        'Position, heading: errors at the end. Slip: rms error.',
        [row['report'] for row in drives])
    return Report(name, [], [Section('drives', 'Drives', 'Drives', [table])], ABOUT, tiles)


def findings(row: Mapping[str, Any]) -> str:
    """Return what is wrong with a drive, the most serious first."""
    found = [*([f'{row["status"]}: {row["error"]}'] if row['error'] else []),
             *(row['errors'] or ()), *(row['warnings'] or ())]
    more = [counted(len(found) - MAX_FINDINGS, 'more finding')] if len(
        found) > MAX_FINDINGS else []
    return '; '.join([*found[:MAX_FINDINGS], *more]) or UNKNOWN
