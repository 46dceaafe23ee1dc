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

"""State of all robots as seen on their topics: nodes, rates, ages; without ROS and clock."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Protocol

from smart_tire.messages import find_topic

OK, WARNING, ERROR, STALE = range(4)  # levels, as in DiagnosticStatus
LEVELS = ('ok', 'warning', 'error', 'stale')
MAX_STATUS_AGE = 3.0  # s without diagnostics, which are published once a second
RATE_WINDOW = 3.0     # s over which rates are counted
MIN_RATE_TIME = 0.5   # s after the first message, before which a rate is too low
MAX_TOPIC_AGE = 2.0   # s without a message of a periodic topic, or MAX_MISSING of its periods
MAX_MISSING = 3.0
ON_EVENTS = ('tire_friction', 'ground_truth/tire_friction', 'icr', 'ground_state')
STOP, ENABLED = 'emergency_stop_active', 'motors_enabled'  # topics with a Bool
BOOL_OFFSET = 4       # bytes of the encapsulation header of a serialized message
ALL_OK, WARNINGS, ERRORS = 0, 1, 2  # exit statuses


class Status(Protocol):
    """Diagnostic status of a node."""

    @property
    def name(self) -> str:
        """Return the fully qualified name without the leading slash."""

    @property
    def level(self) -> int:
        """Return one of the levels of DiagnosticStatus."""

    @property
    def message(self) -> str:
        """Return the message."""

    @property
    def values(self) -> dict[str, str]:
        """Return the values."""


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
        self._statuses: dict[str, tuple[float, Status]] = {}
        self._topics: dict[tuple[str, str], _Topic] = {}   # namespace, standard name
        self._states: dict[tuple[str, str], bool] = {}     # namespace, STOP or ENABLED

    def add_status(self, status: Status, now: float) -> None:
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
        """Return ``ALL_OK``, ``WARNINGS``, or ``ERRORS``: an error, a dead node, or no node."""
        if not self._statuses:
            return ERRORS
        level = max(robot.level for robot in self.robots(now))
        return (ALL_OK, WARNINGS, ERRORS, ERRORS)[level]

    def _robot(self, space: str, now: float) -> RobotView:
        nodes = [self._node(name, now) for name in sorted(self._statuses)
                 if name.rpartition('/')[0] == space]
        topics = [self._topic(key, now) for key in sorted(self._topics) if key[0] == space]
        supply = next((status.values['supply'] for name, (_, status) in self._statuses.items()
                       if name.rpartition('/')[0] == space and 'supply' in status.values), '')
        return RobotView(space, nodes, topics, self._states.get((space, STOP)),
                         self._states.get((space, ENABLED)), '' if supply == 'nan' else supply)

    def _node(self, name: str, now: float) -> NodeRow:
        received, status = self._statuses[name]
        age, short = now - received, name.rpartition('/')[2]
        if age > MAX_STATUS_AGE:
            return NodeRow(short, STALE, f'no diagnostics for {age:.0f} s; the last: '
                           f'{status.message}', age)
        return NodeRow(short, min(status.level, STALE), status.message, age)

    def _topic(self, key: tuple[str, str], now: float) -> TopicRow:
        row, topic = self._topics[key], find_topic(key[1])
        while row.times and row.times[0] <= now - RATE_WINDOW:
            row.times.popleft()
        nominal = topic.rate if topic else 0.0
        rate = len(row.times) / min(RATE_WINDOW, max(now - row.first, MIN_RATE_TIME))
        limit = max(MAX_TOPIC_AGE, MAX_MISSING / nominal) if nominal else float('inf')
        silent = now - row.latest > limit and key[1] not in ON_EVENTS
        return TopicRow(key[1], rate, nominal, now - row.latest, WARNING if silent else OK)
