# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Currents of the motors of both boards, read after everything else.

Without them only the torques are missing, so no other request waits for them longer than
``MAX_CURRENT_WAIT``, and at high rates not every poll has them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
import time

from smart_tire.drivers.roboclaw_board import Board
from smart_tire.drivers.roboclaw_line import RoboclawLine
from smart_tire.drivers.wheel_encoder import WheelEncoder
from smart_tire.models.vehicle.drive import measured_torque
from smart_tire.parameters.hardware import MotorDriverParams
from smart_tire.protocol.roboclaw import current_from_code, READ_CURRENTS
from smart_tire.samples import NAN

MAX_CURRENT_RATE = 50.0    # Hz, of readings of the currents of a board
MAX_CURRENT_WAIT = 0.02    # s for a reply with currents, at most one poll period
MIN_MISSING_CURRENTS = 4   # consecutive missing replies that are reported


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
