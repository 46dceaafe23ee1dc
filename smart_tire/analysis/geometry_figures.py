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

"""Figures of identified geometry: encoder latency, effective track, rolling radius, ICR."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.calibration.robot.geometry import Geometry
from smart_tire.calibration.robot.latency import YawRateFit
from smart_tire.calibration.robot.reference import RadiusFit
from smart_tire.calibration.robot.turning import IcrFit

SHOWN_DURATION = 20.0  # s, where the yaw rate changes most, so that the latency is visible


def write_geometry(path: Path, found: Geometry) -> bool:
    """Draw the available fits to ``path``; return False without any."""
    yaw_rate_fit, radius_fit = found.yaw_rate_fit, found.radius_fit
    rows = ([['delay', 'delay']] if yaw_rate_fit else []) + [
        (['track'] if yaw_rate_fit else ['radius']) + (['radius'] if radius_fit else ['track'])]
    if yaw_rate_fit is None and radius_fit is None:
        return False
    figure, axes = drawing.new_figure(rows, width=10.0, height=3.8 * len(rows))
    if yaw_rate_fit is not None:
        draw_delay(axes['delay'], yaw_rate_fit)
        draw_track(axes['track'], yaw_rate_fit)
    if radius_fit is not None:
        draw_radius(axes['radius'], radius_fit)
    for ax in axes.values():
        drawing.legend_on_top(ax)
    drawing.add_caption(
        figure, 'Values are given with their standard errors. The yaw rate is shown in the '
        f'{SHOWN_DURATION:.0f} s in which it changes most; an interval is the time between two '
        'wheel messages, or between reference poses.')
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)
    return True


def draw_delay(ax: Axes, fit: YawRateFit) -> None:
    """Draw the wheel speed difference with and without latency correction, and the gyro rate."""
    shown = _busiest(fit)
    latency, slope = fit.latency, fit.slope.value
    time = fit.time[shown]
    ax.plot(time, fit.wheel_difference[shown], color=drawing.SHADE, linewidth=0.9,
            label='right minus left, as stamped')
    ax.plot(time - latency.value, fit.wheel_difference[shown], color=drawing.ORANGE, linewidth=1.6,
            label=f'shifted by {1e3 * latency.value:.1f} ± {1e3 * latency.sigma:.1f} ms')
    ax.plot(time - latency.value, slope * fit.yaw_rate[shown], color=drawing.INK, linewidth=0.9,
            label='gyro, times track over radius')
    ax.set(xlabel='time [s]', ylabel='wheel speed difference [rad/s]')


def _busiest(fit: YawRateFit) -> slice:
    """Return the ``SHOWN_DURATION`` in which the yaw rate changes most."""
    changed = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(fit.yaw_rate)))])
    last = np.searchsorted(fit.time, fit.time + SHOWN_DURATION)
    first = int(np.argmax(changed[last - 1] - changed))
    return slice(first, int(last[first]))


def draw_track(ax: Axes, fit: YawRateFit) -> None:
    """Draw wheel speed difference over yaw rate; the slope is track over radius."""
    slope = fit.slope
    ax.plot(fit.yaw_rate, fit.wheel_difference, '.', color=drawing.SKY, markersize=3,
            label='intervals')
    ends = np.array([fit.yaw_rate.min(), fit.yaw_rate.max()])
    ax.plot(ends, slope.value * ends, color=drawing.INK, linewidth=1.2,
            label=f'{slope.value:.3f} ± {slope.sigma:.3f} wheel rad per yaw rad')
    ax.set(xlabel='yaw rate [rad/s]', ylabel='wheel speed, right minus left [rad/s]')


def draw_radius(ax: Axes, fit: RadiusFit) -> None:
    """Draw the difference of reference and wheel distances over time."""
    radius = fit.radius
    ax.axhline(0.0, color=drawing.INK, linewidth=1.0)
    ax.plot(fit.time, 1e3 * (fit.reference_distance - fit.wheel_distance), 'o',
            color=drawing.VERMILLION, markersize=3.5,
            label=f'intervals; radius {1e3 * radius.value:.1f} ± {1e3 * radius.sigma:.1f} mm')
    ax.set(xlabel='time [s]', ylabel='distance, reference minus wheels [mm]')


def write_icr(path: Path, fit: IcrFit) -> None:
    """Draw the fit of S and its value in each turn to ``path``."""
    figure, axes = drawing.new_figure([['fit', 'turns']], width=10.0, height=4.0)
    draw_icr_fit(axes['fit'], fit)
    draw_icr_turns(axes['turns'], fit)
    for ax in axes.values():
        drawing.legend_on_top(ax)
    drawing.add_caption(
        figure, 'Left: the slope is S, the x coordinate of the instantaneous centers of rotation, '
        'given with its standard error; points beyond the axes are extreme intervals. Right: S of '
        'each turn and its standard error; shaded: standard deviation of S in another recording.')
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)


def draw_icr_fit(ax: Axes, fit: IcrFit) -> None:
    """Draw lateral motion over its regressor; the slope is S."""
    x, y = fit.regressor, fit.response
    ax.plot(x, y, '.', color=drawing.SKY, markersize=3, label='intervals in turns')
    ends = np.array([x.min(), x.max()])
    ax.plot(ends, fit.icr.value * ends, color=drawing.INK, linewidth=1.2,
            label=f'S = {1e3 * fit.icr.value:.1f} ± {1e3 * fit.icr.sigma:.1f} mm')
    low, high = np.quantile(y, (0.01, 0.99))
    margin = 0.3 * (high - low)
    ax.set_ylim(low - margin, high + margin)
    x_label, y_label = (('minus yaw change [rad]', 'lateral displacement') if fit.unit == 'm'
                        else ('minus yaw acceleration [rad/s2]', 'lateral acceleration'))
    ax.set(xlabel=x_label, ylabel=f'{y_label} [{fit.unit}]')


def draw_icr_turns(ax: Axes, fit: IcrFit) -> None:
    """Draw S of each turn with its standard error, and the overall S with its spread."""
    icr, spread = fit.icr.value, fit.initial_sigma
    ax.axhspan(1e3 * (icr - spread), 1e3 * (icr + spread), color=drawing.BLUE, alpha=0.2,
               linewidth=0.0, label='S ± 1σ')
    ax.axhline(1e3 * icr, color=drawing.BLUE, linewidth=1.4)
    ax.errorbar(fit.turn_time, 1e3 * fit.turn_icr, yerr=1e3 * fit.turn_sigma, fmt='o',
                color=drawing.ORANGE, markersize=4, elinewidth=0.9, label='turns ± 1σ')
    ax.set(xlabel='time [s]', ylabel='S [mm]')
