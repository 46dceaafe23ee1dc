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

"""Figure of fused mu and C_x over time, without and with torque."""

from __future__ import annotations

from benchmarks.friction.forces import ForceResult, NO_TORQUE, TORQUE, VARIANTS, WheelPart
from benchmarks.friction.records import FUSED
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from smart_tire.analysis import drawing
from smart_tire.analysis.series import Floats, seconds, Stamps

COLORS = {NO_TORQUE: drawing.ORANGE, TORQUE: drawing.BLUE}
QUANTITIES = {FUSED: ('μ [-]', 2.0), 'stiffness': ('$C_x$ [N]', 2.0)}  # label, limit over truth


def force_figure(title: str, result: ForceResult) -> Figure:
    """Return mu and C_x of each film wheel, with bands of two sigma and ground truth."""
    wheels = list(result.variants[TORQUE].wheels)
    panels = [[f'{wheel} {quantity}' for wheel in wheels] for quantity in QUANTITIES]
    figure, axes = drawing.new_figure(panels, width=1.0 + 6.0 * len(wheels), height=6.5,
                                      share_x=True)
    for wheel in wheels:
        for quantity, (label, headroom) in QUANTITIES.items():
            ax = axes[f'{wheel} {quantity}']
            for name, variant in result.variants.items():
                _draw(ax, variant.wheels[wheel], quantity, name)
            rows = result.variants[TORQUE].wheels[wheel].rows
            true = rows.true[quantity]
            ax.plot(_time(rows.stamp_ns), true, **drawing.TRUTH, label='truth')
            ax.set(ylabel=label, ylim=(0.0, headroom * float(np.nanmax(true, initial=0.1))))
        axes[f'{wheel} {FUSED}'].set(title=f'{title}: {wheel.replace("_", " ")}')
        axes[f'{wheel} stiffness'].set(xlabel='time after the first crossing [s]')
    drawing.finish(figure, axes)
    return figure


def _draw(ax: Axes, part: WheelPart, quantity: str, variant: str) -> None:
    """Draw one quantity; crossings that count have a marker."""
    rows, color = part.rows, COLORS[variant]
    time, value, sigma = _time(rows.stamp_ns), rows.value[quantity], rows.sigma[quantity]
    ax.fill_between(time, value - 2.0 * sigma, value + 2.0 * sigma, color=color, alpha=0.16,
                    linewidth=0.0)
    ax.plot(time, value, color=color, linewidth=0.9, label=f'{VARIANTS[variant]} ± 2σ')
    ax.plot(time[part.counted], value[part.counted], '.', color=color, markersize=4)


def _time(stamps: Stamps) -> Floats:
    return seconds(stamps, int(stamps[0]) if len(stamps) else 0)
