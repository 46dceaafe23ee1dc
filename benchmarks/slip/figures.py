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

"""Figures of one run: slip, path and pose errors by method."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.motion import Estimate, side_means, Truth
from benchmarks.slip.methods import LIVE, LIVE_TORQUE, METHODS, SMOOTHED, SMOOTHED_TORQUE
from matplotlib.figure import Figure
import numpy as np
from smart_tire.analysis import drawing
from smart_tire.analysis.metrics import aligned, rotated
from smart_tire.arrays import Array
from smart_tire.recording import seconds

SHOWN_PERCENT = 1.0, 99.0  # of the true slips inside the axis limits; excludes spikes
SLIP_MARGIN = 0.1          # -
COLORS = (drawing.BLUE, drawing.VERMILLION, drawing.BLUE, drawing.VERMILLION, drawing.SHADE,
          drawing.ORANGE)  # of METHODS
MAX_SHOWN_ERROR = 5.0      # of a method, over that of the estimator under test


def run_figure(title: str, estimates: Mapping[str, Estimate], truth: Truth) -> Figure:
    """Return slips with two-sigma bands over time, the paths, and position and heading errors."""
    figure, axes = drawing.new_figure(
        [['left', 'path'], ['left', 'path'], ['right', 'position'], ['right', 'heading']],
        width=15.0, height=9.0)
    colors, origin = dict(zip(METHODS, COLORS)), int(truth.stamp_ns[0])
    shown = (LIVE_TORQUE, SMOOTHED_TORQUE) if LIVE_TORQUE in estimates else (LIVE, SMOOTHED)
    for side, name in enumerate(('left', 'right')):
        ax, true = axes[name], side_means(truth.ratio)[:, side]
        for method in shown:
            slips = estimates[method].slips
            time = seconds(slips.stamp_ns, origin)
            value, sigma = (side_means(one)[:, side] for one in (slips.ratio, slips.sigma))
            ax.fill_between(time, value - 2.0 * sigma, value + 2.0 * sigma, alpha=0.18,
                            color=colors[method], linewidth=0.0)
            ax.plot(time, value, color=colors[method], label=f'{METHODS[method]} ± 2σ')
        ax.plot(seconds(truth.stamp_ns, origin), true, **drawing.TRUTH, label='truth')
        low, high = np.nanpercentile(true, SHOWN_PERCENT)
        ax.set(xlabel='time [s]', ylabel=f'slip of the {name} side [-]',
               ylim=(low - SLIP_MARGIN, high + SLIP_MARGIN))
        ax.legend(frameon=False)
    tops = np.zeros(2)
    for method, estimate in estimates.items():
        estimated, true, stamps = aligned(truth.poses, estimate.poses)
        color, label = colors[method], METHODS[method]
        axes['path'].plot(*_in_frame(estimated, true, truth.poses.pose[0]).T, color=color,
                          label=label)
        error = np.abs(estimated - true)
        sizes = np.hypot(error[:, 0], error[:, 1]), np.degrees(error[:, 2])
        for ax, size in zip((axes['position'], axes['heading']), sizes):
            ax.plot(seconds(stamps, origin), size, color=color)
        if method in shown:
            tops = np.maximum(tops, [float(size.max()) for size in sizes])
    axes['path'].plot(*truth.poses.pose[:, :2].T, **drawing.TRUTH, label='truth')
    axes['path'].set(title=title, xlabel='x [m]', ylabel='y [m]', aspect='equal')
    axes['path'].legend(frameon=False)
    for name, unit, top in zip(('position', 'heading'), ('m', 'deg'), tops):
        axes[name].set(xlabel='time [s]', ylabel=f'{name} error [{unit}]',
                       ylim=(0.0, MAX_SHOWN_ERROR * max(top, 1e-3)))
    return figure


def _in_frame(estimated: Array, true: Array, first: Array) -> Array:
    """Return the positions of ``estimated`` in the frame where ``true`` begins at ``first``."""
    return rotated(estimated[:, :2] - true[0, :2], first[2] - true[0, 2]) + first[:2]
