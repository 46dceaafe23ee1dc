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

"""PID controller with two degrees of freedom, output and rate limits, and anti-windup."""

from __future__ import annotations

from smart_tire.control.drive_model import Gains
from smart_tire.parameters.control import PidParams


class Pid:
    """
    Feedback of one wheel: duty [-1, 1] of the feed-forward, corrected by the speed error.

    The integral is a duty. Changes of the gains or of the feed-forward at run time change it such
    that the output remains; limits act at once.
    """

    def __init__(self, params: PidParams) -> None:
        self._params = params
        self._gains = Gains(params.proportional, params.integral, params.derivative)
        self.reset()

    def reset(self) -> None:
        """Set integral and output to zero."""
        self._integral = 0.0
        self._output = 0.0
        self.excess = 0.0  # duty that the limits cut off
        self._error = self._slope = 0.0

    def set_gains(self, params: PidParams, gains: Gains) -> None:
        """Use the limits of ``params`` and these ``gains`` from now on, without a jump."""
        self._params = params
        if gains != self._gains:
            before = self._proportional_derivative(self._error, self._slope)
            self._gains = gains
            self._integral += before - self._proportional_derivative(self._error, self._slope)

    def compensate(self, change: float) -> None:
        """Make up for a ``change`` of the feed-forward duty by its parameters."""
        self._integral -= change

    def update(self, feed_forward: float, error: float, slope: float, dt: float, *,
               current: bool = True) -> float:
        """
        Return the duty after ``dt`` [s], within its limits of magnitude and rate.

        ``error`` [rad/s] is the speed error, ``slope`` [rad/s2] the measured acceleration: a step
        of the set point causes no spike of the derivative. Unless the error is ``current``, the
        integral is held. So it is while a limit is active and the error would increase the excess
        (conditional integration); an integral that causes the excess of a magnitude limit decays
        with the tracking time (back-calculation).
        """
        self._error, self._slope = error, slope
        partial = feed_forward + self._proportional_derivative(error, slope)
        integral = self._integral + (self._gains.integral * error * dt if current else 0.0)
        output = self._limited(partial + integral, dt)
        if (partial + integral - output) * error > 0.0:
            integral = self._integral
        self._integral = self._unwound(partial, integral, dt)
        self._output, self.excess = output, partial + self._integral - output
        return output

    def _proportional_derivative(self, error: float, slope: float) -> float:
        return self._gains.proportional * error - self._gains.derivative * slope

    def _unwound(self, partial: float, integral: float, dt: float) -> float:
        """Return the integral after back-calculation, which does not change its sign."""
        sum_, limit = partial + integral, self._params.limit
        excess = sum_ - min(max(sum_, -limit), limit)
        if excess * integral <= 0.0:
            return integral
        step = min(abs(excess) * min(dt / self._params.tracking_time, 1.0), abs(integral))
        return integral - (step if integral > 0.0 else -step)

    def _limited(self, output: float, dt: float) -> float:
        step = self._params.rate_limit * dt
        output = min(max(output, self._output - step), self._output + step)
        return min(max(output, -self._params.limit), self._params.limit)
