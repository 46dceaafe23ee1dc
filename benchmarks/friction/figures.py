"""Figures of the benchmark of friction."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from benchmarks.friction.example_figures import Example, example
from benchmarks.friction.grid import FASTER
from benchmarks.friction.methods import (
    ESTIMATED, EXACT_MAP, METHODS, PRINTED_MAP, SOURCES, TRUE, WAVEFORM)
from benchmarks.friction.monte_carlo import CaseResult
from benchmarks.friction.paper_points import paper_points
from benchmarks.friction.records import FUSED, SINGLE
from benchmarks.friction.results import Part, RunResult
from benchmarks.friction.scoring import JUDGED_BOUND, own_sigma
from smart_tire.analysis import drawing
from smart_tire.analysis.series import Floats, seconds
from smart_tire.reproduction import tire_maps

DRAWN = TRUE, ESTIMATED  # slips with which friction is drawn
EXAMPLES = {'driving': 0.1, 'braking': -0.1}  # -, slips of the passages that are drawn
MM, MV = 1e3, 1e3
SPEED_COLORS = {60.0: drawing.BLUE, FASTER: drawing.ORANGE}  # rpm, of the paper
MAP_COLORS = {EXACT_MAP: drawing.SKY, PRINTED_MAP: drawing.VERMILLION}
RAW = '#b4b4b4'
GAUSSIAN = 1.645     # sigmas that 90 % of Gaussian errors stay below
ALLOWED = 1.3        # standard deviations over the bound, the most that is asked for
DRAWN_ERROR = 1.16   # relative sigma of a deviation off quartiles times the root of the count
SHOWN = 98.0         # %, of the values from one revolution that an axis must hold


def waveform_figure() -> Figure:
    """Return the samples of two passages, driving and braking, with the fit and what it leaves."""
    names = list(EXAMPLES)
    figure, axes = drawing.new_figure([names, [f'{name} rest' for name in names]], width=12.0,
                                    height=6.2, share_x=True)
    for seed, (name, slip) in enumerate(EXAMPLES.items()):
        found = example(slip, seed)
        _draw_waveform(axes[name], found)
        _draw_residual(axes[f'{name} rest'], found)
        axes[name].set(title=f'{name}, slip {slip:+.2f}: μ = {found.mu[0]:.3f} ± '
                             f'{found.mu[1]:.3f}, truth {found.truth:.3f}')
    axes['braking'].sharey(axes['driving'])
    axes['braking rest'].sharey(axes['driving rest'])
    drawing.finish(figure, axes)
    return figure


def _draw_waveform(ax: Axes, found: Example) -> None:
    for film, color in zip(found.films, drawing.FILM_COLORS):
        ax.plot(MM * film.way, film.volts, '.', color=color, markersize=5,
                label=f'film {film.number}, samples')
        ax.plot(MM * film.fine, film.fitted, color=color, linewidth=1.1,
                label=f'film {film.number}, fit')
    ax.set(ylabel='above rest [V]')


def _draw_residual(ax: Axes, found: Example) -> None:
    ax.axhspan(-2.0 * MV * found.noise, 2.0 * MV * found.noise, color=drawing.SHADE, alpha=0.18,
               linewidth=0.0)
    for film, color in zip(found.films, drawing.FILM_COLORS):
        ax.plot(MM * film.way, MV * film.left, '.-', color=color, linewidth=0.6, markersize=4)
    ax.set(xlabel='rolled since film 1 was in the middle [mm]',
           ylabel='samples minus fit [mV]\n(band: ± 2σ of a sample)')


def friction_figure(title: str, result: RunResult) -> Figure:
    """Return mu per revolution with bands, for each wheel, with true and estimated slip."""
    wheels = list(dict.fromkeys(wheel for wheel, _, _ in result.parts))
    panels = [[f'{wheel.replace("_", " ")}, {SOURCES[source]}' for source in DRAWN]
              for wheel in wheels]
    figure, axes = drawing.new_figure(panels, width=13.0, height=1.0 + 3.0 * len(wheels),
                                    share_x=True, share_y=True)
    top = 0.0
    for wheel, row in zip(wheels, panels):
        for source, panel in zip(DRAWN, row):
            part = result.parts[wheel, source, WAVEFORM]
            _draw_run(axes[panel], wheel, part)
            axes[panel].set(title=f'{title}: {panel}')
            top = max(top, _top(part))
    axes[panels[0][0]].set_ylim(0.0, top)
    drawing.finish(figure, axes)
    return figure


def _draw_run(ax: Axes, wheel: str, part: Part) -> None:
    """Draw mu per revolution; what C_x and load leave open is a band of its own."""
    rows = part.rows
    time = seconds(rows.stamp_ns, int(rows.stamp_ns[0]) if len(rows.stamp_ns) else 0)
    mu, whole = rows.value[FUSED], rows.sigma[FUSED]
    ax.fill_between(time, mu - 2.0 * whole, mu + 2.0 * whole, color=drawing.SHADE, alpha=0.16,
                    linewidth=0.0, label='fused ± 2σ, with those of $C_x$ and load')
    fused = mu * rows.sigma['critical_slip'] / rows.value['critical_slip']
    drawing.draw_friction(ax, drawing.FrictionCurve(
        wheel, time, rows.value[SINGLE], own_sigma(rows), mu, fused, time, rows.true[FUSED]))


def _top(part: Part) -> float:
    """Return where the axis must end at least."""
    told = part.rows.value[SINGLE][np.isfinite(part.rows.value[SINGLE])]
    single = float(np.percentile(told, SHOWN)) if len(told) else 0.0
    return 1.3 * max(single, float(part.rows.true[FUSED].max(initial=0.0)))


def bound_figure(cases: Sequence[CaseResult]) -> Figure:
    """Return errors, deviations and biases of synthesised passages beside the bound."""
    figure, axes = drawing.new_figure([['all', 'over'], ['all', 'bias']], width=13.0, height=6.4)
    bound = np.array([one.bound for one in cases])
    own = [one.trials[WAVEFORM] for one in cases]
    deviation, bias, large = np.array([(one.spread, one.bias, one.large) for one in own]).T
    slip = np.array([one.case.slip for one in cases])
    ax = axes['all']
    for method in (PRINTED_MAP, EXACT_MAP):
        read = [one for one in cases if method in one.trials]
        ax.plot([100.0 * one.bound for one in read],
                [100.0 * one.trials[method].large for one in read], 'x', markersize=5,
                color=MAP_COLORS[method], label=METHODS[method])
    ax.plot(100.0 * bound, 100.0 * large, 'o', markersize=4, color=drawing.BLUE,
            label=METHODS[WAVEFORM])
    ends = np.array([0.7 * bound.min(), 1.4 * bound.max()])
    ax.plot(100.0 * ends, 100.0 * GAUSSIAN * ends, color=drawing.INK, linewidth=1.1,
            label='best possible: Gaussian errors as large as the bound')
    ax.set(xscale='log', yscale='log', xlabel='Cramér-Rao bound of one revolution [% of μ]',
           ylabel='error that 90 % stay below [% of μ]', ylim=(70.0 * ends[0], 1000.0))
    ax.legend(frameon=False, loc='lower right')
    telling = bound < JUDGED_BOUND
    _draw_over(axes['over'], slip[telling], (deviation / bound)[telling],
               DRAWN_ERROR / np.sqrt([one.passages for one in cases])[telling])
    axes['bias'].plot(slip[telling], 100.0 * bias[telling], 'o', markersize=4, color=drawing.BLUE)
    axes['bias'].axhline(0.0, color=drawing.INK, linewidth=1.1)
    axes['bias'].set(xlabel='slip [-]', ylabel='median error [% of μ]', ylim=(-2.2, 2.2))
    axes['over'].set(title=f'cases with a bound below {100.0 * JUDGED_BOUND:.0f} %')
    return figure


def _draw_over(ax: Axes, slip: Floats, ratio: Floats, sigma: Floats) -> None:
    ax.errorbar(slip, ratio, yerr=ratio * sigma, fmt='o', markersize=4, elinewidth=0.8,
                color=drawing.BLUE)
    ax.axhline(1.0, color=drawing.INK, linewidth=1.1)
    ax.axhline(ALLOWED, color=drawing.VERMILLION, linewidth=1.1, linestyle='--')
    ax.set(ylabel='deviation over bound [-]', ylim=(0.6, 1.5))


def stretch_figure() -> Figure:
    """Return Fig. 12: q_sm over slip, fitted and as read off raw samples."""
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
    """Return Fig. 13: the adhesion ratio over slip, fitted and as read off raw samples."""
    panels = {'waveform': 'the whole waveform', 'peaks': 'two peaks of raw samples'}
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
