# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Receivers of byte streams: frames are counted, samples get the host time of measurement."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from smart_tire.drivers.clock_sync import ArrivalTimestamps, ClockSync
from smart_tire.errors import FrameError
from smart_tire.protocol import film_charge, vectornav, vectornav_ascii, xsens
from smart_tire.protocol.deframer import Deframer

Item = TypeVar('Item')


@dataclass(frozen=True)
class Protocol:
    """Frames of a device, each with one sample, and their decoder."""

    deframer: Callable[[], Deframer]
    decode: Callable[[bytes], tuple[int | None, Any]]  # body -> device time [ns], sample
    wrap_ns: int = 0  # modulus of the device time, 0 if it does not wrap
    axes: str = ''    # axes of the device and their conversion to REP-103, for the diagnostics


MAX_UNREAD = 2048  # bytes: some frames of each protocol
FLIPPED_AXES = 'x forward, y right, z down on the device: y and z negated'
IMU_PROTOCOLS = {
    'vectornav_binary': Protocol(
        vectornav.BinaryDeframer, vectornav.decode_binary, axes=FLIPPED_AXES),
    'vectornav_ascii': Protocol(
        vectornav_ascii.AsciiDeframer, vectornav_ascii.decode_ymr, axes=FLIPPED_AXES),
    'xsens': Protocol(
        xsens.XsensDeframer, xsens.decode_imu, xsens.SAMPLE_TIME_WRAP_NS,
        'x forward, y left, z up on the device: unchanged'),
}
FILM_CHARGE = Protocol(
    film_charge.FilmDeframer, film_charge.decode_charge, film_charge.TIMER_WRAP_NS)


class FrameReceiver:
    """Base of the receivers: splits a byte stream into frames and counts good and bad ones."""

    def __init__(self, deframer: Deframer) -> None:
        self.frames_ok = 0
        self.last_ok_ns = 0   # host clock, when the latest good frame arrived
        self.rejected = 0     # intact frames with invalid or unexpected content
        self._last_error = ''  # why the latest one was rejected
        self.unread = b''      # latest bytes, until a frame is good: of which protocol are they?
        self._deframer = deframer

    @property
    def frames_bad(self) -> int:
        """Return how many frames were damaged or rejected."""
        return self._deframer.bad_frames + self.rejected

    @property
    def last_error(self) -> str:
        """Return why frames were damaged, if that is known, or the latest one rejected."""
        return self._deframer.damage or self._last_error

    @property
    def bytes_skipped(self) -> int:
        """Return how many bytes did not belong to an intact frame."""
        return self._deframer.skipped_bytes

    def _ignores(self, body: bytes) -> bool:
        """Return whether an intact frame contains no data, which is no fault."""
        return False

    def _decoded(self, chunk: bytes, receive_ns: int,
                 decode: Callable[[bytes], Item]) -> Iterator[Item]:
        """Yield the decoded frames that ``chunk`` completes; reject those with a FrameError."""
        if not self.frames_ok:
            self.unread = (self.unread + chunk)[-MAX_UNREAD:]
        for body in self._deframer.extract(chunk):
            if self._ignores(body):
                continue
            try:
                item = decode(body)
            except FrameError as error:
                self.rejected += 1
                self._last_error = str(error)
                continue
            self.frames_ok += 1
            self.last_ok_ns, self.unread = receive_ns, b''
            yield item


class SampleStream(FrameReceiver):
    """
    Decodes the byte stream of a device, such as an IMU, and assigns host timestamps.

    Timestamps follow the device clock if the frames contain its time, otherwise the regularized
    arrival times. ``latency_ns`` is subtracted from them: the minimum time from the measurement
    to the arrival of the frame's last byte.
    """

    def __init__(self, protocol: Protocol, latency_ns: int = 0) -> None:
        super().__init__(protocol.deframer())
        self.protocol = protocol
        self.timestamp_source = 'none yet'
        self._latency_ns = latency_ns
        self._bad_before = 0
        self.reset_clocks()

    def reset_clocks(self) -> None:
        """Reset the clock models after the port was opened again."""
        self._device_clock = ClockSync()
        self._arrival_clock = ArrivalTimestamps()
        self._device_ns = 0  # of the last frame, unwrapped

    def receive(self, chunk: bytes, receive_ns: int) -> Iterator[Any]:
        """Take bytes that arrived at ``receive_ns`` and yield the samples they complete."""
        for device_ns, sample in self._decoded(chunk, receive_ns, self.protocol.decode):
            stamp_ns = self._stamp(device_ns, receive_ns) - self._latency_ns
            yield replace(sample, stamp_ns=stamp_ns)

    def _stamp(self, device_ns: int | None, receive_ns: int) -> int:
        if device_ns is None:
            self.timestamp_source = 'regularized arrival times (the device sends no time)'
            missed, self._bad_before = self.frames_bad - self._bad_before, self.frames_bad
            return self._arrival_clock.timestamp(receive_ns, missed)
        self.timestamp_source = 'device clock'
        if wrap := self.protocol.wrap_ns:
            device_ns = self._device_ns + (device_ns - self._device_ns) % wrap
        self._device_ns = device_ns
        return self._device_clock.add_arrival(device_ns, receive_ns)
