# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire robot``: starts the nodes of a robot, most of them in one process."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
import os
import sys
import time

from smart_tire.cli._keyboard import StopRequest
from smart_tire.cli._stack import params_arguments, PORTS, SPIN_TIME, Stack
from smart_tire.errors import ParameterError
from smart_tire.launching import ENDED, respawn_delay, SEPARATE, STOP
from smart_tire.nodes.command_line import COMPOSED

SIMULATOR = 'robot_simulator'


def run(args: argparse.Namespace) -> int:
    """Run the nodes until SIGINT or SIGTERM; raise ParameterError if one is refused."""
    if find_spec('rclpy') is None:
        raise ModuleNotFoundError('no rclpy', name='rclpy')
    words = params_arguments(args.params)
    if words[0] in sys.argv:
        words += sys.argv[sys.argv.index(words[0]) + 1:]
    if args.simulated:
        words += ['-p', 'port:=simulated']
    with StopRequest() as stopped, Stack(None, os.environ) as stack:
        if args.simulated:
            ports = (f'ports.{name}:=simulated:{name}' for name in PORTS)
            stack.start(SIMULATOR, f'smart_tire.nodes.{SIMULATOR}', *words,
                        *(word for port in ports for word in ('-p', port)))
        Supervisor(stack, words).run(stopped)
    return 0


class Supervisor:
    """Starts the processes of a robot, and again when they die, with the waits of a launch."""

    def __init__(self, stack: Stack, words: list[str]) -> None:
        self._stack, self._words = stack, words  # ROS arguments
        self._waits = dict.fromkeys((COMPOSED, *SEPARATE), 0.0)  # s, before the latest start
        self._starts = dict.fromkeys(self._waits, time.monotonic())  # s, latest or next start

    def run(self, stopped: StopRequest) -> None:
        """Run until ``stopped``, or until all processes have ended by themselves."""
        for name in self._waits:
            self._start(name)
        while not stopped and self._waits:
            time.sleep(SPIN_TIME)
            for name, status in self._stack.died().items():
                del self._stack.processes[name]
                self._on_end(name, status)
            for name in self._waits.keys() - self._stack.processes.keys():
                if time.monotonic() >= self._starts[name]:
                    self._start(name, again=True)

    def _start(self, name: str, *, again: bool = False) -> None:
        stop = [f'{key}:={str(value).lower()}' for key, value in STOP.items()]
        self._stack.start(name, f'smart_tire.nodes.{name}', *self._words,
                          *(['-p', *stop] if again and name == 'motor_driver' else []))

    def _on_end(self, name: str, status: int) -> None:
        """Plan the next start of a process that died."""
        if name == SIMULATOR or status == ENDED[1]:
            raise ParameterError(f'{name} ended with status {status}')
        if status in ENDED:
            del self._waits[name]
            return
        now = time.monotonic()
        self._waits[name] = respawn_delay(self._waits[name], now - self._starts[name])
        self._starts[name] = now + self._waits[name]
        print(f'smart_tire robot: {name} died with status {status}, starts again in '
              f'{self._waits[name]:.0f} s', file=sys.stderr)
