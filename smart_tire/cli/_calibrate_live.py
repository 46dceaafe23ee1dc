# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Live part of ``smart_tire calibrate``: guides through the steps, records and drives them."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
import os
from pathlib import Path
import select
import signal
import sys
from typing import Any

from smart_tire.calibration.guide import (
    Action, Guide, INSTRUCTIONS, Key, Leg, LEGS, limited, reach)
from smart_tire.calibration.sequence import LIFTED
from smart_tire.cli._options import confirmed, refuse_existing_bag, remove_bag
from smart_tire.cli._stack import params_arguments, Stack
from smart_tire.errors import ParameterError, SmartTireError
from smart_tire.parameters import RobotParams
from smart_tire.samples import Sample

SPIN_TIME = 0.1          # s between two looks at keyboard and progress
INPUT_TIMEOUT = 10.0     # s until the first samples of IMU and wheels
RECORDER_TIMEOUT = 15.0  # s until the recorder has subscribed to the wheels
RECORDED = 'recording /wheel_states', 'recording /imu/data'  # lines of the recorder
KEYS_HELP = 'Enter: start or end the step, r: repeat, s: skip, q: quit'


class CalibrationError(SmartTireError):
    """The guided sequence cannot continue."""


def record_steps(args: argparse.Namespace, robot: RobotParams,
                 steps: list[str]) -> dict[str, list[Path]]:
    """
    Guide through ``steps`` and record them; return step -> bag of those recorded.

    Raises CalibrationError if there are no samples, or a process ends unexpectedly.
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
    session = Session(args.out, Guide(steps), robot, drive=args.drive)
    pilot = partial(Pilot, 'calibration_driver', session.on_sample)
    with (Stack(args.out / 'logs', os.environ) as stack,
          NodeRunner(pilot, params_arguments(args.params)) as runner, driving_ends(runner)):
        session.run(stack, runner)
    return {step: [args.out / step] for step in session.guide.recorded}


@contextmanager
def driving_ends(runner: Any) -> Iterator[None]:
    """Command standstill at the end, however it comes: Ctrl-C, an error, or the last step."""
    try:
        yield
    finally:
        runner.node.halt()


def confirm_driving(steps: list[str], robot: RobotParams) -> None:
    """Announce the space that the robot needs; raise CalibrationError unless confirmed."""
    needed = max(reach(limited(LEGS[step], robot.wheel_radius), robot.wheel_radius,
                       robot.track_width) for step in steps if step != LIFTED)
    print(f'The robot will drive by itself, up to {needed:.1f} m from where it is, in all '
          'directions.\nKeep this space free, and the emergency stop at hand; Ctrl-C stops it.')
    if not confirmed():
        raise CalibrationError('driving was not confirmed: nothing was driven or recorded')


class Keyboard:
    """Lines typed on standard input, without waiting for them."""

    def __init__(self) -> None:
        self._pending = b''
        self._open = True

    def typed(self) -> list[Key]:
        """Return the requests typed since the last call; the end of the input is QUIT."""
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


class Session:
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
        # a driven step ends with its last leg, also if less would do
        if self._drive and self.guide.watch is not None:
            self.guide.watch.take(sample)
        else:
            self._actions += self.guide.take(sample)

    def run(self, stack: Stack, runner: Any) -> None:
        """Carry out all steps."""
        self._await_samples(runner)
        if self._drive:
            self._enable(runner)
        keyboard, announced = Keyboard(), ''
        while True:
            self._carry_out(stack, runner)
            step = self.guide.step
            if step is None:
                return
            if step != announced:
                announced = step
                print(f'\nStep {self.guide.number}, {step}: {INSTRUCTIONS[step]}\n{KEYS_HELP}',
                      flush=True)
            for key in keyboard.typed():
                self._actions += self.guide.key(key)
                self._carry_out(stack, runner)
            runner.spin(SPIN_TIME)
            self._drive_on(runner)
            self._show()
            self._check(stack)

    def _await_samples(self, runner: Any) -> None:
        end_ns = runner.node.steady_ns() + round(INPUT_TIMEOUT * 1e9)
        while {'ImuSample', 'WheelSample'} - self._seen:
            if runner.node.steady_ns() > end_ns:
                raise CalibrationError(
                    f'no messages on imu/data or wheel_states within {INPUT_TIMEOUT:.0f} s: start '
                    'the drivers of the robot first')
            runner.spin(SPIN_TIME)

    @staticmethod
    def _enable(runner: Any) -> None:
        if not runner.node.listeners('cmd_vel'):
            raise ParameterError('--drive: no node subscribes to cmd_vel, start wheel_controller')
        if runner.node.emergency_stop:
            raise CalibrationError('the emergency stop is active: release it first')
        runner.node.enable()

    def _carry_out(self, stack: Stack, runner: Any) -> None:
        actions, self._actions = self._actions, []
        for action in actions:
            if action is Action.RECORD:
                self._start(stack, runner)
            else:
                self._end(stack, runner, keep=action is Action.KEEP)

    def _start(self, stack: Stack, runner: Any) -> None:
        step = self.guide.step
        assert step is not None
        remove_bag(self._folder / step)
        stack.start('recorder', 'smart_tire.cli.main', 'record', '--out',
                    str(self._folder / step))
        end_ns = runner.node.steady_ns() + round(RECORDER_TIMEOUT * 1e9)
        while not all(line in stack.log('recorder') for line in RECORDED):
            self._check(stack)
            if runner.node.steady_ns() > end_ns:
                raise CalibrationError('the recorder does not receive imu/data and wheel_states:'
                                       f'\n{stack.tail("recorder")}')
            runner.spin(SPIN_TIME)
        self._recording = step
        self._actions.clear()
        self.guide.restart_watch()
        print('recording', flush=True)
        if self._drive:
            self._legs = limited(LEGS[step], self._robot.wheel_radius)
            self._leg_end_ns = 0

    def _end(self, stack: Stack, runner: Any, *, keep: bool) -> None:
        runner.node.halt()
        self._legs = []
        status = stack.stop('recorder')['recorder']
        del stack.processes['recorder']
        if status:
            raise CalibrationError(f'the recorder ended with status {status}')
        folder, self._recording = self._folder / self._recording, ''
        if keep:
            print(f'\nrecorded in {folder}')
        else:
            remove_bag(folder)
            print('\ndiscarded')

    def _drive_on(self, runner: Any) -> None:
        """Command the present leg; the step ends after the last one."""
        if not (self._drive and self._recording) or self._actions:
            return
        if runner.node.emergency_stop:
            self._legs = []
            raise CalibrationError('emergency stop: the calibration has ended, nothing is driven')
        if runner.node.steady_ns() < self._leg_end_ns:
            return
        if not self._legs:
            self._actions += self.guide.finish()
            return
        duration, left, right = self._legs.pop(0)
        self._leg_end_ns = runner.node.steady_ns() + round(duration * 1e9)
        runner.node.drive(left, right)

    def _show(self) -> None:
        progress = self.guide.progress
        if progress is None:
            return
        text = progress.text + (f'  ! {progress.warning}' if progress.warning else '')
        if text != self._shown:
            self._shown = text
            print(f'  {text}', flush=True)

    def _check(self, stack: Stack) -> None:
        for name, status in stack.died().items():
            raise CalibrationError(f'{name} ended with status {status}\n{stack.tail(name)}')
