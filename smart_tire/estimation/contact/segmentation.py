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
Film samples of one wheel: regular timestamps, and segmentation into intervals of activity.

A film is active while its output differs from the baseline, with either sign. Segments are
defined over rolled distance, not over time: a segment closes after some length below the
threshold or at a reversal of the wheel. Noise, bumps and standstill cause none.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
import math
from operator import attrgetter

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.estimation.contact import constants as c
from smart_tire.estimation.contact.records import ActiveSegment, FilmGroup
from smart_tire.numerics.levenberg_marquardt import upper_median
from smart_tire.samples import NS_PER_S, TireSample


class FilmSampleBuffer:
    """
    Buffers samples of ``films`` of one wheel until the wheel angle at their timestamps is known.

    A sensor node samples at a constant rate, but each batch of timestamps has an error of its own
    from the unknown part of the radio delay: 0.5 ms between two batches is half a millimeter of
    travel within one crossing, more than the effect of friction. The timestamps are regularized.
    """

    def __init__(self, films: Sequence[int], period_ns: int) -> None:
        self._films, self._period_ns = tuple(films), period_ns
        self._samples: list[TireSample] = []
        self._last = 0.0  # regularized timestamp of the newest sample taken
        self._count = 0   # of samples over which its error is averaged

    def add(self, sample: TireSample) -> None:
        """Add one conversion of all films of the wheel; the last films may be absent."""
        self._samples.append(sample)

    def clear(self) -> None:
        """Drop all samples."""
        self._samples.clear()

    def take(self, until_ns: int) -> tuple[Instants, Array]:
        """
        Remove and return the samples up to an instant.

        Regularized timestamps (n,) [ns] and volts (n, films), NaN where a film is absent.
        """
        count = bisect_right(self._samples, until_ns, key=attrgetter('stamp_ns'))
        taken = self._samples[:count]
        del self._samples[:count]
        rows, films = [one.volts for one in taken], max(self._films) + 1
        if set(map(len, rows)) - {films}:
            rows = [(*row, *(math.nan,) * (films - len(row)))[:films] for row in rows]
        volts: Array = np.array(rows).reshape(-1, films)[:, self._films]
        return self._regularized([one.stamp_ns for one in taken]), volts

    def _regularized(self, stamps: Sequence[int]) -> Instants:
        """Return ``stamps``, which continue those of earlier calls, regularized."""
        period, last, count, out = self._period_ns, self._last, self._count, []
        for stamp in stamps:
            gap = stamp - last
            # one period, of almost all samples, takes no rounding
            regular = last + (period if gap < 1.5 * period else period * round(gap / period))
            error = stamp - regular
            if count and -period < error < period:
                if count < c.AVERAGING_SAMPLES:
                    count += 1
                last = regular + error / count
            else:  # the first sample, or the node has been reset
                last, count = float(stamp), 1
            out.append(last)
        self._last, self._count = last, count
        return np.rint(out).astype(np.int64)


class SegmentExtractor:
    """
    Recent samples of one wheel's films, and the active segments in them.

    The ``baseline`` [V] is tracked from its initial value. Samples at standstill are dropped, so a
    film may wait in the patch for any time.
    """

    def __init__(self, group: FilmGroup, baseline: float, period_ns: int) -> None:
        films = len(group.thresholds)
        self._thresholds = np.array(group.thresholds)
        self._length, self._crossing = group.film_length, 2.0 * group.half_crossing
        self._gap_ns = c.GAP_PERIODS * period_ns
        self._standstill = c.MIN_FILM_SPEED * group.film_length / NS_PER_S  # m/ns
        self._baseline = np.full(films, baseline)
        self._instants: Instants = np.empty(0, dtype=np.int64)
        self._volts: Array = np.empty((0, films))
        self._active = np.empty((0, films), dtype=bool)
        self._sampled: Array = np.empty(0)  # m, distance up to each sample, without gaps
        self._extracted = np.full(films, -1.0)  # m, sampled distance at the end of a segment
        self._open = [False] * films
        self._gaps: list[tuple[int, int]] = []
        self._reversals: list[int] = []  # ns
        self._last: tuple[int, float] | None = None  # instant and position of the newest sample

    @property
    def active(self) -> bool:
        """Whether a segment of any film is open."""
        return any(self._open)

    def extend(self, instants: Instants, positions: Array, volts: Array,
               reversals: Sequence[int]) -> list[ActiveSegment]:
        """
        Add samples and return the segments that they close.

        ``positions`` (n,) [m] is the rolled distance at ``instants`` (n,) [ns], ``volts`` is
        (n, films). ``reversals`` [ns] are not after the last sample.
        """
        self._reversals = [*self._reversals, *reversals][-c.REMEMBERED:]
        count = self._append(instants, positions, volts) if len(instants) else 0
        if not count and not len(reversals):
            return []
        segments = self._extract(c.CLOSING * self._length, count)
        if len(self._sampled):
            old = int(self._sampled.searchsorted(
                self._sampled[-1] - 2.0 * c.MAX_ACTIVE_CROSSINGS * self._crossing))
            self._instants, self._sampled = self._instants[old:], self._sampled[old:]
            self._volts, self._active = self._volts[old:], self._active[old:]
        return segments

    def finish(self) -> list[ActiveSegment]:
        """Close all segments: the films are known to have left the patch."""
        return self._extract(-1.0, 0)

    def lost_share(self, begin_ns: int, end_ns: int) -> float:
        """Return the share of the time between two instants that no sample covers."""
        if self._last is None:
            return 1.0
        missing = sum(max(0, min(end, end_ns) - max(begin, begin_ns))
                      for begin, end in [*self._gaps, (self._last[0], end_ns)])
        return missing / max(end_ns - begin_ns, 1)

    def _append(self, instants: Instants, positions: Array, volts: Array) -> int:
        """Keep the samples in motion; return their number."""
        if self._last is None:  # nothing was sampled before
            self._last = int(instants[0]), float(positions[0])
            self._gaps.append((0, self._last[0]))
        elapsed, steps = instants - self._last[0], positions - self._last[1]
        elapsed[1:] -= elapsed[:-1].copy()
        steps[1:] -= steps[:-1].copy()
        steps = np.abs(steps)
        self._last = int(instants[-1]), float(positions[-1])
        lost = elapsed > self._gap_ns
        kept = lost | (steps > self._standstill * elapsed)
        self._gaps += [(int(instants[i] - elapsed[i]), int(instants[i]))
                       for i in lost.nonzero()[0]]
        del self._gaps[:-c.REMEMBERED]
        steps[lost] = 0.0
        sampled = steps.cumsum() + (self._sampled[-1] if len(self._sampled) else 0.0)
        volts = volts[kept]
        self._instants = np.concatenate([self._instants, instants[kept]])
        self._volts = np.concatenate([self._volts, volts])
        self._active = np.concatenate([
            self._active, np.abs(volts - self._baseline) > self._thresholds])
        self._sampled = np.concatenate([self._sampled, sampled[kept]])
        return len(volts)

    def _extract(self, closing: float, new: int) -> list[ActiveSegment]:
        """Return the segments before a reversal, or inactive for more than ``closing`` [m]."""
        segments = []
        # number of reversals before each sample
        legs = np.searchsorted(self._reversals, self._instants)
        active = self._active & (self._sampled[:, np.newaxis] > self._extracted)
        for film in range(len(self._open)):
            self._open[film] = False
            indices = active[:, film].nonzero()[0]
            if not len(indices):
                self._track_baseline(film, self._volts[len(self._volts) - new:, film])
                continue
            breaks = ((np.diff(self._sampled[indices]) > abs(closing))
                      | (np.diff(legs[indices]) > 0)).nonzero()[0]
            for first, last in zip(indices[[0, *(breaks + 1)]], indices[[*breaks, -1]]):
                if (self._sampled[-1] - self._sampled[last] > closing
                        or legs[last] < len(self._reversals)):
                    self._extracted[film] = self._sampled[last]
                    segments.append(self._segment(film, first, last, legs == legs[last]))
                elif self._sampled[last] - self._sampled[first] > (
                        c.MAX_ACTIVE_CROSSINGS * self._crossing):
                    self._baseline[film] = float(np.median(self._volts[:, film]))
                    self._extracted[film] = self._sampled[-1]
                else:
                    self._open[film] = True
        return segments

    def _segment(self, film: int, first: int, last: int, leg: Array) -> ActiveSegment:
        """Return the samples around the first and the last active one, in the same ``leg``."""
        distance = self._sampled
        # the first active sample is at most a film length after the entry
        around = leg & (distance >= distance[first] - (c.OUTER_LENGTH + 1.0) * self._length) & (
            distance <= distance[last] + c.OUTER_LENGTH * self._length)
        return ActiveSegment(
            film, int(self._instants[first]), int(self._instants[last]), self._instants[around],
            self._volts[around, film], float(self._baseline[film]))

    def _track_baseline(self, film: int, volts: Array) -> None:
        if len(volts) >= c.MIN_SAMPLES:
            error = upper_median(volts) - float(self._baseline[film])
            if math.isfinite(error):  # a film may be absent
                self._baseline[film] += c.RECURSIVE_GAIN * error
