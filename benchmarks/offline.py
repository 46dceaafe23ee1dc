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
Time and memory of the offline analysis, next to reading the same messages with rosbags.

The drive of three minutes is recorded once and repeated for longer bags. Each measurement is a
process of its own; its imports do not count.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
from typing import Any, NamedTuple

from benchmarks.harness import (
    check_ranges, machine, new_table, print_tables, Range, run_benchmark)
from benchmarks.scenarios import sequence
from smart_tire.analysis.pipeline import INPUTS
from smart_tire.bags import BagWriter
from smart_tire.errors import SmartTireError
from smart_tire.parameters import build, SimulatorParams
from smart_tire.parameters.files import snapshot_text
from smart_tire.samples import four, NS_PER_S, Sample, WHEELS, WheelSample
from smart_tire.simulation.offline import Event, simulate

DESCRIPTION = 'measure time and memory of the offline analysis'
# turns in both directions and a straight, from standstill to standstill
LEGS, DURATION = sequence(
    (3.0, 0.0, 0.0), *((15.0, 90.0, 90.0), (24.0, 120.0, 60.0), (16.0, 60.0, 120.0)) * 3,
    (12.0, 0.0, 0.0))
RANGES = (Range('analysis of the longest bag, share of its duration', 0.0, 0.2),
          Range('its memory [MB]', 0.0, 1000.0))
WHEEL_RATE, LEAST_IMU_RATE = 16, 100  # Hz, of the robot
STAMP_JITTER = 1e-3, 0.1  # of wheel_states: s of the robot, and at most this share of a period
# Prints the CPU time of all processes [s], the duration [s] and the size of the largest one [MB].
MEASURED = """
import resource, sys, time
from pathlib import Path
{imports}
def cpu():
    usage = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in usage)
begin, before = time.perf_counter(), cpu()
{work}
# ru_maxrss of this process would be that of its parent, if this was larger
own, = (int(line.split()[1]) for line in open('/proc/self/status') if line.startswith('VmHWM'))
size = max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
print([cpu() - before, time.perf_counter() - begin, size / 1024.0])
"""
PLAIN = MEASURED.format(imports='from rosbags.highlevel import AnyReader', work="""
with AnyReader([Path(sys.argv[1])]) as reader:
    for connection, _, data in reader.messages():
        reader.deserialize(data, connection.msgtype)
""")
ANALYSIS = MEASURED.format(imports="""
from smart_tire.analysis.offline import analyze
from smart_tire.analysis.pipeline import EstimatorParams
""", work="""
params = EstimatorParams.load([Path(sys.argv[2])])
analyze(Path(sys.argv[1]), Path(sys.argv[3]), params)
""")


def main(argv: Sequence[str] | None = None) -> int:
    """Measure bags of growing length and with more wheels; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.offline', description=DESCRIPTION)
    parser.add_argument('--repeats', type=int, nargs='+', default=[1, 4, 20], metavar='N',
                        help='lengths of the bags, times three minutes (default: 1 4 20: an hour)')
    parser.add_argument('--wheels', type=int, nargs='+', default=[1, 2, 4], metavar='N',
                        help='instrumented wheels of a short bag (default: 1 2 4)')
    parser.add_argument('--rates', type=int, nargs='+', default=[16, 100, 1000], metavar='HZ',
                        help='of wheel_states in a short bag, and of the IMU, which has at least '
                        '100 Hz (default: 16 100 1000)')
    args = parser.parse_args(argv)

    def measure() -> None:
        table = new_table('Analysis of a bag, times reading it with rosbags', 'bag [min]',
                          'instrumented\nwheels', 'wheel_states\n[Hz]', 'reading\n[s]', 'CPU',
                          'wall', 'size [MB]', 'share of the\nduration')
        with tempfile.TemporaryDirectory(prefix='smart_tire_bench_') as folder:
            found = list(rows(Path(folder), args.repeats, args.wheels, args.rates))
        for one in found:
            table.add_row(*one.cells)
        print_tables(machine(), [table])
        longest = max(found, key=lambda one: (one.seconds, -one.wheels, -one.rate))
        check_ranges(zip(RANGES, (longest.share, longest.size)))
    return run_benchmark('offline', measure)


class Row(NamedTuple):
    """One bag: its duration [s], and what reading and analysis take."""

    seconds: float
    wheels: int                  # with films
    rate: int                    # Hz, of wheel_states
    plain: tuple[float, float]   # s, CPU time and duration of reading
    ours: tuple[float, float]    # of the analysis
    size: float                  # MB, of the analysis

    @property
    def share(self) -> float:
        """Return the duration of the analysis over that of the bag."""
        return self.ours[1] / self.seconds

    @property
    def cells(self) -> list[str]:
        """Return the row of the table."""
        return [f'{self.seconds / 60.0:.0f}', str(self.wheels), str(self.rate),
                f'{self.plain[1]:.2f}',
                *(f'{ours / plain:.1f}' for ours, plain in zip(self.ours, self.plain)),
                f'{self.size:.0f}', f'{self.share:.3f}']


def rows(folder: Path, repeats: Sequence[int], wheels: Sequence[int], rates: Sequence[int]
         ) -> Iterator[Row]:
    """Yield the rows of the table: bags of growing length, then with more wheels, then rates."""
    shapes = dict.fromkeys([*((times, 1, WHEEL_RATE) for times in repeats),
                            *((1, count, WHEEL_RATE) for count in wheels),
                            *((1, 1, rate) for rate in rates)])
    for times, count, rate in shapes:
        params, bag = folder / 'params.yaml', folder / f'bag_{times}_{count}_{rate}'
        write_params(params, count, rate)
        write_bag(bag, simulated(count, rate), times)
        plain = measured(PLAIN, bag)
        ours = measured(ANALYSIS, bag, params, folder / f'out_{times}_{count}_{rate}')
        yield Row(times * DURATION, count, rate, plain[:2], ours[:2], ours[2])


def write_params(path: Path, wheels: int, rate: int = WHEEL_RATE) -> None:
    """Write the parameters of the estimators to a file."""
    path.write_text(snapshot_text({'/**': _robot(wheels, rate)}), encoding='utf-8')


def _robot(wheels: int, rate: int) -> dict[str, Any]:
    jitter, share = STAMP_JITTER
    return {'film.wheels': list(WHEELS[:wheels]),
            'encoder.stamp_jitter': min(jitter, share / rate)}


def simulated(wheels: int, rate: int = WHEEL_RATE) -> list[Event]:
    """Return the received inputs of the drive with films in the first ``wheels``."""
    params = build(SimulatorParams, {**_robot(wheels, rate), 'seed': 1,
                                     'imu_rate': float(max(rate, LEAST_IMU_RATE))})
    return [event for event in simulate(params, LEGS, DURATION, wheel_rate=rate)
            if event[1] in INPUTS]


def write_bag(path: Path, events: Sequence[Event], times: int) -> None:
    """Write a bag of ``events``, repeated; wheels that stand at both ends go on turning."""
    angles = [sample.position for _, _, sample in events
              if isinstance(sample, WheelSample) and sample.position is not None]
    span = round(DURATION * NS_PER_S)
    with BagWriter(path) as writer:
        for turn in range(times):
            offsets = [turn * (last - first) for first, last in zip(angles[0], angles[-1])]
            for receive_ns, topic, sample in events:
                writer.write_sample(topic, receive_ns + turn * span,
                                    _later(sample, turn * span, offsets))


def _later(sample: Sample, span_ns: int, angles: Sequence[float]) -> Sample:
    sample = replace(sample, stamp_ns=sample.stamp_ns + span_ns)
    if isinstance(sample, WheelSample) and sample.position is not None:
        sample = replace(sample, position=four(map(sum, zip(sample.position, angles))))
    return sample


def measured(program: str, *arguments: Path) -> tuple[float, float, float]:
    """Return CPU time [s], duration [s] and size [MB] of a program; raise SmartTireError."""
    done = subprocess.run([sys.executable, '-c', program, *map(str, arguments)],
                          env={**os.environ, 'OPENBLAS_NUM_THREADS': '1'},  # as the commands
                          capture_output=True, text=True, check=False)
    if done.returncode:
        raise SmartTireError(f'a measured program has failed:\n{done.stderr}')
    cpu, wall, size = json.loads(done.stdout.splitlines()[-1])
    return cpu, wall, size


if __name__ == '__main__':
    sys.exit(main())
