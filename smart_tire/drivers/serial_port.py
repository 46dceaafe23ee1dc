# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Serial ports: a port with its own thread that is reopened when the connection is lost."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import errno
import os
import re
import termios
import threading
from typing import Any

import serial

from smart_tire.drivers.clock import Clock, SYSTEM
from smart_tire.drivers.simulated_time import VARIABLE
from smart_tire.errors import LinkError
from smart_tire.paths import owned_terminal, SIMULATED

READ_TIMEOUT = 0.1      # s, bounds the time to notice ``stop`` while waiting for bytes
WRITE_TIMEOUT = 0.5     # s; a device that accepts no bytes for this long counts as lost
RETRY_DELAY = 0.25      # s between attempts to open a port; a failed one costs 10 us of CPU
CLOSE_TIMEOUT = 5.0     # s for the thread to end
PSEUDO_TERMINALS = '/dev/pts/'
PORT_ERRORS = (OSError, termios.error)  # raised by pyserial when a port is lost
URL_ERRORS = (ValueError, KeyError, TypeError, re.error)  # by pyserial for an invalid URL

REASONS = {
    errno.ENOENT: 'there is no such port; is it plugged in?',
    errno.EACCES: 'no permission; is the user in the group of the port (dialout)?',
    errno.ENOTTY: 'it is not a serial port; is the path right?',
    errno.EBUSY: 'it is busy; does another program use it?',
    errno.EAGAIN: 'it is busy; does another program use it?',
}


def open_port(url: str, baud_rate: int, timeout: float = READ_TIMEOUT) -> Any:
    """
    Return the port, opened exclusively and with an empty input buffer.

    With the scheme ``simulated:`` (``paths.port_url``) a real device is never opened. Raises
    LinkError if it is absent, busy, not permitted, or does not support the baud rate.
    """
    path = url
    if url.startswith(SIMULATED):
        path = owned_terminal(url.removeprefix(SIMULATED))
        if not path.startswith(PSEUDO_TERMINALS):
            raise LinkError(f'cannot open {url.removeprefix(SIMULATED)}: '
                            'no simulator of this namespace and ROS domain runs')
    if SYSTEM.simulated is not None and os.path.exists(path) and not os.path.realpath(
            path).startswith(PSEUDO_TERMINALS):  # time-outs of a real robot need the real time
        raise LinkError(f'cannot open {url}: {VARIABLE} is set, for a simulated robot only')
    try:
        port = serial.serial_for_url(path, baudrate=baud_rate, timeout=timeout,
                                     write_timeout=WRITE_TIMEOUT, exclusive=True)
        port.reset_input_buffer()
    except (*PORT_ERRORS, *URL_ERRORS) as error:
        raise LinkError(f'cannot open {url} at {baud_rate} baud: {_reason(error)}') from error
    return port


def _reason(error: Exception) -> str:
    # pyserial raises some of its errors, without a number, while it handles a system error.
    cause = error.__context__ if isinstance(error.__context__, termios.error) else error
    number = cause.args[0] if isinstance(cause, termios.error) else getattr(cause, 'errno', None)
    if number is None and 'exclusively lock' in str(error):  # pyserial sets no number here
        number = errno.EBUSY
    return REASONS.get(number or 0) or (os.strerror(number) if number else str(error))


def read_loop(port: Any, stopping: threading.Event, deliver: Callable[[bytes, int], None],
              clock: Clock = SYSTEM) -> None:
    """Read until ``stopping`` is set; deliver each chunk with the host time of its last byte."""
    while not stopping.is_set():
        chunk = port.read(port.in_waiting or 1)
        if chunk:
            deliver(chunk, clock.time_ns())


class SerialPort:
    """
    Keeps a port open and runs ``work(port, stopping)`` on it, in its own thread.

    ``work`` returns when ``stopping`` is set; it does not catch the errors of a lost port.
    ``report`` is called with one line of text when the state of the port changes.
    """

    def __init__(self, url: str, baud_rate: int, work: Callable[[Any, threading.Event], None],
                 report: Callable[[str], None], clock: Clock = SYSTEM) -> None:
        self._url, self._baud_rate = url, baud_rate
        self._work, self._report, self._clock = work, report, clock
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f'port {url}', daemon=True)
        self.problem = f'{url} is not open yet'  # '' while the port is open
        self.opened = 0   # successful attempts to open the port
        self.refused = 0  # failed attempts

    def start(self) -> None:
        """Start the thread, which opens the port."""
        self._thread.start()

    def stop(self) -> None:
        """End the work, close the port and end the thread."""
        self._stopping.set()
        if self._thread.ident is not None:
            self._thread.join(CLOSE_TIMEOUT)

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                port = open_port(self._url, self._baud_rate)
            except LinkError as error:
                self.refused += 1
                self._set_problem(str(error))
                self._clock.wait(self._stopping, RETRY_DELAY)
            else:
                self.opened += 1
                self._set_problem('')
                self._use(port)
        self._clock.act(None)

    def _use(self, port: Any) -> None:
        try:
            self._work(port, self._stopping)
        except PORT_ERRORS as error:
            self._set_problem(f'lost {self._url}: {_reason(error)}')
            self._clock.wait(self._stopping, RETRY_DELAY)
        finally:
            with suppress(*PORT_ERRORS):  # the port may be lost already
                port.close()

    def _set_problem(self, problem: str) -> None:
        if problem != self.problem:
            self.problem = problem
            self._report(problem or f'{self._url} is open')
