# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire drive``: drives a simulated or a running robot along a path or by the keyboard."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
import json
import os
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from smart_tire.cli._keyboard import Keyboard, StopRequest
from smart_tire.cli._options import confirmed
from smart_tire.cli._outputs import (
    lock, refuse_existing, refuse_existing_bag, remove, remove_bag)
from smart_tire.cli._stack import NODES
from smart_tire.errors import ParameterError

if TYPE_CHECKING:
    from smart_tire.cli._drive_session import Session
    from smart_tire.cli._path_file import Poses

KEYBOARD_SPEED = 0.3   # m/s
FILES = ('drive.yaml', 'summary.json', 'path.png')
ARRIVED, NOT_ARRIVED, INTERRUPTED = 0, 1, 130  # exit statuses
CANCEL = 'ros2 service call /cancel_path std_srvs/srv/Trigger'


def run(args: argparse.Namespace) -> int:
    """
    Drive, evaluate the recording.

    Return 0 if the end was reached or the keyboard was left, 1 if the path was refused or the
    robot stopped before its end, 130 if a signal ended it.
    """
    poses = _checked(args)
    if args.view:
        import_module('smart_tire.view.viewer')  # raises if rerun is not installed
    # Importing rclpy may restart Python, so it must come before any child and any output.
    from smart_tire.nodes.pilot import Pilot
    _announce(args, poses)
    _remove_results(args.out)
    pilot, status = partial(Pilot, f'smart_tire_drive_{os.getpid()}'), ARRIVED
    with StopRequest() as stopped, _session(args, pilot, stopped) as session, session.ending():
        if poses:
            status = _follow(args, session, poses)
        else:
            _teleoperate(args, session)
    _report(args)
    return status


def _checked(args: argparse.Namespace) -> Poses:
    """Return the path, empty for the keyboard; raise ParameterError for a wrong argument."""
    from smart_tire.cli._path_file import read_plan
    if args.keyboard:
        Keyboard(sys.stdin)  # raises if it is not a terminal
        if args.absolute or args.scale != 1.0:
            raise ParameterError('--absolute and --scale are for --path')
    elif args.robot and args.speed is not None:
        raise ParameterError('--speed: the speed along a path is a parameter of the running robot:'
                             ' ros2 param set /trajectory_controller max_speed V')
    if args.robot and args.params:
        raise ParameterError('--params is for the simulated robot; the running one has parameters')
    poses = () if args.keyboard else read_plan(args.path, args.scale)
    refuse_existing_bag(args.out / 'bag', force=args.force)
    refuse_existing([args.out / name for name in FILES], force=args.force,
                    inputs=[*args.params, *([] if args.keyboard else [Path(args.path)])])
    return poses


def _announce(args: argparse.Namespace, poses: Poses) -> None:
    """Print what will be done; raise ParameterError unless driving a robot is confirmed."""
    from smart_tire.cli._path_file import extent, length
    if not args.robot:
        print(f'starting {len(NODES)} nodes and a recorder', flush=True)
        return
    if not poses:
        print('The running robot will drive while keys are held. Keep its surroundings free, and '
              'the emergency stop at hand.', flush=True)
        return
    place = 'where the path is in odom' if args.absolute else 'its present pose'
    print(f'The running robot will follow {args.path}, {length(poses):.1f} m long, up to '
          f'{extent(poses):.1f} m from {place}.\nKeep this space free, and the emergency stop at '
          'hand; Ctrl-C stops the robot, and so does closing this terminal.\nIf this program is '
          f'killed by SIGKILL, the robot drives on to the end of the path: {CANCEL}')
    if not confirmed():
        raise ParameterError('driving was not confirmed: nothing was driven')


def _remove_results(out: Path) -> None:
    """Delete the results of an earlier drive."""
    from smart_tire.cli._stack import remove_traces
    lock(out)
    remove_bag(out / 'bag')
    remove_traces(out)
    remove(out, FILES, keep=True)  # it is locked


@contextmanager
def _session(args: argparse.Namespace, pilot: Callable[[], Any],
             stopped: StopRequest) -> Iterator[Session]:
    """Start the nodes unless the robot runs, and the recorder; stop all at the end."""
    from smart_tire.cli._drive_session import FOLLOWER, RECORDED, RECORDED_REST, started
    from smart_tire.cli._stack import write_parameters
    params = [] if args.robot else [
        write_parameters(args.out, FILES[0], args.seed, {}), *args.params]
    speed = ('-p', f'max_speed:={float(args.speed)}') if args.speed and args.path else ()
    with started(args.out, params, pilot, stopped, simulated=not args.robot,
                 arguments={FOLLOWER: speed}) as session:
        if args.path:
            session.pilot.enable_path()
            session.await_robot('path', FOLLOWER)
        else:
            session.await_robot('cmd_vel', 'wheel_controller')
            session.refuse_other_driver()
        for text in session.clock_warnings() if args.robot else ():
            print(f'smart_tire drive: {text}', file=sys.stderr)
        if args.view:
            session.stack.start_viewer(*(word for file in params
                                         for word in ('--params', str(file))))
        session.record(args.out / 'bag', ('odom',) if args.robot else RECORDED)
        session.wait(lambda: False, RECORDED_REST)
        yield session


def _follow(args: argparse.Namespace, session: Session, poses: Poses) -> int:
    """Follow the path; return the exit status."""
    from smart_tire.cli._dashboard import Dashboard
    from smart_tire.cli._path_file import placed
    from smart_tire.control.trajectory_control import PathState
    try:
        with Dashboard() as dashboard:
            state = session.follow(Path(args.path).name, poses if args.absolute else placed(
                poses, session.start_pose()), dashboard)
    except KeyboardInterrupt:
        print('interrupted: the path is canceled', file=sys.stderr)
        return INTERRUPTED
    if state != PathState.ARRIVED:
        print(f'smart_tire drive: {state.name.lower()}: {session.reason(state)}', file=sys.stderr)
    return ARRIVED if state == PathState.ARRIVED else NOT_ARRIVED


def _teleoperate(args: argparse.Namespace, session: Session) -> None:
    """Drive by the keyboard until it is left."""
    from smart_tire.cli._keyboard import Teleoperation
    try:
        with Keyboard(sys.stdin) as keyboard:
            session.teleoperate(keyboard, Teleoperation(args.speed or KEYBOARD_SPEED))
    except KeyboardInterrupt:
        pass  # Ctrl-C is as good as q


def _report(args: argparse.Namespace) -> None:
    """Evaluate the recording; write and print the summary."""
    from smart_tire.analysis.drive_report import drive_lines, evaluate_drive
    from smart_tire.analysis.driven_paths import load_grounds
    name = Path(args.path).name if args.path else 'keyboard'
    grounds = None if args.robot else load_grounds([args.out / FILES[0], *args.params])
    summary = evaluate_drive(args.out / 'bag', name, args.out / 'path.png', grounds)
    (args.out / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n', encoding='utf-8')
    print('\n'.join(drive_lines(summary)))
    print(f'bag, path.png and summary.json are in {args.out}/')
