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

"""Command line functions shared by the benchmarks."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Sequence
import os
from pathlib import Path
import platform
import sys

from smart_tire.cli._options import add_force, refuse_existing
from smart_tire.errors import ParameterError, SmartTireError

FAILED, USAGE = 1, 2  # exit statuses
DATA = Path('../shared/data')  # recordings of real robots
DEFAULT_SEEDS = 3  # of each simulated scenario


def positive(text: str) -> int:
    """Return ``text`` as an integer; raise ValueError unless it is positive."""
    number = int(text)
    if number < 1:
        raise ValueError(text)
    return number


def accuracy_parser(name: str, description: str) -> argparse.ArgumentParser:
    """Return the parser of a benchmark that simulates over several seeds and writes figures."""
    parser = argparse.ArgumentParser(prog=f'python -m benchmarks.{name}', description=description)
    parser.add_argument('--seeds', type=positive, default=DEFAULT_SEEDS, metavar='N',
                        help='number of seeds of each simulated scenario (default: %(default)s)')
    parser.add_argument('--first-seed', type=positive, default=1, metavar='SEED',
                        help='first of the seeds (default: %(default)s)')
    parser.add_argument('--quick', action='store_true', help='only one seed of each scenario')
    parser.add_argument('--runs', nargs='+', default=[], metavar='RUN',
                        help='scenarios and recordings to run (default: all)')
    parser.add_argument('--out', type=Path, default=Path('bench_output', name), metavar='DIR',
                        help='folder for figures and results.json (default: %(default)s)')
    add_force(parser)
    return parser


def refuse_existing_results(out: Path, *, force: bool) -> None:
    """Raise ParameterError if ``out`` holds results of an earlier run."""
    refuse_existing([out / 'results.json', *sorted(out.glob('*.png'))], force=force)


def run_benchmark(name: str, work: Callable[[], None]) -> int:
    """Run ``work`` and return the exit status; print errors of this package in one line."""
    try:
        work()
    except SmartTireError as error:
        print(f'benchmarks.{name}: {error}', file=sys.stderr)
        return USAGE if isinstance(error, ParameterError) else FAILED
    return 0


def run_accuracy_benchmark(name: str, args: argparse.Namespace, titles: Collection[str],
                           benchmark: Callable[[Sequence[int], str], None]) -> int:
    """
    Run an accuracy benchmark with the arguments of ``accuracy_parser``; return the exit status.

    ``benchmark`` takes the seeds and the name of the machine. Nothing is run if a run
    is not among ``titles`` or results would be overwritten.
    """
    def work() -> None:
        refuse_existing_results(args.out, force=args.force)
        unknown = [run for run in args.runs if run not in titles]
        if unknown:
            raise ParameterError(f'{", ".join(unknown)}: no such run, expected some of '
                                 f'{", ".join(titles)}')
        on = machine()
        print(on)
        count = 1 if args.quick else args.seeds
        benchmark(range(args.first_seed, args.first_seed + count), on)
    return run_benchmark(name, work)


def parse_no_arguments(name: str, description: str, argv: Sequence[str] | None) -> None:
    """Handle ``--help``; reject all other arguments."""
    argparse.ArgumentParser(
        prog=f'python -m benchmarks.{name}', description=description).parse_args(argv)


def machine() -> str:
    """Return processor, number of cores, Python version and load average."""
    models = [line.partition(':')[2].strip()
              for line in Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
              if line.startswith('model name')]
    return (f'{models[0] if models else platform.machine()}, '
            f'{len(os.sched_getaffinity(0))} cores, Python {platform.python_version()}, '
            f'load {os.getloadavg()[0]:.1f} before')
