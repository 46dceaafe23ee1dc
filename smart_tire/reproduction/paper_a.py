# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Figures and report sections of paper A.

Deflections in figures have the sign of the paper, negative when buckled.
"""

from __future__ import annotations

import math

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.models.film.elastica import TOUCHING_STROKE
from smart_tire.models.film.hysteresis import TABLE_I, TABLE_I_GAIN
from smart_tire.reproduction.film_experiments import FREQUENCY, Identification, PRODUCTS
from smart_tire.reproduction.film_experiments import (
    FREQUENCIES, Loop, Proportionality, RateIndependence, Trace)
from smart_tire.reproduction.report import Section

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


GRAPHS_ONLY = ('The paper gives its measurements as graphs only, so the curves can be compared '
               'qualitatively, not point by point.')
SCALED_GAIN = ('Table I is for the 25 x 3 mm film. For this film K is scaled with the geometry as '
               'in A(15), and the shape of the loop (alpha K) is kept. Both are assumptions, so '
               'the charges in {unit} are not a prediction for the film of the paper.')
SIGNIFICANCE_SIGMAS = 3.0
MAX_FREQUENCY_SLOPE = 0.01  # relative change per decade of frequency that counts as constant
MIN_LINE_R2 = 0.95                      # R^2 of points that appear as a straight line in a graph
EXPECTED_SHARES = {1: 0.683, 2: 0.954}  # of a normal distribution within so many sigmas


def trace_section(trace: Trace) -> Section:
    """Return the section on Fig. 4."""
    section = Section('paper_a_fig_4', 'Paper A, Fig. 4: a buckling test at 5 Hz')
    loop = trace.loop
    section.row('motion', '4 (-1 + sin 10 pi t) mm', 'the same')
    section.row('film', '32 x 3 mm, 110 um', 'the same')
    section.row('charge, half its range', 'graph', f'{loop.peak * 1e9:.2f} nC')
    section.row('lag of the charge', 'graph', f'{math.degrees(loop.lag):.1f} degrees')
    section.row('width of the loop over the range', 'graph', f'{loop.height:.0%}')
    section.check(loop.lag > 0.0,
                  'The charge lags behind the deflection, here by '
                  f'{math.degrees(loop.lag):.1f} degrees of the cycle, in a loop with a width of '
                  f'{loop.height:.0%} of the range.',
                  'The charge does not lag behind the deflection.')
    section.limitation(SCALED_GAIN.format(unit='nC'))
    section.limitation(GRAPHS_ONLY)
    section.limitation('A(8b) requires half the end stroke for each half of the film, so '
                       'delta = Delta / 2L is used, where the paper prints Delta / L.')
    return section


def rate_section(result: RateIndependence) -> Section:
    """Return the section on Fig. 6."""
    section = Section('paper_a_fig_6', 'Paper A, Fig. 6: loops and peaks over frequency')
    low, high = FREQUENCIES[0], FREQUENCIES[-1]
    section.row('(a) 5 against 10 Hz: rms difference', 'one pattern (graph)',
                f'{result.difference:.2f} of its standard error')
    section.row(f'(b) range of the peaks, {low:.0f} to {high:.0f} Hz', 'constant (graph)',
                f'{result.spread:.1%} of the mean')
    section.row('(b) change per decade of frequency', 'none',
                f'{result.slope:+.2%} ± {result.slope_sigma:.2%}')
    section.check(result.difference < SIGNIFICANCE_SIGMAS,
                  'The loops at 5 and 10 Hz agree within the noise of the test stand.',
                  'The loops at 5 and 10 Hz differ by more than the noise of the test stand.')
    section.check(
        abs(result.slope) < max(MAX_FREQUENCY_SLOPE, SIGNIFICANCE_SIGMAS * result.slope_sigma),
        f'The peaks are constant from {low:.0f} to {high:.0f} Hz: they change by '
        f'{result.slope:+.2%} ± {result.slope_sigma:.2%} per decade, as expected of a '
        'rate-independent operator.',
        f'The peaks change by {result.slope:+.2%} per decade of frequency.')
    section.limitation('The agreement is a property of the model: film and operator are '
                       'rate-independent, and only the corner frequencies of the charge amplifier '
                       'and noise depend on the rate. It shows that the instruments do not change '
                       'this, not that a real film is rate-independent.')
    section.limitation(SCALED_GAIN.format(unit='nC and pC'))
    section.limitation('With the printed delta = Delta / L, the 16 mm of (a) would close the '
                       'clamps of the 32 mm film (delta = 1); by A(8b) delta is Delta / 2L = 0.5.')
    return section


def amplitude_section(result: Proportionality) -> Section:
    """Return the section on Fig. 7."""
    section = Section('paper_a_fig_7', 'Paper A, Fig. 7: peaks over amplitude at 2 Hz')
    rise, sigma = result.rise
    first, last = result.amplitude[[0, -1]] * 1e3
    excess = result.models['printed'][-1] / result.models['exact'][-1] - 1.0
    section.row('straight line through the peaks, R^2', 'proportional (graph)',
                f'{result.determination:.3f}')
    section.row('largest distance of the exact curve from its straight line', '-',
                f'{result.curvature:.1%} of the largest peak')
    section.row(f'charge per amplitude, {last:.1f} against {first:.2f} mm', 'the same',
                f'{rise:+.1%} ± {sigma:.1%} (exact {result.exact_rise():+.1%})')
    section.check(result.determination > MIN_LINE_R2,
                  'The peaks are close to a straight line, which explains '
                  f'{result.determination:.1%} of their variance. The exact curve is at most '
                  f'{result.curvature:.1%} of the largest peak below its own line.',
                  'A straight line does not describe the peaks.')
    section.check(abs(rise - result.exact_rise()) < SIGNIFICANCE_SIGMAS * sigma,
                  'The simulated measurements have the exact curvature: charge per amplitude '
                  f'increases by {rise:.0%} ± {sigma:.0%}, by {result.exact_rise():.0%} in the '
                  'models without noise.',
                  'The simulated measurements do not have the curvature of the exact models.')
    section.limitation(
        'The paper describes the peaks as proportional, which holds for small strokes only: '
        f'charge per amplitude increases by {result.exact_rise(0.5):.0%} up to a quarter of the '
        f'film and by {result.exact_rise():.0%} up to half of it. There the exact charge exceeds '
        f'A(16) by {result.elastica_rise:.0%}, and hysteresis alone makes the loop '
        f'{result.loop_rise:.0%} steeper; A(15) as printed, with -1/2 instead of -7/32 in its '
        f'second order, exceeds the exact peak by {excess:.0%}.')
    section.limitation('The paper does not give the amplitudes as numbers; here the largest range '
                       'is half the film, which the paper states for all its experiments. '
                       + SCALED_GAIN.format(unit='pC'))
    return section


def fit_section(result: Identification) -> Section:
    """Return the section on Fig. 8."""
    section = Section('paper_a_fig_8', 'Paper A, Fig. 8: measured and estimated loops')
    first = result.first
    section.row('film and motion', '25 x 3 mm, 110 um; 5 Hz, 6 mm', 'the same')
    section.row('convergence from the initial state after', 'the first few cycles',
                f'{first.settled:.2f} s = {first.settled * FREQUENCY:.1f} cycles')
    section.row('rms of measured minus estimated afterwards', 'graph',
                f'{first.rms * 1e9:.3f} nC')
    section.check(first.settled > 0.0,
                  'From a zero initial condition the estimate starts outside the loop and '
                  f'converges to it within {first.settled * FREQUENCY:.1f} cycles.',
                  'The estimate is on the loop from the start.')
    section.check(first.determination > 0.99,
                  'Afterwards the measured and the estimated loop agree.',
                  'The estimated loop differs from the measured one.')
    section.limitation('The measured loop is that of a simulated film with the same model, so a '
                       'good fit is expected. The sharp tip, where the stage stretched the real '
                       'film, is missing because the elastica model ends at the flat film.')
    if result.touches:
        section.limitation('With the printed delta = Delta / L this motion reaches delta = '
                           f'{result.printed_stroke:.2f}, beyond {TOUCHING_STROKE:.3f}, where a '
                           'film touches itself; Delta / 2L is half of it.')
    return section


def comparison_section(result: Identification) -> Section:
    """Return the section on Fig. 9."""
    section = Section('paper_a_fig_9', 'Paper A, Fig. 9: measured against estimated charge')
    first = result.first
    section.row('slope of measured over estimated', '1', f'{first.slope:.4f}')
    section.row('R^2', 'graph', f'{first.determination:.4f}')
    section.check(abs(first.slope - 1.0) < 0.01,
                  'Measured over estimated charge is a straight line with slope '
                  f'{first.slope:.3f} and R^2 = {first.determination:.4f}.',
                  f'The slope is {first.slope:.3f}, not 1.')
    section.limitation('The scatter is the assumed noise of the simulated instruments only, and '
                       'the sharp positive peak of a film under tension is missing, see Fig. 8. '
                       'Offset and slow drift of the amplifier are subtracted.')
    return section


def table_section(result: Identification) -> Section:
    """Return the section on Table I."""
    section = Section('paper_a_table_1', 'Paper A, Table I: identified parameters')
    alpha, a, b = result.constants(0)
    first = result.estimates[0]
    for name, symbol, unit, scale in (
            ('alpha_gain', 'alpha K', '', 1.0), ('a_gain', 'a K', ' nC', 1e9),
            ('b_gain', 'b K', ' nC', 1e9)):
        section.row(symbol, f'{result.true[name] * scale:.3f}{unit}',
                    f'{first[name].value * scale:.3f} ± {first[name].sigma * scale:.3f}{unit}')
    section.row(f'alpha for K = {TABLE_I_GAIN * 1e9:.2f} nC', f'{TABLE_I.alpha * 1e-9:.2f} /nC',
                f'{alpha * 1e-9:.4f} /nC')
    section.row('a, b for the same K', f'{TABLE_I.a}, {TABLE_I.b}', f'{a:.4f}, {b:.4f}')
    section.row('K from geometry, A(15)', '-', f'{result.geometric_gain * 1e9:.2f} nC')
    pulls = np.abs(result.pulls)
    shares = {sigmas: float(np.mean(pulls < sigmas)) for sigmas in EXPECTED_SHARES}
    section.check(float(pulls.max()) < SIGNIFICANCE_SIGMAS,
                  f'The products from all {len(result.estimates)} noisy recordings are within '
                  f'their error bars: {shares[1]:.0%} of the {pulls.size} values within 1 sigma '
                  f'(expected {EXPECTED_SHARES[1]:.0%}), {shares[2]:.0%} within 2 '
                  f'({EXPECTED_SHARES[2]:.0%}), the largest error is {pulls.max():.1f} sigma.',
                  f'A product is outside its error bar, by {pulls.max():.1f} sigma.')
    section.limitation('Only products are observable: (alpha, a, b, K) and (c alpha, c a, c b, '
                       'K / c) give the same charge. The separate constants above depend on the '
                       'given K.')
    section.limitation(f'K = {TABLE_I_GAIN * 1e9:.2f} nC is a fitted gain: geometry and typical '
                       f'PVDF constants give {result.geometric_gain * 1e9:.2f} nC, '
                       f'{TABLE_I_GAIN / result.geometric_gain:.0f} times less. The model does '
                       'not explain the difference.')
    return section
