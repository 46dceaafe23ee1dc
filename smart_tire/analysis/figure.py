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
Figures as data: curves, marks, panels and captions, without the library that draws them.

``drawing`` writes them as files by matplotlib, ``html_report.plots`` into a page by plotly.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array

SIGMAS = 2.0              # half width of bands and bars, in standard deviations
MAX_GAP = 0.5             # s without values, over which no line is drawn
MAX_SLIP_SIGMA = 1.0 / SIGMAS  # of a slip ratio; above, its band covers all from -1 to 1
COVERED = (1.0, 99.0)     # percentiles of the values that the axes must include
AXIS_MARGIN = 0.2         # of the range of the values, above and below
SEGMENT_DURATION = 15.0   # s, of the parts of a long recording that are drawn in detail
MAX_SEGMENTS = 3          # a recording is long if it is longer than these and one more
ACTIVITY_STEP = 0.1       # s, grid on which the activity is summed
MAX_POINTS = 5000         # of a curve
ELLIPSE_POINTS = 48
CRITERIA = 4              # rows that are kept of each interval, see ``decimated``
# Palette of Okabe and Ito, distinguishable with color vision deficiency.
COLORS = {'blue': '#0072b2', 'vermillion': '#d55e00', 'orange': '#e69f00', 'sky': '#56b4e9',
          'green': '#009e73', 'purple': '#cc79a7', 'ink': '#222222', 'shade': '#8c8c8c'}
PAIR = 'blue', 'orange'   # of two films, or of filtered and smoothed estimates
TRUTH, CAMERA = 'truth', 'camera'  # references, by their names in legends and summaries
SOURCES = {TRUTH: 'ground truth', CAMERA: 'the overhead camera'}
REPORTED = {  # where the standard deviations of errors are from
    TRUTH: 'that the estimator reports',
    CAMERA: 'by the covariances that estimator and camera report, added'}
# What captions say, color, width in points, and whether the line is dashed.
REFERENCE_STYLES = {TRUTH: (' Dashed: ground truth.', 'ink', 1.1, True),
                    CAMERA: (' Green: the overhead camera.', 'green', 2.4, False)}
PICTURE = 'camera.png'  # of smart_tire overhead
GAP = np.full((1, 2), math.nan)  # a row of x and y that interrupts a line
TIME_LABEL = 'time [s]'
TWO_SIGMA = '± 2σ, where σ is the standard deviation that the estimator reports.'

Segments = Sequence[tuple[float, float]]  # s
Limits = tuple[float | None, float | None]


@dataclass(frozen=True, eq=False)
class Curve:
    """Values ``y`` over ``x``, mostly a time [s]; NaN leaves a gap."""

    x: Array
    y: Array
    sigma: Array | None = None  # standard deviation of y, if known

    def at_rows(self, rows: NDArray[np.intp]) -> Curve:
        """Return the curve with these rows only."""
        return Curve(self.x[rows], self.y[rows], None if self.sigma is None else self.sigma[rows])

    @property
    def reach(self) -> Array:
        """Return the half width of the band; 0 where the standard deviation is not known."""
        return SIGMAS * (np.zeros_like(self.y) if self.sigma is None else self.sigma)


@dataclass(frozen=True, eq=False)
class Mark:
    """One series of a panel; with standard deviations a line has a band, points have bars."""

    curve: Curve
    label: str = ''          # in the legend, once per figure
    color: str = 'blue'      # name in ``COLORS``
    kind: Literal['line', 'points', 'area'] = 'line'
    width: float = 1.4       # of a line or point, in points
    dashed: bool = False
    steps: Literal['', 'mid', 'post'] = ''
    opacity: float = 1.0
    around_zero: bool = False        # the band: of an error with its standard deviation
    x_sigma: Array | None = None    # of points


@dataclass(frozen=True, eq=False)
class ColorField:
    """Values of the cells of a plane, as colors with a scale; NaN is not drawn."""

    values: Array                               # (rows, columns), the lowest row first
    extent: tuple[float, float, float, float]   # left, right, bottom, top
    label: str                                  # of the color scale
    limits: tuple[float, float]                 # of the color scale


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes, whose labels carry units."""

    marks: Sequence[Mark]
    x_label: str
    y_label: str
    title: str = ''
    x_limits: Limits | None = None
    y_limits: Limits | None = None
    equal: bool = False  # both axes have the same scale
    image: NDArray[np.uint8] | None = None  # gray, behind the marks, whose unit is its pixels
    field: ColorField | None = None              # behind the marks

    @property
    def over_time(self) -> bool:
        """Return whether the horizontal axis is the time."""
        return self.x_label == TIME_LABEL


@dataclass(frozen=True, eq=False)
class Figure:
    """
    Panels in rows, and a caption.

    A panel that stands in several cells spans them; None leaves a cell empty.
    """

    name: str        # of its file, without suffix
    title: str       # what it shows, for readers who do not see it
    caption: str
    rows: Sequence[Sequence[Panel | None]]
    cell: tuple[float, float] = (9.0, 2.8)  # inch, width and height
    segments: Segments = ()          # shown in detail where there is no zoom
    panel_legends: bool = False      # one legend per panel, not per figure

    @property
    def panels(self) -> list[Panel]:
        """Return the panels in the order of rows and columns."""
        return list(dict.fromkeys(panel for row in self.rows for panel in row if panel))


def truth_marks(curve: Curve, steps: Literal['', 'mid', 'post'] = '') -> list[Mark]:
    """Return the dashed line of the ground truth, without errors; none if it is not known."""
    return reference_marks({TRUTH: Curve(curve.x, curve.y)}, steps)


def reference_marks(curves: Mapping[str, Curve],
                    steps: Literal['', 'mid', 'post'] = '') -> list[Mark]:
    """Return the lines of references by name, with bands where sigmas are given."""
    marks = []
    for name, curve in reversed(list(curves.items())):
        _, color, width, dashed = REFERENCE_STYLES[name]
        if len(curve.x):
            label = name if curve.sigma is None else f'{name} ± 2σ'
            marks.append(Mark(curve, label, color, width=width, dashed=dashed, steps=steps))
    return marks


def reference_caption(names: Iterable[str]) -> str:
    """Return the sentences of a caption that say how references are drawn."""
    return ''.join(REFERENCE_STYLES[name][0] for name in names)


def dots(x: Array, y: Array, label: str = '', color: str = 'sky', sigma: Array | None = None,
         x_sigma: Array | None = None) -> Mark:
    """Return points, with bars where standard deviations are given."""
    return Mark(Curve(x, y, sigma), label, color, 'points', 3.0, x_sigma=x_sigma)


def straight(over: Array, slope: float, label: str = '', color: str = 'vermillion',
             offset: float = 0.0, dashed: bool = False) -> Mark:
    """Return the line with ``slope`` and ``offset`` at zero, over the range of ``over``."""
    ends = np.array([over.min(), over.max()])
    return Mark(Curve(ends, slope * ends + offset), label, color, width=1.2, dashed=dashed)


def ellipse(covariance: Array) -> Array:
    """Return points (n, 2) on the ellipse of two standard deviations around zero."""
    angle = np.linspace(0.0, math.tau, ELLIPSE_POINTS)
    values, vectors = np.linalg.eigh(covariance)
    radii = SIGMAS * np.sqrt(np.maximum(values, 0.0))
    points: Array = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * radii @ vectors.T
    return points


def runs(known: NDArray[np.bool_]) -> Iterator[slice]:
    """Yield the intervals of rows in which ``known`` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(int), [0]])))
    yield from (slice(first, last) for first, last in zip(edges[::2].tolist(),
                                                          edges[1::2].tolist()))


def interrupted(curve: Curve, max_gap: float = MAX_GAP) -> Curve:
    """Return ``curve`` with a NaN in each gap of its timestamps longer than ``max_gap`` [s]."""
    after = np.flatnonzero(np.diff(curve.x) > max_gap) + 1
    between = 0.5 * (curve.x[after - 1] + curve.x[after])
    sigma = None if curve.sigma is None else np.insert(curve.sigma, after, math.nan)
    return Curve(np.insert(curve.x, after, between), np.insert(curve.y, after, math.nan), sigma)


def observable(curve: Curve) -> tuple[Curve, float]:
    """
    Return a slip curve with NaN where slip is unknown, and the share of values removed.

    A slip is unknown if its standard deviation exceeds ``MAX_SLIP_SIGMA``: at walking pace around
    a standstill the ratio jumps between -1 and 1. The share is that of the finite values.
    """
    if curve.sigma is None:
        return curve, 0.0
    finite = np.isfinite(curve.y)
    removed = finite & ~(curve.sigma <= MAX_SLIP_SIGMA)
    share = float(removed.sum() / finite.sum()) if finite.any() else 0.0
    return replace(curve, y=np.where(removed, math.nan, curve.y)), share


def limits(values: Iterable[Array], min_margin: float) -> tuple[float, float]:
    """Return axis limits that a few extreme values do not change; finite also without values."""
    found = _finite(values)
    low, high = np.percentile(found, COVERED) if len(found) else (0.0, 0.0)
    margin = max(AXIS_MARGIN * (high - low), min_margin)
    return float(low - margin), float(high + margin)


def share_outside(values: Iterable[Array], low: float, high: float) -> float:
    """Return the share of the finite values outside of ``low`` to ``high``; 0 without values."""
    found = _finite(values)
    return float(np.mean((found < low) | (found > high))) if len(found) else 0.0


def outside_caption(values: Iterable[Array], low: float, high: float) -> str:
    """Return how many of the values that are drawn are outside of the axes, '' if none is."""
    share = share_outside(values, low, high)
    return f' {100.0 * share:.1f} % of the others are outside of the axes.' if share else ''


def _finite(values: Iterable[Array]) -> Array:
    parts = [np.ravel(part) for part in values]
    found: Array = np.concatenate(parts) if parts else np.empty(0)
    return found[np.isfinite(found)]


def segments(curves: Iterable[Curve]) -> list[tuple[float, float]]:
    """
    Return the time intervals [s] in which ``curves`` change most, a few, in order.

    They do not overlap. Empty if the curves are not long or do not change.
    """
    parts = [(curve.x[1:], np.abs(np.diff(curve.y))) for curve in curves if len(curve.x) > 1]
    if not parts:
        return []
    time, change = (np.concatenate(columns) for columns in zip(*parts))
    start, end = float(time.min()), float(time.max())
    if end - start <= (MAX_SEGMENTS + 1) * SEGMENT_DURATION:
        return []
    cells = np.floor((time - start) / ACTIVITY_STEP).astype(int)
    activity = np.bincount(cells, np.nan_to_num(change))
    width = round(SEGMENT_DURATION / ACTIVITY_STEP)
    total = np.convolve(activity, np.ones(width), 'valid')
    found: list[tuple[float, float]] = []
    while len(found) < MAX_SEGMENTS and total.max(initial=0.0) > 0.0:
        first = int(np.argmax(total))
        begin = start + first * ACTIVITY_STEP
        found.append((begin, begin + SEGMENT_DURATION))
        total[max(first - width, 0):first + width] = 0.0
    return sorted(found)


def decimated(curve: Curve, limit: int = MAX_POINTS) -> Curve:
    """
    Return at most ``limit`` rows of ``curve``, without the loss of extremes.

    The curve is divided into intervals with equal numbers of values. Of each the smallest and the
    largest value, the largest standard deviation and the first NaN, which interrupts the line, are
    kept. Runs of NaN are shortened to one.
    """
    undefined = ~np.isfinite(curve.y)
    rows = np.flatnonzero(~(undefined & np.append(True, undefined[:-1])))
    if len(rows) <= limit:
        return curve.at_rows(rows)
    value, buckets = curve.y[rows], bucket_count(limit)
    criteria = [_in_rows(one, buckets) for one in (
        value, -value, curve.reach[rows], np.where(np.isfinite(value), math.nan, 1.0))]
    offsets = np.arange(buckets) * criteria[0].shape[1]
    kept = [(np.argmax(table, axis=1) + offsets)[np.isfinite(table.max(axis=1))]
            for table in criteria]
    kept.append(np.array([0, len(rows) - 1]))
    return curve.at_rows(rows[np.unique(np.concatenate(kept))])


def bucket_count(limit: int = MAX_POINTS) -> int:
    """Return the number of intervals of a curve with at most ``limit`` points."""
    return (limit - 2) // CRITERIA


def _in_rows(values: Array, buckets: int) -> Array:
    """Return ``values`` in rows of equal length, with -inf for NaN and at the end."""
    width = -(-len(values) // buckets)
    padded = np.full(buckets * width, -math.inf)
    padded[:len(values)] = np.where(np.isfinite(values), values, -math.inf)
    return padded.reshape(buckets, width)
