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

"""The wheel speed controller before: PID on the set points and the readings as they are."""

from __future__ import annotations

from smart_tire.samples import Four

FEED_FORWARD = 0.045  # s/rad
PROPORTIONAL = 0.04   # s/rad
INTEGRAL = 0.15       # 1/rad
RATE_LIMIT = 4.0      # 1/s
LIMIT = 1.0
STANDSTILL_SPEED = 0.1  # rad/s


class PreviousWheelControl:
    """PID with feed-forward and conditional integration, with the defaults that it had."""

    def __init__(self, rate: float) -> None:
        self._dt = 1.0 / rate
        self._measured: Four = (0.0, 0.0, 0.0, 0.0)
        self._integral, self._output = [0.0] * 4, [0.0] * 4

    def add_reading(self, velocity: Four) -> None:
        """Set the measured wheel speeds [rad/s]."""
        self._measured = velocity

    def step(self, set_point: float) -> Four:
        """Return the duties for a common set point [rad/s]."""
        a, b, c, d = (self._duty(wheel, set_point) for wheel in range(4))
        return a, b, c, d

    def _duty(self, wheel: int, set_point: float) -> float:
        error = set_point - self._measured[wheel]
        if set_point == 0.0 and abs(error) < STANDSTILL_SPEED:
            self._integral[wheel] = self._output[wheel] = 0.0
            return 0.0
        integral = self._integral[wheel] + INTEGRAL * error * self._dt
        wanted = FEED_FORWARD * set_point + PROPORTIONAL * error + integral
        change = wanted - self._output[wheel]
        most = RATE_LIMIT * self._dt
        output = self._output[wheel] + min(max(change, -most), most)
        output = min(max(output, -LIMIT), LIMIT)
        if output == wanted or (wanted - output) * error < 0.0:
            self._integral[wheel] = integral
        self._output[wheel] = output
        return output
