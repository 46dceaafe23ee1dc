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
Driving by keys that are held down: the keys, the commands they give, and requests to stop.

A terminal reports no release of a key, only its repetition while it is held: after half a second
(at most ``FIRST_HOLD``), then about 30 times a second. So a key is in force for ``FIRST_HOLD``
after it was pressed, and for ``REPEAT_HOLD`` after a repetition. The same key after a pause longer
than ``REPEAT_HOLD`` is a new press, which the first repetition often is.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
import math
import os
import re
import select
import signal
import termios
from typing import Any, TextIO

from smart_tire.errors import ParameterError


class DriveKey(Enum):
    """What a key asks for."""

    FORWARD = 'forward'
    BACKWARD = 'backward'
    LEFT = 'left'
    RIGHT = 'right'
    STOP = 'stop'
    FASTER = 'faster'
    SLOWER = 'slower'
    QUIT = 'quit'


CHARACTERS = {
    'w': DriveKey.FORWARD, 's': DriveKey.BACKWARD, 'a': DriveKey.LEFT, 'd': DriveKey.RIGHT,
    ' ': DriveKey.STOP, '+': DriveKey.FASTER, '=': DriveKey.FASTER, '-': DriveKey.SLOWER,
    '_': DriveKey.SLOWER, 'q': DriveKey.QUIT}
ARROWS = {'A': DriveKey.FORWARD, 'B': DriveKey.BACKWARD, 'C': DriveKey.RIGHT, 'D': DriveKey.LEFT}
# Control sequences of terminals: ESC [ parameters letter, or ESC O letter.
SEQUENCE = re.compile(r'\x1b(?:\[[0-9;?]*([@-~])|O([@-~]))')
INCOMPLETE = re.compile(r'\x1b(?:\[[0-9;?]*|O)?\Z')
INPUT_FLAGS, LOCAL_FLAGS, CONTROLS = 0, 3, 6  # items of termios.tcgetattr
FIRST_HOLD = 0.75    # s; the delay of the first repetition is 0.25 to 0.66 s by default
REPEAT_HOLD = 0.3    # s; the same key within this time is a repetition
ACCELERATION, BRAKING = 0.8, 1.6         # m/s2 of the commanded speed
YAW_ACCELERATION, YAW_BRAKING = 3.0, 6.0  # rad/s2 of the commanded yaw rate
YAW_RATE = 1.2       # rad/s, before it is changed by ``FASTER`` or ``SLOWER``
STEP_FACTOR = 1.1    # of speed and yaw rate, per key press
MIN_SCALE, MAX_SCALE = 0.2, 3.0  # of speed and yaw rate, relative to those at first
MAX_PERIOD = 0.1     # s between two steps; of a longer pause, the rest changes no command
DIRECTIONS = {DriveKey.FORWARD: 1.0, DriveKey.BACKWARD: -1.0, DriveKey.LEFT: 1.0,
              DriveKey.RIGHT: -1.0}
SPEED_KEYS = DriveKey.FORWARD, DriveKey.BACKWARD
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class KeyDecoder:
    """Bytes of a terminal to keys; a sequence may be split between two calls."""

    def __init__(self) -> None:
        self._pending = ''

    def decode(self, data: bytes) -> list[DriveKey]:
        """Return the keys in ``data``, in order; others are ignored."""
        text, keys = self._pending + data.decode('latin-1'), []
        self._pending = ''
        while text:
            if (found := SEQUENCE.match(text)) is not None:
                keys.append(ARROWS.get(found[1] or found[2]))
                text = text[found.end():]
            elif INCOMPLETE.match(text):
                self._pending, text = text, ''
            else:
                keys.append(CHARACTERS.get(text[0].lower()))
                text = text[1:]
        return [key for key in keys if key is not None]


class Keyboard:
    r"""
    Keys of the terminal ``stream``; a context manager, which restores the terminal.

    Ctrl-C remains an interrupt. Ctrl-Z, Ctrl-S and Ctrl-\ have no effect: a suspended program
    would leave the terminal without echo.
    """

    def __init__(self, stream: TextIO) -> None:
        """Raise ParameterError if ``stream`` is not a terminal."""
        if not stream.isatty():
            raise ParameterError('--keyboard: standard input is not a terminal')
        self._number = stream.fileno()
        self._decoder = KeyDecoder()
        self._saved: list[Any] | None = None

    def __enter__(self) -> Keyboard:
        self._saved = termios.tcgetattr(self._number)
        changed = termios.tcgetattr(self._number)
        changed[LOCAL_FLAGS] &= ~(termios.ICANON | termios.ECHO)
        changed[INPUT_FLAGS] &= ~termios.IXON
        for control, value in ((termios.VMIN, 1), (termios.VTIME, 0), (termios.VSUSP, b'\0'),
                               (termios.VQUIT, b'\0')):
            changed[CONTROLS][control] = value
        termios.tcsetattr(self._number, termios.TCSANOW, changed)
        return self

    def __exit__(self, *_: object) -> None:
        try:
            termios.tcflush(self._number, termios.TCIFLUSH)  # keys held are not for the shell
            termios.tcsetattr(self._number, termios.TCSANOW, self._saved or [])
        except termios.error:
            pass  # the terminal was closed

    def pressed(self) -> list[DriveKey]:
        """Return the keys since the last call; QUIT if the terminal was closed."""
        if not select.select([self._number], [], [], 0.0)[0]:
            return []
        try:
            data = os.read(self._number, 4096)
        except OSError:  # closed
            return [DriveKey.QUIT]
        return self._decoder.decode(data) if data else [DriveKey.QUIT]


@dataclass
class _Axis:
    """Speed or yaw rate: what is asked for, until when, and what is commanded now."""

    acceleration: float
    braking: float
    direction: float = 0.0  # -1, 0 or 1
    until: float = -math.inf  # s
    command: float = 0.0

    def step(self, size: float, time: float, period: float) -> None:
        """Move the command towards ``size`` in the direction asked for, or towards zero."""
        target = self.direction * size if time < self.until else 0.0
        slower = self.command * target < 0.0 or abs(target) < abs(self.command)
        reach = period * (self.braking if slower else self.acceleration)
        if self.command * target < 0.0:
            target = 0.0  # brakes before it reverses
        self.command += min(max(target - self.command, -reach), reach)


class Teleoperation:
    """
    Velocity command from the keys pressed; times are seconds of one steady clock.

    A key of the direction of travel acts as long as it is repeated. A key for turning also
    prolongs the speed, so that curves can be driven: a terminal repeats the latest key only. The
    space bar sets the command to zero at once, all other changes are ramps.
    """

    def __init__(self, speed: float) -> None:
        """Drive at ``speed`` [m/s] until another one is selected."""
        self._speed, self._scale = speed, 1.0
        self._travel = _Axis(ACCELERATION, BRAKING)
        self._turn = _Axis(YAW_ACCELERATION, YAW_BRAKING)
        self._latest: DriveKey | None = None
        self._latest_time = -math.inf  # s
        self._time = math.inf          # s, of the latest step; no acceleration before the first

    @property
    def limits(self) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] that the keys ask for."""
        return self._scale * self._speed, self._scale * YAW_RATE

    def press(self, key: DriveKey, time: float) -> None:
        """Take a key at ``time`` [s]."""
        repeated = key == self._latest and time - self._latest_time <= REPEAT_HOLD
        self._latest, self._latest_time = key, time
        if key is DriveKey.STOP:
            self.stop()
        elif key in (DriveKey.FASTER, DriveKey.SLOWER):
            factor = STEP_FACTOR if key is DriveKey.FASTER else 1.0 / STEP_FACTOR
            self._scale = min(max(self._scale * factor, MIN_SCALE), MAX_SCALE)
        elif key in DIRECTIONS:
            until = time + (REPEAT_HOLD if repeated else FIRST_HOLD)
            axis = self._travel if key in SPEED_KEYS else self._turn
            if axis is self._turn and time < self._travel.until:
                self._travel.until = max(self._travel.until, until)
            axis.direction, axis.until = DIRECTIONS[key], until

    def stop(self) -> None:
        """Command standstill at once, until the next key."""
        for axis in (self._travel, self._turn):
            axis.until, axis.command = -math.inf, 0.0

    def step(self, time: float) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] to command at ``time`` [s]."""
        period = min(max(time - self._time, 0.0), MAX_PERIOD)
        self._time = time
        for axis, size in zip((self._travel, self._turn), self.limits):
            axis.step(size, time, period)
        return self._travel.command, self._turn.command


class StopRequest:
    """
    Context manager that records SIGINT, SIGTERM and SIGHUP; true after the first one.

    SIGHUP comes when the terminal is closed: output is discarded from then on, since writing to a
    closed terminal is an error.
    """

    def __init__(self) -> None:
        self._received: list[int] = []
        self._previous: dict[signal.Signals, Any] = {}

    def __enter__(self) -> StopRequest:
        for number in SIGNALS:
            self._previous[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def __bool__(self) -> bool:
        return bool(self._received)

    def _on_signal(self, number: int, _: object) -> None:
        self._received.append(number)
        if number == signal.SIGHUP:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            for output in (1, 2):
                os.dup2(nowhere, output)
            os.close(nowhere)
