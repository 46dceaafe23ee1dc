"""From the bytes of an inertial unit to samples that carry the instant of their measurement."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from smart_tire.drivers.arrival_timestamps import ArrivalTimestamps
from smart_tire.drivers.clock_sync import ClockSync
from smart_tire.errors import FrameError
from smart_tire.protocol import vectornav, vectornav_ascii, xsens
from smart_tire.protocol.deframer import Deframer
from smart_tire.samples import ImuSample

Decoder = Callable[[bytes, int], tuple[int | None, ImuSample]]


@dataclass(frozen=True)
class Protocol:
    """How one kind of unit speaks."""

    deframer: Callable[[], Deframer]
    decode: Decoder
    wrap_ns: int  # of the device's time, 0 if it does not wrap
    axes: str     # of the device, and what is done about them


TURNED = 'x forward, y right, z down on the device: y and z negated'
PROTOCOLS = {
    'vectornav_binary': Protocol(
        vectornav.BinaryDeframer, vectornav.decode_binary, 0, TURNED),
    'vectornav_ascii': Protocol(
        vectornav_ascii.AsciiDeframer, vectornav_ascii.decode_ymr, 0, TURNED),
    'xsens': Protocol(
        xsens.XsensDeframer, xsens.decode_imu, xsens.SAMPLE_TIME_WRAP_NS,
        'x forward, y left, z up on the device: as they are'),
}


class ImuStream:
    """
    One unit: its frames, and its clock where it tells one.

    Stamps are earlier than the arrival by the constant ``latency_ns``, which is the least time
    from the measurement to the arrival of the frame's last byte.
    """

    def __init__(self, protocol: str, latency_ns: int = 0) -> None:
        self.protocol = PROTOCOLS[protocol]
        self.frames_ok = 0
        self.last_ok_ns = 0       # host clock, when the latest good frame came
        self.rejected = 0         # intact frames that say what they must not
        self.last_error = ''      # why the latest one was rejected
        self.stamped_by = 'nothing yet'
        self._latency_ns = latency_ns
        self._deframer = self.protocol.deframer()
        self._bad_before = 0
        self.reopened()

    def reopened(self) -> None:
        """Forget the times of a port that was closed meanwhile."""
        self._device_clock = ClockSync()
        self._arrival_clock = ArrivalTimestamps()
        self._device_ns = 0  # of the last frame, unwrapped

    @property
    def frames_bad(self) -> int:
        """Return how many frames were damaged or rejected."""
        return self._deframer.bad_frames + self.rejected

    @property
    def bytes_skipped(self) -> int:
        """Return how many bytes belonged to no intact frame."""
        return self._deframer.skipped_bytes

    def feed(self, chunk: bytes, receive_ns: int) -> Iterator[ImuSample]:
        """Take bytes that arrived at ``receive_ns`` and yield the samples they complete."""
        for body in self._deframer.feed(chunk):
            try:
                device_ns, sample = self.protocol.decode(body, 0)
            except FrameError as error:
                self.rejected += 1
                self.last_error = str(error)
                continue
            self.frames_ok += 1
            self.last_ok_ns = receive_ns
            stamp_ns = self._stamp(device_ns, receive_ns) - self._latency_ns
            yield ImuSample(stamp_ns, sample.acceleration, sample.rate, sample.orientation)

    def _stamp(self, device_ns: int | None, receive_ns: int) -> int:
        if device_ns is None:
            self.stamped_by = 'regularised arrival, for the device sends no time'
            missed, self._bad_before = self.frames_bad - self._bad_before, self.frames_bad
            return self._arrival_clock.update(receive_ns, missed)
        self.stamped_by = 'device clock'
        if wrap := self.protocol.wrap_ns:
            device_ns = self._device_ns + (device_ns - self._device_ns) % wrap
        self._device_ns = device_ns
        return self._device_clock.update(device_ns, receive_ns)
