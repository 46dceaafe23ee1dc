# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Stalls of a recording: whether the host was late, and which faults of the messages this explains.

A stall of a device is the time from when a message was due, by the promptest ones around it, until
its reception, and a gap between readings of IMU or wheels. A radio batch that is missing between
punctual ones is no stall. Nodes report for how long they waited for a core; while they did, all
stalls are those of the host. Without these reports, those of independent devices at the same time
are.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array, Instants
from smart_tire.checks import limits
from smart_tire.host_load import HostLoad, WINDOW_TIME, worst_of
from smart_tire.messages import NodeStatus
from smart_tire.recording import Stream
from smart_tire.samples import NS_PER_S, TireSample

BIN_NS = 10_000_000  # resolution of the time of stalls
NO_MESSAGE = np.iinfo(np.int64).max  # least delay of a block of time without messages
Mask = NDArray[np.bool_]  # (n,) a value for each bin


def runs(mask: Mask) -> tuple[Instants, Instants]:
    """Return begins and ends of the runs in ``mask`` (n,); an end is the index after the run."""
    begin, end = np.flatnonzero(np.diff(
        mask.astype(int), prepend=0, append=0)).reshape(-1, 2).T
    return begin, end


def delays(stream: Stream) -> Array:
    """Return reception minus timestamp [s] of each message."""
    return np.asarray((stream.receive_ns - stream.stamp_ns) / NS_PER_S)


def least_delays(stream: Stream) -> tuple[Instants, Instants]:
    """Return the block of time (n,) of each message, and the least delays [ns] of all blocks."""
    block = stream.receive_ns - stream.receive_ns.min()
    block //= block.max() // limits.DRIFT_BLOCKS + 1
    lowest = np.full(limits.DRIFT_BLOCKS, NO_MESSAGE)
    np.minimum.at(lowest, block, stream.receive_ns - stream.stamp_ns)
    return block, lowest


def due_ns(stream: Stream) -> Instants:
    """Return when each message would have been received without lateness."""
    block, lowest = least_delays(stream)
    due = lowest[block]
    due += stream.stamp_ns
    return np.asarray(due)


@dataclass(frozen=True, eq=False)
class Stalls:
    """Stalls of the devices, and what nodes have reported about their host."""

    streams: Sequence[Stream]  # with timestamps, as received
    statuses: Sequence[tuple[int, NodeStatus]] = ()  # timestamps [ns], diagnostics of nodes
    host: HostLoad | None = None  # during the whole recording
    # begin and end [ns] of pauses of the recording, which explain gaps, but are none of the host
    pauses: Sequence[tuple[int, int, bool]] = ()

    @cached_property
    def reported(self) -> HostLoad | None:
        """Return the greatest lateness that nodes have reported; None without reports."""
        return self.host or worst_of(status.values for _, status in self.statuses)

    @property
    def late(self) -> bool:
        """Return whether the host was late."""
        return self.reported is not None and self.reported.late or bool(self.shared)

    @cached_property
    def shared(self) -> list[tuple[str, ...]]:
        """Return the devices that stall at the same times, as pairs."""
        return [pair for pair in combinations(self._devices, 2)
                if _coincide(*(self._devices[name] for name in pair))]

    @cached_property
    def of_host(self) -> Mask:
        """Return the bins in which the host stalled."""
        found = np.zeros(self._bins, bool)
        for pair in self.shared:
            found |= self._devices[pair[0]] & self._devices[pair[1]]
        if self._devices:
            found |= self._reported_late & np.logical_or.reduce([*self._devices.values()])
        return found

    def spans(self) -> Array:
        """Return begin and duration [s] of the stalls of the host, shape (n, 2)."""
        begin, end = runs(self.of_host)
        return np.stack([begin, end - begin], axis=1) * BIN_NS / NS_PER_S

    def explain(self, begin_ns: Instants, end_ns: Instants) -> Mask:
        """Return which of the intervals in time of reception overlap a stall of the host."""
        count = np.concatenate([[0], np.cumsum(self.of_host | self._paused)])
        first, last = (np.clip((one - self.start_ns) // BIN_NS, 0, self._bins - 1)
                       for one in (begin_ns, end_ns))
        return np.asarray(count[last + 1] > count[first])

    @cached_property
    def start_ns(self) -> int:
        """Return when the first message was due."""
        return min((int(due_ns(stream).min()) for stream in self.streams), default=0)

    @cached_property
    def _bins(self) -> int:
        end = max((int(stream.receive_ns.max()) for stream in self.streams), default=0)
        return (end - self.start_ns) // BIN_NS + 1

    @cached_property
    def _devices(self) -> dict[str, Mask]:
        """Return the bins in which each device stalls; all wheels share the radio."""
        found: dict[str, Mask] = {}
        for stream in self.streams:
            stalls = self._mask(stalled_intervals(stream)) & ~self._paused
            found[stream.topic] = found.get(stream.topic, np.zeros(self._bins, bool)) | stalls
        return found

    @cached_property
    def _paused(self) -> Mask:
        """Return the bins of the pauses, and those around until each device is received."""
        margin = 2 * max((round(one.period * NS_PER_S) for one in self.streams), default=0)
        return self._mask([(np.array([begin - margin]), np.array([end + margin]))
                           for begin, end, _ in self.pauses])

    @cached_property
    def _reported_late(self) -> Mask:
        if self.host is not None:
            return np.full(self._bins, self.host.late)
        late = [stamp_ns for stamp_ns, status in self.statuses
                if (load := worst_of([status.values])) is not None and load.late]
        end = np.array(late, np.int64)
        return self._mask([(end - round(WINDOW_TIME * NS_PER_S), end)])

    def _mask(self, intervals: Iterable[tuple[Instants, Instants]]) -> Mask:
        """Return the bins that ``intervals`` touch."""
        change = np.zeros(self._bins + 1, int)
        for begin, end in intervals:
            first, last = (np.clip((one - self.start_ns) // BIN_NS, 0, self._bins - 1)
                           for one in (begin, end))
            np.add.at(change, first, 1)
            np.add.at(change, last + 1, -1)
        return np.asarray(np.cumsum(change)[:-1] > 0)


def stalled_intervals(stream: Stream) -> list[tuple[Instants, Instants]]:
    """Return begins and ends [ns] of waiting messages, and of gaps of IMU and wheels."""
    due = due_ns(stream)
    late = stream.receive_ns - due > limits.MIN_STALL * NS_PER_S
    found = [(due[late], stream.receive_ns[late])]
    if stream.kind is not TireSample:
        due = np.sort(due)
        gap = np.diff(due) / NS_PER_S > max(
            limits.MIN_STALL, limits.MIN_GAP_PERIODS * stream.period)
        found.append((due[:-1][gap], due[1:][gap]))
    return found


def _coincide(one: Mask, other: Mask) -> bool:
    """Return whether two devices stall together: by the correlation of their stalls."""
    if one.all() or other.all() or not one.any() or not other.any():
        return False
    return float(np.corrcoef(one, other)[0, 1]) > limits.MIN_CORRELATION
