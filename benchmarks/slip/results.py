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

"""Scores as named figures per run, method and seed, and their combination over seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

from benchmarks.slip.scoring import PathScore, RunScore
from smart_tire.analysis.metrics import Score

Figures = dict[str, float]

ERRORS = (  # combined by their root mean square
    'slip_left', 'slip_right', 'slip_left_all_times', 'slip_right_all_times', 'speed',
    'speed_all_times',
    'position_rms', 'position_end', 'position_rms_percent', 'position_end_percent',
    'heading_rms', 'heading_end', 'icr_x')  # all others by their mean


@dataclass(frozen=True)
class RunResult:
    """The figures of every method on one run."""

    run: str
    seed: int
    figures: dict[str, Figures]  # method -> figures
    notes: tuple[str, ...] = ()  # lines below the table


def figures_of(score: RunScore) -> Figures:
    """
    Return the figures of one score in SI units, except percent and microseconds.

    Slip and speed are scored at the selected times, with suffix ``_all_times`` at all times.
    ``nees`` is the mean normalized squared error, ``within_two`` the share within two sigma
    (position: within the 95 % ellipse).
    """
    sides = {'slip_left': score.left, 'slip_right': score.right}
    figures = {'speed': score.speed.selected.rms, 'speed_all_times': score.speed.all_times.rms}
    for name, parts in sides.items():
        figures |= {name: parts.selected.rms, f'{name}_all_times': parts.all_times.rms}
    for name, selected in {**{name: parts.selected for name, parts in sides.items()},
                           'speed': score.speed.selected}.items():
        figures |= _statistics(name, selected)
    return figures | path_figures(score.path) | {
        'icr_x': score.icr_x, 'nis': score.nis, 'step_us': score.step_us}


def path_figures(path: PathScore) -> Figures:
    """Return the figures of a path alone."""
    return _statistics('heading', path.heading) | {
        'position_rms': path.rms_m, 'position_end': path.end_m,
        'position_rms_percent': path.rms_percent, 'position_end_percent': path.end_percent,
        'heading_rms': path.heading.rms, 'heading_end': abs(path.heading_end),
        'nees_position': path.nees, 'within_two_position': path.inside,
        'distance': path.distance_m}


def _statistics(name: str, selected: Score) -> Figures:
    """Return NEES and share within two sigma; NaN without sigmas."""
    known = math.isfinite(selected.normalized_rms)
    return {f'nees_{name}': selected.normalized_rms ** 2,
            f'within_two_{name}': selected.within_two if known else math.nan}


def combined(seeds: Sequence[Mapping[str, float]]) -> Figures:
    """Return the figures combined over seeds: errors by rms, statistics by mean."""
    return {name: (math.sqrt(_mean([one[name] ** 2 for one in seeds])) if name in ERRORS
                   else _mean([one[name] for one in seeds])) for name in seeds[0]}


def by_run(results: Sequence[RunResult]) -> dict[str, dict[str, Figures]]:
    """Return run -> method -> combined figures, in order of first occurrence."""
    runs: dict[str, list[RunResult]] = {}
    for result in results:
        runs.setdefault(result.run, []).append(result)
    return {run: {method: combined([seed.figures[method] for seed in seeds])
                  for method in seeds[0].figures} for run, seeds in runs.items()}


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else math.nan
