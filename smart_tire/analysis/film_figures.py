"""Figures of a film on the bench: its loop, what the fit leaves, and what it measures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from smart_tire.analysis import drawing
from smart_tire.analysis.series import Floats

MOST_POINTS = 20_000  # of a line: more only make the file large


def _thinned(*series: Floats) -> list[Floats]:
    step = max(len(series[0]) // MOST_POINTS, 1)
    return [values[::step] for values in series]


def write_fit(path: Path, time: Floats, moved: Floats, measured: Floats, fitted: Floats, *,
              input_label: str, output_label: str) -> None:
    """Draw measured and fitted output over the input and over time, and their difference."""
    figure, axes = drawing.new_figure([['loop', 'time'], ['loop', 'residual']], width=11.0,
                                    height=5.0)
    time, moved, measured, fitted = _thinned(time, moved, measured, fitted)
    for name, x in (('loop', moved), ('time', time)):
        axes[name].plot(x, measured, color=drawing.SKY, linewidth=1.6, label='measured')
        axes[name].plot(x, fitted, color=drawing.INK, linewidth=0.9,
                        label='Duhem operator, fitted')
    axes['residual'].plot(time, measured - fitted, color=drawing.VERMILLION, linewidth=0.8)
    size = 5.0 * float(np.quantile(np.abs(measured - fitted), 0.9))
    axes['residual'].set(xlabel='time [s]', ylabel=f'residual, {output_label}')
    if size > 0.0:
        axes['residual'].set_ylim(-size, size)
    axes['loop'].set(xlabel=input_label, ylabel=output_label)
    axes['time'].set(xlabel='time [s]', ylabel=output_label)
    axes['loop'].legend(frameon=False)
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)


def write_measurement(path: Path, time: Floats, value: Floats, sigma: Floats,
                      reference: Floats | None, *, label: str) -> None:
    """Draw what the film measures with two sigma, and the reference if there is one."""
    figure, axes = drawing.new_figure([['value']], width=9.0)
    time, value, sigma = _thinned(time, value, sigma)
    ax = axes['value']
    ax.fill_between(time, value - 2.0 * sigma, value + 2.0 * sigma, color=drawing.BLUE, alpha=0.25,
                    linewidth=0.0)
    ax.plot(time, value, color=drawing.BLUE, linewidth=1.2, label='film ± 2σ')
    if reference is not None:
        ax.plot(time, *_thinned(reference), label='reference', **drawing.TRUTH)
    ax.set(xlabel='time [s]', ylabel=label)
    ax.legend(frameon=False)
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)
