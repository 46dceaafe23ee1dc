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
Benchmark of the controllers: wheel speed steps, path tracking, starts and stops.

Tables are printed, figures and ``results.json`` are written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
import json
from pathlib import Path
from typing import Any

from benchmarks.command import accuracy_parser, run_accuracy_benchmark
from benchmarks.control.figures import tracking_figure
from benchmarks.control.requirements import missed
from benchmarks.control.scenarios import all_cases, KINEMATICS, title
from benchmarks.control.tables import (
    duration_table, TRACKING_NOTES, tracking_table)
from benchmarks.control.tracking import run_tracking, TrackingResult
from benchmarks.control.tracking_results import as_tree, by_case
from benchmarks.control.traction import run, scenarios, TractionRun, TractionScenario
from benchmarks.control.traction_figures import traction_figure
from benchmarks.control.traction_scoring import scores, traction_table, TractionScore
from benchmarks.control.wheel_steps import Row, wheel_steps
from benchmarks.control.wheel_tables import line_table, wheel_steps_table
from benchmarks.jobs import make_folder, run_jobs
from benchmarks.slip.figures import save
from benchmarks.tables import new_console, print_all
from rich.table import Table
from smart_tire.analysis.summary import plain

DRAWN_RATE = 16.0  # Hz, of the readings in figures of starts and stops
WHEEL_STEPS, TRACTION = 'wheel_steps', 'traction'
TITLES = {WHEEL_STEPS: 'wheel speed steps', TRACTION: 'starts and stops',
          **{case.name: title(case.name) for case in all_cases()}}


@dataclass(frozen=True)
class WheelSteps:
    """Rows of the table of wheel speed steps."""

    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Starts:
    """Scores of the starts and stops of one scenario."""

    scenario: TractionScenario
    scores: tuple[TractionScore, ...]
    drawn: TractionRun | None


Result = TrackingResult | WheelSteps | Starts
Job = Callable[[], Result]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return the exit status."""
    args = accuracy_parser(
        'control', 'wheel speed steps, path tracking, starts and stops').parse_args(argv)
    return run_accuracy_benchmark(
        'control', args, TITLES,
        lambda seeds, on: benchmark(seeds, args.runs or list(TITLES), args.out, on))


def benchmark(seeds: Sequence[int], runs: Sequence[str], out: Path, machine_name: str) -> None:
    """Run all jobs, print the tables and write figures and results."""
    make_folder(out)
    results = list(run_jobs(jobs(seeds, runs), label))
    order = list(all_cases())
    tracking = sorted((one for one in results if isinstance(one, TrackingResult)),
                      key=lambda one: (order.index(one.case), one.seed))
    steps = [row for one in results if isinstance(one, WheelSteps) for row in one.rows]
    starts = [one for one in results if isinstance(one, Starts)]
    starts.sort(key=lambda one: list(scenarios(seeds)).index(one.scenario))
    found = [score for one in starts for score in one.scores]
    _write(out / 'results.json', tracking, steps, found, machine_name)
    print_all(new_console(), TRACKING_NOTES, _tables(tracking, steps, found))
    for one in tracking:
        if not one.score.arrived:
            print(f'{label(one)}: {one.reason or "not arrived in time"}')
    count = _draw(tracking, out) + _draw_starts(starts, out)
    rows = by_case(tracking)
    if rows:
        met = sum(not missed(row) for row in rows.values())
        print(f'path tracking: {len(tracking)} runs, {met} of {len(rows)} rows meet all '
              'requirements')
    print(f'{count} figures and results.json in {out}')


def jobs(seeds: Sequence[int], runs: Sequence[str]) -> list[Job]:
    """Return the jobs of ``runs``, the longest first; the first seed is drawn."""
    found: list[Job] = [partial(run_wheel_steps, tuple(seeds))] if WHEEL_STEPS in runs else []
    if TRACTION in runs:
        found += [partial(run_starts, one, drawn=one.seed == seeds[0]
                          and one.wheel_rate == DRAWN_RATE) for one in scenarios(seeds)]
    found += [
        partial(run_tracking, case, seed, traced=seed == seeds[0])
        for case in all_cases() if case.name in runs for seed in seeds]
    return found


def run_wheel_steps(seeds: Sequence[int]) -> WheelSteps:
    """Return the rows of the wheel speed steps."""
    return WheelSteps(tuple(wheel_steps(seeds)))


def run_starts(scenario: TractionScenario, *, drawn: bool) -> Starts:
    """Return the scores of the starts and stops of ``scenario``."""
    result = run(scenario)
    return Starts(scenario, tuple(scores(result)), result if drawn else None)


def label(result: Result) -> str:
    """Return the label of ``result`` for progress lines."""
    if isinstance(result, WheelSteps):
        return TITLES[WHEEL_STEPS]
    if isinstance(result, Starts):
        return f'{result.scenario.title}, seed {result.scenario.seed}'
    return (f'{title(result.case.name)}, {KINEMATICS[result.case.kinematics]}, '
            f'seed {result.seed}')


def _tables(tracking: Sequence[TrackingResult], steps: Sequence[Row],
            found: Sequence[TractionScore]) -> Iterator[Table]:
    if steps:
        yield wheel_steps_table(steps)
        yield line_table()
    if tracking:
        rows = by_case(tracking)
        yield tracking_table(rows)
        yield duration_table(rows)
    if found:
        yield traction_table(found)


def _draw(tracking: Sequence[TrackingResult], out: Path) -> int:
    """Draw a figure for each path, ground and localization; return their number."""
    drawn = [one for one in tracking if one.trace is not None]
    cases = dict.fromkeys(replace(one.case, kinematics='') for one in drawn)
    for case in cases:
        traces = {one.case.kinematics: one.trace for one in drawn
                  if one.case.name == case.name and one.trace is not None}
        save(tracking_figure(case, traces), out / f'{case.name}.png')
    return len(cases)


def _draw_starts(starts: Sequence[Starts], out: Path) -> int:
    """Draw a figure for each ground, without and with traction control; return their number."""
    pairs: dict[str, list[TractionRun]] = {}
    for one in starts:
        if one.drawn is not None:
            pairs.setdefault(one.scenario.name, []).append(one.drawn)
    for name, runs in pairs.items():
        save(traction_figure(runs), out / f'traction_{name}.png')
    return len(pairs)


def _write(path: Path, tracking: Sequence[TrackingResult], steps: Sequence[Row],
           found: Sequence[TractionScore], machine: str) -> None:
    tree: dict[str, Any] = {
        'machine': machine, 'units': 'SI', 'kinematics': KINEMATICS,
        'wheel_steps': [asdict(row) for row in steps], 'path_tracking': as_tree(tracking),
        'traction': [{**{name: value for name, value in asdict(one).items()
                         if name != 'scenario'}, 'scenario': one.scenario.name,
                      'wheel_rate': one.scenario.wheel_rate, 'seed': one.scenario.seed,
                      'traction_control': one.scenario.traction} for one in found]}
    path.write_text(json.dumps(plain(tree), indent=2, allow_nan=False) + '\n', encoding='utf-8')
