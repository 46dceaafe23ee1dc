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

"""Layout of plotly figures: panels above each other with a common horizontal axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from smart_tire.analysis.html_report.traces import Spec

PANEL_HEIGHT = 165  # px
PANEL_GAP = 38      # px between two panels, for the title of the lower one
TOP, BOTTOM = 62, 48  # px above the first panel, for title and legend, and below the last one
TIME_LABEL = 'time [s]'


@dataclass
class Panel:
    """One pair of axes; ``limits`` of y are shown at first."""

    title: str
    y_label: str
    traces: list[Spec] = field(default_factory=list)
    limits: tuple[float, float] | None = None


@dataclass
class Figure:
    """One figure: panels above each other, their traces and a caption."""

    name: str
    alt: str      # what the figure shows, for screen readers
    caption: str
    panels: list[Panel]
    x_label: str = TIME_LABEL
    panel_height: int = PANEL_HEIGHT
    layout: Spec = field(default_factory=dict)  # changes of the layout below

    @property
    def inner_height(self) -> int:
        """Return the height [px] from the first to the last panel."""
        rows = len(self.panels)
        return rows * self.panel_height + (rows - 1) * PANEL_GAP

    @property
    def height(self) -> int:
        """Return the height [px] of the figure."""
        return self.inner_height + TOP + BOTTOM

    @property
    def over_time(self) -> bool:
        """Return whether the horizontal axis is the time, common to all figures."""
        return self.x_label == TIME_LABEL


def plotly_spec(figure: Figure) -> Spec:
    """Return data and layout of a figure; its panels share the horizontal axis."""
    rows, inner = len(figure.panels), figure.inner_height
    data: list[Spec] = []
    layout = _base_layout(figure)
    for row, panel in enumerate(figure.panels):
        number = '' if row == 0 else str(row + 1)
        top = 1.0 - row * (figure.panel_height + PANEL_GAP) / inner
        bottom = max(top - figure.panel_height / inner, 0.0)
        last = row == rows - 1
        layout[f'yaxis{number}'] = {
            **_axis(panel.y_label), 'domain': [bottom, top], 'anchor': f'x{number}',
            **({'range': list(panel.limits)} if panel.limits else {})}
        layout[f'xaxis{number}'] = {
            **_axis(figure.x_label if last else ''), 'anchor': f'y{number}',
            'showticklabels': last, **({} if row == 0 else {'matches': 'x'})}
        layout['annotations'].append(_title(panel.title, top))
        data += [{**trace, 'xaxis': f'x{number}', 'yaxis': f'y{number}'}
                 for trace in panel.traces]
    return {'data': data, 'layout': _merged(layout, figure.layout)}


def _base_layout(figure: Figure) -> Spec:
    return {
        'height': figure.height, 'hovermode': 'x unified', 'dragmode': 'zoom',
        'margin': {'l': 74, 'r': 16, 't': TOP, 'b': BOTTOM}, 'annotations': [],
        'paper_bgcolor': 'rgba(0,0,0,0)', 'plot_bgcolor': 'rgba(0,0,0,0)',
        'font': {'family': 'system-ui, sans-serif', 'size': 12, 'color': '@ink'},
        'hoverlabel': {'bgcolor': '@paper', 'bordercolor': '@shade', 'font': {'color': '@ink'}},
        'modebar': {'bgcolor': 'rgba(0,0,0,0)', 'color': '@shade', 'activecolor': '@ink'},
        'legend': {'orientation': 'h', 'x': 0.0, 'xanchor': 'left', 'yanchor': 'bottom',
                   'y': 1.0 + 22.0 / figure.inner_height, 'bgcolor': 'rgba(0,0,0,0)'}}


def _axis(label: str) -> Spec:
    return {'title': {'text': label, 'standoff': 8}, 'gridcolor': '@grid', 'linecolor': '@shade',
            'zeroline': False, 'showline': True, 'ticks': 'outside', 'tickcolor': '@shade'}


def _title(text: str, top: float) -> Spec:
    return {'text': f'<b>{text}</b>', 'x': 0.0, 'y': top, 'xref': 'paper', 'yref': 'paper',
            'xanchor': 'left', 'yanchor': 'bottom', 'showarrow': False, 'font': {'size': 12}}


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> Spec:
    return {**base, **{key: _merged(base[key], value)
                       if isinstance(value, Mapping) and isinstance(base.get(key), Mapping)
                       else value for key, value in changes.items()}}
