# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Figures of paper B."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.analysis.figures import recorded_waveform, typical_crossings, waveform_marks
from smart_tire.analysis.motion_figures import side_marks, slip_curves
from smart_tire.reproduction import tire_maps
from smart_tire.reproduction.tire_maps import CRITICAL, METHODS, MU, Outline, Signals, Sweep
from smart_tire.reproduction.tire_runs import ROBOT, Run, StiffnessFit

MS = 1e3
CURVE_POINTS = 60
SPEED_COLORS = {60.0: drawing.BLUE, 80.0: drawing.ORANGE}
METHOD_COLORS = {'exact': drawing.BLUE, 'printed': drawing.ORANGE, 'paper': drawing.SHADE}
METHOD_LABELS = {'exact': 'exact map', 'printed': 'printed map',
                 'paper': 'printed map, raw peaks, longitudinal slip'}


def outline_figure(result: Outline) -> Figure:
    """Return Fig. 8: the parts of one crossing and their sum, in both release conventions."""
    figure, axes = drawing.new_figure([['fig8', 'state']], width=11.0, height=5.0, share_y=True)
    time = MS * result.time
    for release, ax in axes.items():
        ax.plot(time, result.bending[release], color=drawing.ORANGE, linestyle='--', linewidth=1.2,
                label='bending')
        ax.plot(time, result.stretch, color=drawing.SKY, linestyle='--', linewidth=1.2,
                label='stretching')
        ax.plot(time, result.bending[release] + result.stretch, color=drawing.INK, linewidth=1.6,
                label='sum')
        ax.set(xlabel='time since the film is fully in the patch [ms]', title={
            'fig8': 'release as drawn in Fig. 8', 'state': 'release with charge as a state'
        }[release])
    axes['fig8'].set(ylabel='above the baseline [V]')
    axes['fig8'].legend(frameon=False, loc='lower left')
    _spans(axes['fig8'], result)
    return figure


def _spans(ax: Axes, result: Outline) -> None:
    """Draw the intervals of Fig. 8 below the curve."""
    low = float((result.bending['fig8'] + result.stretch).min())
    end = MS * result.whole
    for number, (length, label) in enumerate((
            (result.whole, r'$\Delta t_L$'), (result.interval, r'$\Delta t_a$ exact'),
            (result.printed_interval, r'$\Delta t_a$ printed'))):
        level = low - 0.15 * (number + 1)
        ax.annotate('', (end, level), (end - MS * length, level), arrowprops={
            'arrowstyle': '<->', 'color': drawing.SHADE, 'shrinkA': 0.0, 'shrinkB': 0.0})
        ax.text(end + 2.0, level, label, va='center', fontsize='small')
    ax.set_ylim(bottom=low - 0.62)


def slip_figure(runs: dict[str, Run]) -> Figure:
    """Return Fig. 10: slips of both sides on two grounds, with the truth."""
    figure, axes = drawing.new_figure([list(runs)], width=11.0, height=4.4, share_y=True)
    for ground, ax in axes.items():
        run = runs[ground]
        drawing.draw_marks(ax, side_marks(
            slip_curves(run.estimates, run.truth, run.origin_ns)))
        ax.set(xlabel='time [s]', ylabel='slip ratio [-]', title=ground, ylim=(-0.3, 0.5),
               xlim=(0.0, (run.end_ns - run.origin_ns) / 1e9))
    drawing.finish(figure, axes)
    return figure


def signal_figure(result: Signals, run: Run) -> Figure:
    """Return Fig. 11: the film voltages over the drive, and in one crossing."""
    figure, axes = drawing.new_figure([['film 1', 'contact'], ['film 2', 'contact']], width=12.0,
                                      height=5.4)
    for film, color in enumerate(drawing.FILM_COLORS):
        ax = axes[f'film {film + 1}']
        ax.plot(result.time, result.volts[:, film], color=color, linewidth=0.6)
        ax.set(ylabel=f'film {film + 1} [V]', xlim=(0.0, 18.0), ylim=(0.0, 3.3))
    axes['film 2'].set_xlabel('time [s]')
    axes['film 1'].tick_params(labelbottom=False)
    for crossing in typical_crossings(run.estimates.crossings):
        contact = recorded_waveform(crossing, run.inputs, ROBOT)
        if contact is not None:
            drawing.draw_marks(axes['contact'], waveform_marks(contact))
            axes['contact'].set(
                xlabel='time after the crossing [ms]', ylabel='amplifier output [V]',
                title=f'one crossing of {contact.wheel.replace("_", " ")}')
            break
    axes['contact'].legend(frameon=False, fontsize='small', loc='lower left')
    return figure


def stretch_figure(result: Sweep) -> Figure:
    """Return Fig. 12: q_sm over slip for two wheel speeds."""
    figure, axes = drawing.new_figure([['stretch']], width=8.0, height=5.2)
    ax, crossings = axes['stretch'], result.crossings
    ax.plot(crossings.slip, crossings.raw_stretch, '.', color='#c4c4c4', markersize=5,
            label='from raw samples')
    for speed, line in result.lines.items():
        chosen = crossings.speed == speed
        color = SPEED_COLORS[speed]
        ax.errorbar(crossings.slip[chosen], crossings.stretch[chosen],
                    yerr=2.0 * crossings.stretch_sigma[chosen], fmt='o', markersize=3,
                    elinewidth=0.8, color=color, label=f'{speed:.0f} rpm ± 2σ')
        ends = np.array([0.0, float(np.nanmax(crossings.slip)) * 1.1])
        ax.plot(ends, line.slope * ends + line.offset, color=color, linewidth=1.0)
    slips = np.linspace(0.0, 1.1 * float(np.nanmax(crossings.slip)), CURVE_POINTS)
    ax.plot(slips, tire_maps.exact_stretch(slips), color=drawing.INK, linewidth=1.2,
            label='exact, longitudinal slip')
    ax.plot(slips, tire_maps.printed_stretch(slips), color=drawing.VERMILLION, linestyle='--',
            linewidth=1.2, label='B(25) with its $L_a$')
    ax.set(xlabel='slip ratio [-]', ylabel='$q_{sm}$ [V]', ylim=(-0.05, None))
    ax.legend(frameon=False, fontsize='small')
    return figure


def adhesion_figure(result: Sweep) -> Figure:
    """Return Fig. 13: adhesion ratio over slip: exact, printed, and the paper's method."""
    figure, axes = drawing.new_figure([['paper', 'maps']], width=12.0, height=5.0, share_y=True)
    crossings = result.crossings
    for speed, color in SPEED_COLORS.items():
        chosen = crossings.speed == speed
        axes['paper'].plot(crossings.slip[chosen], result.ratios['paper'][chosen], 'o',
                           markersize=4, color=color, label=f'{speed:.0f} rpm')
    axes['paper'].set(xlabel='slip ratio [-]', ylabel=r'adhesion ratio $\xi_a$ [-]',
                      title='method of the paper: raw peaks, printed map')
    for method in METHODS[:2]:
        axes['maps'].plot(crossings.total_slip, result.ratios[method], 'o', markersize=4,
                          alpha=0.7, color=METHOD_COLORS[method],
                          label=f'{METHOD_LABELS[method]}, fitted peaks')
    axes['maps'].set(xlabel='total slip [-]', title='the same crossings, fitted waveforms')
    reach = 1.1 * float(np.nanmax(crossings.total_slip))  # NaN: motion not known yet
    slips = np.linspace(0.0, reach, CURVE_POINTS)
    for ax in axes.values():
        ax.plot(slips, 1.0 - slips / CRITICAL, color=drawing.INK, linewidth=1.2,
                label=f'B(22), μ = {MU}')
        ax.plot(slips, tire_maps.printed_ratio(slips), color=drawing.VERMILLION, linestyle='--',
                linewidth=1.2, label='printed map of exact peaks')
        ax.set(xlim=(0.0, reach), ylim=(0.6, 1.1))
        ax.legend(frameon=False, fontsize='small', loc='lower left')
    return figure


def table_figure(result: Sweep, fit: StiffnessFit) -> Figure:
    """Return Table I as drawings: forces for C_x, and friction by method."""
    figure, axes = drawing.new_figure([['force', 'friction']], width=11.0, height=4.6)
    ax = axes['force']
    ax.plot(fit.effective, fit.force, '.', color=drawing.SKY, label='straight drive')
    ends = np.array([fit.effective.min(), fit.effective.max()])
    ax.plot(ends, fit.stiffness * ends, color=drawing.INK, linewidth=1.2,
            label=f'$C_x$ = {fit.stiffness:.1f} N')
    ax.set(xlabel='slip times brush shape, without mean [-]', ylabel='force per wheel [N]')
    ax.legend(frameon=False)
    ax = axes['friction']
    for column, method in enumerate(METHODS):
        values = result.friction[method][np.isfinite(result.friction[method])]
        spread = 0.25 * np.linspace(-1.0, 1.0, values.size)
        ax.plot(column + spread, values, '.', color=METHOD_COLORS[method], alpha=0.6)
        ax.plot([column - 0.35, column + 0.35], [np.median(values)] * 2, color=drawing.INK)
    ax.axhline(MU, **drawing.TRUTH)
    ax.text(2.85, MU + 0.02, 'truth', ha='right', va='bottom')
    labels = [METHOD_LABELS[method].replace(', ', ',\n') for method in METHODS]
    ax.set_xticks(range(len(METHODS)), labels, fontsize='small')
    ax.set(ylabel='friction coefficient [-]', xlim=(-0.5, 2.9),
           ylim=(0.0, 1.6))
    return figure
