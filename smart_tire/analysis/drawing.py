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

"""Plots on given axes; no computation, no file access."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from textwrap import wrap
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
import numpy as np

from smart_tire.analysis.curves import Curve
from smart_tire.analysis.series import Floats

# Palette of Okabe and Ito, distinguishable with color vision deficiency.
BLUE, VERMILLION, ORANGE, SKY = '#0072b2', '#d55e00', '#e69f00', '#56b4e9'
INK, SOFT, SHADE = '#222222', '#55626f', '#8c8c8c'
AREA_COLORS = SKY, ORANGE, VERMILLION, BLUE
SIDE_COLORS = {'left': BLUE, 'right': VERMILLION}
FILM_COLORS = (BLUE, ORANGE)
TRUTH: dict[str, Any] = {'color': INK, 'linewidth': 1.1, 'linestyle': (0, (4, 2))}
DOTS_PER_INCH = 150
CAPTION_SIZE = 8.5      # points
CAPTION_DENSITY = 15.5  # characters per inch in this size
TWO_SIGMA = '± 2σ, where σ is the standard deviation that the estimator reports.'


@dataclass(frozen=True)
class SlipCurve:
    """Slip of one side over time; NaN leaves a gap."""

    side: str
    estimate: Curve
    truth: Curve         # empty without ground truth
    hidden_share: float  # of the estimates, which are not drawn


@dataclass(frozen=True)
class CrossingWaveform:
    """Film voltages around one crossing."""

    wheel: str
    time_ms: Floats                         # relative to the timestamp of the crossing
    volts: Floats                           # (n, films)
    inside_ms: list[tuple[float, float]]    # per film: interval in which it overlaps the patch


@dataclass(frozen=True)
class FrictionCurve:
    """Friction of one wheel, one value per revolution; NaN leaves a gap."""

    wheel: str
    single: Curve
    fused: Curve
    truth: Curve  # empty without ground truth


@dataclass(frozen=True)
class Path:
    """Path of the robot in the plane."""

    name: str
    position: Floats  # (n, 2) m
    color: str = BLUE


def new_figure(panels: Sequence[Sequence[str]], *, width: float = 9.0, height: float = 4.0,
               share_x: bool = False, share_y: bool = False) -> tuple[Figure, dict[str, Axes]]:
    """
    Return a figure [inch] and its axes by name; ``panels`` names them row by row.

    A name that stands in several cells intervals them, '.' leaves one empty.
    """
    figure = Figure(figsize=(width, height), layout='constrained')
    axes = figure.subplot_mosaic([list(row) for row in panels], sharex=share_x, sharey=share_y)
    for ax in axes.values():
        ax.grid(True, color='#e4e4e4', linewidth=0.8)
        ax.set_axisbelow(True)
        ax.spines[['top', 'right']].set_visible(False)
    return figure, axes


def finish(figure: Figure, axes: dict[str, Axes]) -> None:
    """Remove inner axis labels; put the legend of the first axes above all panels."""
    for ax in axes.values():
        cell = ax.get_subplotspec()
        if cell is not None and not cell.is_first_col():
            ax.set_ylabel('')
        if cell is not None and not cell.is_last_row():
            ax.set_xlabel('')
    legend_above(figure, next(iter(axes.values())))


def legend_above(figure: Figure, ax: Axes) -> None:
    """Put the legend of ``ax`` above all panels, where it covers no data."""
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside upper center', ncols=len(labels), frameon=False)


def legend_on_top(ax: Axes) -> None:
    """Put title and legend of ``ax`` above its panel, where they cover no data."""
    title = ax.get_title()
    ax.set_title('')
    ax.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), borderaxespad=0.3, frameon=False,
              fontsize='small', title=title or None, alignment='left')


def add_caption(figure: Figure, text: str) -> None:
    """Write ``text`` below all panels, in lines as wide as the figure."""
    lines = wrap(text, round(CAPTION_DENSITY * figure.get_figwidth()))
    figure.supxlabel('\n'.join(lines), x=0.01, ha='left', fontsize=CAPTION_SIZE, color=SOFT)


def mark_segment(ax: Axes, letter: str, first: float, last: float) -> None:
    """Shade a segment [s] of an overview and write its letter above."""
    ax.axvspan(first, last, color=SHADE, alpha=0.16, linewidth=0.0)
    ax.text(0.5 * (first + last), 0.98, letter, transform=ax.get_xaxis_transform(), ha='center',
            va='top', fontsize=CAPTION_SIZE, fontweight='bold', color=SOFT)


def draw_slip(ax: Axes, curves: Sequence[SlipCurve]) -> None:
    """Draw slip with two-sigma bands and dashed ground truth, as in paper B, Fig. 10."""
    for curve in curves:
        color = SIDE_COLORS[curve.side]
        draw_band(ax, curve.estimate, color)
        ax.plot(curve.estimate.time_s, curve.estimate.value, color=color, linewidth=1.3,
                label=f'{curve.side} side ± 2σ')
    for number, curve in enumerate(curves):
        if len(curve.truth.time_s):
            ax.plot(curve.truth.time_s, curve.truth.value, **TRUTH,
                    label='truth' if number == 0 else None)
    ax.set(xlabel='time [s]', ylabel='slip ratio [-]')


def draw_band(ax: Axes, curve: Curve, color: str) -> None:
    """Draw the band of two standard deviations of a curve that has them."""
    if curve.sigma is not None:
        ax.fill_between(curve.time_s, curve.value - 2.0 * curve.sigma,
                        curve.value + 2.0 * curve.sigma, color=color, alpha=0.2, linewidth=0.0)


def draw_waveform(ax: Axes, waveform: CrossingWaveform) -> None:
    """Draw the film voltages during one crossing, as in paper B, Fig. 11(b)."""
    top = float(waveform.volts.max())
    reach = top - float(waveform.volts.min())
    for film, (color, inside) in enumerate(zip(FILM_COLORS, waveform.inside_ms)):
        ax.plot(waveform.time_ms, waveform.volts[:, film], color=color, linewidth=1.4, marker='.',
                markersize=5, label=f'film {film + 1}')
        ax.plot(inside, [top + reach * (0.12 - 0.05 * film)] * 2, color=color, linewidth=5.0,
                solid_capstyle='butt', alpha=0.55, label=f'film {film + 1} in the patch')
    ax.axvline(0.0, color=SHADE, linewidth=1.0, linestyle=':', label='crossing')
    ax.set(xlabel='time after the crossing [ms]', ylabel='amplifier output [V]',
           title=f'one crossing of {waveform.wheel.replace("_", " ")}')


def draw_friction(ax: Axes, curve: FrictionCurve, *, bars: bool = True) -> None:
    """
    Draw single estimates with two-sigma bars and fused ones with a two-sigma band.

    Without ``bars`` many crossings can be drawn in one panel.
    """
    single, fused, truth = curve.single, curve.fused, curve.truth
    draw_band(ax, fused, BLUE)
    size = 2.0 * single.sigma if bars and single.sigma is not None else None
    ax.errorbar(single.time_s, single.value, yerr=size, color=ORANGE, fmt='o',
                markersize=3.5 if bars else 2.0, elinewidth=0.9,
                label=f'single crossing{" ± 2σ" if bars else ""}')
    ax.plot(fused.time_s, fused.value, color=BLUE, linewidth=1.6, zorder=3,
            label='fused ± 2σ')
    if len(truth.time_s):
        ax.plot(truth.time_s, truth.value, **TRUTH, zorder=4, drawstyle='steps-mid',
                label='truth')
    ax.set(xlabel='time [s]', ylabel='friction coefficient [-]',
           title=curve.wheel.replace('_', ' '))


def draw_path(ax: Axes, estimates: Sequence[Path], truth: Floats | None) -> None:
    """Draw estimated paths, dashed ground truth (n, 2), and a dot at the start."""
    for path in estimates:
        ax.plot(*path.position.T, color=path.color, linewidth=1.6, label=path.name)
    if truth is not None:
        ax.plot(*truth.T, **TRUTH, label='truth')
    ax.plot(*estimates[0].position[0], color=INK, marker='o', markersize=6, linestyle='none',
            label='start')
    ax.set(xlabel='x [m]', ylabel='y [m]')
    ax.set_aspect('equal', adjustable='datalim')


def draw_wanted(ax: Axes, paths: Sequence[Floats]) -> None:
    """Draw the paths (n, 2) that were to be followed, below all others."""
    for number, path in enumerate(paths):
        ax.plot(*path.T, color=SHADE, linewidth=5.0, alpha=0.4, solid_capstyle='round', zorder=1.5,
                label='wanted' if number == 0 else None)


def draw_areas(ax: Axes, areas: Sequence[tuple[str, Floats]]) -> None:
    """Shade areas given by name and corners (n, 2), one color per name; keep the axes' limits."""
    colors = dict(zip(dict.fromkeys(name for name, _ in areas), cycle(AREA_COLORS)))
    for name, corners in areas:
        label = None if name in ax.get_legend_handles_labels()[1] else name
        ax.add_artist(Polygon(corners, facecolor=colors[name], alpha=0.13, zorder=0.5,
                              label=label))


def draw_error(ax: Axes, curve: Curve, label: str, path: Path) -> None:
    """Draw an error of ``path`` over time with the two-sigma band around zero."""
    if curve.sigma is not None:
        reach = np.where(np.isfinite(curve.value), 2.0 * curve.sigma, np.nan)
        ax.fill_between(curve.time_s, -reach, reach, color=path.color, alpha=0.2, linewidth=0.0)
    ax.plot(curve.time_s, curve.value, color=path.color, linewidth=1.2,
            label=f'{path.name}: error and 2σ')
    ax.set(xlabel='time [s]', ylabel=label)
