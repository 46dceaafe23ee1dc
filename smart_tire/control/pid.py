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

"""PID controller with feed-forward, output and rate limits, and anti-windup."""

from __future__ import annotations

from smart_tire.parameters.control import PidParams


class Pid:
    """Speed controller of one wheel: speed [rad/s] to duty [-1, 1]."""

    def __init__(self, params: PidParams) -> None:
        self.params = params  # may be replaced at run time: the integral is a duty
        self.reset()

    def reset(self) -> None:
        """Set integral and output to zero and discard the previous measurement."""
        self._integral = 0.0
        self._output = 0.0
        self._measured: float | None = None

    def update(self, set_point: float, measured: float, dt: float) -> float:
        """
        Return the duty after ``dt`` seconds, within its magnitude and rate limits.

        The derivative term acts on the measurement, so a step of the set point causes no spike.
        The integral is frozen while a limit is active and the error would increase the excess.
        """
        params = self.params
        error = set_point - measured
        slope = 0.0 if self._measured is None else (measured - self._measured) / dt
        integral = self._integral + params.integral * error * dt
        sum_ = (params.feed_forward * set_point + params.proportional * error + integral
                - params.derivative * slope)
        output = self._limited(sum_, dt)
        if output == sum_ or (sum_ - output) * error < 0.0:
            self._integral = integral
        self._measured, self._output = measured, output
        return output

    def _limited(self, output: float, dt: float) -> float:
        step = self.params.rate_limit * dt
        output = min(max(output, self._output - step), self._output + step)
        return min(max(output, -self.params.limit), self.params.limit)
