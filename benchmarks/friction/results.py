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

"""Results of one run, and figures combined over seeds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from benchmarks.friction.methods import (
    estimator_params, Event, EXACT_MAP, ground_truth, inputs, METHODS, PRINTED_MAP, run_estimator)
from benchmarks.friction.paper_method import friction_from_peaks
from benchmarks.friction.records import concatenated, match_rows, Rows, true_crossings
from benchmarks.friction.scoring import Change, changes, Figures, figures_of, peak_figures
from smart_tire.analysis.series import Floats
from smart_tire.parameters import RobotParams

Key = tuple[str, str]  # wheel, method


@dataclass(frozen=True)
class Part:
    """Results of one wheel by one method."""

    rows: Rows
    surfaces: list[Change]
    from_peaks: Floats | None  # mu by the method of paper B, (n,); None for waveform
    ms: float                # CPU time per crossing


@dataclass(frozen=True)
class RunResult:
    """Results of one run."""

    run: str
    seed: int
    parts: dict[Key, Part]


def run_all(name: str, seed: int, events: Sequence[Event], robot: RobotParams) -> RunResult:
    """Return the results of a run by all methods."""
    records, samples = ground_truth(events), inputs(events)
    truths = {wheel: true_crossings(records, robot, wheel) for wheel in robot.film.wheels}
    parts: dict[Key, Part] = {}
    for method in METHODS:
        run = run_estimator(samples, estimator_params(method, robot))
        for wheel, truth in truths.items():
            rows = match_rows(truth, run.crossings, wheel)
            parts[wheel, method] = Part(
                rows, changes(rows), _from_peaks(rows, robot, method), run.ms)
    return RunResult(name, seed, parts)


def _from_peaks(rows: Rows, robot: RobotParams, method: str) -> Floats | None:
    if method not in (EXACT_MAP, PRINTED_MAP):
        return None
    return friction_from_peaks(rows.value['peak_interval'], rows.speed, rows.value['total_slip'],
                               rows.value['normal_load'], robot, method)


def by_run(results: Iterable[RunResult]) -> dict[str, dict[Key, Figures]]:
    """Return run -> wheel and method -> figures combined over seeds."""
    runs: dict[str, list[RunResult]] = {}
    for result in results:
        runs.setdefault(result.run, []).append(result)
    return {run: {key: figures_over([seed.parts[key] for seed in seeds])
                  for key in seeds[0].parts} for run, seeds in runs.items()}


def figures_over(parts: Sequence[Part]) -> Figures:
    """Return the figures of all crossings of ``parts``."""
    figures = figures_of(concatenated([part.rows for part in parts]),
                         [change for part in parts for change in part.surfaces],
                         sum(part.ms for part in parts) / len(parts))
    for part in parts:
        if part.from_peaks is None:
            return figures
    return figures | peak_figures(
        [part.from_peaks for part in parts if part.from_peaks is not None],
        [part.rows for part in parts])
