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

"""Figures of paper A; deflections have the paper's sign, negative when buckled."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.reproduction.film_fit import FREQUENCY, Identification, PRODUCTS
from smart_tire.reproduction.film_loops import Loop, Proportionality, RateIndependence, Trace

MM, NC, PC = 1e3, 1e9, 1e12  # from SI units
DELTA, CHARGE = 'deflection Δ [mm]', 'charge $Q_e$ [nC]'
CYCLES = 5 / FREQUENCY  # s, shown in Fig. 8 and 9
SYMBOLS = {'alpha_gain': r'$\alpha K$', 'a_gain': '$aK$', 'b_gain': '$bK$'}
MODEL_LABELS = {'exact': 'exact elastica and Duhem operator',
                'printed': 'A(15) as printed and Duhem operator',
                'linear': 'A(16) and Duhem operator'}
MODEL_STYLES = {'exact': (drawing.INK, '-'), 'printed': (drawing.VERMILLION, '--'),
                'linear': (drawing.SHADE, ':')}


def trace_figure(trace: Trace) -> Figure:
    """Return Fig. 4: charge and deflection over time, and the loop."""
    figure, axes = drawing.new_figure([['time', 'loop']], width=11.0, height=4.4)
    ax = axes['time']
    ax.plot(trace.time, NC * (trace.charge - trace.charge.mean()), color=drawing.BLUE,
            label='charge')
    ax.set(xlabel='time [s]', ylabel=f'{CHARGE}, without its mean')
    charge_axis = ax.twinx()
    charge_axis.spines['top'].set_visible(False)
    charge_axis.plot(trace.time, -MM * trace.deflection, color=drawing.ORANGE, linestyle='--',
                     label='deflection (right)')
    charge_axis.set_ylabel(DELTA)
    handles = [*ax.get_legend_handles_labels()[0], *charge_axis.get_legend_handles_labels()[0]]
    ax.legend(handles=handles, frameon=False, loc='lower center', bbox_to_anchor=(0.5, 1.0),
              ncols=2)
    _draw_loop(axes['loop'], trace.loop, drawing.BLUE, '5 Hz')
    axes['loop'].set(ylabel=f'{CHARGE}, without its mean')
    return figure


def rate_figure(result: RateIndependence) -> Figure:
    """Return Fig. 6: loops at two frequencies, and the peak over frequency."""
    figure, axes = drawing.new_figure([['loops', 'peaks'], ['loops', 'rest']], width=11.0,
                                      height=5.0)
    for (frequency, loop), color, style in zip(result.loops.items(), (drawing.SKY, drawing.INK),
                                               ({'linewidth': 4.0}, {'linewidth': 1.1})):
        _draw_loop(axes['loops'], loop, color, f'{frequency:.0f} Hz', **style)
    axes['loops'].legend(frameon=False)
    axes['loops'].set(ylabel=f'{CHARGE}, without its mean', title='film 32 x 3 mm, amplitude 8 mm')
    ax = axes['peaks']
    mean = PC * float(result.peak.mean())
    ax.axhline(mean, color=drawing.SHADE, linewidth=1.0, label='mean of all')
    ax.errorbar(result.frequency, PC * result.peak, yerr=2.0 * PC * result.sigma, fmt='o',
                color=drawing.BLUE, label='peak ± 2σ')
    ax.set(ylabel='charge peak [pC]', ylim=(0.0, 1.3 * mean),
           title='film 10 x 1 mm, amplitude 2 mm')
    ax.legend(frameon=False, loc='lower right')
    ax = axes['rest']
    ax.axhline(0.0, color=drawing.SHADE, linewidth=1.0)
    ax.errorbar(result.frequency, 100.0 * (PC * result.peak / mean - 1.0),
                yerr=200.0 * PC * result.sigma / mean, fmt='o', color=drawing.BLUE)
    ax.set(xlabel='frequency [Hz]', ylabel='deviation from the mean [%]')
    return figure


def amplitude_figure(result: Proportionality) -> Figure:
    """Return Fig. 7: peaks over amplitude, and their deviation from a straight line."""
    figure, axes = drawing.new_figure([['peaks', 'rest']], width=11.0, height=4.6)
    x = MM * result.amplitude
    ax = axes['peaks']
    ax.errorbar(x, PC * result.peak, yerr=2.0 * PC * result.sigma, fmt='o', color=drawing.BLUE,
                label='bench ± 2σ')
    line = np.polyval(result.line, result.amplitude)
    ax.plot(x, PC * line, color=drawing.BLUE, linewidth=1.0, label='regression line')
    for name, (color, style) in MODEL_STYLES.items():
        ax.plot(x, PC * result.models[name], color=color, linestyle=style, linewidth=1.2,
                label=MODEL_LABELS[name])
    ax.set(xlabel='amplitude [mm]', ylabel='charge peak [pC]')
    ax.legend(frameon=False, fontsize='small')
    ax = axes['rest']
    ax.axhline(0.0, color=drawing.BLUE, linewidth=1.0)
    ax.errorbar(x, PC * (result.peak - line), yerr=2.0 * PC * result.sigma, fmt='o',
                color=drawing.BLUE)
    ax.plot(x, PC * (result.models['exact'] - line), color=drawing.INK, linewidth=1.2)
    ax.set(xlabel='amplitude [mm]', ylabel='deviation from the line [pC]')
    return figure


def fit_figure(result: Identification) -> Figure:
    """Return Fig. 8: measured and estimated loops, with the estimate's transient."""
    figure, axes = drawing.new_figure([['loop']], width=7.5, height=5.2)
    first, ax = result.first, axes['loop']
    shown = first.time < CYCLES
    x = -MM * first.deflection[shown]
    ax.plot(x, NC * first.measured[shown], color=drawing.SKY, linewidth=3.0, label='bench')
    ax.plot(x, NC * first.estimated[shown], color=drawing.INK, linewidth=0.9,
            label='estimated from the deflection')
    ax.plot(x[0], NC * first.estimated[0], color=drawing.VERMILLION, marker='o', linestyle='none',
            label='zero initial condition')
    ax.set(xlabel=DELTA, ylabel=CHARGE)
    ax.legend(frameon=False)
    return figure


def comparison_figure(result: Identification) -> Figure:
    """Return Fig. 9: charge over time, and measured over estimated charge."""
    figure, axes = drawing.new_figure([['time', 'both'], ['rest', 'both']], width=11.0, height=5.0)
    first = result.first
    shown = first.time < CYCLES
    time, measured, estimated = (values[shown] for values in (
        first.time, NC * first.measured, NC * first.estimated))
    axes['time'].plot(time, measured, color=drawing.SKY, linewidth=3.0, label='bench')
    axes['time'].plot(time, estimated, color=drawing.INK, linewidth=0.9, label='estimated')
    axes['time'].set(ylabel=CHARGE)
    axes['time'].legend(frameon=False, loc='lower center', bbox_to_anchor=(0.5, 1.0), ncols=2)
    axes['rest'].plot(time, measured - estimated, color=drawing.VERMILLION, linewidth=0.8)
    axes['rest'].axvline(first.settled, color=drawing.SHADE, linewidth=1.0, linestyle=':')
    axes['rest'].set(xlabel='time [s]', ylabel='difference [nC]')
    settled = first.time >= first.settled
    x = NC * first.estimated[settled]
    axes['both'].plot(x, NC * first.measured[settled], '.', color=drawing.SKY, markersize=3,
                      label='samples')
    ends = np.array([x.min(), x.max()])
    axes['both'].plot(ends, ends, color=drawing.INK, linewidth=0.9, label='slope 1')
    axes['both'].set(xlabel='estimated charge [nC]', ylabel='bench charge [nC]')
    axes['both'].legend(frameon=False)
    return figure


def table_figure(result: Identification) -> Figure:
    """Return Table I as a drawing: errors of the products over their standard errors."""
    figure, axes = drawing.new_figure([list(PRODUCTS)], width=11.0, height=3.8, share_y=True)
    seeds = np.arange(1, len(result.estimates) + 1)
    for name, ax in axes.items():
        true = result.true[name]
        value, sigma = (np.array([getattr(first[name], part) for first in result.estimates])
                        for part in ('value', 'sigma'))
        ax.axhline(0.0, color=drawing.INK, linewidth=1.0)
        ax.errorbar(seeds, 100.0 * (value / true - 1.0), yerr=100.0 * sigma / true, fmt='o',
                    color=drawing.BLUE, capsize=3)
        ax.set(title=SYMBOLS[name], xlabel='recording', ylabel='error [%], ± 1σ')
    axes[PRODUCTS[1]].set_ylabel('')
    axes[PRODUCTS[2]].set_ylabel('')
    return figure


def _draw_loop(ax: Axes, loop: Loop, color: str, label: str, linewidth: float = 1.4) -> None:
    closed = np.append(np.arange(loop.charge.size), 0)
    ax.plot(-MM * loop.deflection[closed], NC * loop.charge[closed], color=color,
            linewidth=linewidth, label=label)
    ax.set(xlabel=DELTA)
