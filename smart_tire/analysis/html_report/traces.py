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
Traces of plotly figures, as plain dictionaries.

Colors are names such as ``@blue``, which the page replaces by those of the light or dark theme.
"""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import Any

import numpy as np

from smart_tire.analysis.curves import Curve
from smart_tire.analysis.html_report.decimation import decimated
from smart_tire.analysis.series import Floats
from smart_tire.analysis.summary import SIGNIFICANT_DIGITS

Spec = dict[str, Any]
SIGMAS = 2.0  # half width of bands, bars and ellipses, in standard deviations


def numbers(values: Iterable[float], digits: int = SIGNIFICANT_DIGITS) -> list[float | None]:
    """Return JSON numbers with ``digits`` significant digits; None for NaN."""
    return [float(f'{value:.{digits}g}') if math.isfinite(value) else None
            for value in np.asarray(values, np.float64).tolist()]


def times(values: Floats) -> list[float]:
    """Return times [s] with a resolution of one millisecond."""
    return [round(value, 3) for value in values.tolist()]


def estimate(curve: Curve, name: str, color: str, unit: str, *,
             legend: bool = True) -> list[Spec]:
    """Return the traces of an estimate: band of two standard deviations, and line."""
    drawn = decimated(curve)
    traces = [] if drawn.sigma is None else [band(drawn, color, name)]
    trace = line(drawn, name, f'@{color}', unit, legend=legend)
    if drawn.sigma is not None:
        trace['customdata'] = numbers(SIGMAS * drawn.sigma, 3)
        trace['hovertemplate'] = f'%{{y:.4g}} ± %{{customdata:.2g}}{unit}'
    return [*traces, trace]


def line(curve: Curve, name: str, color: str, unit: str, *, legend: bool = True,
         **style: Any) -> Spec:
    """Return the trace of a line, decimated."""
    curve = decimated(curve)
    return {'type': 'scatter', 'mode': 'lines', 'name': name, 'x': times(curve.time_s),
            'y': numbers(curve.value), 'legendgroup': name, 'showlegend': legend,
            'hovertemplate': f'%{{y:.4g}}{unit}',
            'line': {'color': color, 'width': 1.4, **style}}


def truth(curve: Curve, unit: str, *, legend: bool = True, **style: Any) -> Spec:
    """Return the dashed line of the ground truth."""
    return line(curve, 'truth', '@ink', unit, legend=legend, dash='dash', **style)


def band(curve: Curve, color: str, group: str) -> Spec:
    """Return the band of two standard deviations, one polygon per run without NaN."""
    x: list[float | None] = []
    y: list[float | None] = []
    sigma = np.zeros(0) if curve.sigma is None else curve.sigma
    low, high = curve.value - SIGMAS * sigma, curve.value + SIGMAS * sigma
    for rows in _runs(np.isfinite(high)):
        time = times(curve.time_s[rows])
        x += [*time, *time[::-1], None]
        y += [*numbers(high[rows]), *numbers(low[rows][::-1]), None]
    return {'type': 'scatter', 'mode': 'lines', 'fill': 'toself', 'x': x, 'y': y,
            'fillcolor': f'@{color}_band', 'line': {'width': 0}, 'hoverinfo': 'skip',
            'showlegend': False, 'legendgroup': group}


def _runs(known: Any) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(int), [0]])))
    return [slice(first, last) for first, last in zip(edges[::2].tolist(), edges[1::2].tolist())]


def points(curve: Curve, name: str, color: str, unit: str, *, legend: bool = True) -> Spec:
    """Return points with bars of two standard deviations; NaN values are left out."""
    rows = np.flatnonzero(np.isfinite(curve.value))
    shown = curve.at_rows(rows)
    trace = {'type': 'scatter', 'mode': 'markers', 'name': name, 'legendgroup': name,
             'x': times(shown.time_s), 'y': numbers(shown.value), 'showlegend': legend,
             'hovertemplate': f'%{{y:.4g}}{unit}', 'marker': {'color': f'@{color}', 'size': 5}}
    if shown.sigma is not None:
        size = numbers(SIGMAS * shown.sigma, 3)
        trace['error_y'] = {'type': 'data', 'array': size, 'thickness': 1, 'width': 0,
                            'color': f'@{color}'}
        trace['customdata'] = size
        trace['hovertemplate'] = f'%{{y:.4g}} ± %{{customdata:.2g}}{unit}'
    return trace
