# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Base class of the driver nodes: a serial port with its thread, its log and diagnostics."""

from __future__ import annotations

from collections.abc import Callable
import math
import threading
from typing import Any, Protocol, TypeVar

from smart_tire.drivers.clock import SYSTEM
from smart_tire.drivers.sample_stream import Protocol as DeviceProtocol, SampleStream
from smart_tire.drivers.serial_port import read_loop, SerialPort
from smart_tire.nodes.base import MAX_INPUT_AGE, SmartTireNode
from smart_tire.nodes.diagnostics import CHECK_PERIOD, PortLog, Status
from smart_tire.paths import port_url
from smart_tire.samples import NS_PER_S

Params = TypeVar('Params')


class FrameSource(Protocol):
    """Decodes the bytes of a port and counts frames."""

    @property
    def frames_ok(self) -> int:
        """Return the number of accepted frames or replies."""

    @property
    def last_ok_ns(self) -> int:
        """Return the host time of the latest accepted frame, 0 if there was none."""

    @property
    def frames_bad(self) -> int:
        """Return the number of frames that were damaged, rejected or missing."""

    @property
    def bytes_skipped(self) -> int:
        """Return the number of bytes outside intact frames."""

    @property
    def last_error(self) -> str:
        """Return why the latest intact frame was rejected."""

    @property
    def unread(self) -> bytes:
        """Return the latest bytes if no frame was accepted before."""


class DriverNode(SmartTireNode[Params]):
    """
    A node with a device on a serial port.

    It publishes from the thread of the port, so that no message waits for the executor; rclpy's
    ``publish`` is safe there, since it holds the interpreter lock.
    """

    device = ''    # name of its simulated port
    polls = False  # whether frames are replies in limited time, which a late host misses

    def __init__(self, name: str, params_class: type[Params]) -> None:
        super().__init__(name, params_class)
        self._next_logged = 1       # number of bad frames at which the next line is logged
        self._port_log = PortLog(self.get_logger(), self.steady_ns)
        self.call_every(CHECK_PERIOD, self._port_log.check, wakes=False)

    def connect(self, source: FrameSource, work: Callable[[Any, threading.Event], None]) -> None:
        """Run ``work`` with the open port, in a thread, once the node has started."""
        params: Any = self.params
        self._source = source
        url = port_url(params.port, self.get_namespace(), self.device)
        self._port = SerialPort(url, params.baud_rate, work, self._on_port_state)
        self.hardware_id = url
        self.input_log.watch(f'frames from {url}', lambda: source.frames_ok, required=True,
                             excused=lambda: bool(self._port.problem))

    def start(self) -> None:
        """Open the port."""
        self._port.start()

    def stop(self) -> None:
        """Close the port."""
        self._port.stop()

    def _on_port_state(self, text: str) -> None:
        if self._port.problem:
            self._port_log.add_problem(text)
        else:
            self._port_log.opened(text)

    def fill_status(self, status: Status) -> None:
        """Add the state of the port and the counts of frames."""
        source, port = self._source, self._port
        age = (SYSTEM.time_ns() - source.last_ok_ns) / NS_PER_S if source.frames_ok else math.inf
        status.values.update(
            frames_ok=source.frames_ok, frames_bad=source.frames_bad,
            bytes_skipped=source.bytes_skipped, last_message_age=age,
            port_opened=port.opened, port_refused=port.refused)
        if port.problem:
            status.error(port.problem)
        elif age > MAX_INPUT_AGE:
            status.error(f'port is open but no valid frames are received ({self._unread_cause()})')
        self._fill_bad_frames(status)

    def _unread_cause(self) -> str:
        """Return why no frame was good: those of another protocol, or none at all."""
        from smart_tire.drivers.port_scan import identify, NAMES  # drivers start without
        protocol, _ = identify(self._source.unread)
        return (f'but those of {NAMES[protocol]}: set protocol, or the output of the device'
                if protocol else 'check baud rate and wiring')

    def _fill_bad_frames(self, status: Status) -> None:
        source = self._source
        bad, latest = source.frames_bad, source.last_error or 'damaged'
        if new := status.new('bad frames', bad):
            status.warn(f'{new} bad frames, latest: {latest}', by_host=self.polls)
        if bad >= self._next_logged:  # the 1st, 2nd, 4th, 8th ..., checked once a second
            self._next_logged = 1 << bad.bit_length()
            self.get_logger().warning(f'{bad} bad frames, latest: {latest}')
        if new := status.new('bytes skipped', source.bytes_skipped):
            status.warn(f'{new} bytes skipped', by_host=self.polls)


class SampleDriver(DriverNode[Params]):
    """A node whose device sends samples of one kind, such as an IMU."""

    def __init__(self, name: str, params_class: type[Params], topic: str,
                 protocol: Callable[[Params], DeviceProtocol],
                 to_msg: Callable[[Params], Callable[[Any, Any], Any]] | None = None) -> None:
        super().__init__(name, params_class)
        params: Any = self.params
        self._stream = SampleStream(protocol(self.params), nanoseconds(params.latency))
        self._publish = self.make_publisher(
            topic, to_msg=None if to_msg is None else to_msg(self.params))
        self.connect(self._stream, self._read_port)

    def _read_port(self, port: Any, stopping: threading.Event) -> None:
        self._stream.reset_clocks()
        read_loop(port, stopping, self._on_bytes)

    def _on_bytes(self, chunk: bytes, receive_ns: int) -> None:
        for sample in self._stream.receive(chunk, receive_ns):
            self._publish(sample)

    def fill_status(self, status: Status) -> None:
        """Add the source of timestamps."""
        super().fill_status(status)
        status.values['stamps'] = self._stream.timestamp_source


def nanoseconds(seconds: float) -> int:
    """Return a duration [s] in nanoseconds."""
    return round(seconds * NS_PER_S)
