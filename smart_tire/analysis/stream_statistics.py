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

from dataclasses import dataclass

import numpy as np

from smart_tire.arrays import Instants
from smart_tire.estimation.streams import INPUTS
from smart_tire.messages import TOPICS
from smart_tire.recording import Recording, seconds

MIN_GAP_PERIODS = 1.5  # of the median period: one lost message gives 2, jitter rarely 1.5


@dataclass(frozen=True)
class StreamStats:
    """Regularity of a stream; its nominal period is the median one."""

    messages: int
    rate_hz: float        # inverse median period; per wheel if wheels share a topic
    gaps: int             # periods longer than ``MIN_GAP_PERIODS`` medians
    missing: int          # messages missing in the gaps
    longest_gap_s: float  # 0 without gaps


def input_stats(inputs: Recording) -> dict[str, StreamStats]:
    """Return topic -> statistics of the inputs; gaps of wheels that share a topic are summed."""
    return {topic: _combine([stream_stats(stream.stamp_ns) for stream in streams])
            for topic in INPUTS if (streams := inputs.of(TOPICS[topic].sample))}


def stream_stats(stamp_ns: Instants) -> StreamStats:
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
