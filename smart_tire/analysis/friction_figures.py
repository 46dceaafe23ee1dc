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

"""Figure of the friction coefficient of the instrumented wheels over time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.analysis.curves import Curve, interrupted, share_outside
from smart_tire.analysis.friction_metrics import (
    column, is_informative, MAX_RELATIVE_SIGMA, of_wheel, stamps_of)
from smart_tire.analysis.labels import LabeledEstimates, panel_title
from smart_tire.analysis.series import seconds, Series
from smart_tire.analysis.zoomed import Draw, overview_figure, Segments
from smart_tire.samples import WHEELS

MAX_FRICTION = 1.2      # upper end of the friction axis
MAX_CROSSING_GAP = 5.0  # s between two crossings, over which no line is drawn


def friction_figure(labeled: LabeledEstimates, truth: Series, origin_ns: int,
                    segments: Segments = ()) -> Figure:
    """Return friction per crossing, one panel per instrumented wheel and label, and segments."""
    wheels = [wheel for wheel in WHEELS
              if any(p.wheel == wheel for series in labeled.values() for p in series.crossings)]
    curves = {panel_title(labeled, label, wheel.replace('_', ' ')):
              friction_curve(wheel, series, truth, origin_ns)
              for wheel in wheels for label, series in labeled.items()}
    draw: dict[str, Draw] = {title: partial(_draw, curve) for title, curve in curves.items()}
    figure, axes = overview_figure(draw, segments, panel_height=2.6)
    next(iter(axes.values())).set_ylim(0.0, MAX_FRICTION)
    drawing.finish(figure, axes)
    drawing.add_caption(figure, _caption([*curves.values()]))
    return figure


def _draw(curve: drawing.FrictionCurve, ax: Axes, brief: bool) -> None:
    drawing.draw_friction(ax, curve, bars=not brief)


def friction_curve(wheel: str, estimates: Series, truth: Series,
                   origin_ns: int) -> drawing.FrictionCurve:
    """Return the friction of ``wheel``; uninformative single estimates are NaN."""
    own, true = of_wheel(estimates.crossings, wheel), of_wheel(truth.crossings, wheel)
    single = column(own, 'friction_coefficient_single')
    sigma = column(own, 'friction_coefficient_single', sigmas=True)
    single[~is_informative(single, sigma)] = np.nan
    time = seconds(stamps_of(own), origin_ns)
    fused = Curve(time, column(own, 'friction_coefficient'),
                  column(own, 'friction_coefficient', sigmas=True))
    reference = Curve(seconds(stamps_of(true), origin_ns), column(true, 'friction_coefficient'))
    return drawing.FrictionCurve(
        wheel, Curve(time, single, sigma), interrupted(fused, MAX_CROSSING_GAP),
        interrupted(reference, MAX_CROSSING_GAP))


def _caption(curves: Sequence[drawing.FrictionCurve]) -> str:
    single = np.concatenate([curve.single.value for curve in curves])
    outside = share_outside([single], 0.0, MAX_FRICTION)
    truth = ' Dashed: ground truth.' if any(len(one.truth.time_s) for one in curves) else ''
    return ('Sliding friction coefficient. Points: single patch crossings; line: fused with the '
            f'crossings before. Bands and bars: {drawing.TWO_SIGMA}{truth} Not drawn: '
            f'{np.isnan(single).sum()} of {len(single)} single crossings that are uninformative '
            f'(σ above {100.0 * MAX_RELATIVE_SIGMA:.0f} % of the value). {100.0 * outside:.1f} % '
            'of the others are outside of the axes.')
