"""
The devices of the simulated robot: values go in, the bytes of the real hardware come out.

No port and no clock in here: true time [ns since the start of the plant] is an argument, and
each device derives its own, wrong, time from it. ``ports`` puts the bytes on pseudo-terminals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import heapq

import numpy as np

from smart_tire.protocol import roboclaw, tire_payload, vectornav, vectornav_ascii, xbee, xsens
from smart_tire.protocol.tire_payload import TireBatch
from smart_tire.samples import Four, ImuSample, NS_PER_S

# Counters start so that each of them wraps while the robot drives: receivers must stand that.
START_SEQUENCE = tire_payload.SEQUENCE_WRAP - 500            # 20 s of batches at 25 per second
START_TIMER_US = tire_payload.TIMER_WRAP_US - 25_000_000     # 25 s
START_IMU_NS = xsens.SAMPLE_TIME_WRAP_NS - 30 * NS_PER_S     # 30 s
FULL_BATTERY_MV = 3900                                       # of a wheel unit
SUPPLY = 148                                                 # 0.1 V, of the motor boards


class DriftingClock:
    """A clock that shows ``start_ns`` at true time 0 and runs fast by ``error`` (relative)."""

    def __init__(self, error: float = 0.0, start_ns: int = 0) -> None:
        self._error, self._start_ns = error, start_ns

    def read(self, true_ns: int) -> int:
        """Return what the clock shows [ns]."""
        return self._start_ns + true_ns + round(true_ns * self._error)

    def instant(self, shown_ns: int) -> int:
        """Return the true time [ns] at which the clock shows ``shown_ns``."""
        elapsed = shown_ns - self._start_ns
        return elapsed - round(elapsed * self._error / (1.0 + self._error))


class SensorNodeEmulator:
    """
    A wheel unit: converts every ``period_us`` by its own timer, counts batches, has an address.

    Conversion 0 takes place ``first_us`` [us, by the unit's timer] after true time 0.
    """

    def __init__(self, address: int, *, period_us: int = 2500, clock_error: float = 0.0,
                 first_us: int = 0) -> None:
        self.address = address
        self.period_us = period_us
        self.battery_mv = FULL_BATTERY_MV
        self.batches = 0  # since the start, lost ones too
        self._first_us = first_us
        self._clock = DriftingClock(clock_error)

    def instant_ns(self, index: int) -> int:
        """Return the true instant of conversion ``index``."""
        return self._clock.instant(1000 * (self._first_us + self.period_us * index))

    def batch(self, first: int, codes: Sequence[Sequence[int]]) -> TireBatch:
        """Return the next batch: ``codes`` (samples x films), of conversion ``first`` onwards."""
        timer = START_TIMER_US + self._first_us + self.period_us * first
        sequence = START_SEQUENCE + self.batches
        self.batches += 1
        clipped = any(code in (0, tire_payload.MAX_CODE) for row in codes for code in row)
        return TireBatch(
            tire_payload.SATURATED if clipped else 0, sequence % tire_payload.SEQUENCE_WRAP,
            timer % tire_payload.TIMER_WRAP_US, self.period_us,
            tuple(tuple(row) for row in codes), self.battery_mv)


class TireRadio:
    """
    The XBee coordinator with its wheel units, by wheel.

    A packet arrives between ``delay`` and ``longest`` [s] after it was sent, ``jitter`` [s] is
    the mean of what exceeds ``delay`` (exponential); packets of one unit never overtake each
    other. A share ``loss`` of them is lost.
    """

    def __init__(self, units: Mapping[str, SensorNodeEmulator], rng: np.random.Generator, *,
                 delay: float = 0.005, jitter: float = 0.003, longest: float = 0.020,
                 loss: float = 0.0) -> None:
        self.units = dict(units)
        self.dropped = dict.fromkeys(units, 0)  # wheel -> batches lost on the air
        self._rng = rng
        self._delay, self._jitter, self._longest, self._loss = delay, jitter, longest, loss
        self._arrival_ns = dict.fromkeys(units, 0)
        self._in_air: list[tuple[int, int, bytes]] = []  # arrival, order of sending, frame
        self._sent = 0

    def send(self, wheel: str, first: int, codes: Sequence[Sequence[int]], sent_ns: int) -> int:
        """
        Send the batch of ``wheel`` that starts with conversion ``first``; return its sequence.

        ``codes`` are samples x films, ``sent_ns`` is the true time of sending: the instant of
        the last conversion or a little later.
        """
        unit = self.units[wheel]
        batch = unit.batch(first, codes)
        lost = self._rng.random() < self._loss
        late = min(self._rng.exponential(self._jitter), max(self._longest - self._delay, 0.0))
        if lost:
            self.dropped[wheel] += 1
            return batch.sequence
        arrival = sent_ns + round((self._delay + late) * NS_PER_S)
        self._arrival_ns[wheel] = max(arrival, self._arrival_ns[wheel])
        heapq.heappush(self._in_air, (self._arrival_ns[wheel], self._sent, _frame(unit, batch)))
        self._sent += 1
        return batch.sequence

    def next_ns(self) -> int | None:
        """
        Return the true time at which the next packet arrives, None if none is on the air.

        Who asks only every millisecond rounds the delays up to the millisecond; that beats
        with the units' clocks and no receiver can filter it out.
        """
        return self._in_air[0][0] if self._in_air else None

    def due(self, now_ns: int) -> bytes:
        """Return what the coordinator has put on its serial port up to true time ``now_ns``."""
        frames = []
        while self._in_air and self._in_air[0][0] <= now_ns:
            frames.append(heapq.heappop(self._in_air)[2])
        return b''.join(frames)


def _frame(unit: SensorNodeEmulator, batch: TireBatch) -> bytes:
    packet = xbee.ReceivePacket(unit.address, unit.address & 0x7FFF, 0x01,
                                tire_payload.encode_batch(batch))
    return xbee.encode_frame(xbee.encode_receive_packet(packet))


class ImuDevice:
    """An inertial unit that speaks ``protocol``, as ``ImuDriverParams`` names them."""

    def __init__(self, protocol: str = 'vectornav_binary', *, clock_error: float = 0.0) -> None:
        self._encode = {'vectornav_binary': self._vectornav_binary,
                        'vectornav_ascii': self._vectornav_ascii,
                        'xsens': self._xsens}[protocol]
        self._clock = DriftingClock(clock_error, START_IMU_NS)
        self._frames = 0

    def frame(self, sample: ImuSample) -> bytes:
        """Return the bytes for ``sample``, whose stamp is the true time of measurement."""
        frame = self._encode(sample, self._clock.read(sample.stamp_ns))
        self._frames += 1
        return frame

    def _vectornav_binary(self, sample: ImuSample, device_ns: int) -> bytes:
        return vectornav.encode_frame(vectornav.encode_binary(device_ns, sample))

    def _vectornav_ascii(self, sample: ImuSample, device_ns: int) -> bytes:
        return vectornav_ascii.encode_sentence(vectornav_ascii.encode_ymr(sample))

    def _xsens(self, sample: ImuSample, device_ns: int) -> bytes:
        return xsens.encode_message(xsens.encode_imu(device_ns, sample, self._frames))


class RoboclawEmulator:
    """
    The RoboClaws on one line: board 1 drives the front wheels, board 2 the rear, M1 is left.

    Encoders and motors are in the order of ``WHEELS``.
    """

    def __init__(self, addresses: Sequence[int] = (128, 129)) -> None:
        self._boards = [_Board(address, motor) for motor, address in zip((0, 2), addresses)]
        self._deframer = roboclaw.RequestDeframer()
        self._heard_ns = 0

    @property
    def bad_frames(self) -> int:
        """Return how many requests had a wrong CRC."""
        return self._deframer.bad_frames

    def feed(self, chunk: bytes, now_ns: int, counts: Sequence[int], speeds: Sequence[float]
             ) -> bytes:
        """
        Take what the host has sent by true time ``now_ns`` and return the answers.

        ``counts`` are what the encoders have counted since the start, ``speeds`` are in counts
        per second.
        """
        if chunk and now_ns - self._heard_ns > roboclaw.PACKET_GAP_NS:
            self._deframer.clear()
        if chunk:
            self._heard_ns = now_ns
        return b''.join(board.answer(request, now_ns, counts, speeds)
                        for request in self._deframer.feed(chunk)
                        for board in self._boards if board.address == request.address)

    def duty(self, now_ns: int) -> Four:
        """Return the duties [-1, 1] that the motors get at true time ``now_ns``."""
        (front_left, front_right), (rear_left, rear_right) = (
            board.duty(now_ns) for board in self._boards)
        return front_left, front_right, rear_left, rear_right


class _Board:
    """One RoboClaw with the motors ``motor`` and ``motor + 1`` of ``WHEELS``."""

    def __init__(self, address: int, motor: int) -> None:
        self.address = address
        self._motors = (motor, motor + 1)
        self._zero = [0, 0]       # what the encoders had counted where the host sees 0
        self._duty = (0.0, 0.0)
        self._timeout = 0         # roboclaw.TIMEOUT_RESOLUTION; 0 is never
        self._heard_ns = 0

    def duty(self, now_ns: int) -> tuple[float, float]:
        """Return the duties; silence for longer than the time-out has stopped both motors."""
        timeout_ns = round(self._timeout * roboclaw.TIMEOUT_RESOLUTION * NS_PER_S)
        if timeout_ns and now_ns - self._heard_ns > timeout_ns:
            self._duty = (0.0, 0.0)
        return self._duty

    def answer(self, request: roboclaw.Request, now_ns: int, counts: Sequence[int],
               speeds: Sequence[float]) -> bytes:
        """Do what ``request`` asks and return the reply."""
        self.duty(now_ns)  # a motor that has timed out stays stopped until the next duty
        self._heard_ns = now_ns
        own = [counts[motor] for motor in self._motors]
        self._obey(request, own)
        first, second = (round(speeds[motor]) for motor in self._motors)
        values = {
            roboclaw.READ_TIMEOUT: (self._timeout,),
            roboclaw.READ_BATTERY: (SUPPLY,),
            roboclaw.READ_ENCODERS: tuple((count - zero) % roboclaw.COUNT_WRAP
                                          for count, zero in zip(own, self._zero)),
            roboclaw.READ_SPEEDS: (first, second),
            roboclaw.READ_STATUS: (0,),
        }.get(request.command, ())
        return roboclaw.encode_reply(self.address, request.command, *values)

    def _obey(self, request: roboclaw.Request, counts: list[int]) -> None:
        command, values = request.command, request.values
        if command == roboclaw.SET_DUTY:
            self._duty = (roboclaw.duty_from_code(values[0]), roboclaw.duty_from_code(values[1]))
        elif command == roboclaw.SET_TIMEOUT:
            self._timeout = values[0]
        elif command == roboclaw.RESET_ENCODERS:
            self._zero = counts
        elif command in (roboclaw.SET_ENCODER_1, roboclaw.SET_ENCODER_2):
            which = int(command == roboclaw.SET_ENCODER_2)
            self._zero[which] = counts[which] - values[0]
