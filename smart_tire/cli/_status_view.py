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

"""The status of all robots as tables of a terminal or as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
import json

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from smart_tire.cli._status_board import ERROR, LEVELS, OK, RobotView, STALE, WARNING

STYLES = {OK: 'green', WARNING: 'yellow', ERROR: 'bold red', STALE: 'magenta'}
YES_NO = {True: 'yes', False: 'no', None: 'unknown'}
NO_NODES = ('no node of smart_tire is heard: is one running in this ROS_DOMAIN_ID, and is '
            'multicast possible? (smart_tire doctor)')


def view(robots: Sequence[RobotView]) -> RenderableType:
    """Return the tables of all robots."""
    if not any(robot.nodes for robot in robots):
        return Text(NO_NODES, style='bold red')
    return Group(*(part for robot in robots for part in _robot(robot)))


def _robot(robot: RobotView) -> list[RenderableType]:
    return [_header(robot), _nodes(robot), _topics(robot), Text('')]


def _header(robot: RobotView) -> Text:
    text = Text(f'/{robot.namespace}', style='bold')
    text.append(f'  {LEVELS[robot.level]}', style=STYLES[robot.level])
    text.append('  emergency stop: ', style='not bold')
    text.append(YES_NO[robot.emergency_stop],
                style='bold red' if robot.emergency_stop else 'not bold')
    text.append('  motors enabled: ', style='not bold')
    text.append(YES_NO[robot.motors_enabled],
                style='yellow' if robot.motors_enabled is False else 'not bold')
    if robot.supply:
        text.append(f'  supply: {robot.supply} V', style='not bold')
    return text


def _nodes(robot: RobotView) -> Table:
    table = Table(box=None, pad_edge=False, header_style='bold')
    table.add_column('node', no_wrap=True, min_width=24)
    table.add_column('state', min_width=8)
    table.add_column('age, s', justify='right')
    table.add_column('message', overflow='fold')
    for row in robot.nodes:
        table.add_row(Text(row.name), Text(LEVELS[row.level], style=STYLES[row.level]),
                      f'{row.age:.1f}', Text(row.message))
    return table


def _topics(robot: RobotView) -> Table:
    table = Table(box=None, pad_edge=False, header_style='bold')
    table.add_column('topic', no_wrap=True, min_width=24)
    table.add_column('state', min_width=8)
    for name in ('age, s', 'rate, Hz', 'nominal, Hz'):
        table.add_column(name, justify='right')
    for row in robot.topics:
        state = 'silent' if row.level else 'ok'
        table.add_row(row.name, Text(state, style=STYLES[row.level]), f'{row.age:.1f}',
                      f'{row.rate:.1f}', f'{row.nominal:g}' if row.nominal else '-')
    return table


def to_json(robots: Sequence[RobotView], exit_status: int) -> str:
    """Return the status as a JSON document."""
    tree = [{**asdict(robot), 'level': LEVELS[robot.level]} for robot in robots]
    for robot in tree:
        for row in (*robot['nodes'], *robot['topics']):
            row['level'] = LEVELS[row['level']]
    return json.dumps({'exit_status': exit_status, 'robots': tree}, indent=2)
