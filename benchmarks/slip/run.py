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

"""
Benchmark of slip and pose: errors and their consistency with the reported covariance.

The slip estimator, its smoother and other methods process simulated scenarios over several seeds
and real recordings. Tables are printed, figures and ``results.json`` are written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
import json
from pathlib import Path
from typing import Any

from benchmarks.command import (
    accuracy_parser, DATA, run_accuracy_benchmark)
from benchmarks.hills import HILL_SCENARIOS
from benchmarks.jobs import make_folder, run_jobs
from benchmarks.scenarios import Scenario, SCENARIOS
from benchmarks.slip.comparison import compare_methods, LIVE, METHODS
from benchmarks.slip.figures import path_figure, save, slip_figure
from benchmarks.slip.previous_results import PREVIOUS_RESULTS
from benchmarks.slip.recordings import bags, parameter_sources, RECORDINGS, run_recording
from benchmarks.slip.reference_results import REFERENCE_RESULTS
from benchmarks.slip.results import by_run, figures_of, path_figures, RunResult
from benchmarks.slip.scoring import score_run
from benchmarks.slip.series import as_truth
from benchmarks.slip.tables import (
    errors_table, print_tables, recordings_table, reference_table, Runs, statistics_table)
from benchmarks.tables import new_console
from rich.table import Table
from smart_tire.analysis.metrics import aligned
from smart_tire.analysis.summary import plain
from smart_tire.parameters import SlipEstimatorParams

DRAWN_SEED = 1   # seed of the run in the figures

RUNS: Mapping[str, Scenario] = {**SCENARIOS, **HILL_SCENARIOS}
KNOWN = {recording.name: recording for recording in RECORDINGS}
TITLES = {**{name: scenario.title for name, scenario in RUNS.items()},
          **{name: recording.title for name, recording in KNOWN.items()}}

Job = Callable[[], RunResult]


@dataclass(frozen=True)
class BenchOptions:
    """Options of the benchmark."""

    seeds: Sequence[int]
    runs: Sequence[str]  # scenarios and recordings; none means all
    data: Path           # folder of the recordings
    out: Path


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return the exit status."""
    parser = accuracy_parser('slip', 'accuracy of slip and pose, compared with other methods')
    parser.add_argument('--data', type=Path, default=DATA, metavar='DIR',
                        help='folder with real recordings (default: %(default)s)')
    args = parser.parse_args(argv)
    return run_accuracy_benchmark('slip', args, TITLES, lambda seeds, on: benchmark(
        BenchOptions(seeds, args.runs, args.data, args.out), on))


def benchmark(options: BenchOptions, machine_name: str) -> None:
    """Run all jobs, print the tables and write figures and results."""
    jobs, absent = _jobs(options)
    for name in absent:
        print(f'{name}: not in {options.data}, skipped (--data DIR)')
    make_folder(options.out)
    results = sorted(run_jobs(jobs, label),
                     key=lambda one: (list(TITLES).index(one.run), one.seed))
    _write(options.out / 'results.json', results, absent, machine_name)
    runs = by_run(results)
    notes = {result.run: result.notes for result in results if result.notes}
    print_tables(new_console(), _tables(runs, notes))
    print(f'{len(results)} runs; figures and results.json in {options.out}')


def _jobs(options: BenchOptions) -> tuple[list[Job], list[str]]:
    """Return the jobs, the longest first, and the names of missing recordings."""
    wanted = options.runs or list(TITLES)
    paths, absent = bags(options.data)
    jobs: list[Job] = [partial(run_recorded, name, path, options.out)
                       for name, path in paths.items() if name in wanted]
    scenarios = [RUNS[name] for name in wanted if name in RUNS]
    scenarios.sort(key=lambda scenario: -scenario.duration)
    jobs += [partial(run_scenario, scenario.name, seed, options.out)
             for scenario in scenarios for seed in options.seeds]
    return jobs, [name for name in absent if name in wanted]


def label(result: RunResult) -> str:
    """Return the label of ``result`` for progress lines."""
    return f'{TITLES[result.run]}, seed {result.seed}'


def run_scenario(name: str, seed: int, out: Path) -> RunResult:
    """Simulate one run and score all methods; draw the figures of the first seed."""
    scenario = RUNS[name]
    events = scenario.events(seed)
    truth = as_truth((sample for _, topic, sample in events
                      if topic.startswith('ground_truth/')), scenario.robot)
    samples = [sample for _, topic, sample in events if not topic.startswith('ground_truth/')]
    estimates = compare_methods(samples, SlipEstimatorParams(robot=scenario.robot), truth.poses)
    if seed == DRAWN_SEED:
        save(slip_figure(scenario.title, estimates, truth), out / f'{name}_slip.png')
        save(path_figure(scenario.title, estimates,
                         {method: aligned(truth.poses, estimate.poses)
                          for method, estimate in estimates.items()}), out / f'{name}_path.png')
    return RunResult(name, seed, {
        method: figures_of(score_run(estimate, truth, averaged=scenario.averaged))
        for method, estimate in estimates.items()})


def run_recorded(name: str, path: Path, out: Path) -> RunResult:
    """Run all methods on a real recording, score and draw their paths."""
    run = run_recording(path, KNOWN[name])
    save(path_figure(TITLES[name], run.estimates, run.aligned_poses), out / f'{name}_path.png')
    return RunResult(name, DRAWN_SEED, {method: path_figures(score)
                                        for method, score in run.scores().items()},
                     parameter_sources(path, KNOWN[name]))


def _tables(runs: Runs, notes: Mapping[str, Sequence[str]]) -> Iterator[Table]:
    simulated = {run: methods for run, methods in runs.items() if run in RUNS}
    for run, methods in simulated.items():
        scenario = RUNS[run]
        distance = methods[LIVE]['distance']
        title = f'{scenario.title}: {scenario.duration:.0f} s, {distance:.0f} m'
        yield errors_table(title, run, methods, REFERENCE_RESULTS.get(run), scenario.averaged)
    for run, methods in runs.items():
        if run in KNOWN:
            yield recordings_table(TITLES[run], methods, notes.get(run, ()))
    if simulated:
        yield statistics_table(simulated, TITLES)
    if simulated.keys() & REFERENCE_RESULTS.keys():
        yield reference_table(simulated, TITLES, REFERENCE_RESULTS)


def _write(path: Path, results: Sequence[RunResult], absent: Sequence[str],
           machine: str) -> None:
    """Write all figures, combined over seeds and of each seed."""
    runs = by_run(results)
    tree: dict[str, Any] = {
        'machine': machine, 'skipped': list(absent), 'methods': METHODS,
        'units': 'SI; _percent: of the distance; step_us: CPU time in microseconds',
        'runs': {run: {
            'title': TITLES[run], 'over_seeds': methods,
            'seeds': {result.seed: result.figures for result in results if result.run == run},
            'parameters': next(result.notes for result in results if result.run == run),
            'reference': REFERENCE_RESULTS.get(run), 'before': PREVIOUS_RESULTS.get(run)}
            for run, methods in runs.items()}}
    path.write_text(json.dumps(plain(tree), indent=2, allow_nan=False) + '\n', encoding='utf-8')
