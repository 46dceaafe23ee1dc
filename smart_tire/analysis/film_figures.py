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

"""Figures of a film on the test stand: hysteresis loop, residual and measured deflection."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from smart_tire.analysis import drawing
from smart_tire.analysis.series import Floats

MAX_POINTS = 20_000  # per line, to limit the file size


def _thinned(*series: Floats) -> list[Floats]:
    step = max(len(series[0]) // MAX_POINTS, 1)
    return [values[::step] for values in series]


def write_fit(path: Path, time: Floats, inputs: Floats, measured: Floats, fitted: Floats, *,
              input_label: str, output_label: str) -> None:
    """Draw measured and fitted output over input and time, and the residual over time."""
    figure, axes = drawing.new_figure([['loop', 'time'], ['loop', 'residual']], width=11.0,
                                      height=5.0)
    time, inputs, measured, fitted = _thinned(time, inputs, measured, fitted)
    for name, x in (('loop', inputs), ('time', time)):
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
    drawing.legend_above(figure, axes['loop'])
    drawing.add_caption(
        figure, 'Output of the film over its input and over time, measured and fitted. Residual: '
        'measured minus fitted; its axis ends at five times the 90 % quantile.')
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)


def write_measurement(path: Path, time: Floats, value: Floats, sigma: Floats,
                      reference: Floats | None, *, label: str) -> None:
    """Draw the measured values with a two-sigma band, and the reference if given."""
    figure, axes = drawing.new_figure([['value']], width=9.0)
    time, value, sigma = _thinned(time, value, sigma)
    ax = axes['value']
    ax.fill_between(time, value - 2.0 * sigma, value + 2.0 * sigma, color=drawing.BLUE, alpha=0.25,
                    linewidth=0.0)
    ax.plot(time, value, color=drawing.BLUE, linewidth=1.2, label='film ± 2σ')
    if reference is not None:
        ax.plot(time, *_thinned(reference), label='reference', **drawing.TRUTH)
    ax.set(xlabel='time [s]', ylabel=label)
    drawing.legend_above(figure, ax)
    drawing.add_caption(figure, 'Measurement with the film. Band: ± 2σ, where σ is its standard '
                        'deviation.')
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)
