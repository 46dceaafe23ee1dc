"""What one run gave, and the figures of all its seeds together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.friction.methods import (
    COMPARED, estimator_params, Event, EXACT_MAP, inputs, PRINTED_MAP, robot_of, tell, TRUE,
    truth_of)
from benchmarks.friction.paper_method import friction_read_off
from benchmarks.friction.records import Rows, rows_of, together, true_passages
from benchmarks.friction.scoring import Change, changes, Figures, figures_of, reading_figures
from benchmarks.slip.scoring import steady_slips
from benchmarks.slip.series import as_estimate, as_truth
from smart_tire.analysis.metrics import rms, score
from smart_tire.analysis.series import Floats
from smart_tire.parameters import RobotParams

Key = tuple[str, str, str]  # wheel, source of the slip, method


@dataclass(frozen=True)
class Part:
    """One wheel by one method."""

    rows: Rows
    grounds: list[Change]
    read_off: Floats | None  # mu as the paper reads it, (n,); None by the waveform
    ms: float                # CPU time per passage


@dataclass(frozen=True)
class RunResult:
    """All that one run gave; ``slips`` are errors and sigmas (n,) by the source of the slip."""

    run: str
    seed: int
    parts: dict[Key, Part]
    slips: dict[str, tuple[Floats, Floats]]


def run_all(name: str, seed: int, events: Sequence[Event], robot: RobotParams) -> RunResult:
    """Return what is made of a run with the true slip, and by all methods with the estimated."""
    records = truth_of(events)
    truths = {wheel: true_passages(records, robot, wheel) for wheel in robot.film.wheels}
    parts: dict[Key, Part] = {}
    slips: dict[str, tuple[Floats, Floats]] = {}
    for source, methods in COMPARED.items():
        own = robot_of(source, robot)
        samples = inputs(events, source, own)
        if source != TRUE:
            slips[source] = steady_slips(as_estimate(samples), as_truth(records, robot))
        for method in methods:
            told = tell(samples, estimator_params(method, own))
            for wheel, truth in truths.items():
                rows = rows_of(truth, told.passages, wheel)
                parts[wheel, source, method] = Part(
                    rows, changes(rows), _read_off(rows, robot, method), told.ms)
    return RunResult(name, seed, parts, slips)


def _read_off(rows: Rows, robot: RobotParams, method: str) -> Floats | None:
    if method not in (EXACT_MAP, PRINTED_MAP):
        return None
    return friction_read_off(rows.value['peak_interval'], rows.speed, rows.value['total_slip'],
                             rows.value['normal_load'], robot, method)


def by_run(results: Iterable[RunResult]) -> dict[str, dict[Key, Figures]]:
    """Return run -> wheel, source and method -> figures of the passages of all seeds."""
    runs: dict[str, list[RunResult]] = {}
    for result in results:
        runs.setdefault(result.run, []).append(result)
    return {run: {key: figures_over([seed.parts[key] for seed in seeds])
                  for key in seeds[0].parts} for run, seeds in runs.items()}


@dataclass(frozen=True)
class SteadySlip:
    """How far off the slips of both sides are while they are steady; NaN where they never are."""

    count: int
    rms: float
    told: float  # rms of the sigmas
    nees: float  # mean normalised squared error: 1 is right


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
    return SteadySlip(found.count, found.rms, rms(sigma), found.normalised_rms**2)


def figures_over(parts: Sequence[Part]) -> Figures:
    """Return the figures of the passages of ``parts`` as of those of one run."""
    figures = figures_of(together([part.rows for part in parts]),
                         [change for part in parts for change in part.grounds],
                         sum(part.ms for part in parts) / len(parts))
    for part in parts:
        if part.read_off is None:
            return figures
    return figures | reading_figures(
        [part.read_off for part in parts if part.read_off is not None],
        [part.rows for part in parts])
