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
What a verb is doing, in one line on standard error.

On a terminal the line is replaced, and erased before other output and at the end. Otherwise it is
printed whenever ``PERIOD`` has passed without output.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, redirect_stdout
from multiprocessing import parent_process
import os
import signal
import sys
import threading
import time
from typing import Any, TextIO

PERIOD = 4.0  # s without output until a line, and between lines
MINUTES_FROM = 120.0  # s
DEFAULT_WIDTH = 80  # characters, of a terminal that does not know its own
ERASE_LINE = '\r\x1b[K'


class ProgressLine:
    """
    Shows the latest text, or that ``what`` is working; a context manager.

    With ``timer`` a line also appears while ``show`` is not called, by a timer signal: threads
    would end in the verbs that fork, and rclpy should not be interrupted.
    """

    def __init__(self, what: str = '', *, timer: bool = True, stream: TextIO | None = None,
                 clock: Callable[[], float] = time.monotonic) -> None:
        stream = stream or sys.__stderr__ or sys.stderr
        self._what, self._clock = what, clock  # clock in s
        self._number, self._on_terminal = stream.fileno(), stream.isatty()
        self._silent = parent_process() is not None  # which shows how many bags are done
        # signals are handled by the main thread only
        self._timer = timer and not self._silent and (
            threading.current_thread() is threading.main_thread())
        self._start = self._latest = clock()
        self._text, self._shown = '', False
        self._stack = ExitStack()

    def __enter__(self) -> ProgressLine:
        if self._timer:
            handler = signal.signal(signal.SIGALRM, lambda *_: self.beat())
            self._stack.callback(signal.signal, signal.SIGALRM, handler)
            before = signal.setitimer(signal.ITIMER_REAL, PERIOD, PERIOD)
            self._stack.callback(signal.setitimer, signal.ITIMER_REAL, *before)
        output: Any = _Watched(sys.stdout, self)
        self._stack.enter_context(redirect_stdout(output))
        return self

    def __exit__(self, *_: object) -> None:
        self.before_output()
        self._stack.close()

    def show(self, text: str) -> None:
        """Show ``text`` until the next call."""
        self._text = text
        if self._on_terminal or self._clock() >= self._latest + PERIOD:
            self.beat()

    def share(self, share: float) -> None:
        """Show the completed share, 0 to 1."""
        self.show(f'{share:.0%}')

    def beat(self) -> None:
        """Write the line; on a terminal, in place of the previous one."""
        if self._silent:
            return
        self._latest = self._clock()
        text = self._text or f'working, {self._latest - self._start:.0f} s'
        text = f'{self._what}: {text}' if self._what else text
        if self._on_terminal:  # log lines of ROS begin in the first column
            width = os.get_terminal_size(self._number).columns or DEFAULT_WIDTH
            text = f'{ERASE_LINE}{text[:width - 1]}\r'
        self._write(text if self._on_terminal else f'{text}\n')
        self._shown = self._on_terminal

    def before_output(self) -> None:
        """Erase the line, and restart the time without output."""
        if self._shown:
            self._shown = False
            self._write(ERASE_LINE)
        self._latest = self._clock()
        if self._timer:
            signal.setitimer(signal.ITIMER_REAL, PERIOD, PERIOD)

    def _write(self, text: str) -> None:
        os.write(self._number, text.encode())  # a signal handler must not use a buffered stream


class _Watched:
    """An output stream before each write to which the line is erased."""

    def __init__(self, stream: TextIO, progress: ProgressLine) -> None:
        self._stream, self._progress = stream, progress

    def write(self, text: str) -> int:
        """Write ``text``."""
        self._progress.before_output()
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def remaining(done: int, total: int, seconds: float) -> str:
    """Return how many of ``total`` are ``done`` after ``seconds``, and the time that is left."""
    if not done:
        return f'0 of {total}'
    left = seconds * (total - done) / done
    return f'{done} of {total}, ' + (
        f'{left:.0f} s left' if left < MINUTES_FROM else f'{left / 60.0:.0f} min left')


class Rate:
    """Rate of a growing number, between two calls of ``since``."""

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None

    def since(self, value: float, time: float) -> float | None:
        """Return the rate [1/s] since the previous call, None at the first one."""
        last, self._last = self._last, (value, time)
        return None if last is None or time <= last[1] else (value - last[0]) / (time - last[1])
