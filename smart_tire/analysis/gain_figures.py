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

"""Figure of identified gains: stretch voltage over slip of each film, and a fitted crossing."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.calibration.film.results import FilmGain, GainFit, Waveform

MM = 1e3


def write_gains(path: Path, found: GainFit) -> bool:
    """Draw the identified gains to ``path``; return False without any."""
    wheels = list(dict.fromkeys(one.wheel for one in found.films if one.gain is not None))
    if not wheels:
        return False
    panels = [*wheels, *(['waveform'] if found.example is not None else [])]
    figure, axes = drawing.new_figure([panels], width=5.0 * len(panels), height=4.4)
    for wheel in wheels:
        draw_gains(axes[wheel], [one for one in found.films if one.wheel == wheel])
        axes[wheel].set(title=wheel.replace('_', ' '))
    if found.example is not None:
        draw_waveform(axes['waveform'], found.example)
    for ax in axes.values():
        drawing.legend_on_top(ax)
    drawing.add_caption(
        figure, 'Points: patch crossings, bars: ± 1σ of stretch voltage and slip. Lines: '
        'identified gains with their standard errors. Right: the films during one crossing; '
        'samples at the limit of the amplifier output are not fitted.'
        if found.example is not None else
        'Points: patch crossings, bars: ± 1σ of stretch voltage and slip. Lines: identified gains '
        'with their standard errors.')
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)
    return True


def draw_gains(ax: Axes, films: list[FilmGain]) -> None:
    """Draw stretch voltage over slip of the films of a wheel, and their gains as lines."""
    for one, color in zip(films, drawing.FILM_COLORS * len(films)):
        if one.per_slip is None:
            continue
        volts = one.per_slip
        ax.errorbar(one.slip, one.stretch, xerr=one.slip_sigma, yerr=one.stretch_sigma, fmt='.',
                    color=color, markersize=4, elinewidth=0.6, alpha=0.55)
        ends = np.array([min(one.slip.min(), 0.0), max(one.slip.max(), 0.0)])
        ax.plot(ends, volts.value * ends, color=color, linewidth=1.4,
                label=f'film {one.film + 1}: {volts.value:.3f} ± {volts.sigma:.3f} V per unit')
    ax.set(xlabel='slip ratio ± 1σ [-]', ylabel='stretch voltage at full adhesion ± 1σ [V]')
    ax.locator_params(axis='x', nbins=5)  # more labels would overlap


def draw_waveform(ax: Axes, example: Waveform) -> None:
    """Draw the samples and the fitted waveform of one crossing."""
    colors = drawing.FILM_COLORS * len(example.films)
    for i, (film, color) in enumerate(zip(example.films, colors)):
        ax.plot(MM * example.distance[i], example.volts[i], '.', color=color, markersize=5,
                label=f'film {film + 1}, samples')
        ax.plot(MM * example.distance[i], example.fitted[i], color=color, linewidth=1.1,
                label=f'film {film + 1}, fit')
    ax.set(title=f'{example.wheel.replace("_", " ")}, slip {example.slip:+.3f}',
           xlabel='rolled distance [mm]', ylabel='voltage above baseline [V]')
