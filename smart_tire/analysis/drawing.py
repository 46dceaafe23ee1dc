"""Drawings on given axes: they compute nothing, decide nothing and show nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from smart_tire.analysis.series import Floats

# Okabe and Ito's palette: its colours stay apart for every kind of colour vision.
BLUE, VERMILLION, ORANGE, SKY = '#0072b2', '#d55e00', '#e69f00', '#56b4e9'
INK, SHADE = '#222222', '#8c8c8c'
SIDE_COLORS = {'left': BLUE, 'right': VERMILLION}
FILM_COLORS = (BLUE, ORANGE)
TRUTH: dict[str, Any] = {'color': INK, 'linewidth': 1.1, 'linestyle': (0, (4, 2))}
DOTS_PER_INCH = 150


@dataclass(frozen=True)
class SlipCurve:
    """Slip of one side over time; NaN leaves a gap."""

    side: str
    time_s: Floats
    slip: Floats
    sigma: Floats
    true_time_s: Floats  # empty without truth
    true_slip: Floats


@dataclass(frozen=True)
class Contact:
    """Voltages of the films around one passage."""

    wheel: str
    time_ms: Floats                         # after the passage's stamp
    volts: Floats                           # (n, films)
    inside_ms: list[tuple[float, float]]    # per film: when any of it is in the patch


@dataclass(frozen=True)
class FrictionCurve:
    """Friction of one wheel, one value per revolution."""

    wheel: str
    time_s: Floats
    single: Floats
    single_sigma: Floats
    fused: Floats
    fused_sigma: Floats
    true_time_s: Floats  # empty without truth
    true: Floats


@dataclass(frozen=True)
class Path:
    """The way of the robot, seen from above."""

    name: str
    position: Floats  # (n, 2) m
    color: str = BLUE


def new_figure(panels: Sequence[Sequence[str]], *, width: float = 9.0, height: float = 4.0,
               share_x: bool = False, share_y: bool = False) -> tuple[Figure, dict[str, Axes]]:
    """
    Return a figure [inch] and its axes by name; ``panels`` names them row by row.

    A name that stands in several cells spans them, '.' leaves one empty.
    """
    figure = Figure(figsize=(width, height), layout='constrained')
    axes = figure.subplot_mosaic([list(row) for row in panels], sharex=share_x, sharey=share_y)
    for ax in axes.values():
        ax.grid(True, color='#e4e4e4', linewidth=0.8)
        ax.set_axisbelow(True)
        ax.spines[['top', 'right']].set_visible(False)
    return figure, axes


def finish(figure: Figure, axes: dict[str, Axes]) -> None:
    """Keep labels at the outer edges, and one legend, that of the first axes, above them all."""
    for ax in axes.values():
        place = ax.get_subplotspec()
        if place is not None and not place.is_first_col():
            ax.set_ylabel('')
        if place is not None and not place.is_last_row():
            ax.set_xlabel('')
    ax = next(iter(axes.values()))
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside upper center', ncols=len(labels), frameon=False)


def draw_slip(ax: Axes, curves: Sequence[SlipCurve]) -> None:
    """Draw slips with their two-sigma bands, and the truth dashed, as paper B's Fig. 10."""
    for curve in curves:
        color = SIDE_COLORS[curve.side]
        ax.fill_between(curve.time_s, curve.slip - 2.0 * curve.sigma,
                        curve.slip + 2.0 * curve.sigma, color=color, alpha=0.2, linewidth=0.0)
        ax.plot(curve.time_s, curve.slip, color=color, linewidth=1.3,
                label=f'{curve.side} side ± 2σ')
    for number, curve in enumerate(curves):
        if len(curve.true_time_s):
            ax.plot(curve.true_time_s, curve.true_slip, **TRUTH,
                    label='truth' if number == 0 else None)
    ax.set(xlabel='time [s]', ylabel='slip ratio [-]')


def draw_contact(ax: Axes, contact: Contact) -> None:
    """Draw the films' voltages through one contact, as paper B's Fig. 11(b)."""
    top = float(contact.volts.max())
    reach = top - float(contact.volts.min())
    for film, (color, inside) in enumerate(zip(FILM_COLORS, contact.inside_ms)):
        ax.plot(contact.time_ms, contact.volts[:, film], color=color, linewidth=1.4, marker='.',
                markersize=5, label=f'film {film + 1}')
        ax.plot(inside, [top + reach * (0.12 - 0.05 * film)] * 2, color=color, linewidth=5.0,
                solid_capstyle='butt', alpha=0.55, label=f'film {film + 1} in the patch')
    ax.axvline(0.0, color=SHADE, linewidth=1.0, linestyle=':', label='passage')
    ax.set(xlabel='time after the passage [ms]', ylabel='amplifier output [V]',
           title=f'one contact of {contact.wheel.replace("_", " ")}')


def draw_friction(ax: Axes, curve: FrictionCurve) -> None:
    """Draw friction per revolution: single with bars and fused with a band, both two sigma."""
    ax.fill_between(curve.time_s, curve.fused - 2.0 * curve.fused_sigma,
                    curve.fused + 2.0 * curve.fused_sigma, color=BLUE, alpha=0.2, linewidth=0.0)
    ax.errorbar(curve.time_s, curve.single, yerr=2.0 * curve.single_sigma, color=ORANGE, fmt='o',
                markersize=3.5, elinewidth=0.9, label='one revolution ± 2σ')
    ax.plot(curve.time_s, curve.fused, color=BLUE, linewidth=1.6, label='fused ± 2σ')
    if len(curve.true_time_s):
        ax.plot(curve.true_time_s, curve.true, **TRUTH, drawstyle='steps-mid', label='truth')
    ax.set(xlabel='time [s]', ylabel='friction coefficient [-]',
           title=curve.wheel.replace('_', ' '))


def draw_path(ax: Axes, estimates: Sequence[Path], truth: Floats | None) -> None:
    """Draw the estimated ways, and the true one (n, 2) dashed, with a dot at the start."""
    for path in estimates:
        ax.plot(*path.position.T, color=path.color, linewidth=1.6, label=path.name)
    if truth is not None:
        ax.plot(*truth.T, **TRUTH, label='truth')
    ax.plot(*estimates[0].position[0], color=INK, marker='o', markersize=6, linestyle='none',
            label='start')
    ax.set(xlabel='x [m]', ylabel='y [m]')
    ax.set_aspect('equal', adjustable='datalim')


def draw_error(ax: Axes, time_s: Floats, error: Floats, sigma: Floats, label: str,
               path: Path) -> None:
    """Draw an error of ``path`` over time against the two-sigma band around zero."""
    ax.fill_between(time_s, -2.0 * sigma, 2.0 * sigma, color=path.color, alpha=0.2, linewidth=0.0)
    ax.plot(time_s, error, color=path.color, linewidth=1.2, label=f'{path.name}: error and 2σ')
    ax.set(xlabel='time [s]', ylabel=label)
