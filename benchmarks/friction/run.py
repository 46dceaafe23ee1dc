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
Benchmark of friction: errors, ratio to the Cramer-Rao bound, and consistency.

The friction estimator and the method of paper B process crossings synthesized from the exact
model and complete simulated runs over several seeds. Tables are printed, figures and
``results.json`` are written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
import json
from pathlib import Path
from typing import Any

from benchmarks.command import accuracy_parser, run_accuracy_benchmark
from benchmarks.friction.counting import COUNTED_FROM
from benchmarks.friction.figures import (
    adhesion_figure, bound_figure, friction_figure, stretch_figure, waveform_figure)
from benchmarks.friction.force_figures import force_figure
from benchmarks.friction.force_results import PartKey, Row, rows_of
from benchmarks.friction.force_tables import FORCE_NOTES, force_tables
from benchmarks.friction.forces import ForceResult, run_forces, VARIANTS
from benchmarks.friction.grid import all_cases, Case, quick_cases
from benchmarks.friction.ground_scenarios import GROUND_SCENARIOS
from benchmarks.friction.methods import METHODS
from benchmarks.friction.monte_carlo import CaseResult, run_case
from benchmarks.friction.previous_results import PREVIOUS_RESULTS
from benchmarks.friction.reference_results import (
    FORCE_REFERENCES, PRINTED_EXCESS, REFERENCE_BOUNDS, REFERENCE_RESULTS)
from benchmarks.friction.results import by_run, Key, run_all, RunResult
from benchmarks.friction.scenarios import FRICTION_SCENARIOS
from benchmarks.friction.scoring import Figures
from benchmarks.friction.tables import (
    cases_table, errors_table, methods_table, NOTES, statistics_table)
from benchmarks.jobs import make_folder, run_jobs
from benchmarks.slip.figures import save
from benchmarks.tables import markdown, new_console, print_all
from rich.table import Table
from smart_tire.analysis.summary import plain

CROSSINGS = 'crossings'          # name of the synthesized crossings among the runs
COUNT, QUICK_COUNT = 400, 150  # crossings per case: 6 and 9 % error of a spread from quartiles
DRAWN_SEED = 1                 # seed of the run in the figures
COUNTED_FROM_JUMP = 4          # revolution; the surfaces of mu_jumps are too short for five
SCENARIOS = {**FRICTION_SCENARIOS, **GROUND_SCENARIOS}
TITLES = {CROSSINGS: 'synthesized crossings',
          **{name: scenario.title for name, scenario in SCENARIOS.items()}}


@dataclass(frozen=True)
class ScenarioResult:
    """Results of one seed of a scenario; methods are compared in ``FRICTION_SCENARIOS`` only."""

    forces: ForceResult
    methods: RunResult | None

    @property
    def run(self) -> str:
        """Return the name of the scenario."""
        return self.forces.run

    @property
    def seed(self) -> int:
        """Return the seed of the random numbers."""
        return self.forces.seed


Result = CaseResult | ScenarioResult
Job = Callable[[], Result]


@dataclass(frozen=True)
class BenchOptions:
    """Options of the benchmark."""

    seeds: Sequence[int]
    quick: bool
    runs: Sequence[str]  # scenarios and ``CROSSINGS``; empty means all
    forces_only: bool    # do not compare methods
    out: Path


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return the exit status."""
    parser = accuracy_parser(
        'friction', 'accuracy of friction, compared with the method of paper B')
    parser.add_argument('--forces-only', action='store_true',
                        help='only estimates without and with torque, no comparison of methods')
    args = parser.parse_args(argv)
    return run_accuracy_benchmark('friction', args, TITLES, lambda seeds, on: benchmark(
        BenchOptions(seeds, args.quick, args.runs, args.forces_only, args.out), on))


def benchmark(options: BenchOptions, machine_name: str) -> None:
    """Run all jobs, print the tables and write figures and results."""
    make_folder(options.out)
    results = list(run_jobs(_jobs(options), label))
    cases = [one for name, group in _cases(options).items() for case in group for one in results
             if isinstance(one, CaseResult) and (one.group, one.case) == (name, case)]
    scenarios = sorted((one for one in results if isinstance(one, ScenarioResult)),
                       key=lambda one: (list(TITLES).index(one.run), one.seed))
    compared = [one.methods for one in scenarios if one.methods is not None]
    forces = [one.forces for one in scenarios]
    rows = rows_of(forces, {name: scenario.ground for name, scenario in SCENARIOS.items()})
    if cases:
        _draw_crossings(cases, options.out)
    _write(options.out / 'results.json', cases, compared, rows, machine_name)
    console = new_console()
    if cases or compared:
        print_all(console, NOTES, _method_tables(cases, compared))
    if rows:
        tables = list(force_tables(rows, forces, TITLES))
        print_all(console, FORCE_NOTES, tables)
        (options.out / 'forces.md').write_text('\n'.join(map(markdown, tables)), encoding='utf-8')
    print(f'{len(cases)} cases and {len(forces)} runs; figures and results.json in {options.out}')


def label(result: Result) -> str:
    """Return the label of ``result`` for progress lines."""
    if isinstance(result, ScenarioResult):
        return f'{TITLES[result.run]}, seed {result.seed}'
    return f'{TITLES[CROSSINGS]}, {result.group}: slip {result.case.slip:+.2f}'


def _cases(options: BenchOptions) -> dict[str, list[Case]]:
    return quick_cases() if options.quick else all_cases()


def _jobs(options: BenchOptions) -> list[Job]:
    """Return the jobs, the longest first."""
    wanted = options.runs or list(TITLES)
    scenarios = sorted((SCENARIOS[name] for name in wanted if name != CROSSINGS),
                       key=lambda scenario: -scenario.duration)
    jobs: list[Job] = [partial(run_scenario, scenario.name, seed, options.out,
                               compare=not options.forces_only)
                       for scenario in scenarios for seed in options.seeds]
    if CROSSINGS in wanted:
        count = QUICK_COUNT if options.quick else COUNT
        jobs += [partial(run_case, name, case, count)
                 for name, group in _cases(options).items() for case in group]
    return jobs


def run_scenario(name: str, seed: int, out: Path, *, compare: bool = True) -> ScenarioResult:
    """Simulate one run and score all methods; draw the figures of ``DRAWN_SEED``."""
    scenario = SCENARIOS[name]
    events, robot = scenario.events(seed), scenario.robot
    first = COUNTED_FROM_JUMP if name == 'mu_jumps' else COUNTED_FROM
    forces = run_forces(name, seed, events, robot, first)
    if seed == DRAWN_SEED:
        save(force_figure(scenario.title, forces), out / f'{name}_forces.png')
    if name in GROUND_SCENARIOS or not compare:
        return ScenarioResult(forces, None)
    result = run_all(name, seed, events, robot)
    if seed == DRAWN_SEED:
        save(friction_figure(scenario.title, result), out / f'{name}.png')
    return ScenarioResult(forces, result)


def _draw_crossings(cases: Sequence[CaseResult], out: Path) -> None:
    for name, figure in (('waveform', waveform_figure()), ('bound', bound_figure(cases)),
                         ('fig_12', stretch_figure()), ('fig_13', adhesion_figure())):
        save(figure, out / f'{name}.png')


def _method_tables(cases: Sequence[CaseResult], results: Sequence[RunResult]) -> Iterator[Table]:
    if cases:
        yield cases_table(cases)
    if results:
        runs = by_run(results)
        yield errors_table(runs, TITLES, REFERENCE_RESULTS)
        yield statistics_table(runs, TITLES)
        yield methods_table(runs, TITLES)


def _write(path: Path, cases: Sequence[CaseResult], results: Sequence[RunResult],
           rows: Mapping[PartKey, Row], machine: str) -> None:
    """Write all figures: per case, and per run combined over seeds."""
    tree: dict[str, Any] = {
        'machine': machine, 'methods': METHODS, 'variants': VARIANTS,
        'units': 'errors of mu, C_x and bounds are relative, of slips and ratios absolute; SI; '
                 'ms: CPU time per crossing in milliseconds; null without data',
        CROSSINGS: [{**asdict(one), 'normalized_slip': one.case.normalized_slip} for one in cases],
        'runs': {run: {
            'title': TITLES[run], 'seeds': [one.seed for one in results if one.run == run],
            'wheels': _nested(figures),
            'reference': REFERENCE_RESULTS.get(run)}
            for run, figures in by_run(results).items()},
        'forces': [{'title': TITLES[row.run], **asdict(row),
                    'before': PREVIOUS_RESULTS.get(key), 'reference': FORCE_REFERENCES.get(key)}
                   for key, row in rows.items()],
        'reference_bounds': REFERENCE_BOUNDS, 'reference_printed_excess': PRINTED_EXCESS}
    path.write_text(json.dumps(plain(tree), indent=2, allow_nan=False) + '\n', encoding='utf-8')


def _nested(figures: dict[Key, Figures]) -> dict[str, Any]:
    tree: dict[str, Any] = {}
    for (wheel, method), values in figures.items():
        tree.setdefault(wheel, {})[method] = values
    return tree
