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

"""Keys typed on a terminal, without waiting for them and without echo."""

from __future__ import annotations

from enum import Enum
import os
import re
import select
import termios
from types import TracebackType
from typing import Any, TextIO

from smart_tire.errors import ParameterError


class Key(Enum):
    """What a key asks for."""

    FORWARD = 'forward'
    BACKWARD = 'backward'
    LEFT = 'left'
    RIGHT = 'right'
    STOP = 'stop'
    FASTER = 'faster'
    SLOWER = 'slower'
    QUIT = 'quit'


CHARACTERS = {'w': Key.FORWARD, 's': Key.BACKWARD, 'a': Key.LEFT, 'd': Key.RIGHT, ' ': Key.STOP,
              '+': Key.FASTER, '=': Key.FASTER, '-': Key.SLOWER, '_': Key.SLOWER, 'q': Key.QUIT}
ARROWS = {'A': Key.FORWARD, 'B': Key.BACKWARD, 'C': Key.RIGHT, 'D': Key.LEFT}
# Control sequences of terminals: ESC [ parameters letter, or ESC O letter.
SEQUENCE = re.compile(r'\x1b(?:\[[0-9;?]*([@-~])|O([@-~]))')
INCOMPLETE = re.compile(r'\x1b(?:\[[0-9;?]*|O)?\Z')
INPUT_FLAGS, LOCAL_FLAGS, CONTROLS = 0, 3, 6  # items of termios.tcgetattr


class KeyDecoder:
    """Bytes of a terminal to keys; a sequence may be split between two calls."""

    def __init__(self) -> None:
        self._pending = ''

    def feed(self, data: bytes) -> list[Key]:
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

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        try:
            termios.tcflush(self._number, termios.TCIFLUSH)  # keys held are not for the shell
            termios.tcsetattr(self._number, termios.TCSANOW, self._saved or [])
        except termios.error:
            pass  # the terminal was closed

    def pressed(self) -> list[Key]:
        """Return the keys since the last call; QUIT if the terminal was closed."""
        if not select.select([self._number], [], [], 0.0)[0]:
            return []
        try:
            data = os.read(self._number, 4096)
        except OSError:  # closed
            return [Key.QUIT]
        return self._decoder.feed(data) if data else [Key.QUIT]
