"""What the drivers share: a link with its thread, and what to say about both."""

from __future__ import annotations

from collections.abc import Callable
import math
import threading
import time
from typing import Any, Protocol, TypeVar

from smart_tire.drivers.serial_port import SerialPort
from smart_tire.nodes.base import SILENCE, SmartTireNode
from smart_tire.nodes.diagnostics import Status
from smart_tire.samples import NS_PER_S

Params = TypeVar('Params')
PORT_GRACE_NS = 2 * NS_PER_S  # that a port may be away without a line: a simulator starts in 1 s
PORT_LOOK = 0.2               # s between looks whether that has passed


class Source(Protocol):
    """What turns bytes into samples, and counts."""

    @property
    def frames_ok(self) -> int:
        """Return how many frames or replies were good."""

    @property
    def last_ok_ns(self) -> int:
        """Return the host's time when the latest good one came, 0 if none did."""

    @property
    def frames_bad(self) -> int:
        """Return how many were damaged, rejected or did not come."""

    @property
    def bytes_skipped(self) -> int:
        """Return how many bytes were part of nothing intact."""

    @property
    def last_error(self) -> str:
        """Return what was wrong with the latest one that was intact."""


class PortLog:
    """
    The log of a port: a problem is logged when it has lasted for PORT_GRACE_NS.

    Ctrl-C ends a simulated device together with its driver, and both start together: neither is
    an error. A shorter loss is logged when the port is open again. The diagnostics report every
    problem at once. The methods may be called from different threads.
    """

    def __init__(self, logger: Any, clock: Callable[[], int]) -> None:
        self._logger, self._clock = logger, clock  # ns, steady
        self._lock = threading.Lock()
        self._pending: list[str] = []
        self._since_ns: int | None = None  # of a problem
        self._was_open = False

    def trouble(self, text: str) -> None:
        """Take a new problem of the port."""
        with self._lock:
            self._pending.append(text)
            if self._since_ns is None:
                self._since_ns = self._clock()

    def opened(self, text: str) -> None:
        """Log that the port is open, after the trouble that it had."""
        with self._lock:
            if self._was_open:
                self._flush()
            self._pending.clear()
            self._since_ns, self._was_open = None, True
        self._logger.info(text)

    def look(self) -> None:
        """Log a problem that has lasted; call this regularly."""
        with self._lock:
            if self._since_ns is not None and self._clock() - self._since_ns >= PORT_GRACE_NS:
                self._flush()

    def _flush(self) -> None:
        for text in self._pending:
            self._logger.error(text)
        self._pending.clear()


class DriverNode(SmartTireNode[Params]):
    """
    A node with a device on a serial port.

    It publishes from the link's own thread: rclpy's ``publish`` holds the interpreter's lock,
    so that no message waits for the executor to wake up.
    """

    def __init__(self, name: str, params_class: type[Params]) -> None:
        super().__init__(name, params_class)
        self._bad_before = 0  # bad frames at the last report
        self._skipped_before = 0  # bytes, likewise
        self._log_at = 1      # bad frames that are worth a line
        self._port_log = PortLog(self.get_logger(), self.steady_ns)
        self.every(PORT_LOOK, self._port_log.look)

    def connect(self, source: Source, work: Callable[[Any, threading.Event], None]) -> None:
        """Let ``work`` go on with the port of the parameters once the node starts."""
        params: Any = self.params
        self._source = source
        self._link = SerialPort(params.port, params.baud_rate, work, self._on_link)
        self.hardware_id = params.port

    def start(self) -> None:
        """Begin to open the port."""
        self._link.start()

    def stop(self) -> None:
        """Close the port."""
        self._link.stop()

    def _on_link(self, text: str) -> None:
        if self._link.problem:
            self._port_log.trouble(text)
        else:
            self._port_log.opened(text)

    def fill_status(self, status: Status) -> None:
        """Add the state of the port and the counts of frames."""
        source, link = self._source, self._link
        age = (time.time_ns() - source.last_ok_ns) / NS_PER_S if source.frames_ok else math.inf
        status.values.update(
            frames_ok=source.frames_ok, frames_bad=source.frames_bad,
            bytes_skipped=source.bytes_skipped, last_message_age=age,
            port_opened=link.opened, port_refused=link.refused)
        if link.problem:
            status.error(link.problem)
        elif age > SILENCE:
            status.error('the port is open, but nothing intelligible comes')
        self._fill_damage(status)

    def _fill_damage(self, status: Status) -> None:
        source = self._source
        bad, latest = source.frames_bad, source.last_error or 'damaged'
        if bad > self._bad_before:
            status.warn(f'{bad - self._bad_before} bad frames, latest: {latest}')
        if bad >= self._log_at:  # at the 1st, 2nd, 4th, 8th ... as far as 1 Hz sees them
            self._log_at = 1 << bad.bit_length()
            self.get_logger().warning(f'{bad} bad frames, latest: {latest}')
        self._bad_before = bad
        skipped = source.bytes_skipped
        if skipped > self._skipped_before:
            status.warn(f'{skipped - self._skipped_before} bytes skipped')
        self._skipped_before = skipped


def nanoseconds(seconds: float) -> int:
    """Return a parameter's seconds as the links count them."""
    return round(seconds * NS_PER_S)
