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

"""Figures of one run: slip, ICR, innovations, path and pose errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from pathlib import Path
from typing import Any

from benchmarks.slip.comparison import (
    LIVE, LIVE_TORQUE, METHODS, OWN, SMOOTHED, SMOOTHED_TORQUE, WITH_TORQUE)
from benchmarks.slip.series import EstimateSeries, side_means, Truth
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from smart_tire.analysis import drawing
from smart_tire.analysis.series import at, Floats, PoseSeries, seconds, Stamps

Estimates = Mapping[str, EstimateSeries]
AlignedPoses = tuple[Floats, Floats, Stamps]  # estimated, true poses in the same frame, timestamps

GREEN, PURPLE = '#009e73', '#cc79a7'  # remaining colors of the palette of drawing
COLORS = {LIVE: drawing.BLUE, SMOOTHED: drawing.VERMILLION, 'wheels': drawing.SHADE,
          'wheels_fitted': drawing.ORANGE, 'gyro': GREEN, 'gyro_fitted': drawing.SKY,
          'plain_ekf': PURPLE, LIVE_TORQUE: drawing.BLUE, SMOOTHED_TORQUE: drawing.VERMILLION}
SHOWN_PERCENT = 98.0   # of the true values inside the axis limits; excludes spikes
RANGE_MARGIN = 0.35    # of the range of the true values, above and below
MIN_SLIP_MARGIN = 0.08  # -
MIN_ICR_MARGIN = 0.05  # m
MIN_NIS_LIMIT = 2.0    # upper end of the NIS axis
MIN_ERROR_LIMIT = 1e-3  # m, degrees: upper end of the error axes
MAX_SHOWN_ERROR = 5.0  # of a method, relative to the estimator under test


def save(figure: Figure, path: Path) -> Path:
    """Write ``figure`` as PNG and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)
    return path


def slip_figure(title: str, estimates: Estimates, truth: Truth) -> Figure:
    """Return slips with two-sigma bands, innovations and, in turns, S over time."""
    turns = bool(np.isfinite(truth.icr.position).any())
    rows = ['left', 'right', *['icr'] * turns, 'nis']
    figure, axes = drawing.new_figure([[row] for row in rows], width=11.0,
                                      height=2.5 * len(rows), share_x=True)
    origin = int(truth.stamp_ns[0])
    for side, name in enumerate(('left', 'right')):
        _draw_slip(axes[name], side, estimates, truth, origin)
        axes[name].set(ylabel=f'slip of the {name} side [-]')
    if turns:
        _draw_icr(axes['icr'], estimates, truth, origin)
    _draw_innovations(axes['nis'], estimates[_shown(estimates)[0]], origin)
    axes['left'].set(title=title)
    drawing.finish(figure, axes)
    return figure


def _shown(estimates: Estimates) -> tuple[str, str]:
    """Return the live and the smoothed estimate, with torque if it was measured."""
    return (LIVE_TORQUE, SMOOTHED_TORQUE) if LIVE_TORQUE in estimates else (LIVE, SMOOTHED)


def _draw_slip(ax: Axes, side: int, estimates: Estimates, truth: Truth, origin: int) -> None:
    for name in _shown(estimates):
        slips = estimates[name].slips
        time = seconds(slips.stamp_ns, origin)
        value, sigma = side_means(slips.ratio)[:, side], side_means(slips.sigma)[:, side]
        _draw_band(ax, time, value, sigma, COLORS[name], METHODS[name])
    true = side_means(truth.ratio)[:, side]
    ax.plot(seconds(truth.stamp_ns, origin), true, **drawing.TRUTH, label='truth')
    ax.set_ylim(*_limits(true, MIN_SLIP_MARGIN))


def _draw_band(ax: Axes, time: Floats, value: Floats, sigma: Floats, color: str,
               label: str) -> None:
    ax.fill_between(time, value - 2.0 * sigma, value + 2.0 * sigma, color=color, alpha=0.18,
                    linewidth=0.0)
    ax.plot(time, value, color=color, linewidth=1.1, label=f'{label} ± 2σ')


def _draw_icr(ax: Axes, estimates: Estimates, truth: Truth, origin: int) -> None:
    for name in _shown(estimates):
        centers = estimates[name].icr
        time, position = _with_gaps(seconds(centers.stamp_ns, origin), centers.position[:, 0])
        ax.plot(time, position, color=COLORS[name], linewidth=1.1)
    true = truth.icr.position[:, 0]
    ax.plot(seconds(truth.stamp_ns, origin), true, **drawing.TRUTH)
    ax.set_ylim(*_limits(true, MIN_ICR_MARGIN))
    ax.set(ylabel='S, x of the ICR [m]')


def _draw_innovations(ax: Axes, estimate: EstimateSeries, origin: int) -> None:
    own = estimate.innovations
    ax.plot(seconds(own.stamp_ns, origin), own.value, color=COLORS[LIVE], linewidth=1.0)
    ax.axhline(1.0, color=drawing.INK, linewidth=1.1, linestyle=(0, (4, 2)))
    ax.set_ylim(0.0, max(MIN_NIS_LIMIT, 1.1 * float(own.value.max(initial=0.0))))
    ax.set(xlabel='time [s]', ylabel='innovation squared,\nnormalized [-]')


def _with_gaps(time: Floats, value: Floats, max_gap: float = 0.1) -> tuple[Floats, Floats]:
    """Return a curve with a NaN in every gap longer than ``max_gap`` [s]."""
    gaps = np.flatnonzero(np.diff(time) > max_gap) + 1
    return np.insert(time, gaps, math.nan), np.insert(value, gaps, math.nan)


def _limits(values: Floats, least: float) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    if not len(known):
        return -1.0, 1.0
    rest = 0.5 * (100.0 - SHOWN_PERCENT)
    low, high = np.percentile(known, (rest, 100.0 - rest))
    margin = max(RANGE_MARGIN * float(high - low), least)
    return float(low) - margin, float(high) + margin


def path_figure(title: str, estimates: Estimates,
                aligned_poses: Mapping[str, AlignedPoses]) -> Figure:
    """
    Return the paths of all methods, and their position and heading errors over time.

    ``aligned_poses`` has the poses of each method and the true ones in the frame of the method.
    """
    figure, axes = drawing.new_figure([['path', 'position'], ['path', 'heading']], width=13.0,
                                      height=6.5)
    frame, origin = aligned_poses[LIVE][1], int(aligned_poses[LIVE][2][0])
    for name, (estimated, true, stamps) in reversed(list(aligned_poses.items())):
        own = name in OWN
        style: dict[str, Any] = {'color': COLORS[name], 'linewidth': 1.6 if own else 0.9,
                                 'linestyle': '--' if name in WITH_TORQUE else '-',
                                 'alpha': 1.0 if own else 0.8, 'label': METHODS[name]}
        axes['path'].plot(*_transformed(estimated, true, frame).T, **style)
        time, errors = seconds(stamps, origin), _pose_errors(estimated, true)
        for ax, error in zip((axes['position'], axes['heading']), errors):
            ax.plot(time, error, **style)
    axes['path'].plot(*frame[:, :2].T, **drawing.TRUTH, label='truth')
    axes['path'].plot(*frame[0, :2], color=drawing.INK, marker='o', markersize=6,
                      linestyle='none', label='start')
    _frame_path(axes['path'], frame)
    axes['path'].set(title=title, xlabel='x [m]', ylabel='y [m]')
    sigmas = _sigmas(estimates[LIVE].poses, aligned_poses[LIVE][2])
    for row, (name, unit) in enumerate((('position', 'm'), ('heading', 'deg'))):
        ax = axes[name]
        ax.plot(seconds(aligned_poses[LIVE][2], origin), 2.0 * sigmas[row], color=COLORS[LIVE],
                linewidth=1.2, linestyle=':', label='2σ, live')
        ax.set(xlabel='time [s]', ylabel=f'{name} error [{unit}]')
        shown = [_pose_errors(estimated, true)[row]
                 for estimated, true, _ in aligned_poses.values()]
        ax.set_ylim(0.0, _top(shown, sigmas[row]))
    handles, labels = (first + last[-1:] for first, last in zip(
        axes['path'].get_legend_handles_labels(), axes['position'].get_legend_handles_labels()))
    figure.legend(handles[::-1], labels[::-1], loc='outside lower center', ncols=5, frameon=False)
    return figure


def _pose_errors(estimated: Floats, true: Floats) -> tuple[Floats, Floats]:
    """Return absolute position [m] and heading [deg] errors."""
    error = estimated - true
    return np.linalg.norm(error[:, :2], axis=1), np.degrees(np.abs(error[:, 2]))


def _top(errors: Sequence[Floats], sigma: Floats) -> float:
    """Return the upper axis limit for ``errors``, that of the estimator under test first."""
    own = max(float(errors[0].max()), 2.0 * float(np.nanmax(sigma, initial=0.0)), MIN_ERROR_LIMIT)
    return 1.1 * max(top for error in errors
                     if (top := max(own, float(error.max()))) <= MAX_SHOWN_ERROR * own)


def _transformed(estimated: Floats, true: Floats, frame: Floats) -> Floats:
    """Return the positions of ``estimated`` in the frame where the true poses are ``frame``."""
    turn = frame[0, 2] - true[0, 2]
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = (estimated[:, :2] - true[0, :2]).T
    return np.column_stack([cos * x - sin * y, sin * x + cos * y]) + frame[0, :2]


def _frame_path(ax: Axes, frame: Floats) -> None:
    """Set axis limits to the true path and its vicinity."""
    low, high = frame[:, :2].min(axis=0), frame[:, :2].max(axis=0)
    center = 0.5 * (low + high)
    longest = float((high - low).max())
    reach = np.maximum(0.5 * (high - low) + 0.12 * longest, 0.25 * longest)
    ax.set_aspect('equal', adjustable='box')
    ax.set(xlim=(center[0] - reach[0], center[0] + reach[0]),
           ylim=(center[1] - reach[1], center[1] + reach[1]))


def _sigmas(poses: PoseSeries, stamps: Stamps) -> tuple[Floats, Floats]:
    """Return standard deviations of position [m], along the worst axis, and heading [deg]."""
    covariance = at(stamps, poses.stamp_ns, poses.pose_covariance)
    longest = np.full(len(stamps), math.nan)
    known = np.isfinite(covariance).all(axis=(1, 2))
    longest[known] = np.sqrt(np.linalg.eigvalsh(covariance[known, :2, :2])[:, -1])
    return longest, np.degrees(np.sqrt(covariance[:, 2, 2]))
