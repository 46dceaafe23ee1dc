# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One motor board: its encoders and latest replies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
import math
import time

from smart_tire.drivers.roboclaw_line import RoboclawLine
from smart_tire.drivers.wheel_encoder import MotionCheck, Reading, WheelEncoder
from smart_tire.models.vehicle.drive import measured_torque
from smart_tire.parameters.hardware import MotorDriverParams
from smart_tire.protocol.roboclaw import current_from_code, READ_CURRENTS
from smart_tire.samples import NAN, NS_PER_S

CHECK_PERIOD_NS = 45_000_000     # between checks of the motion: four or more in a stall time
CURRENT_RETRY_PERIOD = 0.25      # s, after the second missing reply; doubles with each further
MAX_CURRENT_RETRY_PERIOD = 10.0  # s, also between requests to a board without that command
MAX_CURRENT_RATE = 50.0    # Hz, of readings of the currents of a board
MAX_CURRENT_WAIT = 0.02    # s for a reply with currents, at most one poll period
MIN_MISSING_CURRENTS = 4   # consecutive missing replies that are reported


@dataclass
class Board:
    """One board with the encoders of its axle and its latest replies."""

    address: int
    name: str
    encoders: list[WheelEncoder]
    checks: list[MotionCheck]
    read_ns: int | None = None   # steady clock, latest reading of the encoders
    elapsed_ns: int = 0          # between the two latest readings
    sampled: list[float] = field(default_factory=lambda: [0.0, 0.0])  # rad, at the last sample
    span_ns: int = 0             # since the last sample
    duty: tuple[float, float] = (0.0, 0.0)  # at the motor terminals, as acknowledged
    zero_replies: int = 0        # consecutive acknowledgments of zero duty
    torques: tuple[float, ...] = (NAN, NAN)  # N m, forward, at the wheels; of the latest poll
    measured: tuple[tuple[float, float], ...] = ()  # duties and torques since the last check
    checked_ns: int = 0          # steady clock, of the readings of the latest check
    missing_currents: int = 0    # consecutive requests for currents without a good reply
    currents_ns: int = 0         # steady clock, before which currents are not requested
    low_readings: int = 0        # of the supply voltage, consecutive
    supply_voltage: float = math.nan  # V

    def reset(self) -> None:
        """Discard readings from before a pause."""
        self.read_ns, self.measured = None, ()
        self.begin_span()
        for check in self.checks:
            check.reset()

    def check_motion(self) -> list[str]:
        """Return a fault of each wheel, '' if there is none; at most every ``CHECK_PERIOD``."""
        if self.read_ns is None or self.read_ns - self.checked_ns < CHECK_PERIOD_NS:
            return []
        measured = self.measured or [(duty, NAN) for duty in self.forward_duty()]
        self.checked_ns, self.measured = self.read_ns, ()
        return [check.check_reading(Reading(self.read_ns / NS_PER_S, encoder.position, *driven))
                for encoder, check, driven in zip(self.encoders, self.checks, measured)]

    def forward_duty(self) -> list[float]:
        """Return the duties, positive driving forward."""
        return [encoder.sign * duty for encoder, duty in zip(self.encoders, self.duty)]

    def begin_span(self) -> None:
        """Begin a new period of the mean speeds."""
        self.sampled, self.span_ns = [encoder.position for encoder in self.encoders], 0

    def mean_speeds(self) -> list[float]:
        """Return the mean speeds [rad/s] of both wheels since the last sample."""
        positions = [encoder.position for encoder in self.encoders]
        elapsed = self.span_ns / NS_PER_S
        return [(new - old) / elapsed for old, new in zip(self.sampled, positions)]

    def postpone_currents(self, now_ns: int) -> None:
        """Count a missing reply; after the second one, wait longer each time."""
        if self.missing_currents:
            doublings = min(self.missing_currents - 1, 10)
            wait = min(CURRENT_RETRY_PERIOD * 2**doublings, MAX_CURRENT_RETRY_PERIOD)
            self.currents_ns = now_ns + round(wait * NS_PER_S)
        self.missing_currents += 1


class CurrentReader:
    """Reads currents and writes the torques into the boards."""

    def __init__(self, params: MotorDriverParams, boards: Sequence[Board], line: RoboclawLine,
                 poll_period: float) -> None:
        self._params, self._boards, self._line = params, boards, line
        self._polls = 0
        self._interval = math.ceil(1.0 / (poll_period * MAX_CURRENT_RATE))  # in polls
        self._wait = min(MAX_CURRENT_WAIT, poll_period)  # s
        self.missing = 0   # requests for currents without a good reply
        self.rejected = 0  # currents beyond ``max_current``

    def silent_boards(self) -> list[str]:
        """Return the boards that do not report the currents of their motors."""
        return [board.name for board in self._boards
                if board.missing_currents >= MIN_MISSING_CURRENTS]

    def read(self, before_each: Callable[[], None]) -> None:
        """Read the boards whose turn it is, those that may not reply last."""
        self._polls += 1
        due = []
        for index, board in enumerate(self._boards):
            board.torques = NAN, NAN
            turn = self._polls + index * (self._interval // 2)
            if not turn % self._interval and time.monotonic_ns() >= board.currents_ns:
                due.append(board)
        for board in sorted(due, key=lambda board: board.missing_currents):
            before_each()
            self._read_torques(board)

    def _read_torques(self, board: Board) -> None:
        codes = self._line.ask(board.address, READ_CURRENTS, self._wait)
        if codes is None:
            self.missing += 1
            board.postpone_currents(time.monotonic_ns())
            return
        board.missing_currents = 0
        currents = map(current_from_code, codes)
        board.torques = tuple(map(self._torque, currents, board.duty, board.encoders,
                                  board.mean_speeds()))
        board.measured = tuple(zip(board.forward_duty(), board.torques))

    def _torque(self, current: float, duty: float, encoder: WheelEncoder, speed: float) -> float:
        """Return the torque [N m] of ``current`` [A]; NaN if that is not plausible."""
        if not abs(current) <= self._params.max_current:
            self.rejected += 1
            return NAN
        motor = self._params.robot.motor
        return encoder.sign * measured_torque(
            current, duty, encoder.sign * speed, torque_constant=motor.torque_constant,
            current_sign=motor.current_sign)
