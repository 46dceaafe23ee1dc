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

"""
A sign of life of a verb that computes for long without output.

A timer signal is used and no thread, since some verbs fork processes for their work.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
import os
import signal
import sys
import threading
import time
from typing import Any, TextIO

PERIOD = 4.0  # s without output until a line, and between lines
ERASE_LINE = '\r\x1b[K'


class Heartbeat:
    """Writes the elapsed time to ``stream`` whenever PERIOD has passed without output."""

    def __init__(self, what: str, stream: TextIO) -> None:
        self._what, self._number = what, stream.fileno()
        self._on_terminal = stream.isatty()
        self._start = time.monotonic()
        self._shown = False  # a line on the terminal, to be erased

    def beat(self) -> None:
        """Write a line; on a terminal, in place of the previous one."""
        text = f'{self._what}: working, {time.monotonic() - self._start:.0f} s'
        self._write(f'{ERASE_LINE}{text}' if self._on_terminal else f'{text}\n')
        self._shown = self._on_terminal

    def before_output(self) -> None:
        """Erase the line, and restart the time without output."""
        if self._shown:
            self._shown = False
            self._write(ERASE_LINE)
        signal.setitimer(signal.ITIMER_REAL, PERIOD, PERIOD)

    def _write(self, text: str) -> None:
        os.write(self._number, text.encode())  # a signal handler must not use a buffered stream


class WatchedOutput:
    """An output stream that reports each write to a heartbeat before it is done."""

    def __init__(self, stream: TextIO, heartbeat: Heartbeat) -> None:
        self._stream, self._heartbeat = stream, heartbeat

    def write(self, text: str) -> int:
        """Write ``text``."""
        self._heartbeat.before_output()
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def heartbeat(what: str) -> Iterator[None]:
    """Report on standard error that ``what`` is working, whenever it is silent for PERIOD."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are handled by the main thread only
        return
    pulse = Heartbeat(what, sys.__stderr__ or sys.stderr)
    previous = signal.signal(signal.SIGALRM, lambda *_: pulse.beat())
    output: Any = WatchedOutput(sys.stdout, pulse)
    try:
        with redirect_stdout(output):
            pulse.before_output()
            yield
    finally:
        pulse.before_output()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)
