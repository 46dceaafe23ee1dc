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
Live part of ``smart_tire calibrate``: guides the user through the steps and records them.

Each step becomes one bag in the folder ``--out``. With ``--drive`` the robot drives the steps
itself, otherwise the user does.
"""

from __future__ import annotations

import argparse
from functools import partial
import os
from pathlib import Path
import select
import signal
import sys
from typing import TYPE_CHECKING

from smart_tire.calibration.guide import (
    Action, Guide, INSTRUCTIONS, Key, Leg, LEGS, limited, reach)
from smart_tire.calibration.sequence import LIFTED
from smart_tire.cli._drive_session import Session
from smart_tire.cli._options import confirmed
from smart_tire.cli._outputs import refuse_existing_bag, remove_bag
from smart_tire.cli._stack import params_arguments, RECORDER, RobotError, Stack
from smart_tire.errors import ParameterError
from smart_tire.parameters import RobotParams
from smart_tire.samples import Sample

if TYPE_CHECKING:
    from smart_tire.nodes.pilot import Pilot

SPIN_TIME = 0.1          # s between two checks of keyboard and progress
INPUT_TIMEOUT = 10.0     # s until the first samples of IMU and wheels
KEYS_HELP = 'Enter: start or end the step, r: repeat, s: skip, q: quit'


def record_steps(args: argparse.Namespace, robot: RobotParams,
                 steps: list[str]) -> dict[str, list[Path]]:
    """
    Guide through ``steps`` and record them; return step -> bag of those recorded.

    Raises RobotError if there are no samples, or a process ends unexpectedly.
    """
    for step in steps:
        refuse_existing_bag(args.out / step, force=args.force)
    if args.drive:
        confirm_driving(steps, robot)
    # importing rclpy may restart Python, so it must come before any child is started
    from smart_tire.nodes.pilot import Pilot
    from smart_tire.nodes.runner import NodeRunner
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    args.out.mkdir(parents=True, exist_ok=True)
    sequence = Sequence(args.out, Guide(steps), robot, drive=args.drive)
    pilot = partial(Pilot, 'calibration_driver', sequence.on_sample)
    with (Stack(args.out / 'logs', os.environ) as stack,
          NodeRunner(pilot, params_arguments(args.params)) as runner):
        session = Session(stack, runner)
        with session.ending():
            sequence.run(session)
    return {step: [args.out / step] for step in sequence.guide.recorded}


def confirm_driving(steps: list[str], robot: RobotParams) -> None:
    """Announce the space that the robot needs; raise RobotError unless confirmed."""
    needed = max(reach(limited(LEGS[step], robot.wheel_radius), robot.wheel_radius,
                       robot.track_width) for step in steps if step != LIFTED)
    print(f'The robot will drive by itself, up to {needed:.1f} m from where it is, in all '
          'directions.\nKeep this space free, and the emergency stop at hand; Ctrl-C stops it.')
    if not confirmed():
        raise RobotError('driving was not confirmed: nothing was driven or recorded')


class TypedLines:
    """Lines typed on standard input, without waiting for them."""

    def __init__(self) -> None:
        self._pending = b''
        self._open = True

    def typed(self) -> list[Key]:
        """Return the requests typed since the last call, QUIT at the end of the input."""
        found: list[Key] = []
        while self._open and select.select([sys.stdin], [], [], 0.0)[0]:
            chunk = os.read(sys.stdin.fileno(), 4096)
            if not chunk:
                self._open = False
                return [*found, Key.QUIT]
            *lines, self._pending = (self._pending + chunk).split(b'\n')
            for line in lines:
                text = line.decode(errors='replace').strip().lower()
                if text in {key.value for key in Key}:
                    found.append(Key(text))
                else:
                    print(f'"{text}" is no command. {KEYS_HELP}')
        return found


class Sequence:
    """One run of the sequence: carries out the actions of the guide."""

    def __init__(self, folder: Path, guide: Guide, robot: RobotParams, *, drive: bool) -> None:
        self.guide = guide
        self._folder, self._robot, self._drive = folder, robot, drive
        self._actions: list[Action] = []
        self._seen: set[str] = set()
        self._recording = ''       # step that is recorded
        self._legs: list[Leg] = []  # still to drive
        self._leg_end_ns = 0
        self._shown = ''

    def on_sample(self, sample: Sample) -> None:
        """Take a sample of IMU or wheels."""
        self._seen.add(type(sample).__name__)
        # a driven step ends with its last leg, even if the guide has enough data earlier
        if self._drive and self.guide.watch is not None:
            self.guide.watch.take(sample)
        else:
            self._actions += self.guide.take(sample)

    def run(self, session: Session) -> None:
        """Carry out all steps."""
        session.wait(lambda: {'ImuSample', 'WheelSample'} <= self._seen, INPUT_TIMEOUT, RobotError(
            f'no messages on imu/data or wheel_states within {INPUT_TIMEOUT:.0f} s: start the '
            'drivers of the robot first'))
        if self._drive:
            _enable(session.pilot)
        keyboard, announced = TypedLines(), ''
        while True:
            self._carry_out(session)
            step = self.guide.step
            if step is None:
                return
            if step != announced:
                announced = step
                print(f'\nStep {self.guide.number}, {step}: {INSTRUCTIONS[step]}\n{KEYS_HELP}',
                      flush=True)
            for key in keyboard.typed():
                self._actions += self.guide.key(key)
                self._carry_out(session)
            session.spin(SPIN_TIME)
            self._drive_on(session.pilot)
            self._show()

    def _carry_out(self, session: Session) -> None:
        actions, self._actions = self._actions, []
        for action in actions:
            if action is Action.RECORD:
                self._start(session)
            else:
                self._end(session, keep=action is Action.KEEP)

    def _start(self, session: Session) -> None:
        step = self.guide.step
        assert step is not None
        remove_bag(self._folder / step)
        session.record(self._folder / step, ('imu/data', 'wheel_states'))
        self._recording = step
        self._actions.clear()
        self.guide.restart_watch()
        print('recording', flush=True)
        if self._drive:
            self._legs = limited(LEGS[step], self._robot.wheel_radius)
            self._leg_end_ns = 0

    def _end(self, session: Session, *, keep: bool) -> None:
        session.pilot.halt()
        self._legs = []
        session.stack.end(RECORDER)
        folder, self._recording = self._folder / self._recording, ''
        if keep:
            print(f'\nrecorded in {folder}')
        else:
            remove_bag(folder)
            print('\ndiscarded')

    def _drive_on(self, pilot: Pilot) -> None:
        """Command the next leg when the present one is over; end the step after the last one."""
        if not (self._drive and self._recording) or self._actions:
            return
        if pilot.emergency_stop:
            self._legs = []
            raise RobotError('emergency stop: the calibration has ended, nothing is driven')
        if pilot.steady_ns() < self._leg_end_ns:
            return
        if not self._legs:
            self._actions += self.guide.finish()
            return
        duration, left, right = self._legs.pop(0)
        self._leg_end_ns = pilot.steady_ns() + round(duration * 1e9)
        pilot.drive(left, right)

    def _show(self) -> None:
        progress = self.guide.progress
        if progress is None:
            return
        text = progress.text + (f'  ! {progress.warning}' if progress.warning else '')
        if text != self._shown:
            self._shown = text
            print(f'  {text}', flush=True)


def _enable(pilot: Pilot) -> None:
    """Create the publisher of commands; raise if none subscribes, or in an emergency stop."""
    if not pilot.listeners('cmd_vel'):
        raise ParameterError('--drive: no node subscribes to cmd_vel, start wheel_controller')
    if pilot.emergency_stop:
        raise RobotError('the emergency stop is active: release it first')
    pilot.enable()
