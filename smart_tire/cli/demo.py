# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire demo``: run the full stack on the simulated robot, compare it with ground truth."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
import json
import math
from pathlib import Path
import signal
import sys
from typing import Any, TYPE_CHECKING

from smart_tire.cli._outputs import (
    FIGURES, lock, refuse_existing, refuse_existing_bag, remove, remove_bag,
    undone_if_interrupted)
from smart_tire.cli._progress import ProgressLine
from smart_tire.cli._stack import NODES, remove_traces, RobotError, write_parameters
from smart_tire.drivers.clock import SYSTEM
from smart_tire.launching import CAMERA

if TYPE_CHECKING:
    from smart_tire.analysis.summary import Tree
    from smart_tire.cli._dashboard import Dashboard
    from smart_tire.cli._drive_session import Session
    from smart_tire.cli._path_file import Poses

Legs = dict[str, list[tuple[int, int]]]  # name -> time intervals [ns]


FAST_SPEED, SLOW_SPEED = 120.0, 60.0  # rpm, paper B Fig. 10
LEG_DURATION = 9.0            # s of each turn
SETTLING_TIME = 1.0           # s at the start of a leg that are excluded from its means
STANDSTILL_DURATION = 2.5     # s before the first leg
BRAKING_TIME = 0.5            # s in which standstill is commanded after the last leg
HANDOVER_TIME = 1.6           # s until wheel_controller accepts another source of commands
MIN_SAND_DISTANCE = 6.2       # m from the origin in x or y: two circles from there stay on sand
MAX_TRANSFER_DURATION = 30.0  # s; about 7
BORDER = 3.0                  # m, half the side of the concrete square of the simulator
EIGHT_RADIUS = 0.5            # m
PATH_SPEED = 0.7              # m/s, on straight parts
TO_BORDER, EIGHT = 'to the border', 'figure-eight'
DASHBOARD_PERIOD = 0.25       # s between two updates
EXPECTED_TOPICS = (
    'imu/data', 'wheel_states', 'tire_samples', 'tire_battery', 'odom', 'wheel_slip', 'icr',
    'ground_state', 'tire_friction', 'cmd_vel', 'wheel_commands', 'motor_commands',
    'path_progress', 'ground_truth/odom', 'ground_truth/wheel_slip', 'ground_truth/tire_friction',
    '/diagnostics')
CAMERA_TOPICS = (
    'overhead_camera/image_raw/compressed', 'overhead_camera/camera_info', 'overhead/odom',
    'overhead/wheel_slip')
PLACE = 1.5, -2.0, 4.5        # m, of the camera: above the circles on concrete and the border
WITH_CAMERA: dict[str, dict[str, Any]] = {  # parameters; the tag is as large as the robot permits
    '/**': {'overhead.tag_size': 0.22, 'overhead.camera_position': [*PLACE],
            'overhead.camera_rotation': [math.pi, 0.0, 0.0]},
    'overhead_camera_simulator': {
        'image.position': [*PLACE], 'image.focal_length': 680.0, 'image.rate': 10.0,
        'image.jpeg_quality': 60}}
PATH_TOPICS = ('path',)  # expected only if a path is followed
FILES = ('demo.yaml', 'conversions.csv', 'summary.json')


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


def run(args: argparse.Namespace) -> int:
    """Run the demo; return 0 if no node failed, no topic stayed silent and the robot arrived."""
    out: Path = args.out
    lock(out)
    refuse_existing_bag(out / 'bag', force=args.force)
    refuse_existing([out / name for name in (*FILES, 'figures', 'logs')], force=args.force)
    if args.view:
        import_module('smart_tire.view.viewer')  # is it installed?
    # Importing rclpy may restart Python, so it must come before any child and any output.
    from smart_tire.nodes.pilot import Pilot
    nodes = (*NODES, *CAMERA) if args.camera else NODES
    print(f'starting {len(nodes)} nodes and a recorder', flush=True)
    from smart_tire.analysis.drive_report import evaluate_demo
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with undone_if_interrupted(partial(_remove, out)):
        params = _prepare(out, args.seed, camera=args.camera)
        intervals = _drive(out, params, partial(Pilot, 'demo_driver'), nodes, view=args.view)
        print('evaluating the recording', flush=True)
        with ProgressLine('smart_tire demo'):
            summary = evaluate_demo(
                out / 'bag', params, intervals, (
                    *EXPECTED_TOPICS, *PATH_TOPICS, *(CAMERA_TOPICS if args.camera else ())),
                out / 'conversions.csv', out / 'figures', (TO_BORDER, EIGHT))
        return _report(out, summary)


def _remove(out: Path) -> None:
    """Delete the results of a demo."""
    remove_bag(out / 'bag')
    remove(out / 'figures', FIGURES)
    remove_traces(out)
    remove(out, FILES, keep=True)  # it is locked


def _prepare(out: Path, seed: int, *, camera: bool = False) -> Path:
    """Delete the results of an earlier demo and write the parameter file."""
    _remove(out)
    return write_parameters(out, FILES[0], seed, {
        'robot_simulator': {'truth_log': str((out / 'conversions.csv').resolve())},
        'wheel_controller': {'traction.enabled': False},
        'trajectory_controller': {'max_speed': PATH_SPEED}, **(WITH_CAMERA if camera else {})})


def _drive(out: Path, params: Path, pilot: Callable[[], Any], nodes: Sequence[str], *,
           view: bool) -> Legs:
    """Drive both acts and record them; return the time intervals of the legs."""
    # before the robot, which waits for this program
    from smart_tire.cli._dashboard import Dashboard
    from smart_tire.cli._drive_session import RECORDED, started
    from smart_tire.control.path_library import figure_eight
    eight = figure_eight(EIGHT_RADIUS).poses
    with started(out, [params], pilot, nodes=nodes) as session:
        if view:
            session.stack.start_viewer('--params', str(params))
        session.pilot.enable_path()
        session.record(out / 'bag', RECORDED)
        with Dashboard() as dashboard:
            intervals = _drive_legs(session, dashboard)
            _drive_paths(session, dashboard, eight)
    return intervals


def _drive_legs(session: Session, dashboard: Dashboard) -> Legs:
    """Drive by wheel speeds; return the time intervals of the legs."""
    intervals: Legs = {}
    _drive_leg(session, dashboard, Leg('standstill', 0.0, 0.0), STANDSTILL_DURATION)
    for leg in LEGS:
        begin = session.pilot.now_ns()
        duration = LEG_DURATION if leg.evaluated else MAX_TRANSFER_DURATION
        _drive_leg(session, dashboard, leg, duration)
        if leg.evaluated:
            intervals[leg.name] = [(begin + round(SETTLING_TIME * 1e9), session.pilot.now_ns())]
    _drive_leg(session, dashboard, Leg('standstill', 0.0, 0.0), BRAKING_TIME)
    session.pilot.release()
    _spin(session, dashboard, 'standstill', HANDOVER_TIME)
    return intervals


def _drive_leg(session: Session, dashboard: Dashboard, leg: Leg, duration: float) -> None:
    """Drive ``leg`` for ``duration`` [s]; a transfer ends when the sand is reached."""
    pilot = session.pilot

    def reached() -> bool:
        return (leg.left == leg.right != 0.0
                and max(map(abs, pilot.odometry.position)) > MIN_SAND_DISTANCE)

    pilot.drive(leg.left, leg.right)
    _spin(session, dashboard, leg.name, duration, reached)


def _spin(session: Session, dashboard: Dashboard, name: str, duration: float,
          ended: Callable[[], bool] = lambda: False) -> None:
    """Show messages for ``duration`` [s], or until the interval has ``ended``."""
    end = SYSTEM.now() + duration
    while SYSTEM.now() < end and not ended():
        session.spin(DASHBOARD_PERIOD)
        dashboard.show(name, session.pilot)


def _drive_paths(session: Session, dashboard: Dashboard, eight: Poses) -> None:
    """Drive with the trajectory controller: to the border of both grounds, then an eight."""
    from smart_tire.cli._path_file import placed
    session.await_standstill()
    x, y, _ = session.start_pose()
    to_border = (x, y, math.nan), (*border_point(x, y), math.nan)
    if _follow(session, TO_BORDER, to_border, dashboard):
        session.await_standstill()
        _follow(session, EIGHT, placed(eight, session.start_pose()), dashboard)


def _follow(session: Session, name: str, poses: Poses, dashboard: Dashboard) -> bool:
    """Follow a path; return whether its end was reached, else print why not."""
    from smart_tire.control.trajectory_control import PathState
    state = session.follow(name, poses, dashboard)
    if state != PathState.ARRIVED:
        print(f'demo: {name}: {state.name.lower()}: {session.reason(state)}', file=sys.stderr)
    return state == PathState.ARRIVED


def border_point(x: float, y: float) -> tuple[float, float]:
    """
    Return where to cross the border of the concrete square, coming straight from (x, y).

    Raises RobotError inside the square.

    The figure-eight begins there in the direction of travel, and its first loop is to the left of
    this direction by 45 degrees: that is where the middle of the square should be.
    """
    def error(point: tuple[float, float]) -> float:
        to_point = math.atan2(point[1] - y, point[0] - x)
        to_middle = math.atan2(-point[1], -point[0])
        return abs(math.remainder(to_middle - to_point - 0.25 * math.pi, math.tau))

    places = [BORDER * step / 50.0 for step in range(-50, 51)]
    sides = [((x > 0.0) - (x < 0.0), 0), (0, (y > 0.0) - (y < 0.0))]
    points = [(side_x * BORDER or place, side_y * BORDER or place)
              for side_x, side_y in sides if abs(x if side_x else y) > BORDER for place in places]
    if not points:
        raise RobotError(f'the robot is at ({x:.1f}, {y:.1f}) m, it should be on the sand')
    return min(points, key=error)


def _command() -> str:
    """Return the command of this program, with its path if it was started with one."""
    return sys.argv[0] if Path(sys.argv[0]).name == 'smart_tire' else 'smart_tire'


def _report(out: Path, summary: Tree) -> int:
    """Write and print the summary; return 1 for a silent topic or a path not driven."""
    from smart_tire.analysis.drive_report import demo_lines, host_lines
    (out / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n', encoding='utf-8')
    print('\n'.join(demo_lines(summary)))
    print(f'\nbag, figures and summary.json are in {out}/; to see the run: '
          f'{_command()} report {out}, or view {out}')
    if summary['silent']:
        print(f'demo: no messages on {", ".join(summary["silent"])}', file=sys.stderr)
        return 1
    if unfinished := [name for name in (TO_BORDER, EIGHT)
                      if summary['tracking'].get(name, {}).get('state') != 'arrived']:
        problems = [*host_lines(summary),
                    f'the robot did not arrive: {", ".join(unfinished)}']
        print(f'demo: {"; ".join(problems)}', file=sys.stderr)
        return 1
    return 0
