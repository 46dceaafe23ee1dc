"""``smart_tire bench``: what the stack costs on this machine; figures, no judgement."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
import os
from pathlib import Path
import platform
import tempfile
import time
from typing import Any

from smart_tire.cli.outputs import add_force, refuse_existing
from smart_tire.errors import SmartTireError

NAME = 'bench'
HELP = 'measure CPU load, latency, filter step time, offline speed and the models'
WHEEL = 'front_right'           # the instrumented one, as on the paper's robot
UNIT = f'0013A20040A1B2C3={WHEEL}'
RADIO_DELAY = 0.005             # s, of the simulated radio
START_TIMEOUT = 30.0            # s for all nodes to be there
WARM_UP = 3.0                   # s of driving that are not measured
LEFT, RIGHT = 120.0, 60.0       # rpm
LEGS = [(1.0, LEFT, RIGHT)]     # the same drive in memory
SEED = 1
OUT = Path('bench_output')
OFFLINE = 120.0                 # s of the drive that is analyzed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments of this verb."""
    parser.add_argument('--seconds', type=float, default=30.0, metavar='S',
                        help='of driving, live (default: %(default)s)')
    parser.add_argument('--models', action='store_true', help='only the figures on the models')
    truth = parser.add_argument_group('accuracy, by simulation and recordings')
    which = truth.add_mutually_exclusive_group()
    which.add_argument('--slip', action='store_true',
                       help='only how well slip and pose are told, beside other methods')
    which.add_argument('--friction', action='store_true',
                       help="only how well friction is told, beside the paper's method")
    truth.add_argument('--seeds', type=count, default=3, metavar='N',
                       help='of each simulated run (default: %(default)s)')
    truth.add_argument('--quick', action='store_true', help='one seed of each')
    truth.add_argument('--runs', nargs='+', default=[], metavar='RUN',
                       help='only these scenarios and recordings')
    truth.add_argument('--data', type=Path, default=Path('../shared/data'), metavar='DIR',
                       help='folder with real recordings, for --slip (default: %(default)s)')
    truth.add_argument('--out', type=Path, metavar='DIR',
                       help='folder for figures and results.json (default: bench_output/slip or '
                            'bench_output/friction)')
    add_force(parser)


def count(text: str) -> int:
    """Return the whole number in ``text``; raise ValueError unless it is above zero."""
    number = int(text)
    if number < 1:
        raise ValueError(text)
    return number


def run(args: argparse.Namespace) -> int:
    """Print all figures, or those on the models only."""
    if args.slip or args.friction:
        out = args.out or OUT / ('slip' if args.slip else 'friction')
        refuse_existing([out / 'results.json', *sorted(out.glob('*.png'))], force=args.force)
    if args.slip:
        from smart_tire.cli.bench_slip import bench_slip, Wish
        print(machine())
        bench_slip(Wish(1 if args.quick else args.seeds, args.runs, args.data, out),
                   machine())
        return 0
    if args.friction:
        from smart_tire.cli.bench_friction import bench_friction, Wish as FrictionWish
        print(machine())
        bench_friction(FrictionWish(1 if args.quick else args.seeds, args.quick, args.runs, out),
                       machine())
        return 0
    from smart_tire.cli.bench_film import print_measuring
    from smart_tire.cli.bench_models import print_models
    if args.models:
        print(machine())
        print_models()
        print_measuring()
        return 0
    # Importing rclpy may start Python anew, so it must come before any child is started.
    from smart_tire.nodes.pilot import Cockpit
    print(machine())
    with tempfile.TemporaryDirectory(prefix='smart_tire_bench_') as folder:
        measure_live(Path(folder), args.seconds, Cockpit)
        measure_offline(Path(folder))
    print_models()
    print_measuring()
    return 0


def machine() -> str:
    """Return what kind of machine this is."""
    models = [line.partition(':')[2].strip()
              for line in Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
              if line.startswith('model name')]
    return (f'{models[0] if models else platform.machine()}, '
            f'{len(os.sched_getaffinity(0))} cores, Python {platform.python_version()}, '
            f'load {os.getloadavg()[0]:.1f} before')


def measure_live(folder: Path, seconds: float, cockpit_class: Callable[[list[str]], Any]) -> None:
    """Run all nodes as in the demo; print their CPU time and the latency of tire samples."""
    from smart_tire.cli.stack import isolated_environment, NODES, Stack
    from smart_tire.cli.tap import RadioTap
    environment = isolated_environment()
    os.environ.update(environment)  # the cockpit lives in this process
    source, link = str(folder / 'radio'), str(folder / 'tapped_radio')
    params = write_params(folder, source, link)
    with Stack(folder / 'logs', environment) as stack, RadioTap(source, link) as tap:
        for node in NODES:
            stack.node(node, [params])
        with cockpit_class(['--ros-args', '--params-file', str(params)]) as cockpit:
            await_nodes(stack, cockpit, NODES)
            cockpit.pilot.drive(LEFT, RIGHT)
            cockpit.turn(WARM_UP)
            cockpit.pilot.subscribe('tire_samples', tap.heard)
            before, begin = stack.cpu_seconds(), time.monotonic()
            cockpit.turn(seconds)
            elapsed, after = time.monotonic() - begin, stack.cpu_seconds()
        if died := stack.died():
            raise SmartTireError(f'{", ".join(died)} died')
        print_cpu({name: (after[name] - before[name]) / elapsed for name in NODES})
        print_latency(tap.latencies)


def write_params(folder: Path, source: str, link: str) -> Path:
    """Return the parameter file of the live run, with one instrumented wheel."""
    import yaml
    imu, motors = str(folder / 'imu'), str(folder / 'motors')
    nodes: dict[str, dict[str, Any]] = {
        '/**': {'film.wheels': [WHEEL]},
        'robot_simulator': {'seed': SEED, 'units': [UNIT], 'ports.tire_radio': source,
                            'ports.imu': imu, 'ports.motors': motors},
        'tire_receiver': {'port': link, 'units': [UNIT], 'radio_latency': RADIO_DELAY},
        'imu_driver': {'port': imu}, 'motor_driver': {'port': motors}}
    path = folder / 'bench.yaml'
    path.write_text(yaml.safe_dump({name: {'ros__parameters': values}
                                    for name, values in nodes.items()}), encoding='utf-8')
    return path


def await_nodes(stack: Any, cockpit: Any, names: Sequence[str]) -> None:
    """Wait until every node has reported and estimates flow; raise SmartTireError if not."""
    deadline = time.monotonic() + START_TIMEOUT
    while cockpit.pilot.slip is None or set(names) - cockpit.pilot.health.keys():
        for name, status in stack.died().items():
            raise SmartTireError(f'{name} ended with status {status}\n{stack.log(name)}')
        if time.monotonic() > deadline:
            raise SmartTireError(f'not all of {", ".join(names)} began within '
                                 f'{START_TIMEOUT:.0f} s')
        cockpit.turn(0.25)


def print_cpu(shares: dict[str, float]) -> None:
    """Print the CPU seconds per second of robot time."""
    print('CPU seconds per second of robot time, one instrumented wheel:')
    for name, share in shares.items():
        print(f'  {name:20} {share:6.3f}')
    robot = sum(share for name, share in shares.items() if name != 'robot_simulator')
    print(f'  {"all but simulator":20} {robot:6.3f}')


def print_latency(latencies: Sequence[float]) -> None:
    """Print how long batches take from the last byte to the topic."""
    import numpy as np
    if not latencies:
        raise SmartTireError('no radio batch reached tire_samples')
    middle, late, worst = 1e3 * np.percentile(latencies, (50.0, 99.0, 100.0))
    print(f'last byte of a radio batch to its last tire_samples, {len(latencies)} batches: '
          f'p50 {middle:.1f} ms, p99 {late:.1f} ms, worst {worst:.1f} ms')


def measure_offline(folder: Path) -> None:
    """Simulate the same drive in memory; print filter step time and offline speed."""
    from smart_tire.bags import BagWriter
    from smart_tire.parameters import build, SimulatorParams
    from smart_tire.simulation.run import simulate
    events = simulate(build(SimulatorParams, {'film.wheels': [WHEEL], 'seed': SEED}),
                      LEGS, OFFLINE)
    with BagWriter(folder / 'drive') as writer:
        for receive_ns, topic, sample in events:
            writer.write_sample(topic, receive_ns, sample)
    print_steps([sample for _, topic, sample in events if topic in ('imu/data', 'wheel_states')])
    print_speed(folder)


def print_steps(samples: Sequence[Any]) -> None:
    """Print the time of one filter step: prediction, updates and output."""
    import numpy as np
    from smart_tire.estimation.slip.estimator import SlipEstimator
    from smart_tire.parameters import SlipEstimatorParams
    estimator, times = SlipEstimator(SlipEstimatorParams()), []
    for sample in samples:
        begin = time.perf_counter()
        if estimator.update(sample):
            times.append(time.perf_counter() - begin)
    print(f'slip filter step (predict, updates, output): mean {1e6 * np.mean(times):.0f} us, '
          f'p99 {1e6 * np.percentile(times, 99.0):.0f} us, of 8000 us')


def print_speed(folder: Path) -> None:
    """Print how much faster than real time a bag is analyzed."""
    from smart_tire.analysis.offline import analyze
    from smart_tire.analysis.pipeline import EstimatorParams
    params, out = EstimatorParams.load([]), folder / 'analyzed'
    begin = time.perf_counter()
    result = analyze(folder / 'drive', out, params)
    estimated = time.perf_counter() - begin
    from smart_tire.analysis.figures import write_figures
    write_figures(out, result.intake.inputs, result.estimates, result.intake.truth,
                  params.robot)
    drawn = time.perf_counter() - begin
    print(f'offline: {OFFLINE / estimated:.0f} times faster than real time, '
          f'{OFFLINE / drawn:.0f} times with figures')
