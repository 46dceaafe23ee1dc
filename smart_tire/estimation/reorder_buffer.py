"""
One order of events for live, replayed and recorded data.

A grid instant closes when the newest stamp seen on any input is ``window`` later. What is
stamped up to it is then handed over in (stamp, topic) order, whatever the order of arrival; what
comes after its instant has closed is dropped and counted. No clock is read.

Topics that are themselves estimates are awaited: they leave their estimator a window after their
stamps, and at five times real time a busy machine brings them later than any window. While they
flow, an instant closes only when they have reached it. Where nothing is late that changes nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
import heapq
import itertools
from typing import Any

from smart_tire.samples import NS_PER_S

GRID_NS = 8_000_000       # the paper's 125 Hz
JUMP_NS = NS_PER_S        # a stamp further than this from the others is suspect
AHEAD_RUN_NS = 100_000_000  # suspects spanning this, undisturbed, are the new present ...
STALE_RUN_NS = 500_000_000  # ... or a clock that was set back, or a bag that was started again
LONGEST_GAP_NS = 60 * NS_PER_S  # a longer silence starts anew instead of being predicted through
PATIENCE_NS = 900_000_000  # an awaited topic may lag so much; beyond, it counts as silent

Closed = tuple[int, list[Any]]


class ReorderBuffer:
    """
    Reorders samples of several topics on a grid of message time.

    ``late`` counts dropped samples per topic. ``resets`` counts the times when the clock of all
    inputs jumped so that the owner must start anew; compare it after each ``push``.
    """

    def __init__(self, window_ns: int, grid_ns: int = GRID_NS,
                 awaited: Iterable[str] = ()) -> None:
        self._window_ns = window_ns
        self._grid_ns = grid_ns
        self._awaited = frozenset(awaited)
        self.late: Counter[str] = Counter()
        self.resets = 0
        self.reset()

    def reset(self) -> None:
        """Forget all samples and the time, keep the counters."""
        self._heap: list[tuple[int, str, int, Any]] = []
        self._order = itertools.count()  # equal stamps of one topic stay in order of arrival
        self._newest: int | None = None
        self._closed: int | None = None
        self._suspects: list[tuple[str, int, Any]] = []
        self._reached: dict[str, int] = {}  # awaited topic -> its newest stamp

    def push(self, topic: str, stamp_ns: int, sample: Any) -> list[Closed]:
        """Take a sample in; return the grid instants that it closes with their samples."""
        if self._newest is not None and (
                stamp_ns - self._newest > JUMP_NS or self._newest - stamp_ns > JUMP_NS):
            return self._suspect(topic, stamp_ns, sample)
        if self._suspects:
            self._drop_suspects()
        self._insert(topic, stamp_ns, sample)
        return self._close()

    def _insert(self, topic: str, stamp_ns: int, sample: Any) -> None:
        if topic in self._awaited:
            self._reached[topic] = max(stamp_ns, self._reached.get(topic, stamp_ns))
        if self._closed is not None and stamp_ns <= self._closed:
            self.late[topic] += 1
            return
        heapq.heappush(self._heap, (stamp_ns, topic, next(self._order), sample))
        if self._newest is None or stamp_ns > self._newest:
            self._newest = stamp_ns

    def _close(self) -> list[Closed]:
        heap, closed = self._heap, []
        if self._newest is None or not heap and self._closed is None:
            return []
        instant, limit = self._next_instant(), self._newest - self._window_ns
        if limit < instant:
            return []
        limit = min([limit, *(stamp for stamp in self._reached.values()
                              if self._newest - stamp < PATIENCE_NS)])
        while instant <= limit:
            samples = []
            while heap and heap[0][0] <= instant:
                samples.append(heapq.heappop(heap)[3])
            closed.append((instant, samples))
            self._closed = instant
            instant += self._grid_ns
        return closed

    def _next_instant(self) -> int:
        if self._closed is not None:
            return self._closed + self._grid_ns
        return -(-self._heap[0][0] // self._grid_ns) * self._grid_ns

    def _suspect(self, topic: str, stamp_ns: int, sample: Any) -> list[Closed]:
        """Hold a stamp that is far off until others agree with it; then follow the jump."""
        assert self._newest is not None
        if self._suspects and abs(stamp_ns - self._suspects[-1][1]) > JUMP_NS:
            self._drop_suspects()
        self._suspects.append((topic, stamp_ns, sample))
        ahead = stamp_ns > self._newest
        stamps = [suspect[1] for suspect in self._suspects]
        if max(stamps) - min(stamps) < (AHEAD_RUN_NS if ahead else STALE_RUN_NS):
            return []
        run, self._suspects = self._suspects, []
        if not ahead or min(stamps) - self._newest > LONGEST_GAP_NS:
            self.reset()
            self.resets += 1
        for item in run:
            self._insert(*item)
        return self._close()

    def _drop_suspects(self) -> None:
        self.late.update(topic for topic, _, _ in self._suspects)
        self._suspects = []
