"""A serial port that is opened, worked on in a thread, and opened again when it went away."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import errno
import os
import termios
import threading
import time
from typing import Any

import serial

from smart_tire.errors import LinkError

READ_TIMEOUT = 0.1        # s, how long a thread that waits for bytes does not see ``stop``
WRITE_TIMEOUT = 0.5       # s; a device that takes nothing for so long is as good as gone
BACK_OFF = (0.25, 2.0)    # s between attempts to open a port: the first one, and the most
CLOSE_TIMEOUT = 5.0       # s that the thread may take to end
LOST = (OSError, termios.error)  # how pyserial says that a port is gone

REASONS = {
    errno.ENOENT: 'there is no such port; is it plugged in?',
    errno.EACCES: 'no permission; is the user in the group of the port (dialout)?',
    errno.ENOTTY: 'it is no serial port; is the path right?',
    errno.EBUSY: 'it is busy; does another program use it?',
    errno.EAGAIN: 'it is busy; does another program use it?',
}


def open_port(url: str, baud_rate: int, timeout: float = READ_TIMEOUT) -> Any:
    """
    Return the open port, for this process alone and without bytes from the past.

    Raises LinkError if it is absent, busy, forbidden, or can not do the baud rate.
    """
    try:
        port = serial.serial_for_url(url, baudrate=baud_rate, timeout=timeout,
                                     write_timeout=WRITE_TIMEOUT, exclusive=True)
        port.reset_input_buffer()
    except (*LOST, ValueError) as error:
        raise LinkError(f'cannot open {url} at {baud_rate} baud: {_reason(error)}') from error
    return port


def _reason(error: Exception) -> str:
    # pyserial raises some of its errors, without a number, while it handles those of the system
    told = error.__context__ if isinstance(error.__context__, termios.error) else error
    number = told.args[0] if isinstance(told, termios.error) else getattr(told, 'errno', None)
    if number is None and 'exclusively lock' in str(error):  # pyserial gives no number here
        number = errno.EBUSY
    return REASONS.get(number or 0) or (os.strerror(number) if number else str(error))


def pump(port: Any, stopping: threading.Event, deliver: Callable[[bytes, int], None],
         clock: Callable[[], int] = time.time_ns) -> None:
    """Read until told to stop; deliver each chunk with the host's time at its last byte."""
    while not stopping.is_set():
        chunk = port.read(port.in_waiting or 1)
        if chunk:
            deliver(chunk, clock())


class SerialPort:
    """
    Keep a port open and ``work(port, stopping)`` going on it, in a thread of its own.

    ``work`` returns when ``stopping`` is set, or lets the port's error pass when the port went
    away. ``report`` gets a line whenever the port's state changes.
    """

    def __init__(self, url: str, baud_rate: int, work: Callable[[Any, threading.Event], None],
                 report: Callable[[str], None]) -> None:
        self._url, self._baud_rate = url, baud_rate
        self._work, self._report = work, report
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f'link {url}', daemon=True)
        self.problem = f'{url} is not open yet'  # '' while the port is open
        self.opened = 0   # times
        self.refused = 0  # attempts that failed

    def start(self) -> None:
        """Begin to open the port."""
        self._thread.start()

    def stop(self) -> None:
        """End the work, close the port, and return when both are done."""
        self._stopping.set()
        if self._thread.ident is not None:
            self._thread.join(CLOSE_TIMEOUT)

    def _run(self) -> None:
        wait, most = BACK_OFF
        while not self._stopping.is_set():
            try:
                port = open_port(self._url, self._baud_rate)
            except LinkError as error:
                self.refused += 1
                self._state(str(error))
                self._stopping.wait(wait)
                wait = min(2.0 * wait, most)
            else:
                self.opened += 1
                self._state('')
                self._use(port)
                wait = BACK_OFF[0]

    def _use(self, port: Any) -> None:
        try:
            self._work(port, self._stopping)
        except LOST as error:
            self._state(f'lost {self._url}: {_reason(error)}')
            self._stopping.wait(BACK_OFF[0])
        finally:
            with suppress(*LOST):  # it may be gone already, which is all that is wanted
                port.close()

    def _state(self, problem: str) -> None:
        if problem != self.problem:
            self.problem = problem
            self._report(problem or f'{self._url} is open')
