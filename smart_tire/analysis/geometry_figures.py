"""Figures of what was identified: the delay, effective track, rolling radius, and S."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.calibration.robot.geometry import Geometry
from smart_tire.calibration.robot.icr import IcrFit
from smart_tire.calibration.robot.rolling_radius import RadiusFit
from smart_tire.calibration.robot.wheel_latency import YawRateFit

SHOWN = 20.0  # s of the run in which most turning changes, to see a delay by eye


def write_geometry(path: Path, found: Geometry) -> bool:
    """Draw what fits there are to ``path``; return whether there are any."""
    turns, ways = found.yaw_rate_fit, found.radius_fit
    rows = ([['delay', 'delay']] if turns else []) + [
        (['track'] if turns else ['radius']) + (['radius'] if ways else ['track'])]
    if turns is None and ways is None:
        return False
    figure, axes = drawing.new_figure(rows, width=10.0, height=3.8 * len(rows))
    if turns is not None:
        draw_delay(axes['delay'], turns)
        draw_track(axes['track'], turns)
    if ways is not None:
        draw_radius(axes['radius'], ways)
    for ax in axes.values():
        ax.legend(frameon=False, fontsize='small')
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)
    return True


def draw_delay(ax: Axes, turns: YawRateFit) -> None:
    """Draw the wheels' difference at its stamps, moved by the latency, and what the gyro says."""
    near = _busiest(turns)
    late, slope = turns.latency, turns.slope.value
    time = turns.time[near]
    ax.plot(time, turns.wheel_difference[near], color=drawing.SHADE, linewidth=0.9,
            label='right minus left, at its stamps')
    ax.plot(time - late.value, turns.wheel_difference[near], color=drawing.ORANGE, linewidth=1.6,
            label=f'moved by {1e3 * late.value:.1f} ± {1e3 * late.sigma:.1f} ms')
    ax.plot(time - late.value, slope * turns.yaw_rate[near], color=drawing.INK, linewidth=0.9,
            label='gyro, times track over radius')
    ax.set(xlabel='time [s]', ylabel='speed of the wheels [rad/s]')


def _busiest(turns: YawRateFit) -> slice:
    """Return the ``SHOWN`` seconds in which the yaw rate changes most."""
    changed = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turns.yaw_rate)))])
    last = np.searchsorted(turns.time, turns.time + SHOWN)
    first = int(np.argmax(changed[last - 1] - changed))
    return slice(first, int(last[first]))


def draw_track(ax: Axes, turns: YawRateFit) -> None:
    """Draw the wheels' difference over the yaw rate with the line whose slope is the track."""
    slope = turns.slope
    ax.plot(turns.yaw_rate, turns.wheel_difference, '.', color=drawing.SKY, markersize=3,
            label='stretches')
    ends = np.array([turns.yaw_rate.min(), turns.yaw_rate.max()])
    ax.plot(ends, slope.value * ends, color=drawing.INK, linewidth=1.2,
            label=f'{slope.value:.3f} ± {slope.sigma:.3f} rad of wheels per rad of yaw')
    ax.set(xlabel='yaw rate [rad/s]', ylabel='right minus left [rad/s]')


def draw_radius(ax: Axes, ways: RadiusFit) -> None:
    """Draw how far the ways of reference and wheels differ, over the run."""
    radius = ways.radius
    ax.axhline(0.0, color=drawing.INK, linewidth=1.0)
    ax.plot(ways.time, 1e3 * (ways.reference_distance - ways.wheel_distance), 'o',
            color=drawing.VERMILLION, markersize=3.5,
            label=f'stretches; radius {1e3 * radius.value:.1f} ± {1e3 * radius.sigma:.1f} mm')
    ax.set(xlabel='time [s]', ylabel='reference minus wheels [mm]')


def write_icr(path: Path, fit: IcrFit) -> None:
    """Draw the fit of S and its values turn by turn to ``path``."""
    figure, axes = drawing.new_figure([['fit', 'turns']], width=10.0, height=4.0)
    draw_icr_fit(axes['fit'], fit)
    draw_icr_turns(axes['turns'], fit)
    for ax in axes.values():
        ax.legend(frameon=False, fontsize='small')
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)


def draw_icr_fit(ax: Axes, fit: IcrFit) -> None:
    """Draw lateral motion over what S times gives it."""
    x, y = fit.regressor, fit.response
    ax.plot(x, y, '.', color=drawing.SKY, markersize=3, label='stretches in turns')
    ends = np.array([x.min(), x.max()])
    ax.plot(ends, fit.icr.value * ends, color=drawing.INK, linewidth=1.2,
            label=f'S = {1e3 * fit.icr.value:.1f} ± {1e3 * fit.icr.sigma:.1f} mm')
    low, high = np.quantile(y, (0.01, 0.99))
    margin = 0.3 * (high - low)
    ax.set_ylim(low - margin, high + margin)
    what = 'lateral way' if fit.unit == 'm' else 'lateral acceleration'
    ax.set(xlabel='minus turn [rad]' if fit.unit == 'm' else 'minus yaw acceleration [rad/s2]',
           ylabel=f'{what} [{fit.unit}]')


def draw_icr_turns(ax: Axes, fit: IcrFit) -> None:
    """Draw S of each turn with its error, and that of the run with its spread."""
    icr, spread = fit.icr.value, fit.initial_sigma
    ax.axhspan(1e3 * (icr - spread), 1e3 * (icr + spread), color=drawing.BLUE, alpha=0.2,
               linewidth=0.0, label='S and what is known of it, ± 1σ')
    ax.axhline(1e3 * icr, color=drawing.BLUE, linewidth=1.4)
    ax.errorbar(fit.turn_time, 1e3 * fit.turn_icr, yerr=1e3 * fit.turn_sigma, fmt='o',
                color=drawing.ORANGE, markersize=4, elinewidth=0.9, label='turns ± 1σ')
    ax.set(xlabel='time [s]', ylabel='S [mm]')
