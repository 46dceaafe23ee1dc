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

"""Figure of the slip of both sides over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.analysis.curves import (
    Curve, interrupted, limits, MAX_SLIP_SIGMA, observable, share_outside)
from smart_tire.analysis.labels import LabeledEstimates, panel_title
from smart_tire.analysis.metrics import Intervals, SIDES
from smart_tire.analysis.series import seconds, Series
from smart_tire.analysis.zoomed import Draw, overview_figure, Segments
from smart_tire.samples import NS_PER_S

MIN_SLIP_MARGIN = 0.1  # -
MAX_SHOWN_SLIP = 1.05  # -


def slip_figure(labeled: LabeledEstimates, truth: Series, origin_ns: int,
                intervals: Intervals | None = None, segments: Segments = ()) -> Figure:
    """
    Return the slip of both sides over time, one panel per label and interval.

    Without intervals, ``segments`` [s] are also drawn in detail.
    """
    curves = {label: slip_curves(series, truth, origin_ns) for label, series in labeled.items()}
    if intervals:
        figure, axes = _interval_panels(labeled, curves, intervals, origin_ns)
    else:
        draw: dict[str, Draw] = {panel_title(labeled, label, ''): partial(_draw, own)
                                 for label, own in curves.items()}
        figure, axes = overview_figure(draw, segments, panel_height=2.8)
    every = [_shown(curve, intervals, origin_ns) for own in curves.values() for curve in own]
    low, high = slip_limits(every)
    next(iter(axes.values())).set_ylim(low, high)
    drawing.finish(figure, axes)
    drawing.add_caption(figure, _caption(every, low, high))
    return figure


def _shown(curve: drawing.SlipCurve, intervals: Intervals | None,
           origin_ns: int) -> drawing.SlipCurve:
    """Return the part of the curve within ``intervals``, all if there are none."""
    if not intervals:
        return curve
    edges = [[(edge - origin_ns) / NS_PER_S for edge in interval]
             for several in intervals.values() for interval in several]
    estimate, truth = (part.at_rows(np.flatnonzero(np.any(
        [(part.time_s >= begin) & (part.time_s <= end) for begin, end in edges], axis=0)))
        for part in (curve.estimate, curve.truth))
    return replace(curve, estimate=estimate, truth=truth)


def _draw(curves: Sequence[drawing.SlipCurve], ax: Axes, brief: bool) -> None:
    drawing.draw_slip(ax, curves)


def _interval_panels(labeled: LabeledEstimates, curves: dict[str, list[drawing.SlipCurve]],
                     intervals: Intervals, origin_ns: int) -> tuple[Figure, dict[str, Axes]]:
    panels = {panel_title(labeled, label, name): (own, name)
              for name in intervals for label, own in curves.items()}
    names = list(panels)
    rows = [names[i:i + 2] for i in range(0, len(names), 2)]
    rows[-1] += ['.'] * (len(rows[0]) - len(rows[-1]))
    figure, axes = drawing.new_figure(rows, height=1.6 + 2.8 * len(rows), share_y=True)
    for title, (own, name) in panels.items():
        drawing.draw_slip(axes[title], own)
        edges = [(edge - origin_ns) / NS_PER_S
                 for interval in intervals[name] for edge in interval]
        axes[title].set(title=title, xlim=(min(edges), max(edges)))
    return figure, axes


def slip_curves(estimates: Series, truth: Series, origin_ns: int) -> list[drawing.SlipCurve]:
    """Return the slip of each side, the mean of its measured wheels; NaN where unknown."""
    own, true = estimates.slips(), truth.slips()
    found = []
    for side, both in SIDES.items():
        wheels = own.measured(both)
        curve, hidden = observable(interrupted(Curve(
            seconds(own.stamp_ns, origin_ns), own.ratio[:, wheels].mean(axis=1),
            own.sigma[:, wheels].mean(axis=1))))
        reference = interrupted(Curve(seconds(true.stamp_ns, origin_ns),
                                      true.ratio[:, wheels].mean(axis=1)))
        found.append(drawing.SlipCurve(side, curve, reference, hidden))
    return found


def slip_limits(curves: Sequence[drawing.SlipCurve]) -> tuple[float, float]:
    """Return the limits of the slip axis, which single spikes do not change."""
    low, high = limits([part for curve in curves for part in (
        curve.estimate.value, curve.truth.value)], MIN_SLIP_MARGIN)
    return max(-MAX_SHOWN_SLIP, low), min(MAX_SHOWN_SLIP, high)


def _caption(curves: Sequence[drawing.SlipCurve], low: float, high: float) -> str:
    hidden = float(np.mean([curve.hidden_share for curve in curves]))
    outside = share_outside([curve.estimate.value for curve in curves], low, high)
    truth = ' Dashed: ground truth.' if any(len(one.truth.time_s) for one in curves) else ''
    return (f'Mean slip ratio of the two wheels of a side. Bands: {drawing.TWO_SIGMA}{truth} No '
            f'line at standstill, where slip is undefined, and where σ exceeds {MAX_SLIP_SIGMA}, '
            f'where it is not observable ({100.0 * hidden:.1f} % of the values). '
            f'{100.0 * outside:.1f} % of the others are outside of the axes.')
