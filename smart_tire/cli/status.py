# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire status``: nodes, diagnostics, rates and safety state on one screen."""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
import json
import os
from typing import TYPE_CHECKING

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Column, Table
from rich.text import Text

from smart_tire.drivers.clock import SYSTEM
from smart_tire.host_load import other_problems, worst_of
from smart_tire.messages import find_topic, NodeStatus

if TYPE_CHECKING:
    from smart_tire.nodes.observer import Observer
    from smart_tire.nodes.runner import NodeRunner

REFRESH_PERIOD = 0.5  # s
OK, WARNING, ERROR, STALE = range(4)  # levels, as in DiagnosticStatus
LEVELS = ('ok', 'warning', 'error', 'stale')
MAX_STATUS_AGE = 3.0  # s without diagnostics, which are published once a second
RATE_WINDOW = 3.0     # s over which rates are counted
MIN_RATE_TIME = 0.5   # s over which rates are counted at least, also after the first message
MAX_TOPIC_AGE = 2.0   # s without a message of a periodic topic, or MAX_MISSING of its periods
MAX_MISSING = 3.0
# published on events, so that silence is no fault although a rate is nominal
ON_EVENTS = ('tire_friction', 'ground_truth/tire_friction', 'icr', 'ground_state')
STOP, ENABLED = 'emergency_stop_active', 'motors_enabled'  # topics with a Bool
HOST_LATE = 'its host is late'  # in place of a message that says no more
BOOL_OFFSET = 4       # bytes before the Bool in a serialized message: its encapsulation header
EXIT_STATUSES = (0, 1, 2, 2)  # index: highest level of all nodes and topics
STYLES = {OK: 'green', WARNING: 'yellow', ERROR: 'bold red', STALE: 'magenta'}
YES_NO = {True: 'yes', False: 'no', None: 'unknown'}
NO_NODES = ('no node of smart_tire is heard: is one running in this ROS_DOMAIN_ID, and is '
            'multicast possible? (smart_tire doctor)')


def run(args: argparse.Namespace) -> int:
    """Show the status, once or until Ctrl-C; return the exit status for the last one shown."""
    from smart_tire.nodes.observer import Observer
    from smart_tire.nodes.runner import NodeRunner
    console, name = Console(), f'status_{os.getpid()}'
    board = StatusBoard(name)

    def new_observer() -> Observer:
        return Observer(lambda topic, data: board.add_message(topic, data, SYSTEM.now()),
                        lambda status: board.add_status(status, SYSTEM.now()), name=name)

    with NodeRunner(new_observer, []) as runner:
        if args.once or args.json or not console.is_terminal:
            runner.spin(args.seconds)
        else:
            _show(console, board, runner)
        return _finish(args, console, board)


def _show(console: Console, board: StatusBoard, runner: NodeRunner[Observer]) -> None:
    """Show the status until Ctrl-C."""
    with Live(console=console, auto_refresh=False, screen=True) as live:
        try:
            while True:
                runner.spin(REFRESH_PERIOD)
                live.update(view(board.robots(SYSTEM.now())), refresh=True)
        except KeyboardInterrupt:
            return


def _finish(args: argparse.Namespace, console: Console, board: StatusBoard) -> int:
    """Print the latest status; return the exit status."""
    now = SYSTEM.now()
    status, robots = board.exit_status(now), board.robots(now)
    if args.json:
        print(to_json(robots, status))
    else:
        console.print(view(robots))
    return status


@dataclass(frozen=True)
class NodeRow:
    """A node: ``STALE`` if it has been silent for ``MAX_STATUS_AGE``."""

    name: str      # within its namespace
    level: int
    message: str
    age: float     # s since its latest diagnostics


@dataclass(frozen=True)
class TopicRow:
    """A topic that has been received at least once."""

    name: str      # standard name
    rate: float    # Hz
    nominal: float  # Hz; 0: not periodic
    age: float     # s since the latest message
    level: int     # OK or WARNING


@dataclass(frozen=True)
class RobotView:
    """One robot: the nodes and topics of a namespace."""

    namespace: str                # '' if none
    nodes: list[NodeRow]
    topics: list[TopicRow]
    emergency_stop: bool | None   # None if unknown
    motors_enabled: bool | None
    supply: str                   # V, of the motor boards; '' if unknown
    host: str                     # how late its host is; '' if it is not

    @property
    def level(self) -> int:
        """Return the highest level of its nodes and topics."""
        return max([OK, *(node.level for node in self.nodes),
                    *(topic.level for topic in self.topics)])


@dataclass
class _Topic:
    first: float
    latest: float
    times: deque[float] = field(default_factory=deque)  # of the messages in RATE_WINDOW


class StatusBoard:
    """Collects diagnostics and messages; time [s] is an argument, of any steady clock."""

    def __init__(self, own_name: str = '') -> None:
        self._own_name = own_name
        self._statuses: dict[str, tuple[float, NodeStatus]] = {}
        self._topics: dict[tuple[str, str], _Topic] = {}   # namespace, standard name
        self._states: dict[tuple[str, str], bool] = {}     # namespace, STOP or ENABLED

    def add_status(self, status: NodeStatus, now: float) -> None:
        """Take the diagnostic status of a node."""
        if status.name != self._own_name:
            self._statuses[status.name] = now, status

    def add_message(self, name: str, data: bytes, now: float) -> None:
        """Take a serialized message of the fully qualified topic ``name``."""
        namespace, _, last = name.strip('/').rpartition('/')
        if last in (STOP, ENABLED) and len(data) > BOOL_OFFSET:
            self._states[namespace, last] = data[BOOL_OFFSET] != 0
            return
        topic = find_topic(name)
        if topic is None:
            return
        space = name.strip('/')[:-len(topic.name)].rstrip('/')
        row = self._topics.setdefault((space, topic.name), _Topic(now, now))
        row.times.append(now)
        row.latest = now

    def robots(self, now: float) -> list[RobotView]:
        """Return all robots by namespace, as of ``now``."""
        spaces = {name.rpartition('/')[0] for name in self._statuses}
        spaces |= {space for space, _ in (*self._topics, *self._states)}
        return [self._robot(space, now) for space in sorted(spaces)]

    def exit_status(self, now: float) -> int:
        """Return the exit status by the highest level; no node is an error."""
        if not self._statuses:
            return EXIT_STATUSES[ERROR]
        return EXIT_STATUSES[max(robot.level for robot in self.robots(now))]

    def _robot(self, space: str, now: float) -> RobotView:
        statuses = {name: status for name, (_, status) in sorted(self._statuses.items())
                    if name.rpartition('/')[0] == space}
        load = worst_of(status.values for status in statuses.values())
        late = load is not None and load.late
        nodes = [self._node(name, now, late=late) for name in statuses]
        topics = [self._topic(key, now) for key in sorted(self._topics) if key[0] == space]
        supply = next((status.values['supply'] for status in statuses.values()
                       if 'supply' in status.values), '')
        return RobotView(space, nodes, topics, self._states.get((space, STOP)),
                         self._states.get((space, ENABLED)), '' if supply == 'nan' else supply,
                         str(load) if late else '')

    def _node(self, name: str, now: float, *, late: bool) -> NodeRow:
        received, status = self._statuses[name]
        age, short = now - received, name.rpartition('/')[2]
        if age > MAX_STATUS_AGE:
            return NodeRow(short, STALE, f'no diagnostics for {age:.0f} s; the last: '
                           f'{status.message}', age)
        text = other_problems(status.message, status.values, late=late)
        return NodeRow(short, min(status.level, STALE), text or HOST_LATE, age)

    def _topic(self, key: tuple[str, str], now: float) -> TopicRow:
        row, topic = self._topics[key], find_topic(key[1])
        while row.times and row.times[0] <= now - RATE_WINDOW:
            row.times.popleft()
        nominal = topic.rate if topic else 0.0
        rate = len(row.times) / min(RATE_WINDOW, max(now - row.first, MIN_RATE_TIME))
        limit = max(MAX_TOPIC_AGE, MAX_MISSING / nominal) if nominal else float('inf')
        silent = now - row.latest > limit and key[1] not in ON_EVENTS
        return TopicRow(key[1], rate, nominal, now - row.latest, WARNING if silent else OK)


def view(robots: Sequence[RobotView]) -> RenderableType:
    """Return the tables of all robots."""
    if not any(robot.nodes for robot in robots):
        return Text(NO_NODES, style='bold red')
    return Group(*(part for robot in robots for part in _robot(robot)))


def _robot(robot: RobotView) -> list[RenderableType]:
    nodes = _table('node', Column('message', overflow='fold'))
    for node in robot.nodes:
        nodes.add_row(Text(node.name), Text(LEVELS[node.level], style=STYLES[node.level]),
                      f'{node.age:.1f}', Text(node.message))
    topics = _table('topic', *(Column(name, justify='right') for name in ('rate, Hz',
                                                                          'nominal, Hz')))
    for topic in robot.topics:
        topics.add_row(topic.name, Text('silent' if topic.level else 'ok',
                                        style=STYLES[topic.level]), f'{topic.age:.1f}',
                       f'{topic.rate:.1f}', f'{topic.nominal:g}' if topic.nominal else '-')
    return [_header(robot), nodes, topics, Text('')]


def _table(kind: str, *columns: Column) -> Table:
    return Table(Column(kind, no_wrap=True, min_width=24), Column('state', min_width=8),
                 Column('age, s', justify='right'), *columns, box=None, pad_edge=False,
                 header_style='bold')


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
    if robot.host:
        text.append(f'\n{robot.host}', style='yellow')
    return text


def to_json(robots: Sequence[RobotView], exit_status: int) -> str:
    """Return the status as a JSON document."""
    tree = [{**asdict(robot), 'level': LEVELS[robot.level]} for robot in robots]
    for robot in tree:
        for row in (*robot['nodes'], *robot['topics']):
            row['level'] = LEVELS[row['level']]
    return json.dumps({'exit_status': exit_status, 'robots': tree}, indent=2)
