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
Benchmark of ``smart_tire calibrate``: consistency of values and standard errors, and refusals.

The pooled share of true values within two standard errors, and the mean of the squared normalized
errors, over all identified values of all seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial

from benchmarks.calibration.recordings import ROUTES
from benchmarks.calibration.scoring import calibrated_run, parameters, Run, Score, score
from benchmarks.harness import machine, new_table, positive, print_tables, run_benchmark, run_jobs
from rich.table import Table
from smart_tire.errors import ParameterError

FIRST_SEED, LAST_SEED = 201, 220


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.calibration', description=__doc__)
    parser.add_argument('--seeds', type=positive, nargs=2, default=(FIRST_SEED, LAST_SEED),
                        metavar=('FIRST', 'LAST'), help='seeds (default: %(default)s)')
    parser.add_argument('--routes', nargs='+', default=list(ROUTES), metavar='ROUTE',
                        help=f'some of {", ".join(ROUTES)} (default: all)')
    parser.add_argument('--no-films', action='store_true', help='without films, faster')
    args = parser.parse_args(argv)

    def work() -> None:
        if unknown := [route for route in args.routes if route not in ROUTES]:
            raise ParameterError(f'{", ".join(unknown)}: no such route, expected some of '
                                 f'{", ".join(ROUTES)}')
        print(machine())
        first, last = args.seeds
        jobs = [partial(calibrated_run, route, seed, films=not args.no_films)
                for route in args.routes for seed in range(first, last + 1)]
        print_runs(run_jobs(jobs, lambda run: f'{run.route} {run.seed}'))
    return run_benchmark('calibration', work)


def print_runs(runs: Sequence[Run]) -> None:
    """Print a table per route, and the reasons of refusals."""
    for route in dict.fromkeys(run.route for run in runs):
        own = sorted((run for run in runs if run.route == route), key=lambda run: run.seed)
        print_tables('', [table(route, own)])
        for name in parameters(own):
            reasons = [run.kept[name] for run in own if name in run.kept]
            if reasons:
                print(f'{name}: kept in {len(reasons)} of {len(own)}: {reasons[0]}')


def table(route: str, runs: Sequence[Run]) -> Table:
    """Return the scores of each parameter and of all pooled."""
    made = new_table(f'{route}, {len(runs)} seeds', 'parameter', 'identified', 'within 2 sigma',
                     'NEES', 'mean error [sigma]')
    for name in (*parameters(runs), None):
        made.add_row(name or 'all, pooled', *cells(score(runs, name), len(runs)))
    return made


def cells(found: Score | None, runs: int) -> tuple[str, ...]:
    """Return the cells of a row after the name."""
    if found is None:
        return f'0 / {runs}', '-', '-', '-'
    return (f'{found.runs} / {runs}', f'{found.within:.0%}', f'{found.nees:.2f}',
            f'{found.mean:+.2f}')
