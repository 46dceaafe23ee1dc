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

"""Figures of the friction benchmark."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.friction.example_figures import Example, example
from benchmarks.friction.grid import FASTER_SPEED
from benchmarks.friction.methods import EXACT_MAP, METHODS, PRINTED_MAP, WAVEFORM
from benchmarks.friction.monte_carlo import CaseResult
from benchmarks.friction.paper_points import paper_points
from benchmarks.friction.records import FUSED, SINGLE
from benchmarks.friction.results import Part, RunResult
from benchmarks.friction.scoring import MAX_INFORMATIVE_BOUND, own_sigma
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from smart_tire.analysis import drawing
from smart_tire.analysis.figure import Curve
from smart_tire.analysis.figures import FrictionCurve
from smart_tire.analysis.series import Floats, seconds
from smart_tire.reproduction import tire_maps

EXAMPLE_SLIPS = {'driving': 0.1, 'braking': -0.1}  # -, of the crossings in the figure
MM, MV = 1e3, 1e3
SPEED_COLORS = {60.0: drawing.BLUE, FASTER_SPEED: drawing.ORANGE}  # rpm, of the paper
MAP_COLORS = {EXACT_MAP: drawing.SKY, PRINTED_MAP: drawing.VERMILLION}
GAUSSIAN_90 = 1.645  # sigmas; 90 % quantile of absolute Gaussian errors
MAX_RATIO = 1.3      # of the standard deviation to the bound, required
RELATIVE_SPREAD_ERROR = 1.16  # of a spread from quartiles, times the root of the count
SHOWN_PERCENT = 98.0  # of the single estimates inside the axis limits


def waveform_figure() -> Figure:
    """Return samples, fits and residuals of two crossings, driving and braking."""
    names = list(EXAMPLE_SLIPS)
    figure, axes = drawing.new_figure([names, [f'{name} residual' for name in names]], width=12.0,
                                      height=6.2, share_x=True)
    for seed, (name, slip) in enumerate(EXAMPLE_SLIPS.items()):
        found = example(slip, seed)
        _draw_waveform(axes[name], found)
        _draw_residual(axes[f'{name} residual'], found)
        axes[name].set(title=f'{name}, slip {slip:+.2f}: μ = {found.mu[0]:.3f} ± '
                             f'{found.mu[1]:.3f}, truth {found.truth:.3f}')
    axes['braking'].sharey(axes['driving'])
    axes['braking residual'].sharey(axes['driving residual'])
    drawing.finish(figure, axes)
    return figure


def _draw_waveform(ax: Axes, found: Example) -> None:
    for film, color in zip(found.films, drawing.FILM_COLORS):
        ax.plot(MM * film.distance, film.volts, '.', color=color, markersize=5,
                label=f'film {film.number}, samples')
        ax.plot(MM * film.curve_distance, film.fitted, color=color, linewidth=1.1,
                label=f'film {film.number}, fit')
    ax.set(ylabel='voltage above baseline [V]')


def _draw_residual(ax: Axes, found: Example) -> None:
    ax.axhspan(-2.0 * MV * found.noise, 2.0 * MV * found.noise, color=drawing.SHADE, alpha=0.18,
               linewidth=0.0)
    for film, color in zip(found.films, drawing.FILM_COLORS):
        ax.plot(MM * film.distance, MV * film.residual, '.-', color=color, linewidth=0.6,
                markersize=4)
    ax.set(xlabel='rolled distance from film 1 at the patch center [mm]',
           ylabel='residual [mV]\n(band: ± 2σ of a sample)')


def friction_figure(title: str, result: RunResult) -> Figure:
    """Return mu per crossing with bands, for each wheel."""
    wheels = list(dict.fromkeys(wheel for wheel, _ in result.parts))
    figure, axes = drawing.new_figure([[wheel] for wheel in wheels], width=13.0,
                                      height=1.0 + 3.0 * len(wheels), share_x=True, share_y=True)
    for wheel in wheels:
        _draw_run(axes[wheel], wheel, result.parts[wheel, WAVEFORM])
        axes[wheel].set(title=f'{title}: {wheel.replace("_", " ")}')
    axes[wheels[0]].set_ylim(0.0, max(_top(result.parts[wheel, WAVEFORM]) for wheel in wheels))
    drawing.finish(figure, axes)
    return figure


def _draw_run(ax: Axes, wheel: str, part: Part) -> None:
    """Draw mu per crossing, with separate bands with and without the sigmas of C_x and load."""
    rows = part.rows
    time = seconds(rows.stamp_ns, int(rows.stamp_ns[0]) if len(rows.stamp_ns) else 0)
    mu, whole = rows.value[FUSED], rows.sigma[FUSED]
    ax.fill_between(time, mu - 2.0 * whole, mu + 2.0 * whole, color=drawing.SHADE, alpha=0.16,
                    linewidth=0.0, label='fused ± 2σ, including $C_x$ and load')
    fused = mu * rows.sigma['critical_slip'] / rows.value['critical_slip']
    drawing.draw_marks(ax, FrictionCurve(
        Curve(time, rows.value[SINGLE], own_sigma(rows)), Curve(time, mu, fused),
        Curve(time, rows.true[FUSED])).marks)
    ax.set(xlabel='time [s]', ylabel='friction coefficient [-]')


def _top(part: Part) -> float:
    """Return the upper axis limit for ``part``."""
    finite = part.rows.value[SINGLE][np.isfinite(part.rows.value[SINGLE])]
    single = float(np.percentile(finite, SHOWN_PERCENT)) if len(finite) else 0.0
    return 1.3 * max(single, float(part.rows.true[FUSED].max(initial=0.0)))


def bound_figure(cases: Sequence[CaseResult]) -> Figure:
    """Return errors, standard deviations and biases of synthesized crossings over the bound."""
    figure, axes = drawing.new_figure([['all', 'ratio'], ['all', 'bias']], width=13.0, height=6.4)
    bound = np.array([one.bound for one in cases])
    own = [one.trials[WAVEFORM] for one in cases]
    deviation, bias, large = np.array([(one.spread, one.bias, one.large) for one in own]).T
    slip = np.array([one.case.slip for one in cases])
    ax = axes['all']
    for method in (PRINTED_MAP, EXACT_MAP):
        known = [one for one in cases if method in one.trials]
        ax.plot([100.0 * one.bound for one in known],
                [100.0 * one.trials[method].large for one in known], 'x', markersize=5,
                color=MAP_COLORS[method], label=METHODS[method])
    ax.plot(100.0 * bound, 100.0 * large, 'o', markersize=4, color=drawing.BLUE,
            label=METHODS[WAVEFORM])
    ends = np.array([0.7 * bound.min(), 1.4 * bound.max()])
    ax.plot(100.0 * ends, 100.0 * GAUSSIAN_90 * ends, color=drawing.INK, linewidth=1.1,
            label='optimum: Gaussian errors at the bound')
    ax.set(xscale='log', yscale='log', xlabel='Cramér-Rao bound of one crossing [% of μ]',
           ylabel='90 % quantile of absolute errors [% of μ]', ylim=(70.0 * ends[0], 1000.0))
    ax.legend(frameon=False, loc='lower right')
    informative = bound < MAX_INFORMATIVE_BOUND
    _draw_ratio(axes['ratio'], slip[informative], (deviation / bound)[informative],
                RELATIVE_SPREAD_ERROR / np.sqrt([one.crossings for one in cases])[informative])
    axes['bias'].plot(slip[informative], 100.0 * bias[informative], 'o', markersize=4,
                      color=drawing.BLUE)
    axes['bias'].axhline(0.0, color=drawing.INK, linewidth=1.1)
    axes['bias'].set(xlabel='slip [-]', ylabel='median error [% of μ]', ylim=(-2.2, 2.2))
    axes['ratio'].set(title=f'cases with a bound below {100.0 * MAX_INFORMATIVE_BOUND:.0f} %')
    return figure


def _draw_ratio(ax: Axes, slip: Floats, ratio: Floats, sigma: Floats) -> None:
    ax.errorbar(slip, ratio, yerr=ratio * sigma, fmt='o', markersize=4, elinewidth=0.8,
                color=drawing.BLUE)
    ax.axhline(1.0, color=drawing.INK, linewidth=1.1)
    ax.axhline(MAX_RATIO, color=drawing.VERMILLION, linewidth=1.1, linestyle='--')
    ax.set(ylabel='standard deviation over bound [-]', ylim=(0.6, 1.5))


def stretch_figure() -> Figure:
    """Return Fig. 12: q_sm over slip, fitted and from peaks of raw samples."""
    figure, axes = drawing.new_figure([['stretch']], width=8.5, height=5.4)
    ax = axes['stretch']
    for rpm, color in SPEED_COLORS.items():
        found = paper_points(rpm)
        ax.plot(found.slip, found.raw_stretch, 'x', color=color, alpha=0.55, markersize=4,
                label=f'{rpm:.0f} rpm, two peaks of raw samples')
        ax.errorbar(found.slip, found.stretch, yerr=2.0 * found.stretch_sigma, fmt='o',
                    markersize=3.5, elinewidth=0.8, color=color,
                    label=f'{rpm:.0f} rpm, waveform ± 2σ')
    slips = np.linspace(0.0, 0.31, 200)
    ax.plot(slips, tire_maps.exact_stretch(slips), color=drawing.INK, linewidth=1.2,
            label='exact')
    ax.plot(slips, tire_maps.printed_stretch(slips), color=drawing.VERMILLION, linestyle='--',
            linewidth=1.2, label='B(25)')
    ax.set(xlabel='slip ratio [-]', ylabel='$q_{sm}$ of film 1 [V]', xlim=(0.0, 0.31),
           title='Fig. 12 of paper B')
    ax.legend(frameon=False, loc='upper left')
    return figure


def adhesion_figure() -> Figure:
    """Return Fig. 13: adhesion ratio over slip, fitted and from peaks of raw samples."""
    panels = {'waveform': 'waveform fit', 'peaks': 'two peaks of raw samples'}
    figure, axes = drawing.new_figure([list(panels)], width=13.0, height=5.2, share_y=True)
    for rpm, marker in zip(SPEED_COLORS, ('o', '^')):
        found = paper_points(rpm)
        axes['waveform'].errorbar(found.slip, found.ratio, yerr=2.0 * found.ratio_sigma,
                                  fmt=marker, markersize=3.5, elinewidth=0.8,
                                  color=SPEED_COLORS[rpm], label=f'{rpm:.0f} rpm ± 2σ')
        for method, color in MAP_COLORS.items():
            axes['peaks'].plot(found.slip, found.raw_ratio[method], marker, markersize=4,
                               color=color, alpha=0.75,
                               label=f'{rpm:.0f} rpm, {METHODS[method].partition(", ")[2]}')
    slips = np.linspace(-0.31, 0.31, 201)
    for name, ax in axes.items():
        ax.plot(slips, 1.0 - np.abs(slips) / tire_maps.CRITICAL, color=drawing.INK, linewidth=1.2,
                label=f'B(22), μ = {tire_maps.MU}')
        ax.set(xlabel='slip ratio [-]', ylim=(0.2, 1.1),
               title=f'Fig. 13 of paper B: {panels[name]}')
        ax.legend(frameon=False, loc='lower center' if name == 'waveform' else 'lower left')
    axes['waveform'].set(ylabel=r'adhesion ratio $\xi_a$ [-]', xlim=(-0.31, 0.31))
    axes['peaks'].set(xlim=(0.0, 0.31))
    return figure
