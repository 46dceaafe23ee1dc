"""Rates and gaps of recorded streams, and how true the stamps of tire samples are."""

from __future__ import annotations

from array import array
from dataclasses import dataclass

import numpy as np

from smart_tire.analysis.series import seconds, Stamps
from smart_tire.samples import Sample, TireSample

# One missing message doubles a period; jitter rarely stretches it by half.
GAP = 1.5


@dataclass(frozen=True)
class StreamStats:
    """How regular a stream is; its expected period is the median one."""

    messages: int
    rate_hz: float        # one over the median period; of one wheel where several share a topic
    gaps: int             # periods longer than ``GAP`` times the median
    missing: int          # messages that would have filled the gaps
    longest_gap_s: float  # 0 without gaps


class StampLog:
    """Stamps of the inputs, by topic, and by wheel where wheels share a topic."""

    def __init__(self) -> None:
        self._stamps: dict[tuple[str, str], array[int]] = {}

    def add(self, topic: str, sample: Sample) -> None:
        """Note the stamp of one input."""
        wheel = sample.wheel if isinstance(sample, TireSample) else ''
        try:
            self._stamps[topic, wheel].append(sample.stamp_ns)
        except KeyError:
            self._stamps[topic, wheel] = array('q', [sample.stamp_ns])

    def stats(self) -> dict[str, StreamStats]:
        """Return topic -> statistics; gaps of wheels that share a topic add up."""
        found: dict[str, list[StreamStats]] = {}
        for (topic, _), stamps in self._stamps.items():
            found.setdefault(topic, []).append(stream_stats(np.array(stamps, np.int64)))
        return {topic: _together(parts) for topic, parts in found.items()}


def stream_stats(stamp_ns: Stamps) -> StreamStats:
    """Return how regular the stamps of one stream are, whatever order they came in."""
    periods = np.diff(seconds(np.sort(stamp_ns), int(stamp_ns[0])))
    regular = periods[periods > 0.0]
    if not len(regular):
        return StreamStats(len(stamp_ns), 0.0, 0, 0, 0.0)
    median = float(np.median(regular))
    gaps = regular[regular > GAP * median]
    missing = int(np.sum(np.rint(gaps / median) - 1.0))
    return StreamStats(len(stamp_ns), 1.0 / median, len(gaps), missing,
                       float(gaps.max(initial=0.0)))


def _together(parts: list[StreamStats]) -> StreamStats:
    return StreamStats(
        sum(part.messages for part in parts), float(np.median([part.rate_hz for part in parts])),
        sum(part.gaps for part in parts), sum(part.missing for part in parts),
        max(part.longest_gap_s for part in parts))
