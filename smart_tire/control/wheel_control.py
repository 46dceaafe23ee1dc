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

"""Wheel speed controller with command and feedback time-outs."""

from __future__ import annotations

from collections.abc import Sequence
import math

from smart_tire.control.differential_drive import wheel_speeds
from smart_tire.control.duty_gate import STOPPED
from smart_tire.control.pid import Pid
from smart_tire.control.traction import TractionControl
from smart_tire.parameters.control import WheelControllerParams
from smart_tire.samples import Four, NS_PER_S, VelocityCommand

MAX_STEP_PERIODS = 4    # upper limit of the time step of the controllers, in periods
STANDSTILL_SPEED = 0.1  # rad/s; a slower wheel with a set point of zero gets no duty


class WheelControl:
    """
    Speed control of the four wheels; all times are nanoseconds of one steady clock.

    The duty is zero without a command, without wheel speeds for ``wheel_states_timeout``, and
    while the emergency stop is engaged.
    """

    def __init__(self, params: WheelControllerParams) -> None:
        self._pids = [Pid(params.pid) for _ in STOPPED]
        self._measured = STOPPED
        self._measured_ns: int | None = None
        self._stepped_ns: int | None = None
        self.traction = TractionControl(params.traction, params.robot)
        self.emergency_stop = False  # whether the emergency stop is engaged
        self.motors_enabled = True   # whether the duties reach the motors
        self.set_params(params)

    def set_params(self, params: WheelControllerParams) -> None:
        """Use these parameters from now on."""
        self._params = params
        self.traction.params = params.traction
        for pid in self._pids:
            pid.params = params.pid

    def update_measurement(self, velocity: Four, now_ns: int) -> None:
        """Set the measured wheel speeds [rad/s]."""
        self._measured, self._measured_ns = velocity, now_ns

    def discard_measurement(self) -> None:
        """Discard the measured wheel speeds; no duty until the next ones."""
        self._measured_ns = None

    def has_measurement(self, now_ns: int) -> bool:
        """Return whether the measured wheel speeds have not timed out."""
        return (self._measured_ns is not None
                and now_ns - self._measured_ns
                <= math.ceil(self._params.wheel_states_timeout * NS_PER_S))

    def follow(self, command: VelocityCommand | None, now_ns: int,
               stamp_ns: int | None = None) -> tuple[Four, Four]:
        """Return the result of ``step`` for a body velocity; None if there is no command."""
        if command is None:
            return self.step(None, now_ns, stamp_ns)
        return self.step(
            wheel_speeds(command, radius=self._params.robot.wheel_radius,
                         effective_track=self._params.effective_track), now_ns, stamp_ns)

    def step(self, velocity: Sequence[float] | None, now_ns: int,
             stamp_ns: int | None = None) -> tuple[Four, Four]:
        """
        Return the set points of the wheel speeds [rad/s] and the duties [-1, 1].

        ``velocity`` [rad/s] are the commanded wheel speeds, None without a valid command. If one
        exceeds ``max_wheel_speed``, all are scaled down by the same factor. While the motors are
        not enabled, the controllers are reset in every step, which prevents windup. ``stamp_ns``
        is the time of the message clock; without it there is no traction control.
        """
        dt = self._elapsed(now_ns)
        driven = velocity is not None and not self.emergency_stop
        set_points = self._limited(velocity) if velocity is not None and driven else STOPPED
        if not driven or not self.has_measurement(now_ns):
            self._reset()
            return set_points, STOPPED
        if not self.motors_enabled:
            self._reset()
        a, b, c, d = (_duty(*wheel, dt) for wheel in zip(self._pids, set_points, self._measured))
        return set_points, (a, b, c, d)

    def _reset(self) -> None:
        for pid in self._pids:
            pid.reset()

    def _limited(self, velocity: Sequence[float]) -> Four:
        excess = max(max(map(abs, velocity)) / self._params.max_wheel_speed, 1.0)
        a, b, c, d = (speed / excess for speed in velocity)
        return a, b, c, d

    def _elapsed(self, now_ns: int) -> float:
        period = 1.0 / self._params.rate
        before, self._stepped_ns = self._stepped_ns, now_ns
        if before is None or now_ns <= before:
            return period
        return min((now_ns - before) / NS_PER_S, MAX_STEP_PERIODS * period)


def _duty(pid: Pid, set_point: float, measured: float, dt: float) -> float:
    if set_point == 0.0 and abs(measured) < STANDSTILL_SPEED:
        pid.reset()
        return 0.0
    return pid.update(set_point, measured, dt)
