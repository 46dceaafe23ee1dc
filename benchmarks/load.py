# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""CPU load and latency of the running stack."""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
import os
from pathlib import Path
import select
import sys
import tempfile
import threading
import time
from types import TracebackType
from typing import Any

from benchmarks.harness import machine, run_benchmark
from smart_tire.cli._stack import isolated_environment, NODES, Stack
from smart_tire.errors import SmartTireError
from smart_tire.estimation.reorder_buffer import GRID_NS
from smart_tire.launching import SEPARATE
from smart_tire.nodes.command_line import COMPOSED
from smart_tire.protocol.tire_payload import decode_batch, volts
from smart_tire.protocol.xbee import decode_receive_packet, XBeeDeframer
from smart_tire.samples import NS_PER_S, TireSample
from smart_tire.simulation.pseudo_terminal import PtyPort

DESCRIPTION = 'measure CPU load and latency'
WHEEL = 'front_right'           # instrumented wheel, as in paper B
SENSOR_NODE = f'0013A20040A1B2C3={WHEEL}'
RADIO_DELAY = 0.005             # s, of the simulated radio
START_TIMEOUT = 30.0            # s until all nodes run
WARM_UP_TIME = 3.0              # s of driving before the measurement
LEFT_SPEED, RIGHT_SPEED = 120.0, 60.0  # rpm
SEED = 1
MAX_READ = 4096      # bytes
POLL_PERIOD = 0.1    # s
OPEN_TIMEOUT = 10.0  # s until the port of the radio must exist
ODOM_PHASES = 5      # an instant of odom, every 8 ms, waits for IMU samples, every 10 ms
KEY_LENGTH = 8       # samples at the end of a batch whose noise identifies it

Key = tuple[tuple[float, ...], ...]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure the running stack; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.load', description=DESCRIPTION)
    parser.add_argument('--seconds', type=float, default=30.0, metavar='S',
                        help='duration of the live measurement (default: %(default)s)')
    parser.add_argument('--composed', action='store_true',
                        help='the nodes in one process, except motor_driver and wheel_controller')
    args = parser.parse_args(argv)
    # Importing rclpy may start Python again, so it must come before any child is started.
    from smart_tire.nodes.pilot import Pilot
    from smart_tire.nodes.runner import NodeRunner
    print(machine())

    def measure() -> None:
        with tempfile.TemporaryDirectory(prefix='smart_tire_bench_') as folder:
            measure_live(Path(folder), args.seconds,
                         partial(NodeRunner, partial(Pilot, 'demo_driver')),
                         (NODES[0], COMPOSED, *SEPARATE) if args.composed else NODES)
    return run_benchmark('load', measure)


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
        self._newest: deque[tuple[float, ...]] = deque(maxlen=KEY_LENGTH)
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
        self._newest.append(sample.volts)
        sent_ns = self._sent_ns.pop(tuple(self._newest), None)
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


def measure_live(folder: Path, seconds: float, runner_class: Callable[[list[str]], Any],
                 processes: Sequence[str]) -> None:
    """Run all nodes in ``processes``; print their CPU time, and the latency of their messages."""
    environment = isolated_environment()
    os.environ.update(environment)  # the node runner is in this process
    source, link = str(folder / 'radio'), str(folder / 'tapped_radio')
    params = write_params(folder, source, link)
    with Stack(folder / 'logs', environment) as stack, RadioTap(source, link) as tap:
        for name in processes:
            stack.node(name, [params])
        with runner_class(['--ros-args', '--params-file', str(params)]) as runner:
            await_nodes(stack, runner, NODES)
            runner.node.drive(LEFT_SPEED, RIGHT_SPEED)
            runner.spin(WARM_UP_TIME)
            runner.node.subscribe('tire_samples', tap.add_sample)
            ages: list[tuple[int, float]] = []
            runner.node.subscribe('odom', lambda sample: ages.append(
                (sample.stamp_ns, (time.time_ns() - sample.stamp_ns) / NS_PER_S)))
            before, begin = cpu_seconds(stack), time.monotonic()
            runner.spin(seconds)
            elapsed, after = time.monotonic() - begin, cpu_seconds(stack)
        if died := stack.died():
            raise SmartTireError(f'{", ".join(died)} died')
        print_cpu({name: (after[name] - before[name]) / elapsed for name in processes})
        print_latency(tap.latencies)
        print_jitter(ages)


def cpu_seconds(stack: Stack) -> dict[str, float]:
    """Return the user plus system CPU time [s] of each process that runs."""
    found = {}
    for name, process in stack.processes.items():
        if process.poll() is None:
            fields = Path(f'/proc/{process.pid}/stat').read_text().rsplit(')', 1)[1].split()
            found[name] = (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
    return found


def write_params(folder: Path, source: str, link: str) -> Path:
    """Write and return the parameter file of the live run with one instrumented wheel."""
    import yaml
    imu, motors = str(folder / 'imu'), str(folder / 'motors')
    nodes: dict[str, dict[str, Any]] = {
        '/**': {'film.wheels': [WHEEL]},
        'robot_simulator': {'seed': SEED, 'units': [SENSOR_NODE], 'ports.tire_radio': source,
                            'ports.imu': imu, 'ports.motors': motors},
        'tire_receiver': {'port': link, 'units': [SENSOR_NODE], 'radio_latency': RADIO_DELAY},
        'imu_driver': {'port': imu}, 'motor_driver': {'port': motors}}
    path = folder / 'bench.yaml'
    path.write_text(yaml.safe_dump({name: {'ros__parameters': values}
                                    for name, values in nodes.items()}), encoding='utf-8')
    return path


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


def print_cpu(shares: dict[str, float]) -> None:
    """Print the CPU load of each node."""
    print('CPU seconds per second of robot time, one instrumented wheel:')
    for name, share in shares.items():
        print(f'  {name:20} {share:6.3f}')
    robot = sum(share for name, share in shares.items() if name != 'robot_simulator')
    print(f'  {"all but simulator":20} {robot:6.3f}')


def print_latency(latencies: Sequence[float]) -> None:
    """Print the latency of radio batches from the last byte to the topic."""
    import numpy as np
    if not latencies:
        raise SmartTireError('no radio batch reached tire_samples')
    median, p99, worst = 1e3 * np.percentile(latencies, (50.0, 99.0, 100.0))
    print(f'last byte of a radio batch to its last tire_samples, {len(latencies)} batches: '
          f'p50 {median:.1f} ms, p99 {p99:.1f} ms, worst {worst:.1f} ms')


def print_jitter(ages: Sequence[tuple[int, float]]) -> None:
    """Print the jitter of ``odom`` from its timestamps [ns] and its ages on arrival [s]."""
    import numpy as np
    stamps, age = np.array([stamp for stamp, _ in ages]), np.array([one for _, one in ages])
    phases = stamps // GRID_NS % ODOM_PHASES
    jitter = np.empty_like(age)
    for phase in range(ODOM_PHASES):
        jitter[phases == phase] = age[phases == phase] - np.median(age[phases == phase])
    p99, p999, worst = 1e3 * np.percentile(jitter, (99.0, 99.9, 100.0))
    print(f'age of odom on arrival: p50 {1e3 * np.median(age):.1f} ms; later than usual by '
          f'p99 {p99:.1f} ms, p99.9 {p999:.1f} ms, worst {worst:.1f} ms')


if __name__ == '__main__':
    sys.exit(main())
