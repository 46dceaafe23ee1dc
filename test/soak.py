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
Soak test: the simulated robot drives for hours while faults happen at random.

``make soak MINUTES=60`` starts all nodes and a recorder. Nodes are stopped for a moment, other
programs take the cores, participants come and are killed, the emergency stop is engaged; in the
first third of the time nodes are also killed, or ended, and started again. After each fault every
node must report again, and the robot drive, within ``MAX_RECOVERY``; no process may die by itself
or log an exception, and the memory of none may grow by ``MAX_GROWTH``.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
import os
from pathlib import Path
from random import Random
import re
import signal
import subprocess
import sys
import time
from typing import Any

import numpy as np
from smart_tire.cli._options import remove_bag
from smart_tire.cli._stack import (
    isolated_environment, NODES, params_arguments, RECORDER, remove_traces, Stack,
    write_parameters)
from smart_tire.nodes.pilot import Pilot
from smart_tire.nodes.runner import NodeRunner
from smart_tire.samples import NS_PER_S
from std_srvs.srv import SetBool

SPIN_TIME = 0.1           # s
START_TIME = 60.0         # s until all nodes run
MAX_RECOVERY = 30.0       # s after the end of a fault
MAX_AGE = 0.5             # s, of odom, wheel_slip and wheel_states of a robot that drives
MAX_SILENCE = 3.0         # s, of the diagnostics of a node that runs
MIN_WHEEL_SPEED = 1.0     # rad/s, of a wheel that turns
SPEEDS = (30.0, 120.0)    # rpm of the wheels of a side
PAUSE = (2.0, 15.0)       # s between a recovery and the next fault
MEMORY_PERIOD = 5.0       # s between two measurements
RESTARTS_SHARE = 1 / 3    # of the time in which nodes are restarted; then memory is measured
SETTLING = 120.0          # s after a start until a measurement counts
MIN_TIME = 600.0          # s of measurements that show a growth
MAX_GROWTH = 5.0          # MB/h
ANONYMOUS = re.compile(r'^RssAnon:\s+(\d+) kB', re.MULTILINE)
BUSY = [sys.executable, '-c', 'while True: pass']
FAULT_TEXT = re.compile(r'Traceback|Segmentation|terminate called')


class SoakError(Exception):
    """The robot does not recover from a fault."""


@dataclass
class Memory:
    """Anonymous memory of a process, over its lives."""

    lives: list[list[tuple[float, float]]] = field(default_factory=list)  # s since start, MB

    def growth(self) -> tuple[float, float]:
        """Return the slope of all lives together [MB/h] and the time they have lasted [s]."""
        above = below = total = 0.0
        for life in self.lives:
            rows = np.array([row for row in life if row[0] > SETTLING])
            if len(rows) < 2:
                continue
            times, sizes = (rows - rows.mean(axis=0)).T
            above += float(times @ sizes)
            below += float(times @ times)
            total += float(np.ptp(times))
        return (above / below * 3600.0 if below else 0.0), total


class Soak:
    """The robot, its faults, and what became of them."""

    def __init__(self, stack: Stack, runner: Any, params: Path, rng: Random) -> None:
        self._stack, self._runner, self._params, self._rng = stack, runner, params, rng
        self._pilot: Pilot = runner.node
        self._release = self._pilot.create_client(SetBool, 'emergency_stop')
        self._heard: dict[str, float] = {}
        self._health: dict[str, Any] = {}
        self._started: dict[str, float] = {}
        self._measured = 0.0
        self.memory: defaultdict[str, Memory] = defaultdict(Memory)
        self.recoveries: defaultdict[str, list[float]] = defaultdict(list)
        self.problems: list[str] = []

    def start(self, name: str) -> None:
        """Start a node."""
        self._stack.node(name, [self._params])
        self._begin_life(name)

    def _begin_life(self, name: str) -> None:
        self._started[name] = time.monotonic()
        self.memory[name].lives.append([])

    def record(self, bag: Path) -> None:
        """Start the recorder."""
        self._stack.start(RECORDER, 'smart_tire.cli.main', 'record', '--out', str(bag))
        self._begin_life(RECORDER)

    def spin(self, seconds: float) -> None:
        """Handle messages, measure memory, note processes that have died."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._runner.spin(SPIN_TIME)
            now = time.monotonic()
            for name, values in self._pilot.health.items():
                if values is not self._health.get(name):
                    self._health[name], self._heard[name] = values, now
            if now - self._measured > MEMORY_PERIOD:
                self._measured = now
                self._measure(now)

    def _measure(self, now: float) -> None:
        for name, process in self._stack.processes.items():
            if process.poll() is not None:
                self.problems.append(f'{name} has died with status {process.returncode}\n'
                                     f'{self._stack.tail(name)}')
                self.restart(name)
            elif found := ANONYMOUS.search(Path(f'/proc/{process.pid}/status').read_text()):
                self.memory[name].lives[-1].append(
                    (now - self._started[name], int(found[1]) / 1024.0))

    def restart(self, name: str) -> None:
        """Look for exceptions in the log of a node that has ended, then start it again."""
        self.check_log(name)
        self.start(name)

    def check_log(self, name: str) -> None:
        """Note exceptions in the log of a process."""
        if FAULT_TEXT.search(log := self._stack.log(name)):
            self.problems.append(f'{name}:\n{log[-4000:]}')

    def drives(self) -> bool:
        """Return whether every node has reported, and the robot drives with fresh estimates."""
        pilot, now, now_ns = self._pilot, time.monotonic(), self._pilot.now_ns()
        fresh = all(sample is not None and now_ns - sample.stamp_ns < MAX_AGE * NS_PER_S
                    for sample in (pilot.odometry, pilot.slip, pilot.wheels))
        return (fresh and min(map(abs, pilot.wheels.velocity)) > MIN_WHEEL_SPEED
                and all(now - self._heard.get(name, 0.0) < MAX_SILENCE and
                        self._heard[name] > self._started[name] for name in NODES))

    def await_drive(self, seconds: float) -> float:
        """Wait until the robot drives; return the time [s]; raise SoakError after ``seconds``."""
        begin = time.monotonic()
        while not self.drives():
            if self._pilot.emergency_stop:
                self.emergency_stop(False)
            self.steer()
            self.spin(SPIN_TIME)
            if time.monotonic() - begin > seconds:
                silent = [name for name in NODES
                          if time.monotonic() - self._heard.get(name, 0.0) > MAX_SILENCE]
                raise SoakError(f'the robot does not drive after {seconds:.0f} s; silent: '
                                f'{", ".join(silent) or "none"}')
        return time.monotonic() - begin

    def steer(self) -> None:
        """Command wheel speeds, unless they are commanded already."""
        if not self._pilot.emergency_stop and self._pilot._driven is None:
            self._pilot.drive(*(self._rng.uniform(*SPEEDS) for _ in range(2)))

    def emergency_stop(self, engaged: bool) -> None:
        """Engage or release the emergency stop; unanswered calls are repeated by the caller."""
        self._release.call_async(SetBool.Request(data=engaged))
        self.spin(0.5)

    def random_node(self) -> str:
        """Return a node."""
        return self._rng.choice(NODES)

    def stop_for_a_moment(self) -> None:
        """Stop a node and let it continue."""
        process = self._stack.processes[self.random_node()]
        process.send_signal(signal.SIGSTOP)
        self.spin(self._rng.uniform(0.05, 3.0))
        process.send_signal(signal.SIGCONT)

    def kill(self, number: signal.Signals) -> None:
        """End a node by a signal and start it again."""
        name = self.random_node()
        process = self._stack.processes[name]
        process.send_signal(number)
        status = process.wait(30.0)
        if number == signal.SIGINT and status:
            self.problems.append(f'{name} ended with status {status}\n{self._stack.tail(name)}')
        del self._stack.processes[name]
        self.spin(self._rng.uniform(0.0, 3.0))
        self.restart(name)

    def others(self, count: int, words: Sequence[str]) -> None:
        """Run other programs for some seconds, then kill them."""
        with running(count, words):
            self.spin(self._rng.uniform(2.0, 8.0))

    def engage(self) -> None:
        """Engage the emergency stop for some seconds."""
        self.emergency_stop(True)
        self.spin(self._rng.uniform(0.5, 3.0))

    def faults(self, *, restarts: bool) -> dict[str, Callable[[], None]]:
        """Return the faults by name."""
        return {'stopped for a moment': self.stop_for_a_moment,
                'cores busy': partial(self.others, 4, BUSY),
                'participants': partial(self.others, 3, [
                    sys.executable, '-m', 'smart_tire.cli.main', 'status']),
                'emergency stop': self.engage,
                **({'killed': partial(self.kill, signal.SIGKILL),
                    'ended': partial(self.kill, signal.SIGINT)} if restarts else {})}

    def run(self, seconds: float) -> None:
        """Let faults happen for ``seconds``."""
        self.await_drive(START_TIME)
        begin = shown = time.monotonic()
        while (now := time.monotonic()) - begin < seconds:
            faults = self.faults(restarts=now - begin < RESTARTS_SHARE * seconds)
            name = self._rng.choice(list(faults))
            faults[name]()
            self.recoveries[name].append(self.await_drive(MAX_RECOVERY))
            self.spin(self._rng.uniform(*PAUSE))
            self._pilot.drive(*(self._rng.uniform(*SPEEDS) for _ in range(2)))
            if time.monotonic() - shown > 300.0:
                shown = time.monotonic()
                print(f'{(shown - begin) / 60.0:.0f} min, '
                      f'{sum(map(len, self.recoveries.values()))} faults', flush=True)


@contextmanager
def running(count: int, words: Sequence[str]) -> Any:
    """Run ``count`` processes, and kill them at the end."""
    processes = [subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                  stderr=subprocess.DEVNULL) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def report(soak: Soak, bag: Path) -> bool:
    """Print the results; return whether all is well."""
    print(f'{"fault":24}{"number":>8}{"recovery, longest [s]":>24}')
    for name, times in sorted(soak.recoveries.items()):
        print(f'{name:24}{len(times):8}{max(times):24.1f}')
    print(f'\n{"process":24}{"starts":>8}{"memory [MB]":>14}{"growth [MB/h]":>16}'
          f'{"measured [min]":>16}')
    passed = not soak.problems
    for name, memory in sorted(soak.memory.items()):
        growth, total = memory.growth()
        latest = next((life[-1][1] for life in reversed(memory.lives) if life), float('nan'))
        passed &= growth < MAX_GROWTH or total < MIN_TIME
        print(f'{name:24}{len(memory.lives):8}{latest:14.1f}{growth:16.2f}{total / 60.0:16.1f}')
    size = sum(path.stat().st_size for path in bag.iterdir())
    print(f'\nbag: {len(list(bag.glob("*.mcap")))} files, {size / 1e6:.0f} MB')
    for problem in soak.problems:
        print(f'problem: {problem}')
    return passed


def main(words: Sequence[str] | None = None) -> int:
    """Run the soak test; return 1 if the robot has a problem."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--minutes', type=float, default=60.0, help='(%(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='of the faults (%(default)s)')
    parser.add_argument('--out', type=Path, default=Path('bench_output/soak'), metavar='DIR',
                        help='bag and logs (%(default)s)')
    options = parser.parse_args(words)
    bag = options.out / 'bag'
    remove_bag(bag)
    remove_traces(options.out)
    environment = isolated_environment()
    os.environ.update(environment)
    params = write_parameters(options.out, 'soak.yaml', options.seed, {})
    with Stack(options.out / 'logs', environment) as stack, \
            NodeRunner(partial(Pilot, 'soak_driver'), params_arguments([params])) as runner:
        soak = Soak(stack, runner, params, Random(options.seed))
        for name in NODES:
            soak.start(name)
        soak.record(bag)
        try:
            soak.run(60.0 * options.minutes)
        except SoakError as error:
            soak.problems.append(str(error))
        for name, status in stack.stop().items():
            soak.check_log(name)
            if status:
                soak.problems.append(f'{name} ended with status {status}\n{stack.tail(name)}')
    passed = report(soak, bag)
    print('passed' if passed else 'failed')
    return int(not passed)


if __name__ == '__main__':
    sys.exit(main())
