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

"""``smart_tire demo``: run the full stack on the simulated robot, compare it with ground truth."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
import json
import os
from pathlib import Path
import signal
import sys
import time
from typing import Any, TYPE_CHECKING

from smart_tire.cli._dashboard import Dashboard
from smart_tire.cli._heartbeat import heartbeat
from smart_tire.cli._overwrite import (
    add_force, FIGURES, refuse_existing, refuse_existing_bag, remove, remove_bag)
from smart_tire.cli._processes import isolated_environment, NODES, Stack
from smart_tire.cli.view import ANNOUNCED
import yaml

if TYPE_CHECKING:
    from smart_tire.analysis.demo_report import Intervals
    from smart_tire.analysis.summary import Tree

NAME = 'demo'
HELP = 'drive the simulated robot on concrete and sand, record a bag and evaluate the estimates'

UNITS = ('0013A20040A1B2C2=front_left', '0013A20040A1B2C3=front_right')
RADIO_LATENCY = 0.005         # s, radio.delay of the simulator
FAST_SPEED, SLOW_SPEED = 120.0, 60.0  # rpm, paper B Fig. 10
LEG_DURATION = 9.0            # s of each turn
SETTLING_TIME = 1.0           # s at the start of a leg that are excluded from its means
STANDSTILL_DURATION = 2.5     # s before the first leg
MIN_SAND_DISTANCE = 6.2       # m from the origin in x or y: two circles from there stay on sand
MAX_TRANSFER_DURATION = 12.0  # s
START_TIMEOUT = 20.0          # s until all nodes run
WAIT_REPORT_PERIOD = 4.0      # s between lines that name the nodes waited for
DASHBOARD_PERIOD = 0.25       # s between two updates
EXPECTED_TOPICS = (
    'imu/data', 'wheel_states', 'tire_samples', 'tire_battery', 'odom', 'wheel_slip', 'icr',
    'ground_state', 'tire_friction', 'cmd_vel', 'wheel_commands', 'motor_commands',
    'ground_truth/odom', 'ground_truth/wheel_slip', 'ground_truth/tire_friction', '/diagnostics')
PORTS = ('tire_radio', 'imu', 'motors')
VIEWER = 'viewer'  # name of its process
FILES = ('demo.yaml', 'conversions.csv', 'summary.json')


class DemoError(Exception):
    """The demo cannot continue; the text has the reason."""


@dataclass(frozen=True)
class Leg:
    """An interval of constant wheel speeds."""

    name: str
    left: float      # rpm
    right: float     # rpm
    evaluated: bool = True


LEGS = (
    Leg('concrete 120/60', FAST_SPEED, SLOW_SPEED), Leg('concrete 60/120', SLOW_SPEED, FAST_SPEED),
    Leg('to the sand', FAST_SPEED, FAST_SPEED, evaluated=False),
    Leg('sand 120/60', FAST_SPEED, SLOW_SPEED), Leg('sand 60/120', SLOW_SPEED, FAST_SPEED))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument('--out', type=Path, default=Path('demo_output'),
                        help='folder for bag, figures and summary (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1,
                        help='random seed of the simulation (default: %(default)s)')
    parser.add_argument('--view', action='store_true',
                        help='show the run in the rerun viewer, as "smart_tire view --live"')
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Run the demo; return 0 if no node failed and no topic stayed silent."""
    out: Path = args.out
    refuse_existing_bag(out / 'bag', force=args.force)
    refuse_existing([out / name for name in (*FILES, 'figures', 'logs')], force=args.force)
    if args.view:
        import_module('smart_tire.view.viewer')  # is it installed?
    # Importing rclpy may restart Python, so it must come before any child and any output.
    from smart_tire.nodes.demo_driver import DemoDriver
    from smart_tire.nodes.runner import NodeRunner
    print(f'starting {len(NODES)} nodes and a recorder', flush=True)
    from smart_tire.analysis.demo_report import evaluate
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        params = _prepare(out, args.seed)
        intervals = _drive(out, params, partial(NodeRunner, DemoDriver), view=args.view)
        print('evaluating the recording', flush=True)
        with heartbeat('smart_tire demo'):
            summary = evaluate(out / 'bag', params, intervals, EXPECTED_TOPICS,
                               out / 'conversions.csv', out / 'figures')
    except KeyboardInterrupt:
        print('interrupted', file=sys.stderr)
        return 130
    except DemoError as error:
        print(f'demo: {error}', file=sys.stderr)
        return 1
    return _report(out, summary)


def _prepare(out: Path, seed: int) -> Path:
    """Delete the results of an earlier demo and write the parameter file."""
    remove_bag(out / 'bag')
    remove(out / 'figures', FIGURES)
    remove(out / 'logs', [f'{name}.log' for name in (*NODES, 'recorder', VIEWER)])
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


def _drive(out: Path, params: Path, runner_class: Callable[[list[str]], Any], *,
           view: bool = False) -> Intervals:
    """Start all processes, drive the legs, stop all; return the time intervals of the legs."""
    environment = isolated_environment()
    os.environ.update(environment)  # the node runner is in this process
    with Stack(out / 'logs', environment) as stack:
        stack.start('recorder', 'smart_tire.cli.main', 'record', '--out', str(out / 'bag'))
        if view:
            _start_viewer(stack, params)
        for node in NODES:
            stack.node(node, [params])
        with runner_class(['--ros-args', '--params-file', str(params)]) as runner:
            _await_nodes(stack, runner)
            with Dashboard() as dashboard:
                intervals = _drive_legs(stack, runner, dashboard)
        _check_alive(stack)
        # Subscribers first, then the owner of the ports; the recorder last, to record all.
        for names in (NODES[1:], NODES[:1], ('recorder', *[VIEWER] * view)):
            for name, status in stack.stop(*names).items():
                if status:
                    raise DemoError(f'{name} ended with status {status}\n{stack.tail(name)}')
    remove(out / 'ports', PORTS)
    return intervals


def _start_viewer(stack: Stack, params: Path) -> None:
    """Start the viewer in the environment of the nodes; print where it is."""
    stack.start(VIEWER, 'smart_tire.cli.main', 'view', '--live', '--params', str(params))
    deadline = time.monotonic() + START_TIMEOUT
    while not (lines := [line for line in stack.log(VIEWER).splitlines()
                         if line.startswith(ANNOUNCED)]):
        if stack.died() or time.monotonic() > deadline:
            raise DemoError(f'the viewer does not start\n{stack.tail(VIEWER)}')
        time.sleep(DASHBOARD_PERIOD)
    print(lines[0], flush=True)


def _await_nodes(stack: Stack, runner: Any) -> None:
    """Wait until estimates are published and every node has sent diagnostics."""
    pilot, begin, report_at = runner.node, time.monotonic(), WAIT_REPORT_PERIOD
    while pilot.slip is None or pilot.wheels is None or set(NODES) - pilot.health.keys():
        _check_alive(stack)
        waited = time.monotonic() - begin
        missing = sorted(set(NODES) - pilot.health.keys()) or ['wheel_slip']
        if waited > report_at:
            report_at += WAIT_REPORT_PERIOD
            print(f'waiting for messages from {", ".join(missing)}', flush=True)
        if waited > START_TIMEOUT:
            raise DemoError(f'no messages from {", ".join(missing)} within {START_TIMEOUT:.0f} s')
        runner.spin(DASHBOARD_PERIOD)


def _check_alive(stack: Stack) -> None:
    for name, status in stack.died().items():
        if name == VIEWER and not status:
            continue  # closed by the user
        raise DemoError(f'{name} died with status {status}\n{stack.tail(name)}')


def _drive_legs(stack: Stack, runner: Any, dashboard: Dashboard) -> Intervals:
    intervals: Intervals = {}
    _drive_leg(stack, runner, dashboard, Leg('standstill', 0.0, 0.0), STANDSTILL_DURATION)
    for leg in LEGS:
        begin = runner.node.now_ns()
        duration = LEG_DURATION if leg.evaluated else MAX_TRANSFER_DURATION
        _drive_leg(stack, runner, dashboard, leg, duration)
        if leg.evaluated:
            intervals[leg.name] = [(begin + round(SETTLING_TIME * 1e9), runner.node.now_ns())]
    _drive_leg(stack, runner, dashboard, Leg('standstill', 0.0, 0.0), 1.5)
    return intervals


def _drive_leg(stack: Stack, runner: Any, dashboard: Dashboard, leg: Leg, duration: float) -> None:
    """Drive ``leg`` for ``duration`` [s]; a transfer ends when the sand is reached."""
    pilot, end = runner.node, time.monotonic() + duration
    pilot.drive(leg.left, leg.right)
    while time.monotonic() < end:
        distance = max(map(abs, pilot.odometry.position))
        if leg.left == leg.right != 0.0 and distance > MIN_SAND_DISTANCE:
            return
        runner.spin(DASHBOARD_PERIOD)
        _check_alive(stack)
        dashboard.update(leg.name, pilot)


def _command() -> str:
    """Return the command of this program, with its path if it was started with one."""
    return sys.argv[0] if Path(sys.argv[0]).name == 'smart_tire' else 'smart_tire'


def _report(out: Path, summary: Tree) -> int:
    """Write and print the summary; return 1 if an expected topic has no messages."""
    from smart_tire.analysis.demo_report import lines
    (out / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n', encoding='utf-8')
    print('\n'.join(lines(summary)))
    print(f'\nbag, figures and summary.json are in {out}/; to see the run: '
          f'{_command()} view {out}')
    if summary['silent']:
        print(f'demo: no messages on {", ".join(summary["silent"])}', file=sys.stderr)
        return 1
    return 0
