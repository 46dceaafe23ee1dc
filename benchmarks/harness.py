# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Harness of the benchmarks: command line, parallel jobs, tables and ``results.json``.

A ``Benchmark`` names its runs, gives the jobs of each run and seed, and the tables of their
figures. A job returns the ``Run`` of one or several methods on one scenario.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
from dataclasses import dataclass
import json
import math
from multiprocessing import get_context
import os
from pathlib import Path
import platform
import sys
from typing import NamedTuple, TypeVar

from benchmarks.scoring import combined, Figures, Run
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text
from smart_tire.analysis.summary import plain
from smart_tire.cli._outputs import refuse_existing
from smart_tire.errors import ParameterError, SmartTireError

FAILED, USAGE = 1, 2  # exit statuses
DATA = Path('../shared/data')  # recordings of real robots
DEFAULT_SEEDS = 3     # of each simulated scenario
MAX_WORKERS = 2       # parallel processes
CONSOLE_WIDTH = 220   # characters without a terminal; enough for all tables

Rows = Mapping[str, Figures]  # row -> figures over its seeds
Job = Callable[[], Sequence[Run]]
Result = TypeVar('Result')


class Range(NamedTuple):
    """What ``docs/benchmarks.md`` says of a measured figure."""

    figure: str    # with its unit
    least: float
    most: float

    @property
    def text(self) -> str:
        """Return both ends."""
        return f'{self.least:g} to {self.most:g}'


@dataclass(frozen=True)
class Benchmark:
    """An accuracy benchmark; ``jobs`` and ``tables`` get the parsed arguments."""

    name: str
    description: str
    notes: str                # above the tables
    titles: Mapping[str, str]  # of the runs
    jobs: Callable[[str, Sequence[int], argparse.Namespace], Iterable[Job]]
    tables: Callable[[Rows, argparse.Namespace], Iterable[Table]]
    add_arguments: Callable[[argparse.ArgumentParser], object] = lambda parser: None
    draw: Callable[[Sequence[Run], Path], object] = lambda runs, folder: None  # figures
    in_ranges: Callable[[Rows], Iterable[tuple[Range, float]]] = lambda rows: ()

    def main(self, argv: Sequence[str] | None = None) -> int:
        """Run the benchmark; return the exit status."""
        parser = argparse.ArgumentParser(prog=f'python -m benchmarks.{self.name}',
                                         description=self.description)
        parser.add_argument('--seeds', type=positive, default=DEFAULT_SEEDS, metavar='N',
                            help='number of seeds of each scenario (default: %(default)s)')
        parser.add_argument('--first-seed', type=positive, default=1, metavar='SEED',
                            help='first of the seeds (default: %(default)s)')
        parser.add_argument('--quick', action='store_true', help='only one seed of each scenario')
        parser.add_argument('--runs', nargs='+', default=[], metavar='RUN',
                            help='scenarios and recordings to run (default: all)')
        parser.add_argument('--out', type=Path, default=Path('bench_output', self.name),
                            metavar='DIR',
                            help='folder for tables and results (default: %(default)s)')
        parser.add_argument('--force', action='store_true', help='replace existing results')
        self.add_arguments(parser)
        args = parser.parse_args(argv)
        return run_benchmark(self.name, lambda: self._run(args))

    def _run(self, args: argparse.Namespace) -> None:
        """Run all jobs, print the tables and write the results."""
        refuse_existing([args.out / 'results.json'], force=args.force)
        if unknown := [run for run in args.runs if run not in self.titles]:
            raise ParameterError(f'{", ".join(unknown)}: no such run, expected some of '
                                 f'{", ".join(self.titles)}')
        on = machine()
        print(on)
        make_folder(args.out)
        seeds = range(args.first_seed, args.first_seed + (1 if args.quick else args.seeds))
        jobs = [job for name in args.runs or self.titles for job in self.jobs(name, seeds, args)]
        runs = [run for found in run_jobs(jobs, _label) for run in found]
        by_row: dict[str, list[Run]] = {}
        for run in runs:
            by_row.setdefault(run.row, []).append(run)
        rows = {row: combined(own) for row, own in by_row.items()}
        tree = {'machine': on, 'rows': {row: {
            'over_seeds': rows[row], 'seeds': {run.seed: combined([
                one for one in own if one.seed == run.seed]) for run in own}}
            for row, own in by_row.items()}}
        (args.out / 'results.json').write_text(
            json.dumps(plain(tree), indent=1, allow_nan=False) + '\n', encoding='utf-8')
        tables = [*self.tables(rows, args), *_note_tables(runs)]
        print_tables(self.notes, tables)
        (args.out / f'{self.name}.md').write_text(
            f'{self.notes}\n' + '\n'.join(map(markdown, tables)), encoding='utf-8')
        self.draw(runs, args.out)
        print(f'{len(jobs)} jobs; {self.name}.md and results.json in {args.out}')
        check_ranges(self.in_ranges(rows))


def _note_tables(runs: Sequence[Run]) -> Iterator[Table]:
    """Yield the table of the notes of the runs, if any: how often, and the first."""
    notes: dict[tuple[str, str], list[str]] = {}
    for run in runs:
        for name, note in run.notes.items():
            notes.setdefault((run.row, name), []).append(note)
    if notes:
        table = new_table('Notes', '', 'runs', 'first')
        for (row, name), own in notes.items():
            table.add_row(f'{row}: {name}', str(len(own)), own[0])
        yield table


def _label(runs: Sequence[Run]) -> str:
    return ', '.join(dict.fromkeys(f'{run.row}, seed {run.seed}' for run in runs))


def run_benchmark(name: str, work: Callable[[], None]) -> int:
    """Run ``work`` and return the exit status; print errors of this package in one line."""
    try:
        work()
    except SmartTireError as error:
        print(f'benchmarks.{name}: {error}', file=sys.stderr)
        return USAGE if isinstance(error, ParameterError) else FAILED
    return 0


def run_jobs(jobs: Sequence[Callable[[], Result]], label: Callable[[Result], str]
             ) -> list[Result]:
    """Return the results of ``jobs`` in their order; print progress to stderr."""
    if len(jobs) == 1:
        return [jobs[0]()]
    # spawn, not fork: this process may have threads
    with ProcessPoolExecutor(MAX_WORKERS, get_context('spawn')) as pool:
        futures = [pool.submit(job) for job in jobs]
        try:
            for count, future in enumerate(as_completed(futures), 1):
                print(f'{count:3}/{len(jobs)}  {label(future.result())}', file=sys.stderr,
                      flush=True)
        finally:
            pool.shutdown(cancel_futures=True)
        return [future.result() for future in futures]


def positive(text: str) -> int:
    """Return ``text`` as an integer; raise ValueError unless it is positive."""
    number = int(text)
    if number < 1:
        raise ValueError(text)
    return number


def machine() -> str:
    """Return processor, number of cores, Python version and load average."""
    models = [line.partition(':')[2].strip()  # of the processor; on ARM of the board
              for line in Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
              if line.startswith(('model name', 'Model'))]
    return (f'{models[0] if models else platform.machine()}, '
            f'{len(os.sched_getaffinity(0))} cores, Python {platform.python_version()}, '
            f'load {os.getloadavg()[0]:.1f} before')


def make_folder(path: Path) -> None:
    """Create the output folder; raise ParameterError if that fails."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f'{path}: cannot be written ({error.strerror})') from error


def check_ranges(measured: Iterable[tuple[Range, float]]) -> None:
    """Print figures next to their ranges; raise SmartTireError if one is outside."""
    table, outside = new_table('Ranges in docs/benchmarks.md', '', 'measured', 'range', ''), []
    for one, value in measured:
        inside = one.least <= value <= one.most
        table.add_row(Text(one.figure), f'{value:.3g}', one.text, '' if inside else 'OUTSIDE')
        outside += [] if inside else [one.figure]
    if table.row_count:
        print_tables('', [table])
    if outside:
        raise SmartTireError(f'outside the range of docs/benchmarks.md: {"; ".join(outside)}')


class Column(NamedTuple):
    """A column of numbers: heading, name of the figure, decimals, factor from SI units."""

    head: str
    name: str
    digits: int = 1
    scale: float = 1.0


def percent(head: str, name: str, digits: int = 1) -> Column:
    """Return the column of a share in percent."""
    return Column(head, name, digits, 100.0)


def milli(head: str, name: str, digits: int = 1) -> Column:
    """Return the column of a figure in a thousandth of its unit."""
    return Column(head, name, digits, 1e3)


def figure_table(title: str, rows: Iterable[tuple[str, Mapping[str, float]]],
                 columns: Sequence[Column]) -> Table:
    """Return the table of ``rows``, a label and figures each; a dash where there is no figure."""
    table = new_table(title, '', *(column.head for column in columns))
    for label, figures in rows:
        table.add_row(label, *(number(one.scale * figures.get(one.name, math.nan), one.digits)
                               for one in columns))
    return table


def new_table(title: str, *columns: str) -> Table:
    """Return an empty table with a label column and columns of numbers."""
    table = Table(title=Text(title), title_justify='left', title_style='bold', box=SIMPLE_HEAD,
                  pad_edge=False, padding=(0, 1, 0, 0))
    for i, column in enumerate(columns):
        table.add_column(Text(column), justify='right' if i else 'left', no_wrap=True)
    return table


def number(value: float, digits: int) -> str:
    """Return ``value`` with ``digits`` decimals; a dash if it is not finite."""
    return f'{value:.{digits}f}' if math.isfinite(value) else '-'


def print_tables(notes: str, tables: Iterable[Table]) -> None:
    """Print the notes and the tables, wide without a terminal."""
    console = Console()
    console = console if console.is_terminal else Console(width=CONSOLE_WIDTH)
    console.print(Text(notes))
    for table in tables:
        console.print(table)


def markdown(table: Table) -> str:
    """Return ``table`` as a Markdown table under its title."""
    def lines() -> Iterator[Iterable[str]]:
        yield (str(column.header).replace('\n', ' ').strip() for column in table.columns)
        yield ['---'] * len(table.columns)
        yield from zip(*([str(cell).strip() for cell in column.cells]
                         for column in table.columns))
    return f'{table.title}\n\n' + ''.join(f'| {" | ".join(line)} |\n' for line in lines())
