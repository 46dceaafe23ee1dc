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
Start, memory and idle load of each node, next to a node with rclpy and numpy that does nothing.

The nodes start in turn, several times, each until its first ``/diagnostics``; the least of each
figure counts, since other programs only add to it. A round before them writes the bytecode of the
modules, as the first start of an installation does, and is not measured. Then all run together
without any input, and with ``benchmarks.empty_node``, for the idle load. The simulator is never
idle.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
import os
from pathlib import Path
import sys
import tempfile
import time
from typing import Any, NamedTuple

from benchmarks.harness import (
    check_ranges, machine, new_table, positive, print_tables, Range, run_benchmark)
from rich.table import Table
from smart_tire.cli._stack import isolated_environment, NODES, Stack
from smart_tire.errors import SmartTireError

DESCRIPTION = 'measure start, memory and idle load of each node'
FLOOR = 'empty_node'
IDLE = tuple(name for name in NODES if name != 'robot_simulator')
RANGES = (Range('start of a node, largest CPU time over that of the empty node', 1.0, 1.6),
          Range('its memory above that of the empty node, largest [MB]', 0.0, 12.0),
          Range('largest idle load of a node [cores]', 0.0, 0.02))
NO_BYTECODE = 'PYTHONDONTWRITEBYTECODE'  # environment, with which each start compiles all modules
START_TIMEOUT = 60.0  # s until the first diagnostics
SPIN_TIME = 0.02      # s, resolution of the time of a start
WARM_UP_TIME = 3.0    # s after the last start, until all nodes have found each other


class Start(NamedTuple):
    """A process when its first message arrives."""

    cpu: float      # s, user and system
    wall: float     # s since its begin
    private: float  # B, memory of the process alone
    resident: float  # B, with the libraries that processes share


def main(argv: Sequence[str] | None = None) -> int:
    """Measure all nodes and the empty one; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.start', description=DESCRIPTION)
    parser.add_argument('--repeats', type=positive, default=5, metavar='N',
                        help='starts of each node (default: %(default)s)')
    parser.add_argument('--seconds', type=float, default=20.0, metavar='S',
                        help='duration of the idle time (default: %(default)s)')
    args = parser.parse_args(argv)
    # Importing rclpy may start Python again, so it must come before any child is started.
    from smart_tire.nodes.pilot import Pilot
    from smart_tire.nodes.runner import NodeRunner

    def measure() -> None:
        on, environment = machine(), isolated_environment()
        os.environ.update(environment)  # the node runner is in this process
        environment = with_bytecode(environment)
        with tempfile.TemporaryDirectory(prefix='smart_tire_bench_') as folder, \
                Stack(Path(folder), environment) as stack, \
                NodeRunner(partial(Pilot, 'observer'), []) as runner:
            rounds = [{name: start(stack, runner, name) for name in (FLOOR, *NODES)}
                      for _ in range(1 + args.repeats)][1:]
            least = {name: Start(*map(min, zip(*(one[name] for one in rounds))))
                     for name in (FLOOR, *NODES)}
            idle = idle_loads(stack, runner, args.seconds)
            print_tables(on, [table(least, idle)])
            check_ranges(zip(RANGES, worst(least, idle)))
    return run_benchmark('start', measure)


def with_bytecode(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the environment in which Python keeps the bytecode of modules, as by default."""
    return {name: value for name, value in environment.items() if name != NO_BYTECODE}


def start(stack: Stack, runner: Any, name: str) -> Start:
    """Return the figures of a start; the process is ended."""
    begin = time.monotonic()
    launch(stack, name)
    await_message(stack, runner, name)
    wall, pid = time.monotonic() - begin, stack.processes[name].pid
    found = Start(cpu_seconds(pid), wall, *memory(pid))
    stack.stop(name)
    del stack.processes[name]
    runner.spin(SPIN_TIME)
    return found


def launch(stack: Stack, name: str) -> None:
    """Start a node of this package or the empty one."""
    if name == FLOOR:
        stack.start(name, f'benchmarks.{name}')
    else:
        stack.node(name)


def await_message(stack: Stack, runner: Any, name: str) -> None:
    """Wait for the next diagnostics of a node; raise SmartTireError without."""
    deadline = time.monotonic() + START_TIMEOUT
    runner.node.health.pop(name, None)
    while name not in runner.node.health:
        if stack.died() or time.monotonic() > deadline:
            raise SmartTireError(f'{name} does not start\n{stack.log(name)}')
        runner.spin(SPIN_TIME)


def cpu_seconds(pid: int) -> float:
    """Return the CPU time [s] of the threads of a process; /proc/PID/stat counts in 10 ms."""
    return sum(int(file.read_bytes().split()[0]) for file in
               Path(f'/proc/{pid}/task').glob('*/schedstat')) * 1e-9


def memory(pid: int) -> tuple[float, float]:
    """Return the memory [B] of a process: of its own, and with what it shares."""
    status = dict(line.split(':', 1) for line in
                  Path(f'/proc/{pid}/status').read_text(encoding='utf-8').splitlines())
    private, resident = (1024.0 * int(status[key].split()[0]) for key in ('RssAnon', 'VmRSS'))
    return private, resident


def idle_loads(stack: Stack, runner: Any, seconds: float) -> dict[str, float]:
    """Return the cores that nodes without input and the empty node use."""
    for name in (FLOOR, *IDLE):
        launch(stack, name)
    for name in (FLOOR, *IDLE):
        await_message(stack, runner, name)
    runner.spin(WARM_UP_TIME)
    pids = {name: process.pid for name, process in stack.processes.items()}
    begin, before = time.monotonic(), {name: cpu_seconds(pid) for name, pid in pids.items()}
    time.sleep(seconds)
    return {name: (cpu_seconds(pid) - before[name]) / (time.monotonic() - begin)
            for name, pid in pids.items()}


def worst(starts: Mapping[str, Start], idle: Mapping[str, float]) -> tuple[float, float, float]:
    """Return the largest figures of ``RANGES`` among the nodes of a robot."""
    floor = starts[FLOOR]
    return (max(starts[name].cpu for name in IDLE) / floor.cpu,
            (max(starts[name].private for name in IDLE) - floor.private) / 1e6,
            max(idle[name] for name in IDLE))


def table(starts: Mapping[str, Start], idle: Mapping[str, float]) -> Table:
    """Return the table of all nodes, each next to the empty one."""
    found = new_table('Start until the first message, and idle load', '', 'start\nCPU [s]',
                      'of empty\nnode', 'start\n[s]', 'of empty\nnode', 'memory\n[MB]',
                      'above\nempty', 'resident\n[MB]', 'idle\n[cores]', 'of empty\nnode')
    floor = starts[FLOOR]
    for name, one in starts.items():
        cells = [f'{one.cpu:.2f}', f'{one.cpu / floor.cpu:.2f}', f'{one.wall:.2f}',
                 f'{one.wall / floor.wall:.2f}', f'{one.private / 1e6:.1f}',
                 f'{(one.private - floor.private) / 1e6:.1f}', f'{one.resident / 1e6:.1f}']
        if name in idle:
            cells += [f'{idle[name]:.4f}', f'{idle[name] / idle[FLOOR]:.2f}']
        found.add_row(name, *cells)
    return found


if __name__ == '__main__':
    sys.exit(main())
