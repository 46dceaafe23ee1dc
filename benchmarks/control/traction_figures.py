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

"""Figures of starts and stops: slip over time, and forces of the wheels in friction circles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.control.traction import TractionHistory, TractionRun
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from smart_tire.analysis import drawing
from smart_tire.samples import WHEELS

COLORS = drawing.BLUE, drawing.VERMILLION, drawing.SKY, drawing.ORANGE
SHOWN_SLIP = 1.0           # -, end of the axes
MIN_ROLLING_SPEED = 0.1    # m/s, of wheels whose slip is shown
CIRCLE = np.linspace(0.0, 2.0 * np.pi, 361)
POINT_STEP = 5             # logged states between points in the friction circle


def save(figure: Figure, path: Path) -> Path:
    """Write ``figure`` as PNG and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)
    return path


def traction_figure(runs: Sequence[TractionRun]) -> Figure:
    """
    Return slip, forces and path of the last start and stop, one column for each run.

    The runs are those with and without traction control, of the same scenario.
    """
    columns = range(len(runs))
    figure, axes = drawing.new_figure(
        [[f'{row}_{i}' for i in columns] for row in ('slip', 'circle', 'path')],
        width=5.5 * len(runs), height=11.0)
    for i, result in enumerate(runs):
        part = _scored_part(result)
        name = 'with' if result.scenario.traction else 'without'
        axes[f'slip_{i}'].set_title(f'{result.scenario.title}\n{result.scenario.wheel_rate:g} Hz, '
                                    f'{name} traction control', fontsize='medium')
        _draw_slip(axes[f'slip_{i}'], part)
        _draw_circle(axes[f'circle_{i}'], part)
        _draw_path(axes[f'path_{i}'], part)
    drawing.finish(figure, axes)
    return figure


def _scored_part(result: TractionRun) -> TractionHistory:
    """Return the history of the last start and the stop after it."""
    begin = [begin for leg, begin in zip(result.scenario.legs, result.begins)
             if leg.kind == 'start'][-1]
    return result.history.between(begin, float(result.history.time[-1]))


def _draw_slip(axes: Axes, part: TractionHistory) -> None:
    time, (s_x, _) = part.time - part.time[0], part.slip
    turning = np.abs(part.rolling) > MIN_ROLLING_SPEED
    for i, wheel in enumerate(WHEELS):
        axes.plot(time, np.where(turning[:, i], s_x[:, i], np.nan), color=COLORS[i],
                  label=wheel.replace('_', ' '))
    critical = part.critical_slip.min(axis=1)
    for sign in (-1.0, 1.0):
        axes.plot(time, sign * critical, color=drawing.SHADE, linestyle='--',
                  label='critical, least load' if sign > 0.0 else None)
    axes.set(xlabel='time since the command [s]', ylabel='longitudinal slip [-]',
             ylim=(-SHOWN_SLIP, SHOWN_SLIP))


def _draw_circle(axes: Axes, part: TractionHistory) -> None:
    f_x, f_y = part.forces
    turning = np.abs(part.rolling) > MIN_ROLLING_SPEED  # at standstill forces are vibration
    limit = np.where(turning, np.maximum(part.friction * part.load, 1e-6), np.nan)
    axes.plot(np.cos(CIRCLE), np.sin(CIRCLE), color='black', linewidth=0.8)
    for i in range(len(WHEELS)):
        axes.plot((f_y / limit)[::POINT_STEP, i], (f_x / limit)[::POINT_STEP, i], '.',
                  color=COLORS[i], markersize=3.0)
    axes.set(xlabel=r'$F_y / (\mu F_z)$ [-]', ylabel=r'$F_x / (\mu F_z)$ [-]', aspect='equal')


def _draw_path(axes: Axes, part: TractionHistory) -> None:
    cos, sin = np.cos(part.yaw[0]), np.sin(part.yaw[0])
    x, y = part.x - part.x[0], part.y - part.y[0]
    axes.plot(cos * x + sin * y, cos * y - sin * x, color=drawing.BLUE)
    axes.set(xlabel='along the heading at the start [m]', ylabel='lateral [m]',
             ylim=(-0.6, 0.6))
