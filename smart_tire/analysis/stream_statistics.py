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

"""Rates and gaps of recorded input streams."""

from __future__ import annotations

from array import array
from dataclasses import dataclass

import numpy as np

from smart_tire.analysis.series import seconds, Stamps
from smart_tire.samples import Sample, TireSample

MIN_GAP_PERIODS = 1.5  # of the median period: one lost message gives 2, jitter rarely 1.5


@dataclass(frozen=True)
class StreamStats:
    """Regularity of a stream; its nominal period is the median one."""

    messages: int
    rate_hz: float        # inverse median period; per wheel if wheels share a topic
    gaps: int             # periods longer than ``MIN_GAP_PERIODS`` medians
    missing: int          # messages missing in the gaps
    longest_gap_s: float  # 0 without gaps


class StampLog:
    """Timestamps of the inputs, by topic, and by wheel if wheels share a topic."""

    def __init__(self) -> None:
        self._stamps: dict[tuple[str, str], array[int]] = {}

    def add(self, topic: str, sample: Sample) -> None:
        """Add the timestamp of one sample."""
        wheel = sample.wheel if isinstance(sample, TireSample) else ''
        try:
            self._stamps[topic, wheel].append(sample.stamp_ns)
        except KeyError:
            self._stamps[topic, wheel] = array('q', [sample.stamp_ns])

    def stats(self) -> dict[str, StreamStats]:
        """Return topic -> statistics; gaps of wheels that share a topic are summed."""
        found: dict[str, list[StreamStats]] = {}
        for (topic, _), stamps in self._stamps.items():
            found.setdefault(topic, []).append(stream_stats(np.array(stamps, np.int64)))
        return {topic: _combine(parts) for topic, parts in found.items()}


def stream_stats(stamp_ns: Stamps) -> StreamStats:
    """Return the statistics of the timestamps of one stream, in any order."""
    periods = np.diff(seconds(np.sort(stamp_ns), int(stamp_ns[0])))
    regular = periods[periods > 0.0]
    if not len(regular):
        return StreamStats(len(stamp_ns), 0.0, 0, 0, 0.0)
    median = float(np.median(regular))
    gaps = regular[regular > MIN_GAP_PERIODS * median]
    missing = int(np.sum(np.rint(gaps / median) - 1.0))
    return StreamStats(len(stamp_ns), 1.0 / median, len(gaps), missing,
                       float(gaps.max(initial=0.0)))


def _combine(parts: list[StreamStats]) -> StreamStats:
    return StreamStats(
        sum(part.messages for part in parts), float(np.median([part.rate_hz for part in parts])),
        sum(part.gaps for part in parts), sum(part.missing for part in parts),
        max(part.longest_gap_s for part in parts))
