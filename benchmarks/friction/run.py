"""
Benchmark of friction: errors, ratio to the Cramer-Rao bound, and consistency.

The friction estimator and the method of paper B process crossings synthesized from the exact
model and complete simulated runs over several seeds. Tables are printed, figures and
``results.json`` are written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
import json
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.command import accuracy_parser, run_accuracy_benchmark
from benchmarks.friction.figures import (
    adhesion_figure, bound_figure, friction_figure, stretch_figure, waveform_figure)
from benchmarks.friction.grid import all_cases, Case, quick_cases
from benchmarks.friction.methods import METHODS, SOURCES
from benchmarks.friction.monte_carlo import CaseResult, run_case
from benchmarks.friction.reference_results import (
    PRINTED_EXCESS, REFERENCE_BOUNDS, REFERENCE_RESULTS)
from benchmarks.friction.results import by_run, Key, run_all, RunResult, slips_by_run, SteadySlip
from benchmarks.friction.scenarios import FRICTION_SCENARIOS
from benchmarks.friction.scoring import Figures
from benchmarks.friction.tables import (
    aided_table, cases_table, errors_table, methods_table, NOTES, statistics_table)
from benchmarks.jobs import make_folder, run_jobs
from benchmarks.slip.figures import save
from benchmarks.tables import new_console, print_all
from smart_tire.analysis.summary import plain

CROSSINGS = 'crossings'          # name of the synthesized crossings among the runs
COUNT, QUICK_COUNT = 400, 150  # crossings per case: 6 and 9 % error of a spread from quartiles
DRAWN_SEED = 1                 # seed of the run in the figures
TITLES = {CROSSINGS: 'synthesized crossings',
          **{name: scenario.title for name, scenario in FRICTION_SCENARIOS.items()}}

Result = CaseResult | RunResult
Job = Callable[[], Result]


@dataclass(frozen=True)
class BenchOptions:
    """Options of the benchmark."""

    seeds: int
    quick: bool
    runs: Sequence[str]  # scenarios and ``CROSSINGS``; empty means all
    out: Path


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return the exit status."""
    parser = accuracy_parser(
        'friction', 'accuracy of friction, compared with the method of paper B')
    args = parser.parse_args(argv)
    return run_accuracy_benchmark('friction', args, TITLES, lambda seeds, on: benchmark(
        BenchOptions(seeds, args.quick, args.runs, args.out), on))


def benchmark(options: BenchOptions, machine_name: str) -> None:
    """Run all jobs, print the tables and write figures and results."""
    make_folder(options.out)
    results = list(run_jobs(_jobs(options), label))
    cases = [one for name, group in _cases(options).items() for case in group for one in results
             if isinstance(one, CaseResult) and (one.group, one.case) == (name, case)]
    runs = sorted((one for one in results if isinstance(one, RunResult)),
                  key=lambda one: (list(TITLES).index(one.run), one.seed))
    scored, slips = by_run(runs), slips_by_run(runs)
    if cases:
        _draw_crossings(cases, options.out)
    _write(options.out / 'results.json', cases, runs, scored, machine_name)
    print_all(new_console(), NOTES, _tables(cases, scored, slips))
    print(f'{len(cases)} cases and {len(runs)} runs; figures and results.json in {options.out}')


def label(result: Result) -> str:
    """Return the label of ``result`` for progress lines."""
    if isinstance(result, RunResult):
        return f'{TITLES[result.run]}, seed {result.seed}'
    return f'{TITLES[CROSSINGS]}, {result.group}: slip {result.case.slip:+.2f}'


def _cases(options: BenchOptions) -> dict[str, list[Case]]:
    return quick_cases() if options.quick else all_cases()


def _jobs(options: BenchOptions) -> list[Job]:
    """Return the jobs, the longest first."""
    wanted = options.runs or list(TITLES)
    scenarios = sorted((FRICTION_SCENARIOS[name] for name in wanted if name != CROSSINGS),
                       key=lambda scenario: -scenario.duration)
    jobs: list[Job] = [partial(run_scenario, scenario.name, seed, options.out)
                       for scenario in scenarios for seed in range(1, options.seeds + 1)]
    if CROSSINGS in wanted:
        count = QUICK_COUNT if options.quick else COUNT
        jobs += [partial(run_case, name, case, count)
                 for name, group in _cases(options).items() for case in group]
    return jobs


def run_scenario(name: str, seed: int, out: Path) -> RunResult:
    """Simulate one run and score all methods; draw the figures of the first seed."""
    scenario = FRICTION_SCENARIOS[name]
    result = run_all(name, seed, scenario.events(seed), scenario.robot)
    if seed == DRAWN_SEED:
        save(friction_figure(scenario.title, result), out / f'{name}.png')
    return result


def _draw_crossings(cases: Sequence[CaseResult], out: Path) -> None:
    for name, figure in (('waveform', waveform_figure()), ('bound', bound_figure(cases)),
                         ('fig_12', stretch_figure()), ('fig_13', adhesion_figure())):
        save(figure, out / f'{name}.png')


def _tables(cases: Sequence[CaseResult], runs: dict[str, dict[Key, Figures]],
            slips: dict[str, dict[str, SteadySlip]]) -> Iterator[Table]:
    if cases:
        yield cases_table(cases)
    if runs:
        yield errors_table(runs, TITLES, REFERENCE_RESULTS)
        yield statistics_table(runs, TITLES)
        yield methods_table(runs, TITLES)
        yield aided_table(runs, slips, TITLES)


def _write(path: Path, cases: Sequence[CaseResult], results: Sequence[RunResult],
           runs: dict[str, dict[Key, Figures]], machine: str) -> None:
    """Write all figures: per case, and per run combined over seeds."""
    slips = {run: {source: asdict(one) for source, one in sources.items()}
             for run, sources in slips_by_run(results).items()}
    tree: dict[str, Any] = {
        'machine': machine, 'methods': METHODS, 'slips': SOURCES,
        'units': 'errors of mu and bounds are relative, of slips and ratios absolute; ms: CPU '
                 'time per crossing in milliseconds; null without data',
        CROSSINGS: [{**asdict(one), 'normalized_slip': one.case.normalized_slip} for one in cases],
        'runs': {run: {
            'title': TITLES[run], 'seeds': [one.seed for one in results if one.run == run],
            'slips': slips[run], 'wheels': _nested(figures),
            'reference': REFERENCE_RESULTS.get(run)}
            for run, figures in runs.items()},
        'reference_bounds': REFERENCE_BOUNDS, 'reference_printed_excess': PRINTED_EXCESS}
    path.write_text(json.dumps(plain(tree), indent=2, allow_nan=False) + '\n', encoding='utf-8')


def _nested(figures: dict[Key, Figures]) -> dict[str, Any]:
    tree: dict[str, Any] = {}
    for (wheel, source, method), values in figures.items():
        tree.setdefault(wheel, {}).setdefault(source, {})[method] = values
    return tree
