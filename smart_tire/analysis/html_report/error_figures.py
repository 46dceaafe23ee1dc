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

"""Interactive figures of errors against ground truth and of their distribution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smart_tire.analysis.curves import Curve, interrupted, limits
from smart_tire.analysis.errors import ErrorCurve
from smart_tire.analysis.html_report.decimation import decimated
from smart_tire.analysis.html_report.layout import Figure, Panel
from smart_tire.analysis.html_report.traces import band, line, numbers, Spec
from smart_tire.analysis.series import Floats

HISTOGRAM_RANGE, BIN_WIDTH = 5.0, 0.25  # in standard deviations
ZERO_BAND = ('Shaded bands: ± 2σ around zero. If the reported σ is right, 95 % of the errors are '
             'inside; errors of one recording are correlated, so the share varies.')


def error_figure(name: str, title: str, errors: Sequence[ErrorCurve]) -> Figure | None:
    """Return errors over time, one panel per quantity; None without errors."""
    if not errors:
        return None
    panels = []
    for row, error in enumerate(errors):
        curve = interrupted(error.curve)
        sigma = np.zeros(0) if curve.sigma is None else curve.sigma[np.isfinite(curve.value)]
        unit = f' {error.unit}' if error.unit else ''
        drawn = line(curve, 'error', '@blue', unit, legend=row == 0)
        panels.append(Panel(
            error.name, f'error [{error.unit or "-"}]',
            [*_zero_bands(curve), drawn], limits([curve.value, 2.0 * sigma, -2.0 * sigma], 1e-4)))
    return Figure(name, f'{title} over time', f'{title}: estimate minus ground truth. {ZERO_BAND}',
                  panels, panel_height=130)


def _zero_bands(curve: Curve) -> list[Spec]:
    if curve.sigma is None:
        return []
    known = np.isfinite(curve.value)
    zero = replace(curve, value=np.where(known, 0.0, np.nan))
    return [band(decimated(zero), 'blue', 'error')]


def histogram_figure(groups: Sequence[tuple[str, Floats]]) -> Figure | None:
    """Return the distribution of normalized errors by group; None without errors."""
    shown = [(name, values) for name, values in groups if len(values)]
    if not shown:
        return None
    edges = np.arange(-HISTOGRAM_RANGE, HISTOGRAM_RANGE + 0.5 * BIN_WIDTH, BIN_WIDTH)
    centers = 0.5 * (edges[:-1] + edges[1:])
    colors = ('@blue', '@vermillion', '@orange', '@sky', '@green')
    traces: list[Spec] = []
    for (name, values), color in zip(shown, colors):
        counts = np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0]
        traces.append(_density(name, centers, counts / (len(values) * BIN_WIDTH), color, 'hvh'))
    normal = np.exp(-0.5 * centers ** 2) / np.sqrt(2.0 * np.pi)
    traces.append({**_density('standard normal', centers, normal, '@ink', 'spline'),
                   'line': {'color': '@ink', 'width': 1.4, 'dash': 'dash', 'shape': 'spline'}})
    return Figure(
        'normalized', 'Distribution of the normalized errors compared with a standard normal',
        'Errors divided by their reported standard deviations. A consistent estimator follows the '
        'standard normal distribution (dashed); a wider curve means that σ is too small. Errors '
        'beyond ± 5σ are counted in the outer bins.',
        [Panel('Normalized errors', 'density [-]', traces)], 'error / σ [-]', 260)


def _density(name: str, x: Floats, y: Floats, color: str, shape: str) -> Spec:
    return {'type': 'scatter', 'mode': 'lines', 'name': name, 'x': numbers(x),
            'y': numbers(y, 4), 'line': {'color': color, 'width': 1.6, 'shape': shape},
            'hovertemplate': '%{y:.3f}'}
