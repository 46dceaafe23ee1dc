# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Core of ``motor_driver``: the output stage with its boards, on any clock."""

from __future__ import annotations

from collections.abc import Callable

from smart_tire.control.duty_gate import DutyGate
from smart_tire.drivers.clock import Clock, SYSTEM
from smart_tire.drivers.roboclaw_pair import RoboclawPair
from smart_tire.parameters.hardware import MotorDriverParams
from smart_tire.samples import MotorCommand, WheelSample

ZERO_DUTY_TIMEOUT = 0.4    # s for the boards to acknowledge an emergency stop
PUBLISHERS = 'publishers'  # name of the hold while several nodes command


class MotorOutput:
    """
    Commands, stops and releases to the motors; what it changes acts at once.

    ``deliver`` is called with the wheel samples, ``report`` with each reason to stop, ``watch``
    when something else may have changed at the gate.
    """

    def __init__(self, params: MotorDriverParams, deliver: Callable[[WheelSample], None],
                 report: Callable[[str], None], watch: Callable[[], None] = lambda: None,
                 clock: Clock = SYSTEM) -> None:
        self._clock = clock
        self.gate = DutyGate(params.command_timeout, report, stopped=params.start_stopped,
                             require_arming=params.require_arming,
                             release_hold_off=params.release_hold_off)
        self.boards = RoboclawPair(params, self.gate, deliver, watch, clock)

    def set_command(self, command: MotorCommand, received_ns: int) -> None:
        """Apply a command whose time-out counts from ``received_ns``."""
        self.gate.command(command.duty, received_ns)
        self.boards.wake()

    def set_conflict(self, reason: str) -> None:
        """Stop the motors while several nodes command, ``reason`` is not empty."""
        if reason:
            self.gate.hold(PUBLISHERS, reason)
            self.boards.wake()
        else:
            self.gate.clear(PUBLISHERS)

    def engage(self) -> None:
        """Latch the emergency stop."""
        self.gate.engage(self._clock.now_ns())
        self.boards.wake()

    def unconfirmed(self) -> list[str]:
        """Return the boards that do not acknowledge zero duty in time."""
        return self.boards.await_zero(ZERO_DUTY_TIMEOUT)

    def release(self) -> str:
        """Release the emergency stop; return why that is refused, '' if it is released."""
        return self.gate.release(self._clock.now_ns())

    def arm(self, armed: bool) -> list[str]:
        """Arm or disarm; return the causes that prevent arming, empty on success."""
        causes = self.gate.arm(armed)
        self.boards.wake()
        return causes
