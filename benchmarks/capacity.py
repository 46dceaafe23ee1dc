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
Largest load that the nodes of a robot take without loss: films and IMU at growing rates.

The rates grow until something is lost, late or old. Precomputed bytes of four wheels with two
films each and of an IMU are written to the ports at their times, so that no simulator needs a
core; ``wheel_states`` is published at 16 Hz.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
import math
import os
from pathlib import Path
import sys
import tempfile
import time
from typing import Any

from benchmarks.harness import (
    check_ranges, machine, new_table, print_tables, Range, run_benchmark)
from benchmarks.load import cpu_seconds
from smart_tire.cli._stack import isolated_environment, params_arguments, Stack
from smart_tire.errors import SmartTireError
from smart_tire.parameters import RobotParams, SimulatorParams
from smart_tire.protocol import vectornav, xbee
from smart_tire.protocol.tire_payload import encode_batch, TireBatch, volts
from smart_tire.samples import ImuSample, NS_PER_S, TireSample, WHEELS, WheelSample
from smart_tire.simulation.offline import simulate
from smart_tire.simulation.pseudo_terminal import PtyPort
import yaml

DESCRIPTION = 'measure the largest load without loss'
FILM_RATE, IMU_RATE = 400.0, 200.0  # Hz, at factor 1
FACTORS = (1.0, 2.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0)
BATCH = 16                # samples per packet
ADDRESS = 0x0013A20040A1B2C0  # of the first sensor node
STANDSTILL = 2.0          # s, before the drive
SPEEDS = (100.0, 70.0)    # rpm
START_TIMEOUT = 30.0      # s
DISCOVERY_TIME = 4.0      # s until all nodes have found each other
DRAIN_TIME = 2.0          # s after the last byte until the counts are read
MAX_AGE = 0.25            # s, of odom; older ones stop the robot
RANGES = (Range('largest factor of the rates without loss', 2.0, 16.0),
          Range('greatest age of `odom` there [s]', 0.0, 0.1))
STEPS = 'tire_receiver', 'imu_driver', 'slip_estimator', 'friction_estimator'


@dataclass(frozen=True)
class Loss:
    """What a load was too much for."""

    receivers: int   # samples and readings that the drivers have not received
    estimators: int  # messages that the estimators have not received
    late: int        # messages after their place in the order had passed
    age: float       # s, of the oldest odom in motion

    @property
    def none(self) -> bool:
        """Return whether everything was used in time."""
        return not (self.receivers or self.estimators or self.late) and self.age <= MAX_AGE

    def __str__(self) -> str:
        return (f'{self.receivers} lost at the receivers, {self.estimators} at the estimators, '
                f'{self.late} late, odom up to {1e3 * self.age:.0f} ms old')


@dataclass(frozen=True)
class Load:
    """What the ports get: (time [s], port, bytes), and the wheel samples."""

    writes: list[tuple[float, str, bytes]]
    wheels: list[tuple[float, WheelSample]]
    samples: int  # of films
    readings: int  # of the IMU


def main(argv: Sequence[str] | None = None) -> int:
    """Measure at growing rates; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.capacity', description=DESCRIPTION)
    parser.add_argument('--seconds', type=float, default=20.0, metavar='S',
                        help='duration of each drive (default: %(default)s)')
    parser.add_argument('--factors', type=float, nargs='+', default=FACTORS, metavar='F',
                        help='of the rates of films (400 Hz) and IMU (200 Hz), until a loss '
                        '(default: 1 to 32)')
    args = parser.parse_args(argv)
    # Importing rclpy may start Python again, so it must come before any child is started.
    from smart_tire.nodes.pilot import Pilot
    from smart_tire.nodes.runner import NodeRunner

    def measure() -> None:
        table = new_table('Load without loss, four wheels with two films', 'factor', 'films [Hz]',
                          'IMU [Hz]', *(f'{name}\n[cores]' for name in STEPS),
                          'lost at\nthe receivers', 'lost at\nthe estimators', 'late',
                          'odom age\nmax [ms]')
        losses: dict[float, Loss] = {}
        for factor in args.factors:
            load = make_load(factor, args.seconds)
            with tempfile.TemporaryDirectory(prefix='smart_tire_bench_') as folder:
                cores, losses[factor] = run(Path(folder), factor, load, partial(
                    NodeRunner, partial(Pilot, 'capacity')))
            table.add_row(*row(factor, cores, losses[factor]))
            if not losses[factor].none:
                break
        print_tables(machine(), [table])
        print(limit(losses))
        good = [(factor, loss.age) for factor, loss in losses.items() if loss.none]
        check_ranges(zip(RANGES, good[-1] if good else (0.0, math.inf)))
    return run_benchmark('capacity', measure)


def row(factor: float, cores: Sequence[float], loss: Loss) -> list[str]:
    """Return the row of a factor, with the load of each of ``STEPS``."""
    return [f'{factor:g}', f'{factor * FILM_RATE:g}', f'{factor * IMU_RATE:g}',
            *(f'{one:.2f}' for one in cores), str(loss.receivers), str(loss.estimators),
            str(loss.late), f'{1e3 * loss.age:.0f}']


def limit(losses: Mapping[float, Loss]) -> str:
    """Return up to which rates nothing was lost, and what was lost at the next."""
    def rates(factor: float) -> str:
        return f'{factor * FILM_RATE:g} Hz of 4 x 2 films, {factor * IMU_RATE:g} Hz of the IMU'

    good = [factor for factor, loss in losses.items() if loss.none]
    text = f'without loss: up to {rates(good[-1])}' if good else 'without loss: no rate measured'
    return text + ''.join(f'; not {rates(factor)}: {loss}' for factor, loss in losses.items()
                          if not loss.none)


def parameters(factor: float) -> SimulatorParams:
    """Return the simulated robot, with films in all wheels and ``factor`` times the rates."""
    robot = RobotParams()
    return SimulatorParams(
        seed=1, imu_rate=factor * IMU_RATE, radio=replace(SimulatorParams().radio, loss=0.0),
        robot=replace(robot, film=replace(
            robot.film, wheels=WHEELS, sample_rate=factor * FILM_RATE)))


def make_load(factor: float, seconds: float) -> Load:
    """Return the bytes and wheel samples of a drive."""
    events = simulate(parameters(factor), [(0.0, 0.0, 0.0), (STANDSTILL, *SPEEDS)], seconds)
    begin = min(sample.stamp_ns for _, _, sample in events)
    writes: list[tuple[float, str, bytes]] = []
    wheels: list[tuple[float, WheelSample]] = []
    batches: dict[str, list[TireSample]] = {wheel: [] for wheel in WHEELS}
    counts = Counter[str]()
    for _, _, sample in events:
        due = (sample.stamp_ns - begin) / NS_PER_S
        if isinstance(sample, ImuSample):
            counts['imu'] += 1
            writes.append((due, 'imu', vectornav.encode_frame(
                vectornav.encode_binary(sample.stamp_ns - begin + NS_PER_S, sample))))
        elif isinstance(sample, WheelSample):
            wheels.append((due, sample))
        elif isinstance(sample, TireSample):
            batch = batches[sample.wheel]
            batch.append(sample)
            if len(batch) == BATCH:
                counts['films'] += BATCH
                writes.append((due, 'radio', frame(batch, counts[sample.wheel], begin, factor)))
                counts[sample.wheel] += 1
                batch.clear()
    writes.sort()
    end = writes[-1][0]  # after it, feed() publishes nothing
    return Load(writes, [one for one in wheels if one[0] <= end], counts['films'], counts['imu'])


def frame(batch: Sequence[TireSample], sequence: int, begin_ns: int, factor: float) -> bytes:
    """Return the radio frame of a batch."""
    payload = encode_batch(TireBatch(
        0, sequence, (batch[0].stamp_ns - begin_ns) // 1000, round(1e6 / (factor * FILM_RATE)),
        tuple(tuple(round(one / volts(1)) for one in sample.volts) for sample in batch), 3900))
    address = ADDRESS + WHEELS.index(batch[0].wheel)
    return xbee.encode_frame(xbee.encode_receive_packet(
        xbee.ReceivePacket(address, 0, 0, payload)))


def run(folder: Path, factor: float, load: Load, runner_class: Callable[[list[str]], Any]
        ) -> tuple[list[float], Loss]:
    """Feed the nodes in real time; return the cores that each of ``STEPS`` uses, and losses."""
    environment = isolated_environment()
    os.environ.update(environment)  # the node runner is in this process
    params = write_params(folder, factor)
    with Stack(folder / 'logs', environment) as stack, PtyPort(str(folder / 'radio')) as radio, \
            PtyPort(str(folder / 'imu')) as imu:
        for node in STEPS:
            stack.node(node, [params])
        with runner_class(params_arguments([params])) as runner:
            node, end = runner.node, time.monotonic() + START_TIMEOUT
            publish = node.make_publisher('wheel_states', rate=16.0)
            while set(STEPS) - node.health.keys():
                if time.monotonic() > end:
                    raise SmartTireError(f'nodes do not start:\n{stack.log("slip_estimator")}')
                runner.spin(0.25)
            runner.spin(DISCOVERY_TIME)
            before, begin = cpu_seconds(stack), time.monotonic()
            age = feed(load, {'radio': radio, 'imu': imu}, publish, runner)
            elapsed, after = time.monotonic() - begin, cpu_seconds(stack)
            runner.spin(DRAIN_TIME)
            counts = {name: {key: int(value) for key, value in values.items()
                             if value.lstrip('-').isdigit()}
                      for name, values in node.health.items()}
    receiver, friction = counts['tire_receiver'], counts['friction_estimator']
    expected = load.samples + load.readings + len(load.wheels)
    lost = (load.samples - BATCH * receiver['batches_ok']
            + load.readings - counts['imu_driver']['frames_ok'])
    late = friction['late_messages'] + counts['slip_estimator']['late_messages']
    return ([(after[name] - before[name]) / elapsed for name in STEPS],
            Loss(lost, expected - friction['frames_ok'], late, age))


def feed(load: Load, ports: dict[str, PtyPort], publish: Callable[[Any], None], runner: Any
         ) -> float:
    """Write all bytes at their times; return the greatest age of ``odom`` [s] in motion."""
    begin, start_ns = time.monotonic(), time.time_ns()
    wheels, age, node = iter(load.wheels), 0.0, runner.node
    due_wheels, sample = next(wheels)
    for due, port, data in load.writes:
        while due_wheels <= due:
            publish(replace(sample, stamp_ns=start_ns + round(due_wheels * NS_PER_S)))
            due_wheels, sample = next(wheels, (float('inf'), sample))
        while (left := begin + due - time.monotonic()) > 0.0:
            runner.spin(min(left, 0.01))
        ports[port].write(data)
        if due > STANDSTILL and node.odometry is not None:
            age = max(age, (node.now_ns() - node.odometry.stamp_ns) / NS_PER_S)
    return age


def write_params(folder: Path, factor: float) -> Path:
    """Write and return the parameter file."""
    units = [f'{ADDRESS + index:016X}={wheel}' for index, wheel in enumerate(WHEELS)]
    nodes: dict[str, dict[str, Any]] = {
        '/**': {'film.wheels': list(WHEELS), 'film.sample_rate': factor * FILM_RATE},
        'tire_receiver': {'port': str(folder / 'radio'), 'units': units},
        'imu_driver': {'port': str(folder / 'imu')}}
    path = folder / 'capacity.yaml'
    path.write_text(yaml.safe_dump({name: {'ros__parameters': values}
                                    for name, values in nodes.items()}), encoding='utf-8')
    return path


if __name__ == '__main__':
    sys.exit(main())
