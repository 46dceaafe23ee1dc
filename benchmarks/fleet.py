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
Time and memory of many short bags: one process, all cores, and a cluster of processes here.

One drive is simulated; the others are hard links to its file. Each measurement is a command of
its own, whose imports count.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import json
import os
from pathlib import Path
import re
import socket
import subprocess
import sys
import tempfile

from benchmarks.harness import machine, new_table, print_tables, run_benchmark
from smart_tire.bags import BagWriter
from smart_tire.errors import SmartTireError
from smart_tire.parameters import build, SimulatorParams
from smart_tire.simulation.offline import simulate

DESCRIPTION = 'measure time and memory of many short bags'
DURATION = 5.0  # s, of a bag by default
PARAMETERS = '/**: {ros__parameters: {wheel_radius: 0.087, film: {wheels: [front_left]}}}\n'
ONE, ALL, CLUSTER = 'one process', 'all cores', 'cluster'
# Prints wall and CPU time [s], and the sizes of this process and of its largest child [MB].
MEASURED = """
import json, resource, sys, time
from smart_tire.cli.main import main
begin, status = time.perf_counter(), main(sys.argv[1:])
usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
print(json.dumps([status, time.perf_counter() - begin, sum(
    one.ru_utime + one.ru_stime for one in usage), *(one.ru_maxrss / 1024.0 for one in usage)]))
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure growing numbers of bags; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.fleet', description=DESCRIPTION)
    parser.add_argument('--bags', type=int, nargs='+', default=[10, 100], metavar='N',
                        help='numbers of bags (default: 10 100)')
    parser.add_argument('--modes', nargs='+', choices=[ONE, ALL, CLUSTER],
                        default=[ONE, ALL, CLUSTER], help='who reads them (default: all)')
    parser.add_argument('--duration', type=float, default=DURATION, metavar='S',
                        help='of a bag (default: %(default)s)')
    args = parser.parse_args(argv)

    def measure() -> None:
        table = new_table(f'Bags of {args.duration:g} s into a data set', 'processes', 'bags',
                          'wall [s]', 'per bag [s]', 'CPU per bag [s]', 'client [MB]',
                          'worker [MB]', 'scheduler [MB]', 'data set per bag [kB]')
        with tempfile.TemporaryDirectory(prefix='smart_tire_bench_') as folder:
            for row in rows(Path(folder), args.modes, args.bags, args.duration):
                table.add_row(*row)
                print(' '.join(row), file=sys.stderr, flush=True)
        print_tables(machine(), [table])
    return run_benchmark('fleet', measure)


def rows(folder: Path, modes: Sequence[str], counts: Sequence[int], duration: float = DURATION
         ) -> Iterator[list[str]]:
    """Yield the rows of the table."""
    params = folder / 'params.yaml'
    params.write_text(PARAMETERS, encoding='utf-8')
    first = folder / 'drive'
    with BagWriter(first) as writer:
        for receive_ns, topic, sample in simulate(build(SimulatorParams, {
                'film.wheels': ['front_left'], 'seed': 1}), [(0.3, 100.0, 60.0)], duration):
            writer.write_sample(topic, receive_ns, sample)
    for mode in modes:
        for count in counts:
            bags, out = folder / f'bags_{count}', folder / f'{mode.split()[0]}_{count}'
            link_bags(first, bags, count)
            words = ['analyze', bags, '--params', params, '--dataset', out]
            if mode == CLUSTER:
                with local_cluster() as (address, scheduler):
                    found = measured([*words, '--dask', address])
                    size = f'{peak_size(scheduler):.0f}'
                cpu = worker = '-'
            else:
                found = measured([*words, '--jobs', 1 if mode == ONE else os.cpu_count() or 1])
                cpu, worker, size = f'{found[1] / count:.2f}', f'{found[3]:.0f}', '-'
            written = sum(path.stat().st_size for path in out.rglob('*.parquet'))
            yield [mode, str(count), f'{found[0]:.1f}', f'{found[0] / count:.2f}', cpu,
                   f'{found[2]:.0f}', worker, size, f'{written / count / 1000.0:.0f}']


def link_bags(first: Path, folder: Path, count: int) -> None:
    """Make ``count`` bags in ``folder`` with the files of the bag ``first``."""
    for number in range(count):
        bag = folder / f'drive_{number:04d}'
        if not bag.exists():
            bag.mkdir(parents=True)
            for file in first.iterdir():
                os.link(file, bag / file.name)


def measured(words: Sequence[object]) -> list[float]:
    """Return wall, CPU time [s], size of the client and of its largest child [MB]."""
    done = subprocess.run([sys.executable, '-c', MEASURED, *map(str, words)],
                          capture_output=True, text=True, check=False)
    found = json.loads(done.stdout.splitlines()[-1]) if not done.returncode else [1]
    if found[0]:
        raise SmartTireError(f'a measured command has failed:\n{done.stderr}')
    return found[1:]


@contextmanager
def local_cluster() -> Iterator[tuple[str, int]]:
    """Yield address and process of a scheduler that has a worker per core."""
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    address = f'tcp://127.0.0.1:{port}'
    common = ['--host', '127.0.0.1', '--no-dashboard']
    commands = [['scheduler', '--port', str(port), *common],
                ['worker', address, '--nworkers', str(os.cpu_count() or 1), '--nthreads', '1',
                 *common]]
    processes = [subprocess.Popen(
        [sys.executable, '-m', f'distributed.cli.dask_{name}', *words],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) for name, *words in commands]
    try:
        yield address, processes[0].pid
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def peak_size(process: int) -> float:
    """Return the largest size [MB] that a process has had."""
    text = Path(f'/proc/{process}/status').read_text(encoding='ascii')
    return int(re.findall(r'VmHWM:\s+(\d+)', text)[0]) / 1024.0


if __name__ == '__main__':
    sys.exit(main())
