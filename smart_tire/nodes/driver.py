"""What the drivers share: a link with its thread, and what to say about both."""

from __future__ import annotations

from collections.abc import Callable
import threading
from typing import Any, Protocol, TypeVar

from smart_tire.links.serial_link import SerialLink
from smart_tire.nodes.base import SILENCE, SmartTireNode
from smart_tire.nodes.diagnostics import Status, Tally

Params = TypeVar('Params')


class Source(Protocol):
    """What turns bytes into samples, and counts."""

    @property
    def frames_ok(self) -> int:
        """Return how many frames or replies were good."""

    @property
    def frames_bad(self) -> int:
        """Return how many were damaged, rejected or did not come."""

    @property
    def last_error(self) -> str:
        """Return what was wrong with the latest one that was intact."""


class DriverNode(SmartTireNode[Params]):
    """
    A node with a device on a serial port.

    It publishes from the link's own thread: rclpy's ``publish`` holds the interpreter's lock,
    so that no message waits for the executor to wake up.
    """

    def __init__(self, name: str, params_class: type[Params]) -> None:
        super().__init__(name, params_class)
        self._frames = Tally()
        self._log_at = 1  # bad frames

    def connect(self, source: Source, work: Callable[[Any, threading.Event], None]) -> None:
        """Let ``work`` go on with the port of the parameters once the node starts."""
        params: Any = self.params
        self._source = source
        self._link = SerialLink(params.port, params.baud_rate, work, self._on_link)
        self.hardware_id = params.port

    def start(self) -> None:
        """Begin to open the port."""
        self._link.start()

    def stop(self) -> None:
        """Close the port."""
        self._link.stop()

    def _on_link(self, text: str) -> None:
        if self._link.problem:
            self.get_logger().error(text)
        else:
            self.get_logger().info(text)

    def fill_status(self, status: Status) -> None:
        """Add the state of the port and the counts of frames."""
        now_ns, frames = self.steady_ns(), self._frames
        if self._source.frames_ok > frames.ok:
            frames.good(now_ns, self._source.frames_ok - frames.ok)
        frames.bad = self._source.frames_bad
        status.values.update(
            frames_ok=frames.ok, frames_bad=frames.bad, last_message_age=frames.age(now_ns),
            port_opened=self._link.opened, port_refused=self._link.refused)
        if self._link.problem:
            status.error(self._link.problem)
        elif frames.age(now_ns) > SILENCE:
            status.error('the port is open, but nothing intelligible comes')
        if new := frames.newly_bad():
            status.warn(f'{new} bad frames, latest: {self._source.last_error or "damaged"}')
        if frames.bad >= self._log_at:  # at the 1st, 2nd, 4th, 8th ... as far as 1 Hz sees them
            self._log_at = 1 << frames.bad.bit_length()
            self.get_logger().warning(
                f'{frames.bad} bad frames, latest: {self._source.last_error or "damaged"}')


def nanoseconds(seconds: float) -> int:
    """Return a parameter's seconds as the links count them."""
    return round(seconds * 1e9)
