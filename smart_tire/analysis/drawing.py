# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Figures by matplotlib; no computation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math
from pathlib import Path
from string import ascii_uppercase
from textwrap import wrap

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Polygon
import numpy as np

from smart_tire.analysis.figure import (
    ColorField, COLORS, decimated, Figure, Mark, Panel, runs, SIGMAS)

SOFT = '#55626f'
DASHES = (0, (4, 2))  # points of the line width
DOTS_PER_INCH = 150
CAPTION_SIZE = 8.5      # points
CAPTION_DENSITY = 15.5  # characters per inch in this size
ENTRY_WIDTH, LETTER_WIDTH = 0.7, 0.07  # inch, in a legend
LEGEND_HEIGHT = 1.2     # inch, of legend and caption
SEGMENTED_WIDTH = 11.0  # inch, of a figure with segments


def save(figure: Figure, path: Path) -> Path:
    """Draw ``figure`` into the file ``path``; return it."""
    render(figure).savefig(path, dpi=DOTS_PER_INCH)
    return path


def save_all(figures: Iterable[Figure | None], folder: Path) -> list[Path]:
    """Draw those of ``figures`` that have something to show into ``folder``; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    return [save(figure, folder / f'{figure.name}.png')
            for figure in figures if figure is not None]


def render(figure: Figure) -> Canvas:
    """Return ``figure``; below its panels, its segments are drawn in panels of their own."""
    panels, parts = figure.panels, list(zip(ascii_uppercase, figure.segments))
    names = {panel: str(number) for number, panel in enumerate(panels)}
    rows: list[list[str]] = []
    for row in figure.rows:
        rows.append([names[panel] if panel else '.' for panel in row for _ in parts or ' '])
        rows += [[names[panel] + letter for letter, _ in parts] for panel in row
                 if panel and parts]
    # axes of equal scale that are shared may be cut
    free = not any(panel.equal for panel in panels)
    share_y = free and len(panels) + len(parts) > 1 and len({
        (panel.y_label, panel.y_limits) for panel in panels}) == 1
    width = SEGMENTED_WIDTH if parts else figure.cell[0] * len(rows[0])
    drawn, axes = new_figure(
        rows, width=width, height=LEGEND_HEIGHT + figure.cell[1] * len(rows), share_y=share_y,
        share_x=free and len(rows[0]) == 1 and len({panel.x_label for panel in panels}) == 1)
    for panel, name in names.items():
        draw_panel(axes[name], panel, brief=bool(parts))
        for letter, (first, last) in parts:
            draw_panel(axes[name + letter], panel)
            axes[name + letter].set(xlim=(first, last), title=', '.join(filter(None, [
                panel.title, f'{letter}: {first:.0f} s to {last:.0f} s'])))
            mark_segment(axes[name], letter, first, last)
    if share_y:
        clear_inner_labels(axes.values())
    if figure.panel_legends:
        for ax in axes.values():
            legend_on_top(ax)
    else:
        legend_above(drawn, *axes.values())
    add_caption(drawn, figure.caption)
    return drawn


def draw_panel(ax: Axes, panel: Panel, *, brief: bool = False) -> None:
    """Draw a panel, in an overview without bars."""
    if panel.image is not None:
        ax.imshow(panel.image, cmap='gray', vmin=0, vmax=255)
        ax.autoscale(False)
        ax.grid(False)
    if panel.field is not None:
        _draw_field(ax, panel.field)
    draw_marks(ax, panel.marks, brief=brief)
    ax.set(xlabel=panel.x_label, ylabel=panel.y_label, title=panel.title)
    if panel.x_limits is not None:
        ax.set_xlim(*panel.x_limits)
    if panel.y_limits is not None:
        ax.set_ylim(*panel.y_limits)
    if panel.equal:
        ax.set_aspect('equal', adjustable='datalim')


def _draw_field(ax: Axes, field: ColorField) -> None:
    low, high = field.limits
    beyond = np.nanmax(field.values, initial=low) > high
    drawn = ax.imshow(field.values, origin='lower', extent=field.extent, vmin=low, vmax=high,
                      cmap='viridis', interpolation='nearest', aspect='auto')
    ax.figure.colorbar(drawn, ax=ax, label=field.label, extend='max' if beyond else 'neither')
    ax.locator_params(integer=True, min_n_ticks=4)  # numbers of films, but shares of a width, too
    ax.grid(False)


def draw_marks(ax: Axes, marks: Iterable[Mark], *, brief: bool = False) -> None:
    """Draw ``marks``, later ones above earlier ones; a label that is there is not repeated."""
    for mark in marks:
        label = mark.label if mark.label not in ax.get_legend_handles_labels()[1] else ''
        _DRAW[mark.kind](ax, mark, label or None, brief)


def _draw_line(ax: Axes, mark: Mark, label: str | None, brief: bool) -> None:
    curve, color = decimated(mark.curve), COLORS[mark.color]
    if curve.sigma is not None:
        middle = np.where(np.isfinite(curve.y), 0.0, np.nan) if mark.around_zero else curve.y
        ax.fill_between(curve.x, middle - curve.reach, middle + curve.reach, color=color,
                        alpha=0.2, linewidth=0.0)
    ax.plot(curve.x, curve.y, color=color, linewidth=mark.width, alpha=mark.opacity,
            linestyle=DASHES if mark.dashed else '-', solid_capstyle='butt', label=label,
            drawstyle=f'steps-{mark.steps}' if mark.steps else 'default')


def _draw_points(ax: Axes, mark: Mark, label: str | None, brief: bool) -> None:
    curve, sigmas = mark.curve, (mark.curve.sigma, mark.x_sigma)
    y_bar, x_bar = (None if sigma is None or brief else SIGMAS * sigma for sigma in sigmas)
    ax.errorbar(curve.x, curve.y, yerr=y_bar, xerr=x_bar, color=COLORS[mark.color], fmt='o',
                markersize=mark.width, markeredgewidth=0.0, elinewidth=0.9, alpha=mark.opacity,
                label=label)


def _draw_area(ax: Axes, mark: Mark, label: str | None, brief: bool) -> None:
    corners = np.column_stack([mark.curve.x, mark.curve.y])
    for rows in runs(np.isfinite(mark.curve.y)):
        # an artist, unlike a patch, does not change the limits of the axes
        ax.add_artist(Polygon(
            corners[rows], facecolor=COLORS[mark.color], alpha=mark.opacity, zorder=0.5,
            label=label))
        label = None


_DRAW = {'line': _draw_line, 'points': _draw_points, 'area': _draw_area}


def new_figure(panels: Sequence[Sequence[str]], *, width: float = 9.0, height: float = 4.0,
               share_x: bool = False, share_y: bool = False
               ) -> tuple[Canvas, dict[str, Axes]]:
    """
    Return a figure [inch] and its axes by name; ``panels`` names them row by row.

    A name that stands in several cells spans them, '.' leaves one empty.
    """
    figure = Canvas(figsize=(width, height), layout='constrained')
    axes = figure.subplot_mosaic([list(row) for row in panels], sharex=share_x, sharey=share_y)
    for ax in axes.values():
        ax.grid(True, color='#e4e4e4', linewidth=0.8)
        ax.set_axisbelow(True)
        ax.spines[['top', 'right']].set_visible(False)
    return figure, axes


def clear_inner_labels(axes: Iterable[Axes]) -> None:
    """Remove the axis labels that repeat those of the first column and the last row."""
    for ax in axes:
        cell = ax.get_subplotspec()
        if cell is not None and not cell.is_first_col():
            ax.set_ylabel('')
        if cell is not None and not cell.is_last_row():
            ax.set_xlabel('')


def legend_above(figure: Canvas, *axes: Axes) -> None:
    """Put one legend of all ``axes`` above all panels, where it covers no data."""
    entries = {label: handle for ax in axes
               for handle, label in zip(*ax.get_legend_handles_labels())}
    width = sum(ENTRY_WIDTH + LETTER_WIDTH * len(label) for label in entries)
    rows = math.ceil(width / figure.get_figwidth()) or 1
    figure.legend(list(entries.values()), list(entries), loc='outside upper center',
                  ncols=max(math.ceil(len(entries) / rows), 1), frameon=False)


def legend_on_top(ax: Axes) -> None:
    """Put title and legend of ``ax`` above its panel, where they cover no data."""
    title = ax.get_title()
    if not ax.get_legend_handles_labels()[1]:
        return
    ax.set_title('')
    ax.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), borderaxespad=0.3, frameon=False,
              fontsize='small', title=title or None, alignment='left')


def add_caption(figure: Canvas, text: str) -> None:
    """Write ``text`` below all panels, in lines as wide as the figure."""
    lines = wrap(text, round(CAPTION_DENSITY * figure.get_figwidth()))
    figure.supxlabel('\n'.join(lines), x=0.01, ha='left', fontsize=CAPTION_SIZE, color=SOFT)


def mark_segment(ax: Axes, letter: str, first: float, last: float) -> None:
    """Shade a segment [s] of an overview and write its letter above."""
    ax.axvspan(first, last, color=COLORS['shade'], alpha=0.16, linewidth=0.0)
    ax.text(0.5 * (first + last), 0.98, letter, transform=ax.get_xaxis_transform(), ha='center',
            va='top', fontsize=CAPTION_SIZE, fontweight='bold', color=SOFT)
