"""The main job: drive the simulated robot over concrete and sand, show, record and judge it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
import json
import os
from pathlib import Path
import signal
import sys
import time
from typing import Any, TYPE_CHECKING

import yaml

from smart_tire.cli._dashboard import Dashboard
from smart_tire.cli._overwrite import (
    add_force, FIGURES, refuse_existing, refuse_existing_bag, remove, remove_bag)
from smart_tire.cli._processes import isolated_environment, NODES, Stack

if TYPE_CHECKING:
    from smart_tire.analysis.demo_report import Spans
    from smart_tire.analysis.summary import Tree

NAME = 'demo'
HELP = 'drive the simulated robot on concrete and sand, record it and judge the estimates'

UNITS = ('0013A20040A1B2C2=front_left', '0013A20040A1B2C3=front_right')
RADIO_LATENCY = 0.005     # s, radio.delay of the simulator
FAST, SLOW = 120.0, 60.0  # rpm, paper B Fig. 10
LEG = 9.0                 # s of each turn
SETTLE = 1.0              # s at the start of a leg that its means leave out
STAND = 2.5               # s of standstill before the first leg
SAND_FROM = 6.2           # m from the origin, in x or y: two circles from there stay on sand
LONGEST_TRANSFER = 12.0   # s
START_TIMEOUT = 20.0      # s for all nodes to be there
REFRESH = 0.25            # s between two looks at the dashboard
EXPECTED = ('imu/data', 'wheel_states', 'tire_samples', 'tire_battery', 'odom', 'wheel_slip',
            'icr', 'tire_friction', 'cmd_vel', 'wheel_commands', 'motor_commands',
            'ground_truth/odom', 'ground_truth/wheel_slip', 'ground_truth/tire_friction',
            '/diagnostics')


PORTS = ('tire_radio', 'imu', 'motors')
FILES = ('demo.yaml', 'conversions.csv', 'summary.json')


class DemoError(Exception):
    """The demo can not go on; its text says why."""


@dataclass(frozen=True)
class Leg:
    """A stretch of constant wheel speeds."""

    name: str
    left: float      # rpm
    right: float     # rpm
    judged: bool = True


LEGS = (
    Leg('concrete 120/60', FAST, SLOW), Leg('concrete 60/120', SLOW, FAST),
    Leg('to the sand', FAST, FAST, judged=False),
    Leg('sand 120/60', FAST, SLOW), Leg('sand 60/120', SLOW, FAST))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments of this verb."""
    parser.add_argument('--out', type=Path, default=Path('demo_output'),
                        help='folder for bag, figures and summary (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='of the simulation')
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Run the demo; return 0 if every node lived, every topic spoke."""
    out: Path = args.out
    refuse_existing_bag(out / 'bag', force=args.force)
    refuse_existing([out / name for name in (*FILES, 'figures', 'logs')], force=args.force)
    # Importing rclpy may start Python anew, so it must come before any child is started.
    from smart_tire.analysis.demo_report import judge
    from smart_tire.nodes.demo_driver import NodeRunner
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        params = _prepare(out, args.seed)
        spans = _drive(out, params, NodeRunner)
        judged = judge(out / 'bag', params, spans, EXPECTED, out / 'conversions.csv',
                       out / 'figures')
    except KeyboardInterrupt:
        print('interrupted', file=sys.stderr)
        return 130
    except DemoError as error:
        print(f'demo: {error}', file=sys.stderr)
        return 1
    return _conclude(out, judged)


def _prepare(out: Path, seed: int) -> Path:
    """Delete the files of an earlier demo and write this one's parameter file."""
    remove_bag(out / 'bag')
    remove(out / 'figures', FIGURES)
    remove(out / 'logs', [f'{name}.log' for name in (*NODES, 'recorder')])
    remove(out / 'ports', PORTS)
    remove(out, FILES)
    out.mkdir(parents=True, exist_ok=True)
    ports = (out / 'ports').resolve()
    links = {name: str(ports / name) for name in PORTS}
    nodes: dict[str, dict[str, Any]] = {
        '/**': {'film.wheels': ['front_left', 'front_right']},
        'robot_simulator': {'seed': seed, 'units': list(UNITS),
                            'truth_log': str((out / 'conversions.csv').resolve()),
                            **{f'ports.{name}': link for name, link in links.items()}},
        'tire_receiver': {'port': links['tire_radio'], 'units': list(UNITS),
                          'radio_latency': RADIO_LATENCY},
        'imu_driver': {'port': links['imu']},
        'motor_driver': {'port': links['motors']}}
    file = out / 'demo.yaml'
    file.write_text(yaml.safe_dump({name: {'ros__parameters': values}
                                    for name, values in nodes.items()}), encoding='utf-8')
    return file


def _drive(out: Path, params: Path, cockpit_class: Callable[[list[str]], Any]) -> Spans:
    """Start all, drive the legs, end all; return when each leg was."""
    environment = isolated_environment()
    os.environ.update(environment)  # the cockpit lives in this process
    with Stack(out / 'logs', environment) as stack:
        stack.start('recorder', 'smart_tire.cli.main', 'record', '--out', str(out / 'bag'))
        for node in NODES:
            stack.node(node, [params])
        with cockpit_class(['--ros-args', '--params-file', str(params)]) as cockpit:
            _await_nodes(stack, cockpit)
            with Dashboard() as dashboard:
                spans = _legs(stack, cockpit, dashboard)
        _check_alive(stack)
        # from the listeners to the ports' owner; the recorder last: it hears them to the end
        for names in (NODES[1:], NODES[:1], ('recorder',)):
            for name, status in stack.stop(*names).items():
                if status:
                    raise DemoError(f'{name} ended with status {status}\n{stack.tail(name)}')
    remove(out / 'ports', PORTS)
    return spans


def _await_nodes(stack: Stack, cockpit: Any) -> None:
    """Wait until the estimates flow and every node has reported."""
    pilot, deadline = cockpit.pilot, time.monotonic() + START_TIMEOUT
    while pilot.slip is None or pilot.wheels is None or set(NODES) - pilot.health.keys():
        _check_alive(stack)
        if time.monotonic() > deadline:
            missing = sorted(set(NODES) - pilot.health.keys()) or ['wheel_slip']
            raise DemoError(f'nothing heard of {", ".join(missing)} for {START_TIMEOUT:.0f} s')
        cockpit.turn(REFRESH)


def _check_alive(stack: Stack) -> None:
    for name, status in stack.died().items():
        raise DemoError(f'{name} died with status {status}\n{stack.tail(name)}')


def _legs(stack: Stack, cockpit: Any, dashboard: Dashboard) -> Spans:
    spans: Spans = {}
    _hold(stack, cockpit, dashboard, Leg('standing', 0.0, 0.0), STAND)
    for leg in LEGS:
        begin = cockpit.pilot.now_ns()
        _hold(stack, cockpit, dashboard, leg, LEG if leg.judged else LONGEST_TRANSFER)
        if leg.judged:
            spans[leg.name] = [(begin + round(SETTLE * 1e9), cockpit.pilot.now_ns())]
    _hold(stack, cockpit, dashboard, Leg('standing', 0.0, 0.0), 1.5)
    return spans


def _hold(stack: Stack, cockpit: Any, dashboard: Dashboard, leg: Leg, duration: float) -> None:
    """Drive ``leg`` for ``duration`` [s], a transfer at most until the sand is reached."""
    pilot, end = cockpit.pilot, time.monotonic() + duration
    pilot.drive(leg.left, leg.right)
    while time.monotonic() < end:
        if leg.left == leg.right != 0.0 and max(map(abs, pilot.odometry.position)) > SAND_FROM:
            return
        cockpit.turn(REFRESH)
        _check_alive(stack)
        dashboard.show(leg.name, pilot)


def _conclude(out: Path, judged: Tree) -> int:
    """Write and print the summary; return 1 if a topic stayed silent."""
    from smart_tire.analysis.demo_report import lines
    (out / 'summary.json').write_text(json.dumps(judged, indent=2) + '\n', encoding='utf-8')
    print('\n'.join(lines(judged)))
    print(f'\nbag, figures and summary.json are in {out}/')
    if judged['silent']:
        print(f'demo: nothing on {", ".join(judged["silent"])}', file=sys.stderr)
        return 1
    return 0
