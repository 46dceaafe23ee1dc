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
    COMPARED, estimator_params, Event, EXACT_MAP, ground_truth, inputs, PRINTED_MAP, robot_of,
    run_estimator, TRUE)
from benchmarks.friction.paper_method import friction_from_peaks
from benchmarks.friction.records import concatenated, match_rows, Rows, true_crossings
from benchmarks.friction.scoring import Change, changes, Figures, figures_of, peak_figures
from benchmarks.slip.scoring import steady_slips
from benchmarks.slip.series import as_estimate, as_truth
import numpy as np
from smart_tire.analysis.metrics import rms, score
from smart_tire.analysis.series import Floats
from smart_tire.parameters import RobotParams

Key = tuple[str, str, str]  # wheel, source of the slip, method


@dataclass(frozen=True)
class Part:
    """Results of one wheel by one method."""

    rows: Rows
    surfaces: list[Change]
    from_peaks: Floats | None  # mu by the method of paper B, (n,); None for waveform
    ms: float                # CPU time per crossing


@dataclass(frozen=True)
class RunResult:
    """Results of one run; ``slips`` has errors and sigmas (n,) per source of slip."""

    run: str
    seed: int
    parts: dict[Key, Part]
    slips: dict[str, tuple[Floats, Floats]]


def run_all(name: str, seed: int, events: Sequence[Event], robot: RobotParams) -> RunResult:
    """Return the results of a run for all sources of slip and methods."""
    records = ground_truth(events)
    truths = {wheel: true_crossings(records, robot, wheel) for wheel in robot.film.wheels}
    parts: dict[Key, Part] = {}
    slips: dict[str, tuple[Floats, Floats]] = {}
    for source, methods in COMPARED.items():
        own = robot_of(source, robot)
        samples = inputs(events, source, own)
        if source != TRUE:
            slips[source] = steady_slips(as_estimate(samples), as_truth(records, robot))
        for method in methods:
            run = run_estimator(samples, estimator_params(method, own))
            for wheel, truth in truths.items():
                rows = match_rows(truth, run.crossings, wheel)
                parts[wheel, source, method] = Part(
                    rows, changes(rows), _from_peaks(rows, robot, method), run.ms)
    return RunResult(name, seed, parts, slips)


def _from_peaks(rows: Rows, robot: RobotParams, method: str) -> Floats | None:
    if method not in (EXACT_MAP, PRINTED_MAP):
        return None
    return friction_from_peaks(rows.value['peak_interval'], rows.speed, rows.value['total_slip'],
                               rows.value['normal_load'], robot, method)


def by_run(results: Iterable[RunResult]) -> dict[str, dict[Key, Figures]]:
    """Return run -> wheel, source and method -> figures combined over seeds."""
    runs: dict[str, list[RunResult]] = {}
    for result in results:
        runs.setdefault(result.run, []).append(result)
    return {run: {key: figures_over([seed.parts[key] for seed in seeds])
                  for key in seeds[0].parts} for run, seeds in runs.items()}


@dataclass(frozen=True)
class SteadySlip:
    """Errors of the slips of both sides in steady intervals; NaN without any."""

    count: int
    rms: float
    sigma: float  # rms of the reported sigmas
    nees: float   # 1 if consistent


def slips_by_run(results: Iterable[RunResult]) -> dict[str, dict[str, SteadySlip]]:
    """Return run -> source of the slip -> scores over all seeds."""
    runs: dict[str, dict[str, list[tuple[Floats, Floats]]]] = {}
    for result in results:
        for source, slips in result.slips.items():
            runs.setdefault(result.run, {}).setdefault(source, []).append(slips)
    return {run: {source: _steady(*(np.concatenate(part) for part in zip(*parts)))
                  for source, parts in sources.items()} for run, sources in runs.items()}


def _steady(error: Floats, sigma: Floats) -> SteadySlip:
    found = score(error, sigma)
    return SteadySlip(found.count, found.rms, rms(sigma), found.normalized_rms**2)


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
