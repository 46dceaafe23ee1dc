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
Figures by plotly: data and layout as plain dictionaries.

Panels are above each other with a common horizontal axis. Colors are names such as ``@blue``,
which the page replaces by those of the light or dark theme.
"""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import Any

import numpy as np

from smart_tire.analysis.figure import Curve, decimated, Figure, Mark, Panel, runs
from smart_tire.analysis.summary import SIGNIFICANT_DIGITS
from smart_tire.arrays import Array

PIXELS = 60        # px per inch of the height of a panel
PANEL_GAP = 38     # px between two panels, for the title of the lower one
TOP, BOTTOM = 62, 48  # px above the first panel, for title and legend, and below the last one
STEPS = {'mid': 'hvh', 'post': 'hv'}

Spec = dict[str, Any]


def height(figure: Figure) -> int:
    """Return the height [px] of a figure."""
    return _inner_height(figure) + TOP + BOTTOM


def _inner_height(figure: Figure) -> int:
    rows = len(figure.panels)
    return round(rows * PIXELS * figure.cell[1]) + (rows - 1) * PANEL_GAP


def plotly_spec(figure: Figure, time_range: tuple[float, float] | None = None) -> Spec:
    """Return data and layout of a figure; panels over time show ``time_range`` [s] at first."""
    inner, panels = _inner_height(figure), figure.panels
    size = PIXELS * figure.cell[1] / inner
    data: list[Spec] = []
    layout = _base_layout(figure)
    labels: set[str] = set()
    for row, panel in enumerate(panels):
        number = '' if row == 0 else str(row + 1)
        top = 1.0 - row * (size + PANEL_GAP / inner)
        last = row == len(panels) - 1
        layout[f'yaxis{number}'] = {
            **_axis(panel.y_label), 'domain': [max(top - size, 0.0), top],
            'anchor': f'x{number}',
            **({'range': list(panel.y_limits)} if panel.y_limits else {}),
            **({'scaleanchor': 'x', 'scaleratio': 1} if panel.equal else {})}
        layout[f'xaxis{number}'] = {
            **_axis(panel.x_label if last else ''), 'anchor': f'y{number}',
            'showticklabels': last, **({} if row == 0 else {'matches': 'x'})}
        layout['annotations'].append(_title(panel.title, top))
        data += [{**trace, 'xaxis': f'x{number}', 'yaxis': f'y{number}'}
                 for mark in panel.marks for trace in traces(mark, panel, labels)]
    if time_range is not None and panels[0].over_time:
        layout['xaxis']['range'] = list(time_range)
    return {'data': data, 'layout': layout}


def _base_layout(figure: Figure) -> Spec:
    return {
        'height': height(figure), 'dragmode': 'zoom',
        'hovermode': 'closest' if figure.panels[0].equal else 'x unified',
        'margin': {'l': 74, 'r': 16, 't': TOP, 'b': BOTTOM}, 'annotations': [],
        'paper_bgcolor': 'rgba(0,0,0,0)', 'plot_bgcolor': 'rgba(0,0,0,0)',
        'font': {'family': 'system-ui, sans-serif', 'size': 12, 'color': '@ink'},
        'hoverlabel': {'bgcolor': '@paper', 'bordercolor': '@shade', 'font': {'color': '@ink'}},
        'modebar': {'bgcolor': 'rgba(0,0,0,0)', 'color': '@shade', 'activecolor': '@ink'},
        'legend': {'orientation': 'h', 'x': 0.0, 'xanchor': 'left', 'yanchor': 'bottom',
                   'y': 1.0 + 22.0 / _inner_height(figure), 'bgcolor': 'rgba(0,0,0,0)'}}


def _axis(label: str) -> Spec:
    return {'title': {'text': label, 'standoff': 8}, 'gridcolor': '@grid', 'linecolor': '@shade',
            'zeroline': False, 'showline': True, 'ticks': 'outside', 'tickcolor': '@shade'}


def _title(text: str, top: float) -> Spec:
    return {'text': f'<b>{text}</b>', 'x': 0.0, 'y': top, 'xref': 'paper', 'yref': 'paper',
            'xanchor': 'left', 'yanchor': 'bottom', 'showarrow': False, 'font': {'size': 12}}


def traces(mark: Mark, panel: Panel, labels: set[str]) -> list[Spec]:
    """Return the traces of a mark; add its label to ``labels``, which are in the legend."""
    curve = decimated(mark.curve) if panel.over_time else mark.curve
    if mark.kind == 'points':
        curve = curve.at_rows(np.flatnonzero(np.isfinite(curve.y)))
    shown = bool(mark.label) and mark.label not in labels
    labels.add(mark.label)
    round_x = times if panel.over_time else numbers
    unit = panel.y_label.rpartition('[')[2].rstrip(']')
    unit = '' if unit == '-' else f' {unit}'
    trace: Spec = {
        'type': 'scatter', 'mode': 'markers' if mark.kind == 'points' else 'lines',
        'name': mark.label, 'x': round_x(curve.x), 'y': numbers(curve.y),
        'legendgroup': mark.label, 'showlegend': shown, 'opacity': mark.opacity,
        'hovertemplate': f'x %{{x:.3f}}, y %{{y:.3f}}{unit}' if panel.equal
        else f'%{{y:.4g}}{unit}'}
    color = f'@{mark.color}'
    if mark.kind == 'area':
        return [{**trace, **_filled(color), 'opacity': 1.0,
                 'line': {'color': color, 'width': 0.8}}]
    if mark.kind == 'points':
        trace['marker'] = {'color': color, 'size': 1.5 * mark.width}
    else:
        trace['line'] = {'color': color, 'width': mark.width,
                         **({'dash': 'dash'} if mark.dashed else {}),
                         **({'shape': STEPS[mark.steps]} if mark.steps else {})}
    if curve.sigma is None:
        return [trace]
    reach = numbers(curve.reach, 3)
    if mark.kind == 'points':
        trace['error_y'] = {'type': 'data', 'array': reach, 'thickness': 1, 'width': 0,
                            'color': color}
    trace.update(customdata=reach, hovertemplate=f'%{{y:.4g}} ± %{{customdata:.2g}}{unit}')
    return [trace] if mark.kind == 'points' else [band(curve, mark), trace]


def _filled(color: str) -> Spec:
    return {'fill': 'toself', 'fillcolor': f'{color}_band', 'hoverinfo': 'skip',
            'hovertemplate': None}


def band(curve: Curve, mark: Mark) -> Spec:
    """Return the band of two standard deviations, one polygon per run without NaN."""
    x: list[float | None] = []
    y: list[float | None] = []
    middle = np.where(np.isfinite(curve.y), 0.0, np.nan) if mark.around_zero else curve.y
    low, high = middle - curve.reach, middle + curve.reach
    for rows in runs(np.isfinite(high)):
        time = times(curve.x[rows])
        x += [*time, *time[::-1], None]
        y += [*numbers(high[rows]), *numbers(low[rows][::-1]), None]
    return {'type': 'scatter', 'mode': 'lines', 'x': x, 'y': y, 'line': {'width': 0},
            'showlegend': False, 'legendgroup': mark.label, **_filled(f'@{mark.color}')}


def numbers(values: Iterable[float], digits: int = SIGNIFICANT_DIGITS) -> list[float | None]:
    """Return JSON numbers with ``digits`` significant digits; None for NaN."""
    return [float(f'{value:.{digits}g}') if math.isfinite(value) else None
            for value in np.asarray(values, np.float64).tolist()]


def times(values: Array) -> list[float]:
    """Return times [s] with a resolution of one millisecond."""
    return [round(value, 3) for value in values.tolist()]
