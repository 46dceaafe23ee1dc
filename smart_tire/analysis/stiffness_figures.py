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

"""Figure of an identified stiffness: wheel force over slip."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.calibration.tire.stiffness import StiffnessFit


def write_stiffness(path: Path, found: StiffnessFit) -> None:
    """Draw the fit to ``path``."""
    figure, axes = drawing.new_figure([['force']], width=7.0, height=5.0)
    draw_stiffness(axes['force'], found)
    drawing.legend_on_top(axes['force'])
    drawing.add_caption(figure, 'Force of one wheel over its slip; the slope at zero is C_x, '
                        'given with its standard error.')
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)


def draw_stiffness(ax: Axes, found: StiffnessFit) -> None:
    """Draw force over slip of each interval between wheel samples, the fit and its slope C_x."""
    stiffness = found.stiffness
    ax.plot(found.slip, found.force, '.', color=drawing.SKY, markersize=4,
            label='intervals between wheel samples')
    ax.plot(*found.curve, color=drawing.INK, linewidth=1.2, label='fit, with rolling drag')
    ends = np.array([found.force.min(), found.force.max()])
    ax.plot(ends / stiffness.value, ends, color=drawing.VERMILLION, linewidth=1.2, linestyle='--',
            label=f'C_x = {stiffness.value:.1f} ± {stiffness.sigma:.1f} N')
    ax.set(xlabel='slip ratio [-]', ylabel='force of one wheel, positive in traction [N]')
