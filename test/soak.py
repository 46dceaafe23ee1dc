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

``make soak MINUTES=60`` starts all nodes and a recorder. Nodes and the host freeze for a moment,
other programs take the cores, participants come and are killed, ports hang up or deliver late,
clocks are set, commands end, the emergency stop is engaged; in the first third of the time nodes
and the recorder are also killed, or ended, and started again, and the disk becomes full.

Where a fault is a hazard of ``docs/safety.md``, the record of the emulated motor boards must show
zero duty within its bound. After each fault every node must report again, and the robot drive,
within ``MAX_RECOVERY``. Until the next fault no node may warn, and the motors not stop, but after
a stall of the host. A killed recorder may lose ``MAX_LOSS``. No process may die by itself or log
an exception; in none may the memory grow by ``MAX_GROWTH``, descriptors or threads become more.
``soak.png`` shows the three over time.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
import math
import os
from pathlib import Path
from random import Random
import re
import resource
import signal
import statistics
import struct
import subprocess
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from matplotlib.figure import Figure
import numpy as np
from smart_tire.bags import Bag
from smart_tire.cli._outputs import remove_bag
from smart_tire.cli._stack import (
    DRIVERS, isolated_environment, NODES, params_arguments, PORTS, RECORDER, remove_traces, Stack,
    write_parameters)
from smart_tire.host_load import other_problems, PREFIX
from smart_tire.messages import statuses_from_msg
from smart_tire.nodes.pilot import Pilot
from smart_tire.nodes.runner import NodeRunner
from smart_tire.samples import NS_PER_S
from std_srvs.srv import SetBool
from support.hazards import HAZARDS
from support.motor_boards import Record, STILL
from support.soak_simulator import HELD, UNPLUGGED
from support.verdict import RunQueues, Verdict, verdict

SPIN_TIME = 0.1           # s
START_TIME = 60.0         # s until all nodes run
MAX_RECOVERY = 30.0       # s after the end of a fault
MAX_AGE = 0.5             # s, of odom, wheel_slip and wheel_states of a robot that drives
MAX_SILENCE = 3.0         # s, of the diagnostics of a node that runs
MIN_WHEEL_SPEED = 1.0     # rad/s, of a wheel that turns
SPEEDS = (30.0, 120.0)    # rpm of the wheels of a side
PAUSE = (5.0, 20.0)       # s between a recovery and the next fault
CALM = 3.0                # s after a recovery in which the diagnostics may still have the fault
MEMORY = 2.0              # s for which diagnostics have a stall
STALL_PERIOD = 0.05       # s in which no thread waits for a core longer than MAX_WAIT ...
MAX_WAIT = 0.015          # s, half of the time in which a board must reply
PASSED = 3                # ... and in processes that a message passes (port, driver, estimator)
MAX_DELAY = 0.03          # s, their sum: half of the window in which films are sorted by time
STAY = 0.5                # s beyond the bound in which the motors must stay without duty
MAX_LOSS = 0.2            # s of messages that a killed recorder may lose
CLOCK_STEPS = (0.01, 100.0)  # s, least and greatest
FULL = 300_000            # bytes that a file may have while the disk is "full"
MEMORY_PERIOD = 5.0       # s between two measurements
RESTARTS_SHARE = 1 / 3    # of the time in which nodes are restarted; then memory is measured
SETTLING = 1200.0         # s after a start: four files of the recorder, whose index of up to 10 MB
# is freed with each; buffers and caches have their size then (soak.png)
MIN_TIME = 600.0          # s of measurements that show a growth
MAX_GROWTH = 5.0          # MB/h
MEASURED = {'memory [MB]': re.compile(r'^RssAnon:\s+(\d+) kB', re.MULTILINE),
            'threads': re.compile(r'^Threads:\s+(\d+)', re.MULTILINE)}
BUSY = [sys.executable, '-c', 'while True: pass']
FAULT_TEXT = re.compile(r'Traceback|Segmentation|terminate called')
SIMULATOR = 'robot_simulator'
LATCHED = 'latched until commands pause'  # in the message of motor_driver
TRIP_PAUSE = 1.5          # s, more than that which resets a trip
THIS = 'soak'  # name of this process
STOPPING = ('motor_driver', 'wheel_controller')  # nodes that stop the motors
ROOT = Path(__file__).resolve().parents[1]
CLOCK_SKEW = ROOT / 'test' / 'support' / 'clock_skew.c'


class SoakError(Exception):
    """The robot does not recover from a fault."""


@dataclass
class Usage:
    """Memory [MB], threads and descriptors of a process, over its lives."""

    lives: list[list[tuple[float, ...]]] = field(default_factory=list)  # s; the three
    starts: list[float] = field(default_factory=list)                   # s

    def measured(self) -> Iterator[Any]:
        """Yield the measurements of each life after ``SETTLING``, at least two."""
        for start, life in zip(self.starts, self.lives):
            if len(rows := [row for row in life if row[0] - start > SETTLING]) > 1:
                yield np.array(rows)

    def growth(self) -> tuple[float, float]:
        """Return the slope of memory in all lives together [MB/h], and how long they were [s]."""
        above = below = total = 0.0
        for rows in self.measured():
            times, sizes = (rows - rows.mean(axis=0)).T[:2]
            above += float(times @ sizes)
            below += float(times @ times)
            total += float(np.ptp(times))
        return (above / below * 3600.0 if below else 0.0), total

    def more(self) -> list[int]:
        """Return how many threads and descriptors more there are than in the first quarter."""
        most = [0, 0]
        for rows in self.measured():
            if np.ptp(rows[:, 0]) > MIN_TIME:
                quarter = len(rows) // 4
                begin, end = (np.median(part, axis=0)[2:] for part in (
                    rows[:quarter], rows[-quarter:]))
                most = np.maximum(most, end - begin).astype(int).tolist()
        return most


class Watcher(Pilot):
    """Drives the robot; collects problems in the diagnostics that a late host does not explain."""

    def __init__(self) -> None:
        super().__init__('soak_driver')
        self.warnings: list[tuple[float, str]] = []  # s
        self.latest: dict[str, str] = {}  # by node

    def _on_diagnostics(self, msg: Any) -> None:
        super()._on_diagnostics(msg)
        for status in statuses_from_msg(msg):
            self.latest[status.name] = status.message
            if int.from_bytes(DiagnosticStatus.OK, 'big') != status.level and (
                    text := other_problems(status.message, status.values,
                                           late=PREFIX in status.message)):
                self.warnings.append((time.monotonic(), f'{status.name}: {text}'))


class Processes(Stack):
    """The processes, each with a clock of its own."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        super().__init__(folder / 'logs', environment)
        self._out = folder

    def start(self, name: str, module: str, *arguments: str) -> None:
        """Start a process whose clock is right."""
        self._environment['CLOCK_SKEW_FILE'] = str(skew_file(self._out, name))
        self.set_clock(0.0, name)
        super().start(name, module, *arguments)

    def set_clock(self, seconds: float, *names: str) -> None:
        """Set the clocks of processes, and of this one, to a time that differs from that now."""
        for name in names:
            file = skew_file(self._out, name)
            with file.open('r+b' if file.exists() else 'wb') as opened:
                opened.write(struct.pack('q', round(seconds * NS_PER_S)))


class Soak:
    """The robot, its faults, and what became of them."""

    def __init__(self, stack: Processes, runner: Any, out: Path, params: Path,
                 rng: Random) -> None:
        self._stack, self._runner, self._out = stack, runner, out
        self._params, self._rng = params, rng
        self._pilot: Watcher = runner.node
        self._release = self._pilot.create_client(SetBool, 'emergency_stop')
        self._heard: dict[str, float] = {}
        self._health: dict[str, Any] = {}
        self._measured, self._begin = 0.0, time.monotonic()
        self._duties = (out / 'duties.txt').open('w+')
        self._record = Record()
        self.bags: list[Path] = []
        self.usage: defaultdict[str, Usage] = defaultdict(Usage)
        self.recoveries: defaultdict[str, list[float]] = defaultdict(list)
        self.stops: defaultdict[str, list[float]] = defaultdict(list)  # hazard -> s
        self.losses: list[float] = []  # s, of killed recorders
        self.unclear = Counter[str]()
        self.trips = 0    # that ended only after a pause of the commands
        self.quiet = 0.0  # s in which alarms would have been false
        self.problems: list[str] = []

    def _now(self) -> float:
        return time.monotonic() - self._begin

    def problem(self, text: str) -> None:
        """Note a problem."""
        self.problems.append(text)
        print(f'{self._now():.0f} s: problem: {text}', flush=True)

    def start(self, name: str) -> None:
        """Start a node, or the recorder with a new bag."""
        if name == RECORDER:
            self.bags.append(self._out / f'bag_{len(self.bags)}')
            remove_bag(self.bags[-1])
            self._stack.start(RECORDER, 'smart_tire.cli.main', 'record', '--out',
                              str(self.bags[-1]))
        elif name == SIMULATOR:
            self._stack.start(name, 'support.soak_simulator', *params_arguments([self._params]))
        else:
            self._stack.node(name, [self._params])
        self.usage[name].lives.append([])
        self.usage[name].starts.append(self._now())

    def spin(self, seconds: float) -> None:
        """Handle messages, measure memory, note processes that have died."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._runner.spin(min(SPIN_TIME, seconds))
            now = time.monotonic()
            for name, values in self._pilot.health.items():
                if values is not self._health.get(name):
                    self._health[name], self._heard[name] = values, now
            if now - self._measured > MEMORY_PERIOD:
                self._measured = now
                self._measure()

    def _measure(self) -> None:
        for name, process in self._stack.processes.items():
            if process.poll() is not None:
                self.problem(f'{name} has died with status {process.returncode}\n'
                             f'{self._stack.tail(name)}')
                self.restart(name)
                return
            folder = Path(f'/proc/{process.pid}')
            found = [pattern.search((folder / 'status').read_text())
                     for pattern in MEASURED.values()]
            if all(found):
                memory, threads = (int(match[1]) for match in found if match)
                self.usage[name].lives[-1].append(
                    (self._now(), memory / 1024.0, threads, len(os.listdir(folder / 'fd'))))

    def restart(self, name: str) -> None:
        """Look for exceptions in the log of a node that has ended, then start it again."""
        self.check_log(name)
        self.start(name)

    def check_log(self, name: str) -> None:
        """Note exceptions in the log of a process."""
        if FAULT_TEXT.search(log := self._stack.log(name)):
            self.problem(f'{name}:\n{log[-4000:]}')

    def drives(self) -> bool:
        """Return whether every node has reported, and the robot drives with fresh estimates."""
        pilot, now, now_ns = self._pilot, time.monotonic(), self._pilot.now_ns()
        fresh = all(sample is not None and abs(now_ns - sample.stamp_ns) < MAX_AGE * NS_PER_S
                    for sample in (pilot.odometry, pilot.slip, pilot.wheels))
        return (fresh and min(map(abs, pilot.wheels.velocity)) > MIN_WHEEL_SPEED
                and all(now - self._heard.get(name, 0.0) < MAX_SILENCE and
                        self._heard[name] - self._begin > self.usage[name].starts[-1]
                        for name in NODES))

    def await_drive(self, seconds: float, after: str = 'the start') -> float:
        """Wait until the robot drives; return the time [s]; raise SoakError after ``seconds``."""
        begin = time.monotonic()
        while not self.drives():
            if self._pilot.emergency_stop:
                self.emergency_stop(False)
            self.steer()
            self.spin(SPIN_TIME)
            if LATCHED in self._pilot.latest.get('motor_driver', ''):
                self.trips += 1
                self._pilot.halt()
                self.spin(TRIP_PAUSE)
            if time.monotonic() - begin > seconds:
                silent = [name for name in NODES
                          if time.monotonic() - self._heard.get(name, 0.0) > MAX_SILENCE]
                raise SoakError(
                    f'the robot does not drive {seconds:.0f} s after "{after}"; silent: '
                    f'{", ".join(silent) or "none"}; {self._pilot.latest}')
        return time.monotonic() - begin

    def steer(self) -> None:
        """Command wheel speeds, unless they are commanded already."""
        if not self._pilot.emergency_stop and self._pilot._driven is None:
            self._pilot.drive(*(self._rng.uniform(*SPEEDS) for _ in range(2)))

    def emergency_stop(self, engaged: bool) -> bool:
        """Engage or release the emergency stop; return whether it was acknowledged at once."""
        future = self._release.call_async(SetBool.Request(data=engaged))
        self.spin(0.5)
        return future.done() and future.result().success

    def duties(self, since: float) -> Record:
        """Return the record of the motor boards since then."""
        for line in self._duties:
            when, *duty = map(float, line.split())
            self._record.duties.append((when, tuple(duty)))
        found = self._record.after(since)
        self._record = self._record.after(since - MAX_RECOVERY)
        return found

    @contextmanager
    def hazard(self, name: str, *processes: str) -> Iterator[None]:
        """
        Do in the context what happens to the robot; then the motors must stop in time.

        ``processes`` are those which must stop them, and the boards.
        """
        queues = RunQueues(os.getpid(), *(self._stack.processes[process].pid
                                          for process in (SIMULATOR, *processes)))
        begin = time.monotonic()
        yield
        self.spin(max(begin + HAZARDS[name].bound + STAY - time.monotonic(), SPIN_TIME))
        record = self.duties(begin)
        if not record.duties or record.duties[0][1] == STILL:
            return  # it did not drive
        end = min((when for when, duty in record.duties if duty == STILL), default=math.inf)
        found = verdict(end - begin, queues.seconds(), HAZARDS[name].bound)
        self.unclear[name] += found is Verdict.INCONCLUSIVE
        self.stops[name].append(end - begin)
        if found is Verdict.FAIL:
            self.problem(f'{name}: zero duty after {end - begin:.3f} s, {queues.seconds():.3f} s '
                         f'on run queues\n{record.duties}')
        elif record.after(end).driven():
            self.problem(f'{name}: a motor has a duty again\n{record.duties}')

    def random_node(self) -> str:
        """Return a node."""
        return self._rng.choice(NODES)

    def stop_for_a_moment(self) -> None:
        """Stop a node and let it continue; a stop of the motors is required after their bound."""
        name, seconds = self.random_node(), self._rng.uniform(0.05, 3.0)
        process = self._stack.processes[name]
        hazard = f'{name} killed or stopped'
        if name in STOPPING and seconds > HAZARDS[hazard].bound + STAY:
            others = [other for other in STOPPING if other != name]
            with self.hazard(hazard, *others):
                process.send_signal(signal.SIGSTOP)
        else:
            process.send_signal(signal.SIGSTOP)
            self.spin(seconds)
        process.send_signal(signal.SIGCONT)

    def freeze_host(self) -> None:
        """Stop both nodes that stop the motors, for a moment."""
        with self.hazard('host frozen'):
            for name in STOPPING:
                self._stack.processes[name].send_signal(signal.SIGSTOP)
        for name in STOPPING:
            self._stack.processes[name].send_signal(signal.SIGCONT)

    def kill(self, number: signal.Signals) -> None:
        """End a node, or the recorder, by a signal and start it again."""
        name = self._rng.choice((*NODES, RECORDER))
        process = self._stack.processes[name]
        if name in STOPPING and number == signal.SIGKILL:
            with self.hazard(f'{name} killed or stopped',
                             *(other for other in STOPPING if other != name)):
                del self._stack.processes[name]
                process.kill()
        else:
            queues, killed_ns = RunQueues(process.pid, os.getpid()), time.time_ns()
            waited = queues.seconds()
            process.send_signal(number)
            del self._stack.processes[name]
            if name == RECORDER and number == signal.SIGKILL:
                process.wait(30.0)
                self._check_loss(killed_ns, waited)
        status = process.wait(30.0)
        if number == signal.SIGINT and status:
            self.problem(f'{name} ended with status {status}\n{self._stack.tail(name)}')
        self.spin(self._rng.uniform(0.0, 3.0))
        self.restart(name)

    def _check_loss(self, end_ns: int, waited: float) -> None:
        with Bag(self.bags[-1]) as bag:
            latest_ns = max(receive_ns for receive_ns, _, _ in bag.raw())
        self.losses.append((end_ns - latest_ns) / NS_PER_S)
        if self.losses[-1] > MAX_LOSS + waited:
            self.problem(f'the killed recorder lost {self.losses[-1]:.3f} s of messages')

    def fill_disk(self) -> None:
        """Let no file grow; the recorder must say so in one line, and its bag be readable."""
        process = self._stack.processes[RECORDER]
        while max(file.stat().st_size for file in self.bags[-1].glob('*.mcap')) < FULL:
            self.spin(SPIN_TIME)
        del self._stack.processes[RECORDER]
        full_ns = time.time_ns()
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (FULL // 2, resource.RLIM_INFINITY))
        end = time.monotonic() + MAX_RECOVERY
        while process.poll() is None and time.monotonic() < end:
            self.spin(SPIN_TIME)
        if process.poll() is None:
            process.kill()
        if process.wait() != 2 or 'cannot be written' not in self._stack.tail(RECORDER, 1):
            self.problem(f'full disk: {process.returncode}\n{self._stack.tail(RECORDER)}')
        self._check_loss(full_ns, 0.0)
        self.restart(RECORDER)

    @contextmanager
    def port_fault(self, kind: str, port: str) -> Iterator[None]:
        """Have a fault of a port in this context."""
        file = self._out / f'{port}.fault'
        file.with_suffix('.new').write_text(kind)
        file.with_suffix('.new').replace(file)
        yield
        file.unlink()

    def hang_up(self) -> None:
        """Unplug a port for some seconds."""
        port = self._rng.choice(PORTS)
        with self.port_fault(UNPLUGGED, port):
            if port == 'motors':
                with self.hazard('cable unplugged', *STOPPING):
                    pass
            self.spin(self._rng.uniform(0.5, 5.0))

    def hold_port(self) -> None:
        """Let the bytes of a port, and so its messages, arrive late."""
        port, seconds = self._rng.choice(PORTS), self._rng.uniform(0.05, 2.0)
        hazard = 'replies of both boards lost'
        with self.port_fault(HELD, port):
            if port == 'motors' and seconds > HAZARDS[hazard].bound + STAY:
                with self.hazard(hazard, *STOPPING):
                    pass
            else:
                self.spin(seconds)

    def set_clocks(self, names: Sequence[str]) -> None:
        """Set clocks wrong, and later right."""
        sign, (low, high) = self._rng.choice((-1.0, 1.0)), map(math.log, CLOCK_STEPS)
        self._stack.set_clock(sign * math.exp(self._rng.uniform(low, high)), *names)
        self.spin(self._rng.uniform(1.0, 5.0))
        self._stack.set_clock(0.0, *names)

    def set_clock_of_sender(self) -> None:
        """Set the clock of a node that sends timestamps."""
        self.set_clocks([self._rng.choice((*DRIVERS, 'wheel_controller'))])

    def set_clock_of_host(self) -> None:
        """Set the clock of all processes; the motors of a robot do not follow it."""
        self.set_clocks([*(set(self._stack.processes) - {SIMULATOR}), THIS])

    def end_commands(self) -> None:
        """Stop commanding."""
        with self.hazard('cmd_vel ends', *STOPPING):
            self._pilot._driven = None

    def others(self, count: int, words: Sequence[str]) -> None:
        """Run other programs for some seconds, then kill them."""
        with running(count, words):
            self.spin(self._rng.uniform(2.0, 8.0))

    def engage(self) -> None:
        """Engage the emergency stop for some seconds."""
        with self.hazard('emergency stop', *STOPPING):
            self.emergency_stop(True)
        self.spin(self._rng.uniform(0.5, 3.0))

    def faults(self, *, restarts: bool) -> dict[str, Callable[[], None]]:
        """Return the faults by name."""
        return {'stopped for a moment': self.stop_for_a_moment,
                'host frozen': self.freeze_host,
                'cores busy': partial(self.others, 4, BUSY),
                'participants': partial(self.others, 3, [
                    sys.executable, '-m', 'smart_tire.cli.main', 'status']),
                'port hung up': self.hang_up,
                'messages late': self.hold_port,
                'clock of a node set': self.set_clock_of_sender,
                'clock of the host set': self.set_clock_of_host,
                'commands ended': self.end_commands,
                'emergency stop': self.engage,
                **({'killed': partial(self.kill, signal.SIGKILL),
                    'ended': partial(self.kill, signal.SIGINT),
                    'disk full': self.fill_disk} if restarts else {})}

    def stay_quiet(self, after: str) -> None:
        """Drive without a fault; alarms and stops are false but after a stall of the host."""
        self.spin(CALM)
        self.await_drive(MAX_RECOVERY, after)
        self._pilot.warnings.clear()
        begin = now = time.monotonic()
        end, stalls = begin + self._rng.uniform(*PAUSE), [-math.inf]

        def is_quiet(when: float) -> bool:
            return all(not 0.0 <= when - stall < MEMORY for stall in stalls)

        while now < end:
            queues = [RunQueues(os.getpid()), *(
                RunQueues(process.pid) for process in self._stack.processes.values())]
            self.spin(STALL_PERIOD)
            before, now = now, time.monotonic()
            waits = sorted(one.longest() for one in queues)
            if waits[-1] > MAX_WAIT or sum(waits[-PASSED:]) > MAX_DELAY:
                stalls += [before, now]
            self.quiet += (now - before) * is_quiet(now)
        alarms = Counter(text for when, text in self._pilot.warnings if is_quiet(when))
        for text, count in alarms.items():
            self.problem(f'false alarm after "{after}", {count} times: {text}')
        if any(duty == STILL and is_quiet(when) for when, duty in self.duties(begin).duties):
            self.problem(f'the motors stopped without a reason after "{after}"')

    def run(self, seconds: float, only: str) -> None:
        """Let faults, or those whose name contains ``only``, happen for ``seconds``."""
        self.await_drive(START_TIME)
        begin = shown = time.monotonic()
        while (now := time.monotonic()) - begin < seconds:
            faults = self.faults(restarts=now - begin < RESTARTS_SHARE * seconds)
            name = self._rng.choice([name for name in faults if only in name])
            faults[name]()
            self.recoveries[name].append(self.await_drive(MAX_RECOVERY, name))
            self.stay_quiet(name)
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


def report(soak: Soak) -> bool:
    """Print the results; return whether all is well."""
    print(f'{"fault":24}{"number":>8}{"recovery, longest [s]":>24}')
    for name, times in sorted(soak.recoveries.items()):
        print(f'{name:24}{len(times):8}{max(times):24.1f}')
    print(f'\n{"hazard":38}{"number":>8}{"bound [s]":>12}{"median":>9}{"longest":>9}'
          f'{"unclear":>9}')
    for name, times in sorted(soak.stops.items()):
        print(f'{name:38}{len(times):8}{HAZARDS[name].bound:12.2f}{statistics.median(times):9.3f}'
              f'{max(times):9.3f}{soak.unclear[name]:9}')
    print(f'\n{"process":24}{"starts":>8}{"memory [MB]":>14}{"growth [MB/h]":>16}'
          f'{"measured [min]":>16}{"threads":>9}{"more":>6}{"descriptors":>13}{"more":>6}')
    passed = not soak.problems
    for name, usage in sorted(soak.usage.items()):
        growth, total = usage.growth()
        more = usage.more()
        _, memory, *counts = next((life[-1] for life in reversed(usage.lives) if life),
                                  (0.0, math.nan, 0, 0))
        passed &= (growth < MAX_GROWTH and max(more) <= 0) or total < MIN_TIME
        print(f'{name:24}{len(usage.lives):8}{memory:14.1f}{growth:16.2f}{total / 60.0:16.1f}'
              f'{counts[0]:9}{more[0]:6}{counts[1]:13}{more[1]:6}')
    files = [file for bag in soak.bags for file in bag.glob('*.mcap')]
    print(f'\n{len(soak.bags)} bags, {len(files)} files, '
          f'{sum(file.stat().st_size for file in files) / 1e6:.0f} MB; lost by killed recorders, '
          f'longest: {max(soak.losses, default=0.0):.3f} s')
    print(f'{soak.trips} trips reset by a pause of the commands\n'
          f'{soak.quiet / 60.0:.1f} min in which alarms would have been false')
    for problem in soak.problems:
        print(f'problem: {problem}')
    return passed


def draw(soak: Soak, path: Path) -> None:
    """Draw memory, threads and descriptors of each process over time."""
    figure = Figure(figsize=(8.0, 8.0), layout='constrained')
    axes = figure.subplots(3, 1, sharex=True)
    for number, (name, usage) in enumerate(sorted(soak.usage.items())):
        axes[0].plot([], [], color=f'C{number}', label=name)
        for life in (np.array(life) for life in usage.lives if life):
            for axis, column in zip(axes, life.T[1:]):
                axis.plot(life[:, 0] / 60.0, column, color=f'C{number}', linewidth=1.0)
    for axis, label in zip(axes, (*MEASURED, 'descriptors')):
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel('time [min]')
    figure.legend(loc='outside upper center', ncols=3)
    figure.savefig(path, dpi=80)


def main(words: Sequence[str] | None = None) -> int:
    """Run the soak test; return 1 if the robot has a problem."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--minutes', type=float, default=60.0, help='(%(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='of the faults (%(default)s)')
    parser.add_argument('--out', type=Path, default=Path('bench_output/soak'), metavar='DIR',
                        help='bag and logs (%(default)s)')
    parser.add_argument('--only', default='', metavar='TEXT',
                        help='faults whose name contains it')
    options = parser.parse_args(words)
    out = options.out.resolve()
    if 'CLOCK_SKEW_FILE' not in os.environ:
        restart_with_clock(out)
    remove_traces(out)
    # as on a robot: on LOCALHOST rmw_fastrtps uses shared memory, whatever is chosen
    environment = {**isolated_environment(), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
                   'SOAK_FOLDER': str(out),
                   'PYTHONPATH': os.pathsep.join(map(str, (ROOT, ROOT / 'test')))}
    os.environ.update(environment)
    params = write_parameters(out, 'soak.yaml', options.seed, {})
    with Processes(out, environment) as stack, \
            NodeRunner(Watcher, params_arguments([params])) as runner:
        soak = Soak(stack, runner, out, params, Random(options.seed))
        for name in (*NODES, RECORDER):
            soak.start(name)
        try:
            soak.run(60.0 * options.minutes, options.only)
        except SoakError as error:
            soak.problem(str(error))
        for name, status in stack.stop().items():
            soak.check_log(name)
            if status:
                soak.problem(f'{name} ended with status {status}\n{stack.tail(name)}')
    passed = report(soak)
    draw(soak, out / 'soak.png')
    print('passed' if passed else 'failed')
    return int(not passed)


def restart_with_clock(out: Path) -> None:
    """Start this program again with the library that can set the clock of a process."""
    library = out / 'clock_skew.so'
    out.mkdir(parents=True, exist_ok=True)
    subprocess.run(['cc', '-shared', '-fPIC', '-o', library, CLOCK_SKEW], check=True)
    file = skew_file(out, THIS)
    file.write_bytes(bytes(8))
    os.execve(sys.executable, [sys.executable, *sys.argv], {
        **os.environ, 'LD_PRELOAD': str(library), 'CLOCK_SKEW_FILE': str(file)})


def skew_file(out: Path, name: str) -> Path:
    """Return the file that sets the clock of a process."""
    return out / f'{name}.clock'


if __name__ == '__main__':
    sys.exit(main())
