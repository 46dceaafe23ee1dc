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

"""Encoder of one wheel: unwrapped angle, and plausibility against the duty of the motor."""

from __future__ import annotations

import math

from smart_tire.protocol.roboclaw import count_step

MAX_SPEED = 100.0           # rad/s; a larger step of the counts means that the board lost them
MIN_DRIVING_DUTY = 0.05     # -, below it gear friction may stop a wheel
MIN_ROLLING_SPEED = 0.5     # rad/s, above it a wheel counts as rolling
MIN_ROLLING_COUNTS = 5      # counts of a rolling wheel within the stall time
BRAKING_SPEED_RATIO = 0.85  # -, speed over initial speed below which a wheel is slowing down
# Motor torque against the rotation over stall torque, duty + speed / free speed. The tire force
# can keep a wheel rotating against it up to friction * load * radius: 0.47 * 26.7 N * 0.087 m is
# 0.22 of a stall torque of 5 N m, and about twice that on surfaces with high friction.
MAX_OPPOSING_TORQUE = 0.5


class WheelEncoder:
    """Unwraps the counts of one encoder; ``sign`` is -1 if it counts backwards."""

    def __init__(self, sign: int, counts_per_revolution: float) -> None:
        self.sign = sign
        self._radians_per_count = math.tau / counts_per_revolution
        self._count: int | None = None
        self.position = 0.0  # rad, unwrapped
        self.step = 0.0      # rad, of the latest reading
        self.jumped = False  # whether the latest step exceeded MAX_SPEED

    def update(self, count: int, elapsed: float) -> None:
        """Update the angle with a count read ``elapsed`` seconds after the previous one."""
        self.step, self.jumped = 0.0, False
        if self._count is not None and elapsed > 0.0:
            step = self.sign * count_step(count, self._count) * self._radians_per_count
            self.jumped = abs(step) > MAX_SPEED * elapsed
            if not self.jumped:
                self.position += step
                self.step = step
        self._count = count

    @property
    def resolution(self) -> float:
        """Return the angle of one count [rad]."""
        return self._radians_per_count


class MotionCheck:
    """
    Compares the encoder counts of a wheel with the duty of its motor.

    A wheel that was rolling and stops while its duty continues, or that does not start at
    ``stall_duty``, is blocked or its encoder is broken. A wheel that rotates against a large motor
    torque without slowing down has a reversed encoder or motor. Both are faults after
    ``stall_time`` [s], which is short enough for zero duty within 0.5 s. ``free_speed`` [rad/s] is
    the speed of the unloaded motor at full duty, ``resolution`` the angle of one count [rad].
    """

    def __init__(self, resolution: float, free_speed: float, stall_duty: float,
                 stall_time: float) -> None:
        self._free_speed = free_speed
        self._stall_duty, self._stall_time = stall_duty, stall_time
        self._rolling_speed = max(MIN_ROLLING_SPEED, MIN_ROLLING_COUNTS * resolution / stall_time)
        self.reset()

    def reset(self) -> None:
        """Reset all timers, after a pause in the readings."""
        self._rolling = 0         # direction of the latest motion, 0 if it was not rolling
        self._still = 0.0         # s without a count under duty
        self._opposed = 0.0       # s of rotation against the torque without slowing down
        self._opposed_from = 0.0  # rad/s, speed at the start of that time

    def update(self, duty: float, step: float, elapsed: float) -> str:
        """
        Check a reading: angle ``step`` [rad] in ``elapsed`` [s] under ``duty`` [-1, 1].

        Returns a description of the fault, '' if there is none.
        """
        return self._check_still(duty, step, elapsed) or self._check_opposed(duty, step, elapsed)

    def _check_still(self, duty: float, step: float, elapsed: float) -> str:
        if step != 0.0:
            rolls = abs(step) >= self._rolling_speed * elapsed
            self._rolling = int(math.copysign(rolls, step))
            self._still = 0.0
        elif abs(duty) < (MIN_DRIVING_DUTY if duty * self._rolling > 0.0 else self._stall_duty):
            self._rolling, self._still = 0, 0.0
        else:
            self._still += elapsed
        if self._still < self._stall_time:
            return ''
        return f'no encoder counts under duty {duty:.2f}: wheel blocked or encoder broken'

    def _check_opposed(self, duty: float, step: float, elapsed: float) -> str:
        speed = abs(step) / elapsed
        if (duty * step >= 0.0 or speed < MIN_ROLLING_SPEED
                or abs(duty) + speed / self._free_speed < MAX_OPPOSING_TORQUE):
            self._opposed = self._opposed_from = 0.0
        elif speed < BRAKING_SPEED_RATIO * self._opposed_from or self._opposed_from == 0.0:
            self._opposed, self._opposed_from = 0.0, speed
        else:
            self._opposed += elapsed
        if self._opposed < self._stall_time:
            return ''
        return f'turns against duty {duty:.2f}: encoder or motor reversed'
