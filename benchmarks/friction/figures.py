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

"""Figures of the friction benchmark."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.friction.crossings import FUSED, Rows, SINGLE
from benchmarks.scoring import Figures
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from smart_tire.analysis import drawing
from smart_tire.recording import seconds

COLORS = drawing.ORANGE, drawing.BLUE  # without and with torque
PANELS = {FUSED: 'friction coefficient [-]', 'stiffness': '$C_x$ [N]'}
MAX_SHOWN = 2.0      # of the true value
GAUSSIAN_90 = 1.645  # sigmas; 90 % quantile of absolute Gaussian errors


def friction_figure(title: str, variants: Mapping[str, Mapping[str, Rows]]) -> Figure:
    """Return mu and C_x of each film wheel over time, by variant, with two-sigma bands."""
    wheels = list(next(iter(variants.values())))
    figure, axes = drawing.new_figure(
        [[f'{wheel} {name}' for wheel in wheels] for name in PANELS],
        width=1.0 + 6.0 * len(wheels), height=6.5, share_x=True)
    for wheel in wheels:
        for name, label in PANELS.items():
            ax = axes[f'{wheel} {name}']
            for color, (variant, rows) in zip(COLORS, variants.items()):
                _draw(ax, rows[wheel], name, color, variant)
            rows = variants[variant]
            time = seconds(rows[wheel].stamp_ns, int(rows[wheel].stamp_ns[0]))
            ax.plot(time, rows[wheel].true[name], **drawing.TRUTH, label='truth')
            ax.set(xlabel='time after the first crossing [s]', ylabel=label,
                   ylim=(0.0, MAX_SHOWN * float(rows[wheel].true[name].max())))
        axes[f'{wheel} {FUSED}'].set(title=f'{title}: {wheel.replace("_", " ")}')
    drawing.finish(figure, axes)
    return figure


def _draw(ax: Axes, rows: Rows, name: str, color: str, variant: str) -> None:
    time = seconds(rows.stamp_ns, int(rows.stamp_ns[0]))
    value, sigma = rows.value[name], rows.sigma[name]
    ax.fill_between(time, value - 2.0 * sigma, value + 2.0 * sigma, color=color, alpha=0.16,
                    linewidth=0.0)
    ax.plot(time, value, color=color, linewidth=0.9, label=f'{variant} ± 2σ')
    if name == FUSED:
        ax.plot(time, rows.value[SINGLE], '.', color=color, markersize=3)


def bound_figure(cases: Mapping[str, Figures]) -> Figure:
    """Return the errors of synthesized crossings over the Cramer-Rao bound, by method."""
    figure, axes = drawing.new_figure([['all']], width=8.0, height=6.0)
    ax = axes['all']
    for name, marker, color in (('printed', 'x', drawing.VERMILLION), ('exact', 'x', drawing.SKY),
                                ('single', 'o', drawing.BLUE)):
        own = [one for one in cases.values() if f'{name}.q90' in one]
        ax.plot([100.0 * one['bound'] for one in own],
                [100.0 * one[f'{name}.q90'] for one in own], marker, color=color, linestyle='none',
                label='waveform' if name == 'single' else f'two peaks, {name} map')
    bounds = [one['bound'] for one in cases.values()]
    ends = np.array([0.7 * min(bounds), 1.4 * max(bounds)])
    ax.plot(100.0 * ends, 100.0 * GAUSSIAN_90 * ends, color=drawing.INK,
            label='optimum: Gaussian errors at the bound')
    ax.set(xscale='log', yscale='log', xlabel='Cramér-Rao bound of one crossing [% of μ]',
           ylabel='90 % quantile of absolute errors [% of μ]', ylim=(70.0 * ends[0], 1000.0))
    ax.legend(frameon=False, loc='lower right')
    return figure
