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
CPU load, memory and latency of the running stack while it follows a path.

The whole stack runs with the simulated robot, once as in paper B and once with all that the
drivers support: films in all wheels at 400 Hz, an IMU at 200 Hz. Then, for each of its processes,
one publishes and receives the same messages at the same rates, as bytes that it does not look at:
the floor. The CPU load on another machine is that of the table times the ratio of the times of
``--reference``.
"""

from __future__ import annotations

import argparse
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
import json
import math
import os
from pathlib import Path
import select
import sys
import tempfile
import threading
import time
from types import TracebackType
from typing import Any, NamedTuple

from benchmarks.harness import (
    check_ranges, machine, make_folder, new_table, positive, print_tables, Range, run_benchmark)
from benchmarks.start import FLOOR, memory
import numpy as np
from rich.table import Table
from smart_tire.analysis.pipeline import estimates_of, forwarded, INPUTS
from smart_tire.arrays import Array
from smart_tire.cli._path_file import length, placed, Poses
from smart_tire.cli._stack import isolated_environment, NODES, Stack, write_parameters
from smart_tire.control.path_library import figure_eight
from smart_tire.control.trajectory_control import PathState
from smart_tire.errors import SmartTireError
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.estimation.reorder_buffer import GRID_NS
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.host_load import HostLoad, worst_of
from smart_tire.launching import SEPARATE
from smart_tire.nodes.command_line import COMPOSED
from smart_tire.parameters import FrictionEstimatorParams, SimulatorParams, SlipEstimatorParams
from smart_tire.protocol.tire_payload import decode_batch, volts
from smart_tire.protocol.xbee import decode_receive_packet, XBeeDeframer
from smart_tire.rotation import euler
from smart_tire.samples import NS_PER_S, TireSample, WHEELS
from smart_tire.simulation.offline import simulate
from smart_tire.simulation.pseudo_terminal import PtyPort

DESCRIPTION = 'measure CPU load, memory and latency'
ADDRESS = 0x0013A20040A1B2C0    # of the first sensor node
START_TIMEOUT = 30.0            # s until all nodes run
WARM_UP_TIME = 3.0              # s of driving before the measurement
RADIUS = 1.0                    # m, of the figure-eight that is followed
MAX_SPEED = 0.5                 # m/s
SEED = 1
MAX_READ = 4096      # bytes
POLL_PERIOD = 0.1    # s
OPEN_TIMEOUT = 10.0  # s until the port of the radio must exist
ODOM_PHASES = 5      # an instant of odom, every 8 ms, waits for IMU samples, every 10 ms
DISCOVERY_TIME = 5.0  # s until all processes of the floor have found each other
TRAFFIC_TIME = 5.0   # s in which the messages of the nodes are counted
BURST_TIME = 1e-3    # s between messages that are published together
UNCOUNTED = '/diagnostics', '/rosout', '/parameter_events'  # the first one is of any node
KEY_LENGTH = 8       # samples at the end of a batch whose noise identifies it
REFERENCE_TIME, REFERENCE_REPEATS = 10.0, 3  # s of the drive that is estimated, and how often

Key = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Setup:
    """What is measured."""

    wheels: tuple[str, ...]  # with films
    imu_rate: float          # Hz

    @property
    def title(self) -> str:
        """Return number of wheels and rate of the IMU."""
        count = len(self.wheels)
        return f'{count} wheel{"s" * (count > 1)}, IMU {self.imu_rate:g} Hz'


SETUPS = Setup(('front_right',), 100.0), Setup(WHEELS, 200.0)  # paper B, and all
OF_THE_TABLE = 0.0333  # s, reference time of the machine of docs/benchmarks.md
ROBOT = 'all but robot_simulator'
RANGES = tuple(
    Range(f'{setup.title}: {figure}', *ends[column]) for column, setup in enumerate(SETUPS)
    for figure, *ends in (
        ('cores of all nodes of a robot, at a reference of 33.3 ms', (0.35, 0.75), (0.5, 1.1)),
        ('the same, times that of processes that only exchange the messages as bytes',
         (1.0, 2.0), (1.0, 2.0)),
        ('their memory [MB]', (250.0, 350.0), (250.0, 350.0)),
        ('radio batch to `tire_samples`, 99 % [ms]', (10.0, 25.0), (20.0, 45.0)),
        ('age of `odom`, median [ms]', (25.0, 45.0), (25.0, 45.0)),
        ('later than that, 99 % [ms]', (0.0, 8.0), (0.0, 8.0))))


@dataclass(frozen=True)
class Usage:
    """What a process uses."""

    cpu: float     # cores
    memory: float  # B, of the process alone
    floor: float = math.nan  # cores, of one that only exchanges the same messages

    @classmethod
    def of_robot(cls, usages: Mapping[str, Usage]) -> Usage:
        """Return the sum of the processes on a robot, which has no simulator."""
        own = [usage for name, usage in usages.items() if name != 'robot_simulator']
        return cls(*(sum(getattr(one, name) for one in own)
                     for name in ('cpu', 'memory', 'floor')))


def main(argv: Sequence[str] | None = None) -> int:
    """Measure the running stack; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.load', description=DESCRIPTION)
    parser.add_argument('--seconds', type=float, default=30.0, metavar='S',
                        help='duration of each live measurement (default: %(default)s)')
    parser.add_argument('--composed', action='store_true',
                        help='the nodes in one process, except motor_driver and wheel_controller')
    parser.add_argument('--wheels', type=positive, metavar='N',
                        help='only with films in N wheels, and an IMU at 100 Hz; without ranges')
    parser.add_argument('--out', type=Path, default=Path('bench_output', 'load'), metavar='DIR',
                        help='folder for delays.png (default: %(default)s)')
    parser.add_argument('--reference', action='store_true',
                        help='only the time of the estimators on one core, without ROS')
    args = parser.parse_args(argv)
    setups = SETUPS if args.wheels is None else (Setup(WHEELS[:args.wheels], 100.0),)
    if args.reference:
        print(machine(), reference_line(reference_time()), sep='\n')
        return 0
    # Importing rclpy may start Python again, so it must come before any child is started.
    from smart_tire.nodes.pilot import Pilot
    from smart_tire.nodes.runner import NodeRunner
    reference = reference_time()
    print(machine(), reference_line(reference), sep='\n', flush=True)
    processes: dict[str, tuple[str, ...]] = {name: (name,) for name in NODES}
    if args.composed:
        together = tuple(name for name in NODES[1:] if name not in SEPARATE)
        processes = {NODES[0]: NODES[:1], COMPOSED: together, **{
            name: processes[name] for name in SEPARATE}}

    def measure() -> None:
        usages: dict[str, Mapping[str, Usage]] = {}
        delays: dict[str, Delays] = {}
        figures: list[float] = []
        for setup in setups:
            print(setup.title, flush=True)
            with tempfile.TemporaryDirectory(prefix='smart_tire_bench_') as folder:
                usages[setup.title], delays[setup.title] = measure_live(
                    Path(folder), setup, args.seconds,
                    partial(NodeRunner, partial(Pilot, 'load')), processes)
            print(*delays[setup.title].lines(), sep='\n')
            robot = Usage.of_robot(usages[setup.title])
            figures += (robot.cpu * OF_THE_TABLE / reference, robot.cpu / robot.floor,
                        robot.memory / 1e6, *delays[setup.title].figures)
        print_tables('', [usage_table(usages)])
        make_folder(args.out)
        draw(delays, args.out / 'delays.png')
        if setups == SETUPS and not args.composed:
            check_ranges(zip(RANGES, figures))
    return run_benchmark('load', measure)


def reference_line(reference: float) -> str:
    """Return the time [s] that the estimators need for a second of a drive, as text."""
    return (f'reference: the estimators need {1e3 * reference:.1f} ms of CPU time per second of '
            'a drive')


def reference_time() -> float:
    """Return the CPU time [s] of both estimators per second of a simulated drive, the least."""
    params = SimulatorParams(seed=SEED)
    events = [sample for _, topic, sample in simulate(
        params, [(0.0, 0.0, 0.0), (1.0, 100.0, 60.0)], REFERENCE_TIME) if topic in INPUTS]
    times = []
    for _ in range(REFERENCE_REPEATS):
        friction = FrictionEstimator(FrictionEstimatorParams())
        slip, begin = SlipEstimator(SlipEstimatorParams()), time.process_time()
        for sample in events:
            for item in forwarded(friction, sample):
                estimates_of(slip, item)
        times.append(time.process_time() - begin)
    return min(times) / REFERENCE_TIME


class RadioTap:
    """
    Forwards bytes from the simulated radio at ``source`` to a receiver that opens ``link``.

    ``add_sample`` takes the samples published by the receiver. ``latencies`` [s] are measured
    from forwarding the last byte of a batch to the call with its last sample.
    """

    def __init__(self, source: str, link: str) -> None:
        self.latencies: list[float] = []
        self._source = source
        self._port = PtyPort(link)
        self._deframer = XBeeDeframer()
        self._sent_ns: dict[Key, int] = {}
        self._newest: dict[str, deque[tuple[float, ...]]] = {}  # of each wheel
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._forward_bytes, name='radio_tap', daemon=True)

    def __enter__(self) -> RadioTap:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._stopping.set()
        self._thread.join()
        self._port.close()

    def add_sample(self, sample: TireSample) -> None:
        """Add a sample published by the receiver, in order."""
        now_ns = time.monotonic_ns()
        newest = self._newest.setdefault(sample.wheel, deque(maxlen=KEY_LENGTH))
        newest.append(sample.volts)
        sent_ns = self._sent_ns.pop(tuple(newest), None)
        if sent_ns is not None:
            self.latencies.append((now_ns - sent_ns) / NS_PER_S)

    def _forward_bytes(self) -> None:
        source = self._open()
        if source is None:
            return
        try:
            while not self._stopping.is_set():
                if select.select([source], [], [], POLL_PERIOD)[0]:
                    self._forward(os.read(source, MAX_READ))
        except OSError:  # EIO: the simulator has exited
            pass
        finally:
            os.close(source)

    def _open(self) -> int | None:
        """Return the open port; None if it does not appear within ``OPEN_TIMEOUT``."""
        deadline = time.monotonic() + OPEN_TIMEOUT
        while not self._stopping.wait(POLL_PERIOD) and time.monotonic() < deadline:
            if os.path.exists(self._source):
                return os.open(self._source, os.O_RDONLY | os.O_NOCTTY)
        return None

    def _forward(self, chunk: bytes) -> None:
        keys = [self._key(body) for body in self._deframer.extract(chunk)]
        self._sent_ns.update(dict.fromkeys(keys, time.monotonic_ns()))
        self._port.write(chunk)

    @staticmethod
    def _key(body: bytes) -> Key:
        batch = decode_batch(decode_receive_packet(body).data)
        return tuple(tuple(map(volts, codes)) for codes in batch.codes[-KEY_LENGTH:])


def measure_live(folder: Path, setup: Setup, seconds: float,
                 runner_class: Callable[[list[str]], Any], processes: Mapping[str, Sequence[str]]
                 ) -> tuple[dict[str, Usage], Delays]:
    """
    Run all nodes, by process; return what each process uses, and the delays.

    The path is longer than all measurements.
    """
    environment = isolated_environment()
    os.environ.update(environment)  # the node runner is in this process
    source, link = str(folder / 'radio'), str(folder / 'tapped_radio')
    params = write_params(folder, setup, source, link)
    with Stack(folder / 'logs', environment) as stack, RadioTap(source, link) as tap:
        for name in processes:
            stack.node(name, [params])
        with runner_class(['--ros-args', '--params-file', str(params)]) as runner:
            await_nodes(stack, runner, NODES)
            runner.node.follow(path_for(
                seconds + TRAFFIC_TIME + 2.0 * WARM_UP_TIME, runner.node.odometry))
            runner.spin(WARM_UP_TIME)
            runner.node.subscribe('tire_samples', tap.add_sample)
            ages: list[tuple[int, float]] = []
            runner.node.subscribe('odom', lambda sample: ages.append(
                (sample.stamp_ns, (time.time_ns() - sample.stamp_ns) / NS_PER_S)))
            before, begin = cpu_seconds(stack), time.monotonic()
            runner.spin(seconds)
            elapsed, after = time.monotonic() - begin, cpu_seconds(stack)
            sizes = {name: memory(stack.processes[name].pid)[0] for name in processes}
            messages = traffic(runner, {
                name: nodes for name, nodes in processes.items() if name != NODES[0]})
            state = PathState(runner.node.progress.state)
            host = worst_of(runner.node.health.values())
        if died := stack.died():
            raise SmartTireError(f'{", ".join(died)} died')
    if state != PathState.FOLLOWING:
        raise SmartTireError(f'the path was not followed to the end of the measurement: '
                             f'{state.name.lower()}')
    print_host(host)
    least = floors(folder, environment, messages, seconds)
    return ({name: Usage((after[name] - before[name]) / elapsed, sizes[name],
                         least.get(name, math.nan)) for name in processes},
            Delays.of(tap.latencies, ages))


def traffic(runner: Any, processes: Mapping[str, Sequence[str]]
            ) -> dict[str, dict[str, list[list[Any]]]]:
    """
    Return what each process publishes and receives, as ``benchmarks.empty_node`` takes it.

    Messages are counted for ``TRAFFIC_TIME``; topics without any are left out, as is what nodes of
    one process exchange.
    """
    from smart_tire.nodes.compat import message_class
    from smart_tire.nodes.qos import subscriber_qos
    node, counts, bursts = runner.node, Counter[str](), Counter[str]()
    latest: dict[str, tuple[float, bytes]] = {}
    kinds: dict[str, tuple[str, int]] = {}  # of a topic: type and depth of the queue

    def topics_of(names: Sequence[str], find: Callable[[str, str], Any]) -> list[str]:
        found = {topic: kind for name in names
                 for topic, (kind, *_) in find(name, node.get_namespace())
                 if topic not in UNCOUNTED}
        kinds.update((topic, (kind, subscriber_qos(topic.lstrip('/')).depth))
                     for topic, kind in found.items())
        return list(found)

    def count(topic: str, data: bytes) -> None:
        now = time.monotonic()
        counts[topic] += 1
        bursts[topic] += now - latest.get(topic, (0.0,))[0] > BURST_TIME
        latest[topic] = now, data

    published, received = [{name: topics_of(nodes, find) for name, nodes in processes.items()}
                           for find in (node.get_publisher_names_and_types_by_node,
                                        node.get_subscriber_names_and_types_by_node)]
    subscriptions = [node.create_subscription(
        message_class(kinds[topic][0]), topic, partial(count, topic), kinds[topic][1], raw=True)
        for topic in {topic for topics in published.values() for topic in topics}]
    runner.spin(TRAFFIC_TIME)
    for one in subscriptions:
        node.destroy_subscription(one)
    return {name: {'received': [[topic, *kinds[topic]] for topic in received[name]
                                if topic not in published[name]],
                   'published': [[topic, *kinds[topic],
                                  max(round(bursts[topic] / TRAFFIC_TIME), 1),
                                  round(counts[topic] / bursts[topic]), latest[topic][1].hex()]
                                 for topic in published[name] if topic in counts]}
            for name in processes}


def floors(folder: Path, environment: Mapping[str, str],
           messages: Mapping[str, Mapping[str, Any]], seconds: float) -> dict[str, float]:
    """Return the cores of processes that only exchange ``messages``."""
    with Stack(folder / 'floor', environment) as stack:
        for name, own in messages.items():
            file = folder / f'{name}.json'
            file.write_text(json.dumps(own), encoding='utf-8')
            stack.start(name, f'benchmarks.{FLOOR}', str(file), f'{name}_floor')
        time.sleep(DISCOVERY_TIME)
        before, begin = cpu_seconds(stack), time.monotonic()
        time.sleep(seconds)
        elapsed, after = time.monotonic() - begin, cpu_seconds(stack)
        if died := stack.died():
            raise SmartTireError('\n'.join(stack.log(name) for name in died))
    return {name: (after[name] - before[name]) / elapsed for name in messages}


def path_for(seconds: float, odometry: Any) -> Poses:
    """Return figures-of-eight from the robot on, which last for ``seconds`` at full speed."""
    eight = figure_eight(RADIUS).poses
    laps = math.ceil(seconds * MAX_SPEED / length(eight))
    return placed((*eight, *eight[1:] * (laps - 1)), (
        *odometry.position[:2], euler(odometry.orientation)[2]))


def cpu_seconds(stack: Stack) -> dict[str, float]:
    """Return the user plus system CPU time [s] of each process that runs."""
    found = {}
    for name, process in stack.processes.items():
        if process.poll() is None:
            fields = Path(f'/proc/{process.pid}/stat').read_text().rsplit(')', 1)[1].split()
            found[name] = (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
    return found


def write_params(folder: Path, setup: Setup, source: str, link: str) -> Path:
    """Write and return the parameter file of a live run; the radio is at ``source``."""
    units = [f'{ADDRESS + WHEELS.index(wheel):016X}={wheel}' for wheel in setup.wheels]
    return write_parameters(folder, 'bench.yaml', SEED, {
        '/**': {'film.wheels': list(setup.wheels)},
        'robot_simulator': {'units': units, 'imu_rate': setup.imu_rate,
                            'ports.tire_radio': source},
        'tire_receiver': {'units': list(units), 'port': link},  # no alias in the file
        'trajectory_controller': {'max_speed': MAX_SPEED}})


def await_nodes(stack: Any, runner: Any, names: Sequence[str]) -> None:
    """Wait for diagnostics of all nodes and for estimates; raise SmartTireError on timeout."""
    deadline = time.monotonic() + START_TIMEOUT
    while runner.node.slip is None or set(names) - runner.node.health.keys():
        for name, status in stack.died().items():
            raise SmartTireError(f'{name} ended with status {status}\n{stack.log(name)}')
        if time.monotonic() > deadline:
            raise SmartTireError(f'not all of {", ".join(names)} started within '
                                 f'{START_TIMEOUT:.0f} s')
        runner.spin(0.25)


def usage_table(usages: Mapping[str, Mapping[str, Usage]]) -> Table:
    """Return the table of all processes, and their sum on a robot, which has no simulator."""
    table = new_table('CPU load and memory while a path is followed', '', *(
        f'{name.replace(", ", chr(10))}\n[{unit}]' for name in usages
        for unit in ('cores', 'MB', 'of the floor')))
    rows = [{**usage, ROBOT: Usage.of_robot(usage)} for usage in usages.values()]
    for name in rows[0]:
        found = [row[name] for row in rows]
        table.add_row(name, *(text for one in found for text in (
            f'{one.cpu:.3f}', f'{one.memory / 1e6:.0f}',
            '' if math.isnan(one.floor) else f'{one.cpu / one.floor:.1f}')))
    return table


def print_host(host: HostLoad | None) -> None:
    """Print that the machine was too busy for figures that count, if it was."""
    if host is not None and host.late:
        print(f'  not a quiet machine: {host}')


class Delays(NamedTuple):
    """Delays of a run [s]: of radio batches, and ages of ``odom`` with their excess."""

    latencies: Array  # (n,), from the last byte of a batch to its last ``tire_samples``
    ages: Array       # (m,), of ``odom`` on arrival
    excess: Array     # (m,), of an age above the median of its phase

    @classmethod
    def of(cls, latencies: Sequence[float], ages: Sequence[tuple[int, float]]) -> Delays:
        """
        Return the delays of a run; ``ages`` are of timestamps [ns] of ``odom``.

        Raises SmartTireError if there are none.
        """
        if not latencies or not ages:
            raise SmartTireError('no radio batch reached tire_samples, or no odom came')
        stamps, age = np.array([stamp for stamp, _ in ages]), np.array([one for _, one in ages])
        phases = stamps // GRID_NS % ODOM_PHASES
        usual = np.array([np.median(age[phases == phase]) if (phases == phase).any() else math.nan
                          for phase in range(ODOM_PHASES)])
        return cls(np.array(latencies), age, age - usual[phases])

    @property
    def figures(self) -> tuple[float, float, float]:
        """Return the 99 % of the latencies, the median of the ages, the 99 % of excess [ms]."""
        return (1e3 * float(np.percentile(self.latencies, 99.0)),
                1e3 * float(np.median(self.ages)), 1e3 * float(np.percentile(self.excess, 99.0)))

    def lines(self) -> Iterator[str]:
        """Yield the percentiles as text."""
        median, p99, worst = 1e3 * np.percentile(self.latencies, (50.0, 99.0, 100.0))
        yield (f'  last byte of a radio batch to its last tire_samples, {len(self.latencies)} '
               f'batches: p50 {median:.1f} ms, p99 {p99:.1f} ms, worst {worst:.1f} ms')
        p99, p999, worst = 1e3 * np.percentile(self.excess, (99.0, 99.9, 100.0))
        yield (f'  age of odom on arrival: p50 {self.figures[1]:.1f} ms; later than usual by '
               f'p99 {p99:.1f} ms, p99.9 {p999:.1f} ms, worst {worst:.1f} ms')


def draw(runs: Mapping[str, Delays], path: Path) -> None:
    """Draw the distributions of the delays of all ``runs``, by title."""
    from matplotlib.figure import Figure
    figure = Figure(figsize=(10.0, 3.6), layout='constrained')
    for axes, name, label in zip(figure.subplots(1, 3, sharey=True), Delays._fields, (
            'last byte of a batch to its topic [ms]', 'age of odom on arrival [ms]',
            'that age above its median [ms]')):
        for title, delays in runs.items():
            values = 1e3 * np.sort(getattr(delays, name))
            axes.plot(values, 1.0 - np.arange(len(values)) / len(values), label=title)
        axes.set(xlabel=label, yscale='log', xlim=(min(0.0, axes.get_xlim()[0]), None))
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel('share that is later')
    figure.axes[0].legend(fontsize='small')
    figure.savefig(path, dpi=80)


if __name__ == '__main__':
    sys.exit(main())
