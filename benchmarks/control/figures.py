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

"""Figures of path tracking: paths, error, slip and friction used, side by side."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.control.scenarios import (
    CHANGE, FIXED, KINEMATICS, OURS, SAND_FIELDS, SHORT, title, TrackingCase)
from benchmarks.control.scoring import dense_points
from benchmarks.control.tracking import Trace
from benchmarks.grounds import SAND
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from smart_tire.analysis import drawing
from smart_tire.samples import WHEELS

SAND_COLOR = '#f3e3c3'
WHEEL_COLORS = drawing.BLUE, drawing.VERMILLION, drawing.SKY, drawing.ORANGE
CAPTION = (
    'Top: wanted path, path of the pose that is followed, and true path of base_link; sand is '
    'shaded. Below, over time: distance of the true position from the wanted '
    'path, magnitude of the slip of each wheel, and its tire force over the friction available '
    '(1: the whole patch slides). The same path follower and gains in all columns.')


def tracking_figure(case: TrackingCase, traces: Mapping[str, Trace]) -> Figure:
    """Return the figure of the runs of one case, a column for each kinematics."""
    columns, run = [SHORT, FIXED, OURS], title(case.name)
    figure, axes = drawing.new_figure(
        [[f'{row}_{name}' for name in columns] for row in
         ('path', 'path', 'error', 'slip', 'used')], width=13.0, height=11.0)
    for name in columns:
        trace = traces[name]
        _draw_paths(axes[f'path_{name}'], case, trace)
        axes[f'path_{name}'].set_title(f'{run}:\n{KINEMATICS[name]}', fontsize='medium')
        axes[f'error_{name}'].plot(trace.time, 1e3 * trace.error, color=drawing.BLUE)
        axes[f'error_{name}'].set(ylabel='tracking error [mm]', ylim=(0.0, _top(traces)))
        for i, (wheel, color) in enumerate(zip(WHEELS, WHEEL_COLORS)):
            axes[f'slip_{name}'].plot(trace.time, trace.slip[:, i], color=color, linewidth=1.0,
                                      label=wheel.replace('_', ' '))
            axes[f'used_{name}'].plot(trace.time, trace.used[:, i], color=color, linewidth=1.0)
        axes[f'slip_{name}'].set(ylabel='slip [-]', ylim=(0.0, 1.0))
        axes[f'used_{name}'].set(ylabel='friction used [-]', ylim=(0.0, 1.05), xlabel='time [s]')
    for name in columns[1:]:
        for row in ('path', 'error', 'slip', 'used'):
            axes[f'{row}_{name}'].set_ylabel('')
    axes[f'slip_{columns[0]}'].legend(frameon=False, fontsize='small', ncols=2)
    drawing.legend_above(figure, axes[f'path_{columns[0]}'])
    drawing.add_caption(figure, CAPTION)
    return figure


def _draw_paths(ax: Axes, case: TrackingCase, trace: Trace) -> None:
    wanted = dense_points(case.wanted())
    if case.ground == CHANGE:
        ax.axvspan(*SAND_FIELDS[case.path], color=SAND_COLOR, zorder=0)
    elif case.ground == SAND:
        ax.set_facecolor(SAND_COLOR)
    ax.plot(*wanted.T, color=drawing.SHADE, linewidth=3.0, alpha=0.6, label='wanted')
    ax.plot(*trace.followed.T, color=drawing.BLUE, linewidth=1.2, label='driven, as localized')
    ax.plot(*trace.position.T, **drawing.TRUTH, label='true')
    low, high = wanted.min(axis=0) - 0.3, wanted.max(axis=0) + 0.3
    ax.set(xlabel='x [m]', ylabel='y [m]', xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    ax.set_aspect('equal', adjustable='box')


def _top(traces: Mapping[str, Trace]) -> float:
    return 1.1e3 * max(float(trace.error.max()) for trace in traces.values())
