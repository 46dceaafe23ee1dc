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

"""
Segmentation of the signals of one wheel's films into intervals of activity.

A film is active while its output differs from the baseline, with either sign. Segments are
defined over rolled distance, not over time: a segment closes after some millimeters below the
threshold or at a reversal of the wheel. Noise, bumps and standstill cause none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array, Instants
from smart_tire.samples import NS_PER_S

CLOSING_DISTANCE = 0.035  # m below threshold that closes a segment; hard braking shows 26 mm
LEAD_DISTANCE = 0.050     # m of samples kept before the first active one: entry, bump ...
TAIL_DISTANCE = 0.030     # m ... and after the last: bump, recovery
STANDSTILL_SPEED = 0.002  # m/s, below which samples carry no new information
MAX_ACTIVE_CROSSINGS = 2.5  # crossing lengths of activity, beyond which the baseline has moved
BASELINE_GAIN = 0.1       # share of a new median in the tracked baseline
MIN_BASELINE_SAMPLES = 8  # for a median
GAP_PERIODS = 2.5         # sample periods; a longer step between timestamps is a gap
KEPT_CROSSINGS = 5.0      # crossing lengths of samples kept
MAX_GAPS = 64             # remembered


@dataclass(frozen=True, slots=True, eq=False)
class ActiveSegment:
    """Samples of one film while it was active and the wheel rolled in one direction."""

    film: int           # index, 0 for film 1
    begin_ns: int       # first active sample
    end_ns: int         # last active sample
    instants: Instants  # ns, of the samples, including some before and after
    volts: Array        # V, as sampled
    baseline: float     # V


@dataclass(slots=True)
class _OpenSegment:
    """A segment that is not closed yet."""

    begin_ns: int
    end_ns: int
    begin: float   # m, sampled distance at the first active sample
    end: float     # m, sampled distance at the last active sample
    since_ns: int  # latest reversal; earlier samples belong to another segment


class SegmentExtractor:
    """
    Recent samples of one wheel's films, and the active segments in them.

    ``thresholds`` [V] are the activity thresholds per film; the ``baseline`` [V] is tracked from
    its initial value. Samples at standstill are dropped, so a film may wait in the patch for any
    time. ``crossing`` [m] is the distance from entry to release of a film.
    """

    def __init__(self, thresholds: Sequence[float], baseline: float, period_ns: int,
                 crossing: float) -> None:
        films = len(thresholds)
        self._thresholds = np.asarray(thresholds, dtype=float)
        self._period_ns = period_ns
        self._crossing = crossing
        self._baseline = np.full(films, baseline)
        self._instants: Instants = np.empty(0, dtype=np.int64)
        self._volts: Array = np.empty((0, films))
        self._sampled: Array = np.empty(0)  # m, distance up to each sample, without gaps
        self._open: list[_OpenSegment | None] = [None] * films
        self._gaps: list[tuple[int, int]] = []
        self._last: tuple[int, float] | None = None  # instant and position of the newest sample
        self._reversal_ns = 0  # latest reversal
        self.stuck = 0  # times that a film was active for longer than a crossing

    def add(self, instants: Instants, positions: Array, volts: Array,
            reversals: Sequence[int]) -> list[ActiveSegment]:
        """
        Add samples and return the segments that they close.

        ``positions`` (n,) [m] is the rolled distance at ``instants`` (n,) [ns], ``volts`` is
        (n, films). ``reversals`` [ns] are at most at the last sample and not before those of
        earlier calls.
        """
        segments: list[ActiveSegment] = []
        for reversal_ns in reversals:
            split = int(np.searchsorted(instants, reversal_ns, side='right'))
            segments += self._append(instants[:split], positions[:split], volts[:split])
            instants, positions, volts = instants[split:], positions[split:], volts[split:]
            segments += self._close_at_reversal(reversal_ns)
        return segments + self._append(instants, positions, volts)

    def finish(self) -> list[ActiveSegment]:
        """Close all segments: the films are known to have left the patch."""
        segments = []
        for film in range(len(self._baseline)):
            segments += self._close(film, math.inf, 0.0)
        return segments

    @property
    def active(self) -> bool:
        """Whether a segment of any film is open."""
        return any(segment is not None for segment in self._open)

    def lost_share(self, begin_ns: int, end_ns: int) -> float:
        """Return the share of the time between two instants that no sample covers."""
        if self._last is None:
            return 1.0
        missing = sum(max(0, min(end, end_ns) - max(begin, begin_ns))
                      for begin, end in [*self._gaps, (self._last[0], end_ns)])
        return missing / max(end_ns - begin_ns, 1)

    def _append(self, instants: Instants, positions: Array, volts: Array) -> list[ActiveSegment]:
        if not len(instants):
            return []
        last = self._last
        if last is None:  # nothing was sampled before
            last = int(instants[0]), float(positions[0])
            self._gaps.append((0, last[0]))
        elapsed, steps = np.empty(len(instants), dtype=np.int64), np.empty(len(instants))
        elapsed[0], steps[0] = instants[0] - last[0], positions[0] - last[1]
        np.subtract(instants[1:], instants[:-1], out=elapsed[1:])
        np.subtract(positions[1:], positions[:-1], out=steps[1:])
        steps = np.abs(steps)
        self._last = int(instants[-1]), float(positions[-1])
        rolling = steps > (STANDSTILL_SPEED / NS_PER_S) * elapsed
        if elapsed.max() > GAP_PERIODS * self._period_ns:
            lost = elapsed > GAP_PERIODS * self._period_ns
            self._gaps += [(int(instants[i] - elapsed[i]), int(instants[i]))
                           for i in lost.nonzero()[0]]
            del self._gaps[:-MAX_GAPS]
            rolling |= lost
            steps[lost] = 0.0
        sampled = steps.cumsum()
        if len(self._sampled):
            sampled += self._sampled[-1]
        if not rolling.all():
            instants, volts, sampled = instants[rolling], volts[rolling], sampled[rolling]
            if not len(instants):
                return []
        self._instants = np.concatenate([self._instants, instants])
        self._volts = np.concatenate([self._volts, volts])
        self._sampled = np.concatenate([self._sampled, sampled])
        segments = self._update(instants, volts, sampled)
        self._drop_before(float(sampled[-1]) - KEPT_CROSSINGS * self._crossing)
        return segments

    def _drop_before(self, sampled: float) -> None:
        old = int(self._sampled.searchsorted(sampled))
        self._instants, self._volts = self._instants[old:], self._volts[old:]
        self._sampled = self._sampled[old:]

    def _update(self, instants: Instants, volts: Array, sampled: Array) -> list[ActiveSegment]:
        """Track baselines, open, extend and close segments with new samples."""
        segments = []
        signal = volts - self._baseline
        active = np.abs(signal) > self._thresholds
        for film, any_active in enumerate(active.any(axis=0).tolist()):
            if not any_active and self._open[film] is None:
                self._track_baseline(film, signal[:, film])
                continue
            for first, last in (_runs(active[:, film].nonzero()[0], sampled) if any_active
                                else ()):
                segments += self._close(film, float(sampled[first]), CLOSING_DISTANCE)
                self._extend(film, int(instants[first]), float(sampled[first]))
                self._extend(film, int(instants[last]), float(sampled[last]))
            segments += self._close(film, float(sampled[-1]), CLOSING_DISTANCE)
        return segments

    def _track_baseline(self, film: int, signal: Array) -> None:
        if len(signal) >= MIN_BASELINE_SAMPLES:
            # np.median takes ten times as long
            ordered = np.sort(signal)
            median = 0.5 * (ordered[(len(signal) - 1) // 2] + ordered[len(signal) // 2])
            if math.isfinite(median):  # a film may be absent
                self._baseline[film] += BASELINE_GAIN * float(median)

    def _extend(self, film: int, instant: int, sampled: float) -> None:
        segment = self._open[film]
        if segment is None:
            self._open[film] = _OpenSegment(
                instant, instant, sampled, sampled, self._reversal_ns)
            return
        segment.end_ns, segment.end = instant, sampled
        if sampled - segment.begin > MAX_ACTIVE_CROSSINGS * self._crossing:
            # longer than any crossing: the baseline has moved
            self._baseline[film] = float(np.median(self._volts[:, film]))
            self._open[film] = None
            self.stuck += 1

    def _close(self, film: int, sampled: float, distance: float) -> list[ActiveSegment]:
        """Close the film's segment if it was inactive for more than ``distance`` [m]."""
        segment = self._open[film]
        if segment is None or sampled - segment.end <= distance:
            return []
        self._open[film] = None
        return [self._extract(film, segment, segment.end + TAIL_DISTANCE)]

    def _close_at_reversal(self, reversal_ns: int) -> list[ActiveSegment]:
        """Close every segment at a reversal; later activity opens another."""
        segments = []
        self._reversal_ns = reversal_ns
        at = int(np.searchsorted(self._instants, reversal_ns, side='right')) - 1
        if at < 0:
            return []
        sampled = float(self._sampled[at])
        for film, segment in enumerate(self._open):
            if segment is None or segment.begin_ns > reversal_ns:
                continue
            self._open[film] = None
            if segment.end_ns > reversal_ns:
                self._open[film] = _OpenSegment(
                    reversal_ns, segment.end_ns, sampled, segment.end, reversal_ns)
                segment.end_ns, segment.end = reversal_ns, sampled
            segments.append(self._extract(film, segment, sampled))
        return segments

    def _extract(self, film: int, segment: _OpenSegment, until: float) -> ActiveSegment:
        low, high = np.searchsorted(self._sampled, [segment.begin - LEAD_DISTANCE, until + 1e-9])
        low = max(int(low), int(np.searchsorted(self._instants, segment.since_ns)))
        return ActiveSegment(film, segment.begin_ns, segment.end_ns, self._instants[low:high],
                             self._volts[low:high, film], float(self._baseline[film]))


def _runs(indices: NDArray[np.intp], sampled: Array) -> list[tuple[int, int]]:
    """Return first and last of each run of active ``indices`` (n,) closer than a closing gap."""
    positions = sampled[indices]
    breaks = (positions[1:] - positions[:-1] > CLOSING_DISTANCE).nonzero()[0]
    firsts = indices[[0, *(breaks + 1)]]
    lasts = indices[[*breaks, -1]]
    return list(zip(firsts.tolist(), lasts.tolist()))
