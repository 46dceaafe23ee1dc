# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, show_performance_hints=False

"""
Reorder buffer on message time: identical sample order live, replayed and offline.

A grid instant is closed when the newest timestamp of any input is ``window`` later. The samples up
to it are then handed over in (timestamp, topic) order, whatever the order of arrival; samples that
arrive after their instant was closed are dropped and counted. No clock is read.

Topics that are themselves estimates can be awaited: they leave their estimator a window after
their timestamps, and at five times real time a busy computer delivers them later than any window.
While such a topic is active, an instant is closed only when the topic has reached it; samples of a
periodic topic reach up to the next one. Without delays this changes nothing.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
import heapq
import itertools
from math import inf
from typing import Any

from smart_tire.samples import NS_PER_S

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

COMPILED: bool = cython.compiled

GRID_NS = 8_000_000       # output period, 125 Hz as in paper B
MAX_JUMP_NS = NS_PER_S    # a timestamp that differs more from the newest one is suspect
FORWARD_JUMP_NS = 100_000_000   # suspects that span this, without others, advance the time ...
BACKWARD_JUMP_NS = 500_000_000  # ... or show a clock that was set back, or a restarted bag
MAX_GAP_NS = 60 * NS_PER_S  # after a longer gap the owner is reset instead of predicting
MAX_AWAITED_LAG_NS = 900_000_000  # an awaited topic that lags more counts as inactive

ClosedInstant = tuple[int, list[Any]]  # grid instant [ns] and its samples


class ReorderBuffer:
    """
    Reorders samples of several topics on a grid of message time.

    ``late`` counts dropped samples per topic. ``resets`` counts jumps of the clock of all inputs,
    after which the owner must reset its state; compare it after each ``push``. ``awaited`` are
    topics with their periods [ns]; 0 for those with a sample at every grid instant.
    """

    def __init__(self, window_ns: int, grid_ns: int = GRID_NS,
                 awaited: Mapping[str, int] | None = None) -> None:
        self._window_ns = window_ns
        self._grid_ns = grid_ns
        # topic -> ns after its newest timestamp in which there is no other sample of it
        self._awaited = {topic: max(period_ns - grid_ns, 0)
                         for topic, period_ns in (awaited or {}).items()}
        self.late: Counter[str] = Counter()
        self.resets = 0
        self.reset()

    def reset(self) -> None:
        """Discard all samples and the time; the counters stay."""
        self._heap: list[tuple[int, str, int, Any]] = []
        self._order = itertools.count()  # equal timestamps of one topic stay in order of arrival
        self._newest: int | None = None
        self._closed: int | None = None
        self._due_ns = -inf  # no newest timestamp before this one closes an instant
        self._suspects: list[tuple[str, int, Any]] = []
        self._reached: dict[str, int] = {}  # awaited topic -> latest instant that it allows

    def push(self, topic: str, stamp_ns: int, sample: Any) -> list[ClosedInstant]:
        """Add a sample; return the grid instants that it closes, with their samples."""
        newest = self._newest
        if newest is not None and not -MAX_JUMP_NS <= stamp_ns - newest <= MAX_JUMP_NS:
            return self._add_suspect(topic, stamp_ns, sample)
        if self._suspects:
            self._drop_suspects()
        self._insert(topic, stamp_ns, sample)
        newest = self._newest
        return [] if newest is None or newest < self._due_ns else self._close(newest)

    def finish(self) -> list[ClosedInstant]:
        """Return the remaining grid instants with their samples, at the end of all inputs."""
        self._drop_suspects()
        if self._newest is None or not self._heap and self._closed is None:
            return []
        return self._close_until(-(-self._newest // self._grid_ns) * self._grid_ns)

    def _insert(self, topic: str, stamp_ns: int, sample: Any) -> None:
        awaited = topic in self._awaited
        if awaited:
            reached = stamp_ns + self._awaited[topic]
            self._reached[topic] = max(reached, self._reached.get(topic, reached))
        if self._closed is not None and stamp_ns <= self._closed:
            self.late[topic] += 1
            return
        heapq.heappush(self._heap, (stamp_ns, topic, next(self._order), sample))
        # an awaited sample may be stamped ahead of the inputs: it takes effect later
        if not awaited and (self._newest is None or stamp_ns > self._newest):
            self._newest = stamp_ns

    def _close(self, newest: int) -> list[ClosedInstant]:
        if not self._heap and self._closed is None:
            return []
        limit = newest - self._window_ns
        for reached in self._reached.values():
            if newest - reached < MAX_AWAITED_LAG_NS:
                limit = min(limit, reached)
        return self._close_until(limit)

    def _close_until(self, limit: int) -> list[ClosedInstant]:
        heap, closed, instant = self._heap, [], self._next_instant()
        while instant <= limit:
            samples = []
            while heap and heap[0][0] <= instant:
                samples.append(heapq.heappop(heap)[3])
            closed.append((instant, samples))
            self._closed = instant
            instant += self._grid_ns
            self._due_ns = instant + self._window_ns
        return closed

    def _next_instant(self) -> int:
        if self._closed is not None:
            return self._closed + self._grid_ns
        return -(-self._heap[0][0] // self._grid_ns) * self._grid_ns

    def _add_suspect(self, topic: str, stamp_ns: int, sample: Any) -> list[ClosedInstant]:
        """Hold a sample whose timestamp jumps; accept the jump once further samples confirm it."""
        assert self._newest is not None
        if self._suspects and abs(stamp_ns - self._suspects[-1][1]) > MAX_JUMP_NS:
            self._drop_suspects()
        self._suspects.append((topic, stamp_ns, sample))
        forward = stamp_ns > self._newest
        stamps = [suspect[1] for suspect in self._suspects]
        if max(stamps) - min(stamps) < (FORWARD_JUMP_NS if forward else BACKWARD_JUMP_NS):
            return []
        confirmed, self._suspects = self._suspects, []
        if not forward or min(stamps) - self._newest > MAX_GAP_NS:
            self.reset()
            self.resets += 1
        for item in confirmed:
            self._insert(*item)
        return [] if self._newest is None else self._close(self._newest)

    def _drop_suspects(self) -> None:
        self.late.update(topic for topic, _, _ in self._suspects)
        self._suspects = []
