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

"""CPU load and latency of the running stack, filter step time and offline speed."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
import os
from pathlib import Path
import sys
import tempfile
import time
from typing import Any

from benchmarks.harness import machine, run_benchmark
from smart_tire.errors import SmartTireError

DESCRIPTION = 'measure CPU load, latency, filter step time and offline speed'
WHEEL = 'front_right'           # instrumented wheel, as in paper B
SENSOR_NODE = f'0013A20040A1B2C3={WHEEL}'
RADIO_DELAY = 0.005             # s, of the simulated radio
START_TIMEOUT = 30.0            # s until all nodes run
WARM_UP_TIME = 3.0              # s of driving before the measurement
LEFT_SPEED, RIGHT_SPEED = 120.0, 60.0  # rpm
LEGS = [(1.0, LEFT_SPEED, RIGHT_SPEED)]  # of the simulated drive for offline analysis
SEED = 1
OFFLINE_DURATION = 120.0        # s of the drive for offline analysis


def main(argv: Sequence[str] | None = None) -> int:
    """Measure the running stack, then the estimators offline; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.load', description=DESCRIPTION)
    parser.add_argument('--seconds', type=float, default=30.0, metavar='S',
                        help='duration of the live measurement (default: %(default)s)')
    args = parser.parse_args(argv)
    # Importing rclpy may start Python again, so it must come before any child is started.
    from smart_tire.nodes.pilot import Pilot
    from smart_tire.nodes.runner import NodeRunner
    print(machine())

    def measure() -> None:
        with tempfile.TemporaryDirectory(prefix='smart_tire_bench_') as folder:
            measure_live(Path(folder), args.seconds,
                         partial(NodeRunner, partial(Pilot, 'demo_driver')))
            measure_offline(Path(folder))
    return run_benchmark('load', measure)


def measure_live(folder: Path, seconds: float, runner_class: Callable[[list[str]], Any]) -> None:
    """Analysis all nodes as in the demo; print their CPU time and the latency of tire samples."""
    from benchmarks.latency_probe import RadioTap
    from smart_tire.cli._stack import isolated_environment, NODES, Stack
    environment = isolated_environment()
    os.environ.update(environment)  # the node runner is in this process
    source, link = str(folder / 'radio'), str(folder / 'tapped_radio')
    params = write_params(folder, source, link)
    with Stack(folder / 'logs', environment) as stack, RadioTap(source, link) as tap:
        for node in NODES:
            stack.node(node, [params])
        with runner_class(['--ros-args', '--params-file', str(params)]) as runner:
            await_nodes(stack, runner, NODES)
            runner.node.drive(LEFT_SPEED, RIGHT_SPEED)
            runner.spin(WARM_UP_TIME)
            runner.node.subscribe('tire_samples', tap.add_sample)
            before, begin = stack.cpu_seconds(), time.monotonic()
            runner.spin(seconds)
            elapsed, after = time.monotonic() - begin, stack.cpu_seconds()
        if died := stack.died():
            raise SmartTireError(f'{", ".join(died)} died')
        print_cpu({name: (after[name] - before[name]) / elapsed for name in NODES})
        print_latency(tap.latencies)


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


def measure_offline(folder: Path) -> None:
    """Simulate the same drive in memory; print filter step time and offline speed."""
    from smart_tire.bags import BagWriter
    from smart_tire.parameters import build, SimulatorParams
    from smart_tire.simulation.offline import simulate
    events = simulate(build(SimulatorParams, {'film.wheels': [WHEEL], 'seed': SEED}),
                      LEGS, OFFLINE_DURATION)
    with BagWriter(folder / 'drive') as writer:
        for receive_ns, topic, sample in events:
            writer.write_sample(topic, receive_ns, sample)
    print_steps([sample for _, _, sample in events])
    print_speed(folder)


def print_steps(samples: Sequence[Any]) -> None:
    """Print the time of a step of the slip filter on the ground that the films show."""
    import numpy as np
    from smart_tire.analysis.pipeline import EstimatorParams, FrictionStage
    from smart_tire.estimation.reorder_buffer import GRID_NS
    from smart_tire.estimation.slip.kalman import COMPILED
    from smart_tire.estimation.slip.estimator import SlipEstimator
    from smart_tire.parameters import build, FrictionEstimatorParams
    from smart_tire.samples import GroundState, ImuSample, NS_PER_S, WheelSample
    params = EstimatorParams(friction=build(FrictionEstimatorParams, {'film.wheels': [WHEEL]}))
    friction, estimator, times = FrictionStage(params.friction), SlipEstimator(params.slip), []
    inputs = [item for sample in samples for item in friction.update(sample)]
    for sample in inputs:
        if isinstance(sample, (ImuSample, WheelSample, GroundState)):
            begin = time.thread_time()
            estimator.update(sample)
            times.append(time.thread_time() - begin)
    steps = OFFLINE_DURATION * NS_PER_S / GRID_NS
    print(f'slip filter, {"" if COMPILED else "not "}compiled: '
          f'{1e6 * sum(times) / steps:.0f} us of CPU for a step of {GRID_NS / 1000:.0f} us, '
          f'99 % of the samples within {1e6 * np.percentile(times, 99.0):.0f} us')


def print_speed(folder: Path) -> None:
    """Print how much faster than real time a bag is analyzed."""
    from smart_tire.analysis.offline import analyze
    from smart_tire.analysis.pipeline import EstimatorParams
    params, out = EstimatorParams.load([]), folder / 'analyzed'
    begin = time.perf_counter()
    result = analyze(folder / 'drive', out, params)
    estimated = time.perf_counter() - begin
    from smart_tire.analysis.figures import write_figures
    write_figures(out, result.result, params.robot)
    drawn = time.perf_counter() - begin
    print(f'offline: {OFFLINE_DURATION / estimated:.0f} times faster than real time, '
          f'{OFFLINE_DURATION / drawn:.0f} times with figures')


if __name__ == '__main__':
    sys.exit(main())
