"""Drawings of paper B's figures."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.analysis.figures import contact_of, slip_curves, typical_passages
from smart_tire.reproduction import tire_maps
from smart_tire.reproduction.tire_maps import CRITICAL, MU, Outline, Signals, Sweep, WAYS
from smart_tire.reproduction.tire_runs import ROBOT, Run, StiffnessFit

MS = 1e3
POINTS = 60  # of a curve
SPEED_COLORS = {60.0: drawing.BLUE, 80.0: drawing.ORANGE}
WAY_COLORS = {'exact': drawing.BLUE, 'printed': drawing.ORANGE, 'paper': drawing.SHADE}
WAY_LABELS = {'exact': 'exact map', 'printed': 'printed map',
              'paper': 'printed map, raw peaks, longitudinal slip'}


def outline_figure(found: Outline) -> Figure:
    """Return Fig. 8: the parts of one passage and their sum, in both release conventions."""
    figure, axes = drawing.new_figure([['fig8', 'state']], width=11.0, height=5.0, share_y=True)
    time = MS * found.time
    for release, ax in axes.items():
        ax.plot(time, found.bending[release], color=drawing.ORANGE, linestyle='--', linewidth=1.2,
                label='bending')
        ax.plot(time, found.stretch, color=drawing.SKY, linestyle='--', linewidth=1.2,
                label='stretching')
        ax.plot(time, found.bending[release] + found.stretch, color=drawing.INK, linewidth=1.6,
                label='sum')
        ax.set(xlabel='time since the film is all in the patch [ms]', title={
            'fig8': 'release as drawn in Fig. 8', 'state': 'release of a charge that is a state'
        }[release])
    axes['fig8'].set(ylabel='above rest [V]')
    axes['fig8'].legend(frameon=False, loc='lower left')
    _spans(axes['fig8'], found)
    return figure


def _spans(ax: Axes, found: Outline) -> None:
    """Draw the intervals of Fig. 8 below the curve."""
    low = float((found.bending['fig8'] + found.stretch).min())
    end = MS * found.whole
    for number, (length, label) in enumerate((
            (found.whole, r'$\Delta t_L$'), (found.interval, r'$\Delta t_a$ exact'),
            (found.printed_interval, r'$\Delta t_a$ printed'))):
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
        drawing.draw_slip(ax, slip_curves(run.estimates, run.truth, run.origin_ns))
        ax.set(title=ground, xlim=(0.0, (run.end_ns - run.origin_ns) / 1e9), ylim=(-0.3, 0.5))
    drawing.finish(figure, axes)
    return figure


def signal_figure(found: Signals, run: Run) -> Figure:
    """Return Fig. 11: the films' voltages over the drive, and through one contact."""
    figure, axes = drawing.new_figure([['film 1', 'contact'], ['film 2', 'contact']], width=12.0,
                                    height=5.4)
    for film, color in enumerate(drawing.FILM_COLORS):
        ax = axes[f'film {film + 1}']
        ax.plot(found.time, found.volts[:, film], color=color, linewidth=0.6)
        ax.set(ylabel=f'film {film + 1} [V]', xlim=(0.0, 18.0), ylim=(0.0, 3.3))
    axes['film 2'].set_xlabel('time [s]')
    axes['film 1'].tick_params(labelbottom=False)
    for passage in typical_passages(run.estimates.passages):
        contact = contact_of(passage, run.inputs, ROBOT)
        if contact is not None:
            drawing.draw_contact(axes['contact'], contact)
            break
    axes['contact'].legend(frameon=False, fontsize='small', loc='lower left')
    return figure


def stretch_figure(found: Sweep) -> Figure:
    """Return Fig. 12: q_sm over slip for two wheel speeds."""
    figure, axes = drawing.new_figure([['stretch']], width=8.0, height=5.2)
    ax, told = axes['stretch'], found.passages
    ax.plot(told.slip, told.raw_stretch, '.', color='#c4c4c4', markersize=5,
            label='off raw samples')
    for speed, line in found.lines.items():
        chosen = told.speed == speed
        color = SPEED_COLORS[speed]
        ax.errorbar(told.slip[chosen], told.stretch[chosen], yerr=2.0 * told.stretch_sigma[chosen],
                    fmt='o', markersize=3, elinewidth=0.8, color=color,
                    label=f'{speed:.0f} rpm ± 2σ')
        ends = np.array([0.0, float(told.slip.max()) * 1.1])
        ax.plot(ends, line.slope * ends + line.offset, color=color, linewidth=1.0)
    slips = np.linspace(0.0, 1.1 * float(told.slip.max()), POINTS)
    ax.plot(slips, tire_maps.highest_stretch(slips), color=drawing.INK, linewidth=1.2,
            label='exact, slip straight ahead')
    ax.plot(slips, tire_maps.printed_stretch(slips), color=drawing.VERMILLION, linestyle='--',
            linewidth=1.2, label='B(25) with its $L_a$')
    ax.set(xlabel='slip ratio [-]', ylabel='$q_{sm}$ [V]', ylim=(-0.05, None))
    ax.legend(frameon=False, fontsize='small')
    return figure


def adhesion_figure(found: Sweep) -> Figure:
    """Return Fig. 13: adhesion ratio over slip, exact, printed, and as the paper reads it."""
    figure, axes = drawing.new_figure([['paper', 'maps']], width=12.0, height=5.0, share_y=True)
    told = found.passages
    for speed, color in SPEED_COLORS.items():
        chosen = told.speed == speed
        axes['paper'].plot(told.slip[chosen], found.ratios['paper'][chosen], 'o', markersize=4,
                           color=color, label=f'{speed:.0f} rpm')
    axes['paper'].set(xlabel='slip ratio [-]', ylabel=r'adhesion ratio $\xi_a$ [-]',
                      title='as the paper reads it: raw peaks, printed map')
    for way in WAYS[:2]:
        axes['maps'].plot(told.total_slip, found.ratios[way], 'o', markersize=4, alpha=0.7,
                          color=WAY_COLORS[way], label=f'{WAY_LABELS[way]}, fitted peaks')
    axes['maps'].set(xlabel='total slip [-]', title='the same passages, fitted waveforms')
    reach = 1.1 * float(told.total_slip.max())
    slips = np.linspace(0.0, reach, POINTS)
    for ax in axes.values():
        ax.plot(slips, 1.0 - slips / CRITICAL, color=drawing.INK, linewidth=1.2,
                label=f'B(22), μ = {MU}')
        ax.plot(slips, tire_maps.printed_ratio(slips), color=drawing.VERMILLION, linestyle='--',
                linewidth=1.2, label='printed map of exact peaks')
        ax.set(xlim=(0.0, reach), ylim=(0.6, 1.1))
        ax.legend(frameon=False, fontsize='small', loc='lower left')
    return figure


def table_figure(found: Sweep, fit: StiffnessFit) -> Figure:
    """Return Table I as drawings: forces for C_x, and friction by way."""
    figure, axes = drawing.new_figure([['force', 'friction']], width=11.0, height=4.6)
    ax = axes['force']
    ax.plot(fit.effective, fit.force, '.', color=drawing.SKY, label='straight run')
    ends = np.array([fit.effective.min(), fit.effective.max()])
    ax.plot(ends, fit.stiffness * ends, color=drawing.INK, linewidth=1.2,
            label=f'$C_x$ = {fit.stiffness:.1f} N')
    ax.set(xlabel='slip times brush shape, without mean [-]', ylabel='force per wheel [N]')
    ax.legend(frameon=False)
    ax = axes['friction']
    told = [found.friction[way][np.isfinite(found.friction[way])] for way in WAYS]
    for place, (way, values) in enumerate(zip(WAYS, told)):
        spread = 0.25 * np.linspace(-1.0, 1.0, values.size)
        ax.plot(place + spread, values, '.', color=WAY_COLORS[way], alpha=0.6)
        ax.plot([place - 0.35, place + 0.35], [np.median(values)] * 2, color=drawing.INK)
    ax.axhline(MU, **drawing.TRUTH)
    ax.text(2.85, MU + 0.02, 'truth', ha='right', va='bottom')
    ax.set_xticks(range(len(WAYS)), [WAY_LABELS[way].replace(', ', ',\n') for way in WAYS],
                  fontsize='small')
    ax.set(ylabel='friction coefficient [-]', xlim=(-0.5, 2.9),
           ylim=(0.0, 1.6))
    return figure
