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
Device emulators of the simulated robot: physical values in, bytes of the real hardware out.

They use neither ports nor clocks: true time [ns since the start of the plant] is an argument, and
each device derives its own time, with clock error, from it. ``realtime`` connects the emulators to
pseudo-terminals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import heapq

import numpy as np

from smart_tire.protocol import roboclaw, tire_payload, vectornav, vectornav_ascii, xbee, xsens
from smart_tire.protocol.tire_payload import TireBatch
from smart_tire.samples import Four, four, ImuSample, NS_PER_S

# Initial values such that each counter wraps while the robot drives, as receivers must handle.
START_SEQUENCE = tire_payload.SEQUENCE_WRAP - 500         # wraps after 20 s at 25 batches/s
START_TIMER_US = tire_payload.TIMER_WRAP_US - 25_000_000  # wraps after 25 s
START_IMU_NS = xsens.SAMPLE_TIME_WRAP_NS - 30 * NS_PER_S  # wraps after 30 s
FULL_BATTERY_MV = 3900                                    # of a sensor node
PACKET_GAP_NS = 10_000_000  # ns without a byte after which a board discards a packet
SUPPLY_VOLTAGE_CODE = 148                                 # 0.1 V, of the motor boards
VERSION = 'USB Roboclaw 2x15a v4.1.34'                     # of the firmware of the boards
NO_CURRENTS = (0.0, 0.0, 0.0, 0.0)                        # A
NO_SPEEDS = (0.0, 0.0, 0.0, 0.0)                          # counts per second


class DriftingClock:
    """A clock that reads ``start_ns`` at true time 0 and is fast by the relative ``error``."""

    def __init__(self, error: float = 0.0, start_ns: int = 0) -> None:
        self._error, self._start_ns = error, start_ns

    def read(self, true_ns: int) -> int:
        """Return the reading of the clock [ns] at true time ``true_ns``."""
        return self._start_ns + true_ns + round(true_ns * self._error)

    def true_ns(self, device_ns: int) -> int:
        """Return the true time [ns] at which the clock reads ``device_ns``."""
        elapsed = device_ns - self._start_ns
        return elapsed - round(elapsed * self._error / (1.0 + self._error))


class SensorNodeEmulator:
    """
    Sensor node: converts every ``period_us`` of its own timer and numbers its batches.

    Conversion 0 takes place ``first_us`` [us, by the timer of the node] after true time 0.
    """

    def __init__(self, address: int, *, period_us: int = 2500, clock_error: float = 0.0,
                 first_us: int = 0) -> None:
        self.address = address
        self.period_us = period_us
        self.battery_mv = FULL_BATTERY_MV
        self.batches = 0  # since the start, including lost ones
        self._first_us = first_us
        self._clock = DriftingClock(clock_error)

    def instant_ns(self, index: int) -> int:
        """Return the true time of conversion ``index``."""
        return self._clock.true_ns(1000 * (self._first_us + self.period_us * index))

    def batch(self, first: int, codes: Sequence[Sequence[int]]) -> TireBatch:
        """Return the next batch: ``codes`` (samples x films), from conversion ``first`` on."""
        timer = START_TIMER_US + self._first_us + self.period_us * first
        sequence = START_SEQUENCE + self.batches
        self.batches += 1
        clipped = any(code in (0, tire_payload.MAX_CODE) for row in codes for code in row)
        return TireBatch(
            tire_payload.SATURATED if clipped else 0, sequence % tire_payload.SEQUENCE_WRAP,
            timer % tire_payload.TIMER_WRAP_US, self.period_us,
            tuple(tuple(row) for row in codes), self.battery_mv)


class RadioEmulator:
    """
    XBee coordinator with its sensor nodes, by wheel.

    The delay of a packet is ``delay`` plus an exponential variable with mean ``jitter``, at most
    ``max_delay`` [s]; packets of one node arrive in order. A share ``loss`` of them is lost.
    """

    def __init__(self, sensor_nodes: Mapping[str, SensorNodeEmulator], rng: np.random.Generator,
                 *, delay: float = 0.005, jitter: float = 0.003, max_delay: float = 0.020,
                 loss: float = 0.0) -> None:
        self.sensor_nodes = dict(sensor_nodes)
        self.dropped = dict.fromkeys(sensor_nodes, 0)  # wheel -> lost batches
        self._rng = rng
        self._delay, self._jitter, self._max_delay, self._loss = delay, jitter, max_delay, loss
        self._arrival_ns = dict.fromkeys(sensor_nodes, 0)
        self._pending: list[tuple[int, int, bytes]] = []  # heap of (arrival, packet number, frame)
        self._sent = 0

    def send(self, wheel: str, first: int, codes: Sequence[Sequence[int]], sent_ns: int) -> int:
        """
        Send the batch of ``wheel`` that starts with conversion ``first``; return its sequence.

        ``codes`` are samples x films, ``sent_ns`` is the true time of transmission: that of the
        last conversion or slightly later.
        """
        node = self.sensor_nodes[wheel]
        batch = node.batch(first, codes)
        lost = self._rng.random() < self._loss
        late = min(self._rng.exponential(self._jitter), max(self._max_delay - self._delay, 0.0))
        if lost:
            self.dropped[wheel] += 1
            return batch.sequence
        arrival = sent_ns + round((self._delay + late) * NS_PER_S)
        self._arrival_ns[wheel] = max(arrival, self._arrival_ns[wheel])
        heapq.heappush(self._pending, (self._arrival_ns[wheel], self._sent, _frame(node, batch)))
        self._sent += 1
        return batch.sequence

    def next_ns(self) -> int | None:
        """
        Return the true time at which the next packet arrives, None if none is pending.

        Polling every millisecond instead would round the delays up to milliseconds, which beats
        with the clocks of the nodes and cannot be filtered out by a receiver.
        """
        return self._pending[0][0] if self._pending else None

    def due(self, now_ns: int) -> bytes:
        """Return the bytes that the coordinator sends up to true time ``now_ns``."""
        frames = []
        while self._pending and self._pending[0][0] <= now_ns:
            frames.append(heapq.heappop(self._pending)[2])
        return b''.join(frames)


def _frame(node: SensorNodeEmulator, batch: TireBatch) -> bytes:
    packet = xbee.ReceivePacket(node.address, node.address & 0x7FFF, 0x01,
                                tire_payload.encode_batch(batch))
    return xbee.encode_frame(xbee.encode_receive_packet(packet))


class ImuEmulator:
    """IMU with one of the protocols of ``ImuDriverParams``."""

    def __init__(self, protocol: str = 'vectornav_binary', *, clock_error: float = 0.0) -> None:
        self._encode = {'vectornav_binary': self._vectornav_binary,
                        'vectornav_ascii': self._vectornav_ascii,
                        'xsens': self._xsens}[protocol]
        self._clock = DriftingClock(clock_error, START_IMU_NS)
        self._frames = 0

    def frame(self, sample: ImuSample) -> bytes:
        """Return the frame of ``sample``, whose timestamp is the true time of measurement."""
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
    Two RoboClaws on one line: board 1 drives the front wheels, board 2 the rear ones, M1 is left.

    Encoders and motors are in the order of ``WHEELS``.
    """

    def __init__(self, addresses: Sequence[int] = (128, 129)) -> None:
        self._boards = [_Board(address, motor) for motor, address in zip((0, 2), addresses)]
        self._deframer = roboclaw.RequestDeframer()
        self._byte_ns = 0  # true time of the latest byte

    @property
    def bad_frames(self) -> int:
        """Return how many requests had a wrong CRC."""
        return self._deframer.bad_frames

    def replies(self, chunk: bytes, now_ns: int, counts: Sequence[int],
                currents: Sequence[float] = NO_CURRENTS,
                speeds: Sequence[float] = NO_SPEEDS) -> bytes:
        """
        Return the replies to the bytes that the host has sent up to true time ``now_ns``.

        ``counts`` are the encoder counts since the start, ``currents`` [A] have the sign that the
        boards report, ``speeds`` are in counts per second.
        """
        if chunk and now_ns - self._byte_ns > PACKET_GAP_NS:
            self._deframer.clear()
        if chunk:
            self._byte_ns = now_ns
        requests = map(roboclaw.decode_request, self._deframer.extract(chunk))
        return b''.join(board.reply(request, now_ns, counts, currents, speeds)
                        for request in requests for board in self._boards
                        if board.address == request.address)

    def duty(self, now_ns: int) -> Four:
        """Return the duties [-1, 1] of the motors at true time ``now_ns``."""
        return four(duty for board in self._boards for duty in board.duty(now_ns))


class _Board:
    """One RoboClaw with the motors ``motor`` and ``motor + 1`` of ``WHEELS``."""

    def __init__(self, address: int, motor: int) -> None:
        self.address = address
        self._motors = (motor, motor + 1)
        self._duty = (0.0, 0.0)
        self._timeout = 0         # in roboclaw.TIMEOUT_RESOLUTION; 0 disables it
        self._request_ns = 0      # true time of the latest request

    def duty(self, now_ns: int) -> tuple[float, float]:
        """Return the duties; both are zero after a time-out without a request."""
        timeout_ns = round(self._timeout * roboclaw.TIMEOUT_RESOLUTION * NS_PER_S)
        if timeout_ns and now_ns - self._request_ns > timeout_ns:
            self._duty = (0.0, 0.0)
        return self._duty

    def reply(self, request: roboclaw.Request, now_ns: int, counts: Sequence[int],
              currents: Sequence[float], speeds: Sequence[float]) -> bytes:
        """Execute ``request`` and return the reply."""
        self.duty(now_ns)  # after a time-out the motors stay stopped until the next duty
        self._request_ns = now_ns
        if request.command == roboclaw.SET_DUTY:
            first, second = map(roboclaw.duty_from_code, request.values)
            self._duty = (first, second)
        elif request.command == roboclaw.SET_TIMEOUT:
            (self._timeout,) = request.values
        if request.command == roboclaw.READ_VERSION:
            return roboclaw.encode_text_reply(self.address, request.command, VERSION)
        values = {
            roboclaw.READ_TIMEOUT: (self._timeout,),
            roboclaw.READ_BATTERY: (SUPPLY_VOLTAGE_CODE,),
            roboclaw.READ_ENCODERS: tuple(counts[motor] % roboclaw.COUNT_WRAP
                                          for motor in self._motors),
            roboclaw.READ_SPEEDS: tuple(round(speeds[motor]) for motor in self._motors),
            roboclaw.READ_CURRENTS: tuple(roboclaw.current_code(currents[motor])
                                          for motor in self._motors),
            roboclaw.READ_STATUS: (0,),
        }.get(request.command, ())
        return roboclaw.encode_reply(self.address, request.command, *values)
