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

from collections.abc import Mapping

from benchmarks.friction.crossings import FUSED, Rows, SINGLE
from benchmarks.scoring import Figures
import numpy as np
from smart_tire.analysis.figure import (
    Curve, Figure, Mark, Panel, TIME_LABEL, truth_marks, TWO_SIGMA)
from smart_tire.recording import seconds

COLORS = 'orange', 'blue'  # without and with torque
PANELS = {FUSED: 'friction coefficient [-]', 'stiffness': 'C_x [N]'}
MAX_SHOWN = 2.0      # of the true value
GAUSSIAN_90 = 1.645  # sigmas; 90 % quantile of absolute Gaussian errors


def friction_figure(title: str, variants: Mapping[str, Mapping[str, Rows]]) -> Figure:
    """Return mu and C_x of each film wheel over time, by variant, with two-sigma bands."""
    wheels = list(next(iter(variants.values())))
    return Figure('friction', title, f'{title}. {TWO_SIGMA}', [
        [_panel(wheel, name, {variant: rows[wheel] for variant, rows in variants.items()})
         for wheel in wheels] for name in PANELS])


def _panel(wheel: str, name: str, variants: Mapping[str, Rows]) -> Panel:
    marks = []
    for color, (variant, rows) in zip(COLORS, variants.items()):
        time = seconds(rows.stamp_ns, int(rows.stamp_ns[0]))
        marks.append(Mark(Curve(time, rows.value[name], rows.sigma[name]), variant, color))
        if name == FUSED:
            marks.append(Mark(Curve(time, rows.value[SINGLE]), f'{variant}, single crossing',
                              color, 'points', width=2.0))
    true = rows.true[name]
    return Panel([*marks, *truth_marks(Curve(time, true))], TIME_LABEL, PANELS[name],
                 wheel.replace('_', ' '), y_limits=(0.0, MAX_SHOWN * float(true.max())))


def bound_figure(cases: Mapping[str, Figures]) -> Figure:
    """Return the errors of synthesized crossings over the Cramer-Rao bound, by method."""
    marks = []
    for name, color in (('printed', 'vermillion'), ('exact', 'sky'), ('single', 'blue')):
        own = [one for one in cases.values() if f'{name}.q90' in one]
        points = np.log10(100.0 * np.array([(one['bound'], one[f'{name}.q90']) for one in own]).T)
        marks.append(Mark(Curve(*points), 'waveform' if name == 'single' else
                          f'two peaks, {name} map', color, 'points', width=4.0))
    ends = np.log10([100.0 * pick([one['bound'] for one in cases.values()])
                     for pick in (min, max)])
    marks.append(Mark(Curve(ends, ends + np.log10(GAUSSIAN_90)),
                      'optimum: Gaussian errors at the bound', 'ink'))
    return Figure('bound', 'errors of one crossing over the bound', '', [[Panel(
        marks, 'log10 of the Cramér-Rao bound of one crossing [% of μ]',
        'log10 of the 90 % quantile of errors [% of μ]')]], cell=(9.0, 6.0))
