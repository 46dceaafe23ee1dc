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
from dataclasses import dataclass
import json
import os
from pathlib import Path
import signal
import socket
import subprocess
import sys
import tempfile
import threading

from benchmarks.harness import machine, new_table, print_tables, run_benchmark
from smart_tire.bags import BagWriter
from smart_tire.errors import SmartTireError
from smart_tire.parameters import build, SimulatorParams
from smart_tire.simulation.offline import simulate

DESCRIPTION = 'measure time and memory of many short bags'
DURATION = 5.0  # s, of a bag by default
PARAMETERS = '/**: {ros__parameters: {wheel_radius: 0.087, film: {wheels: [front_left]}}}\n'
ONE, ALL, CLUSTER, KILLED = 'one process', 'all cores', 'cluster', 'cluster, worker killed'
POLL = 0.2  # s, between two looks at what is done
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
    parser.add_argument('--modes', nargs='+', choices=[ONE, ALL, CLUSTER, KILLED],
                        default=[ONE, ALL, CLUSTER, KILLED], help='who reads them (default: all)')
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
            if mode in (CLUSTER, KILLED):
                with local_cluster() as (address, used), killed_worker(
                        used.workers, out, count // 2 if mode == KILLED else 0):
                    found = measured([*words, '--dask', address])
                cpu, worker, size = used.cpu + found[1], used.worker, f'{used.scheduler:.0f}'
            else:
                found = measured([*words, '--jobs', 1 if mode == ONE else os.cpu_count() or 1])
                (_, cpu, _, worker), size = found, '-'
            done = len(list(out.glob('drives/*/*/*.parquet')))
            if done != count:
                raise SmartTireError(f'{done} of {count} bags are in the data set')
            written = sum(path.stat().st_size for path in out.rglob('*.parquet'))
            yield [mode, str(count), f'{found[0]:.1f}', f'{found[0] / count:.2f}',
                   f'{cpu / count:.2f}', f'{found[2]:.0f}', f'{worker:.0f}', size,
                   f'{written / count / 1000.0:.0f}']


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


@dataclass
class ClusterUsage:
    """What a cluster has used when it has ended."""

    workers: int            # process that starts them, and again if they die
    cpu: float = 0.0        # s, of all
    worker: float = 0.0     # MB, the largest size of any
    scheduler: float = 0.0  # MB


@contextmanager
def local_cluster() -> Iterator[tuple[str, ClusterUsage]]:
    """Yield the address of a scheduler with a worker per core, and what they use."""
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    address = f'tcp://127.0.0.1:{port}'
    common = ['--host', '127.0.0.1', '--no-dashboard']
    commands = [['scheduler', '--port', str(port), *common],
                ['worker', address, '--nworkers', str(os.cpu_count() or 1), '--nthreads', '1',
                 *common]]
    scheduler, workers = (subprocess.Popen(
        [sys.executable, '-m', f'distributed.cli.dask_{name}', *words],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) for name, *words in commands)
    used = ClusterUsage(workers.pid)
    try:
        yield address, used
    finally:
        sizes = []
        for process in (workers, scheduler):
            process.terminate()
            _, status, usage = os.wait4(process.pid, 0)  # with the children it has waited for
            process.returncode = os.waitstatus_to_exitcode(status)
            used.cpu += usage.ru_utime + usage.ru_stime
            sizes.append(usage.ru_maxrss / 1024.0)
        used.worker, used.scheduler = sizes


@contextmanager
def killed_worker(parent: int, folder: Path, count: int) -> Iterator[None]:
    """Kill a worker as soon as ``count`` drives are in the data set ``folder``; 0: none."""
    ended, killed = threading.Event(), threading.Event()

    def kill() -> None:
        while len(list(folder.glob('drives/*/*/*.parquet'))) < count:
            if ended.wait(POLL):
                return
        children = [child for task in Path(f'/proc/{parent}/task').iterdir()
                    for child in (task / 'children').read_text(encoding='ascii').split()]
        os.kill(next(int(child) for child in children if b'spawn_main' in Path(
            f'/proc/{child}/cmdline').read_bytes()), signal.SIGKILL)
        killed.set()

    thread = threading.Thread(target=kill)
    if count:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        if count:
            thread.join()
    if count and not killed.is_set():
        raise SmartTireError('no worker was killed')


if __name__ == '__main__':
    sys.exit(main())
