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

"""Health of links and nodes by /diagnostics, and events."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Protocol

import rerun as rr

from smart_tire.view.recorder import Recorder, Track
from smart_tire.view.style import Color, FILM_COLORS, NODE_COLORS, TRUTH, WARNING

# Counts of what went wrong; of each the sum over all nodes is always shown.
COUNTS = {'batches_lost': 'radio batches lost', 'batches_late': 'radio batches late',
          'frames_bad': 'frames or messages bad', 'late_messages': 'messages late',
          'messages_lost': 'messages lost by the recorder'}
COUNT_COLORS = (*FILM_COLORS, WARNING)
AGE = 'last_message_age'
LEVELS = ('INFO', 'WARN', 'ERROR', 'WARN')  # of events by the level of a status: 3 is stale


class Status(Protocol):
    """Diagnostic status of a node, with the level of ``DiagnosticStatus``."""

    @property
    def name(self) -> str: ...
    @property
    def level(self) -> int: ...
    @property
    def message(self) -> str: ...
    @property
    def values(self) -> Mapping[str, str]: ...


class LinkLayer:
    """Counts and ages by node and topic; an event for each new state of a node."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._colors: dict[str, Color] = {}
        self._states: dict[str, tuple[int, str]] = {}
        self._counts: dict[tuple[str, str], float] = {}  # key, node -> count
        self._totals = {key: recorder.line(f'links/total/{key}', name, color, steps=True)
                        for (key, name), color in zip(COUNTS.items(), COUNT_COLORS)}
        self._delay = recorder.line('links/delay', 'reception to viewer [s]', TRUTH)

    def add(self, stamp_ns: int, status: Status) -> None:
        """Add the status of a node."""
        node = status.name.strip('/')
        for key, text in status.values.items():
            value = number(text)
            topic, _, quantity = key.rpartition('.')
            if value is None:
                continue
            if key in COUNTS:
                self._add_count(stamp_ns, node, key, value)
            elif quantity == AGE:
                self._line(f'links/ages/{_path(node, topic)}', f'{node} {topic}'.strip() + ' [s]',
                           node).add(stamp_ns, value)
        state = status.level, status.message
        if self._states.get(node) != state:
            self._states[node] = state
            self.event(stamp_ns, f'{node}: {status.message}', LEVELS[min(status.level, 3)])

    def event(self, stamp_ns: int, text: str, level: str = 'INFO') -> None:
        """Add a line of text."""
        self._recorder.shape('links/events', stamp_ns, rr.TextLog(text, level=level))

    def add_delay(self, stamp_ns: int, delay: float) -> None:
        """Add the time [s] from the reception of a sample until it was sent to the viewer."""
        self._delay.add(stamp_ns, delay)

    def _add_count(self, stamp_ns: int, node: str, key: str, value: float) -> None:
        self._counts[key, node] = value
        total = sum(count for (name, _), count in self._counts.items() if name == key)
        self._totals[key].add(stamp_ns, total)
        self._line(f'links/counts/{_path(node, key)}', f'{node}: {COUNTS[key]}', node,
                   steps=True).add(stamp_ns, value)

    def _line(self, path: str, name: str, node: str, *, steps: bool = False) -> Track:
        color = self._colors.setdefault(node, NODE_COLORS[len(self._colors) % len(NODE_COLORS)])
        return self._recorder.line(path, name, color, steps=steps)


def number(text: str) -> float | None:
    """Return ``text`` as a number, None if it is none; an infinite age is NaN."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else math.nan


def _path(node: str, name: str) -> str:
    return '/'.join(part for part in (*node.split('/'), *name.split('/')) if part)
