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

"""Curves over time, prepared for drawing: gaps, undefined slip, axis limits, segments."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.analysis.series import Floats

MAX_GAP = 0.5             # s without values, over which no line is drawn
# -, of a slip ratio; above it the band of two standard deviations covers all slips from -1 to 1.
MAX_SLIP_SIGMA = 0.5
COVERED = (1.0, 99.0)     # percentiles of the values that the axes must include
AXIS_MARGIN = 0.2         # of the range of the values, above and below
MIN_LONG_DURATION = 60.0  # s; longer recordings are also drawn in segments
SEGMENT_DURATION = 15.0   # s
MAX_SEGMENTS = 3
ACTIVITY_STEP = 0.1       # s, grid on which the activity is summed


@dataclass(frozen=True)
class Curve:
    """Values over time; NaN leaves a gap."""

    time_s: Floats
    value: Floats
    sigma: Floats | None = None  # standard deviation, if known

    def at_rows(self, rows: NDArray[np.intp]) -> Curve:
        """Return the curve with these rows only."""
        return Curve(self.time_s[rows], self.value[rows],
                     None if self.sigma is None else self.sigma[rows])


def interrupted(curve: Curve, max_gap: float = MAX_GAP) -> Curve:
    """Return ``curve`` with a NaN in each gap of its timestamps longer than ``max_gap`` [s]."""
    after = np.flatnonzero(np.diff(curve.time_s) > max_gap) + 1
    between = 0.5 * (curve.time_s[after - 1] + curve.time_s[after])
    sigma = None if curve.sigma is None else np.insert(curve.sigma, after, math.nan)
    return Curve(np.insert(curve.time_s, after, between),
                 np.insert(curve.value, after, math.nan), sigma)


def observable(curve: Curve) -> tuple[Curve, float]:
    """
    Return a slip curve with NaN where slip is unknown, and the share of values removed.

    A slip is unknown if its standard deviation exceeds ``MAX_SLIP_SIGMA``: at walking pace around
    a standstill the ratio jumps between -1 and 1. The share is that of the finite values.
    """
    if curve.sigma is None:
        return curve, 0.0
    finite = np.isfinite(curve.value)
    removed = finite & ~(curve.sigma <= MAX_SLIP_SIGMA)
    share = float(removed.sum() / finite.sum()) if finite.any() else 0.0
    return replace(curve, value=np.where(removed, math.nan, curve.value)), share


def limits(values: Iterable[Floats], min_margin: float) -> tuple[float, float]:
    """Return axis limits that a few extreme values do not change; finite also without values."""
    found = _finite(values)
    low, high = np.percentile(found, COVERED) if len(found) else (0.0, 0.0)
    margin = max(AXIS_MARGIN * (high - low), min_margin)
    return float(low - margin), float(high + margin)


def share_outside(values: Iterable[Floats], low: float, high: float) -> float:
    """Return the share of the finite values outside of ``low`` to ``high``; 0 without values."""
    found = _finite(values)
    return float(np.mean((found < low) | (found > high))) if len(found) else 0.0


def _finite(values: Iterable[Floats]) -> Floats:
    parts = [np.ravel(part) for part in values]
    found: Floats = np.concatenate(parts) if parts else np.empty(0)
    return found[np.isfinite(found)]


def segments(curves: Iterable[Curve], duration: float = SEGMENT_DURATION,
             count: int = MAX_SEGMENTS) -> list[tuple[float, float]]:
    """
    Return the time intervals [s] in which ``curves`` change most, at most ``count``, in order.

    They do not overlap. Empty if the curves are not longer than ``MIN_LONG_DURATION`` together or
    do not change.
    """
    parts = [(curve.time_s[1:], np.abs(np.diff(curve.value))) for curve in curves
             if len(curve.time_s) > 1]
    if not parts:
        return []
    time, change = (np.concatenate(columns) for columns in zip(*parts))
    start, end = float(time.min()), float(time.max())
    if end - start <= MIN_LONG_DURATION:
        return []
    cells = np.floor((time - start) / ACTIVITY_STEP).astype(int)
    activity = np.bincount(cells, np.nan_to_num(change))
    width = round(duration / ACTIVITY_STEP)
    total = np.convolve(activity, np.ones(width), 'valid')
    found: list[tuple[float, float]] = []
    while len(found) < count and total.max(initial=0.0) > 0.0:
        first = int(np.argmax(total))
        begin = start + first * ACTIVITY_STEP
        found.append((begin, begin + duration))
        total[max(first - width, 0):first + width] = 0.0
    return sorted(found)
