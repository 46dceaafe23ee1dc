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
Benchmark of robots drawn at random around the model of the estimators, and away from it.

The complete pipeline with the nominal parameters processes the messages of each robot. Tables are
printed; ``robots.md`` and ``results.json`` are written.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
import json
from pathlib import Path
from typing import Any

from benchmarks.command import accuracy_parser, run_accuracy_benchmark
from benchmarks.jobs import make_folder, run_jobs
from benchmarks.robots.draws import DISTRIBUTIONS, draw, ROWS, TUNING_SEED
from benchmarks.robots.scoring import RobotResult, row_figures, run_robot
from benchmarks.robots.tables import before_path, compact, NOTES, tables
from benchmarks.tables import markdown, new_console, print_all
from smart_tire.analysis.summary import plain

TITLES = {name: row.title for name, row in ROWS.items()}

Job = Callable[[], RobotResult]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return the exit status."""
    parser = accuracy_parser('robots', 'accuracy on robots drawn at random')
    parser.add_argument('--tuning', action='store_true',
                        help=f'seeds for tuning: counted from {TUNING_SEED}')
    parser.add_argument('--known-radius', action='store_true',
                        help='give the true wheel radius to the estimators')
    parser.add_argument('--nominal', nargs='+', default=[], choices=DISTRIBUTIONS,
                        metavar='PROPERTY', help='properties that are not drawn: '
                        + ', '.join(DISTRIBUTIONS))
    parser.add_argument('--keep-before', action='store_true',
                        help=f'write the figures to {before_path().name}, shown by later runs')
    args = parser.parse_args(argv)
    if args.tuning:
        args.first_seed += TUNING_SEED - 1
    return run_accuracy_benchmark('robots', args, TITLES, lambda seeds, on: benchmark(
        args.runs or list(ROWS), seeds, args.out, on, nominal=args.nominal,
        known_radius=args.known_radius, keep=args.keep_before))


def benchmark(names: Sequence[str], seeds: Sequence[int], out: Path, machine_name: str, *,
              nominal: Sequence[str] = (), known_radius: bool = False, keep: bool = False
              ) -> None:
    """Run all robots, print the tables and write the results."""
    make_folder(out)
    variant = [*nominal, *['known_radius'] * known_radius]
    jobs: list[Job] = [partial(run, name, seed, nominal, known_radius)
                       for seed in seeds for name in names]
    results = sorted(run_jobs(jobs, label), key=lambda one: one.seed)
    by_row = {name: [one for one in results if one.row == name]
              for name in ROWS if name in names}
    rows = {name: row_figures(own) for name, own in by_row.items()}
    tree: dict[str, Any] = {
        'machine': machine_name, 'seeds': list(seeds), 'known_radius': known_radius,
        'nominal': list(nominal),
        'units': 'mu: relative errors; slip: -; u, v_y: m/s; load: CPU time over duration',
        'rows': {name: {'title': TITLES[name], 'over_robots': rows[name], 'robots': {
            one.seed: {**one.figures, 'drawn': draw(name, one.seed, nominal).values}
            for one in own}} for name, own in by_row.items()}}
    (out / 'results.json').write_text(
        json.dumps(plain(tree), indent=1, allow_nan=False) + '\n', encoding='utf-8')
    if keep:
        before_path(variant).write_text(compact(rows, seeds), encoding='utf-8')
    found = list(tables(rows, variant))
    print_all(new_console(), NOTES, found)
    (out / 'robots.md').write_text(
        NOTES + '\n\n' + '\n'.join(map(markdown, found)), encoding='utf-8')
    print(f'{len(results)} robots; robots.md and results.json in {out}')


def run(name: str, seed: int, nominal: Sequence[str] = (), known_radius: bool = False
        ) -> RobotResult:
    """Return the results of one robot."""
    one = draw(name, seed, nominal)
    return run_robot(one.known_radius() if known_radius else one)


def label(result: RobotResult) -> str:
    """Return the label of ``result`` for progress lines."""
    return f'{TITLES[result.row]}, seed {result.seed}'
