# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Histograms of normalized errors: errors over the standard deviations that are reported."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.robots.scoring import LATERAL, MU, SLIP, SPEED
from benchmarks.scoring import Errors, pooled, Run
import numpy as np
from smart_tire.arrays import Array

TITLES = {MU: 'friction of crossings', SLIP: 'slip', SPEED: 'forward speed', LATERAL:
          'lateral speed'}
LIMIT = 5.0  # sigmas; the outermost bins hold what lies beyond
EDGES = np.linspace(-LIMIT, LIMIT, 41)


def normalized(errors: Errors) -> Array:
    """Return the errors (n,) over their standard deviations, of those that have one."""
    known = np.isfinite(errors.error) & np.isfinite(errors.sigma)
    return np.asarray(errors.error[known] / errors.sigma[known])


def draw_histograms(runs: Sequence[Run], folder: Path) -> None:
    """Draw the histograms over all ``runs`` to ``normalized_errors.png`` in ``folder``."""
    from matplotlib.figure import Figure
    figure = Figure(figsize=(9.0, 5.6), layout='constrained')
    centers, width = 0.5 * (EDGES[1:] + EDGES[:-1]), float(EDGES[1] - EDGES[0])
    for axes, (name, title) in zip(figure.subplots(2, 2, sharex=True, sharey=True).flat,
                                   TITLES.items()):
        values = normalized(pooled([run.errors[name] for run in runs]))
        counts, _ = np.histogram(np.clip(values, -LIMIT, LIMIT), EDGES)
        axes.bar(centers, counts / max(len(values) * width, 1.0), width, color='tab:blue',
                 label=f'{len(values):,} errors')
        axes.plot(centers, np.exp(-0.5 * centers ** 2) / np.sqrt(2.0 * np.pi), 'k-',
                  label='standard normal')
        axes.set_yscale('log')
        axes.set_ylim(1e-5, 2.0)
        beyond = float(np.mean(np.abs(values) > 3.0)) if len(values) else 0.0
        axes.set_title(f'{title}: NEES {np.mean(values ** 2):.2f}, '
                       f'{100.0 * beyond:.1f} % beyond 3', fontsize='medium')
        axes.legend(loc='upper left', fontsize='small')
    figure.supxlabel('error / standard deviation (outermost bins: all beyond)')
    figure.supylabel('density')
    figure.savefig(folder / 'normalized_errors.png', dpi=80)
