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

"""Interactive figures of friction: coefficient and adhesion ratio of each instrumented wheel."""

from __future__ import annotations

import math

from smart_tire.analysis.curves import Curve, interrupted
from smart_tire.analysis.friction_figures import (
    friction_curve, MAX_CROSSING_GAP, MAX_FRICTION)
from smart_tire.analysis.friction_metrics import column, of_wheel, stamps_of
from smart_tire.analysis.html_report.layout import Figure, Panel
from smart_tire.analysis.html_report.motion_figures import TRUTH
from smart_tire.analysis.html_report.traces import band, line, points, truth
from smart_tire.analysis.series import seconds, Series
from smart_tire.samples import WHEELS

BARS = 'Bars and bands: ± 2σ, where σ is the standard deviation that the estimator reports.'


def friction_figure(estimates: Series, truths: Series, origin_ns: int) -> Figure | None:
    """Return the friction coefficient of each instrumented wheel; None without crossings."""
    panels: list[Panel] = []
    for wheel in _wheels(estimates):
        found, first = friction_curve(wheel, estimates, truths, origin_ns), not panels
        traces = [band(found.fused, 'blue', 'fused ± 2σ'),
                  points(found.single, 'single crossing ± 2σ', 'orange', '', legend=first),
                  line(found.fused, 'fused ± 2σ', '@blue', '', legend=first)]
        if len(found.truth.time_s):
            traces.append(truth(found.truth, '', legend=first, shape='hvh'))
        panels.append(Panel(wheel.replace('_', ' '), 'µ<sub>x</sub> [-]', traces,
                            (0.0, MAX_FRICTION)))
    return Figure(
        'friction', 'Friction coefficient per patch crossing of each instrumented wheel',
        'Sliding friction coefficient. Points: from a single patch crossing (uninformative ones, '
        'with a relative σ above 60 %, are not drawn); line: fused with the crossings before. '
        f'{BARS} {TRUTH if truths.crossings else ""}', panels) if panels else None


def adhesion_figure(estimates: Series, truths: Series, origin_ns: int) -> Figure | None:
    """Return the adhesion ratio of each instrumented wheel; None without crossings."""
    panels: list[Panel] = []
    for wheel in _wheels(estimates):
        own, true = of_wheel(estimates.crossings, wheel), of_wheel(truths.crossings, wheel)
        first = not panels
        sigma = column(own, 'adhesion_ratio', sigmas=True)
        sigma[sigma == math.inf] = math.nan
        traces = [points(Curve(seconds(stamps_of(own), origin_ns), column(own, 'adhesion_ratio'),
                               sigma), 'single crossing ± 2σ', 'orange', '', legend=first)]
        if true:
            curve = interrupted(Curve(seconds(stamps_of(true), origin_ns),
                                      column(true, 'adhesion_ratio')), MAX_CROSSING_GAP)
            traces.append(truth(curve, '', legend=first))
        panels.append(Panel(wheel.replace('_', ' '), 'adhesion ratio [-]', traces, (0.0, 1.1)))
    return Figure(
        'adhesion', 'Adhesion ratio per patch crossing of each instrumented wheel',
        'Share of the contact patch in which the tread adheres to the ground: 1 without sliding. '
        f'{BARS} {TRUTH if truths.crossings else ""}', panels) if panels else None


def _wheels(estimates: Series) -> list[str]:
    return [wheel for wheel in WHEELS if any(one.wheel == wheel for one in estimates.crossings)]
