# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How far the accelerometer shows motion on unknown ground, learned from the wheels."""

from __future__ import annotations

import math

from smart_tire.estimation.slip.state import (
    LEARNING_TIME, SLIP_CHANGE_SHARE, SLIP_CORRELATION_TIME)


class AccelerometerModel:
    """
    Regression of a reference speed on the integral of an acceleration, over the past driving.

    What the accelerometer is to show is slip, which lasts for ``SLIP_CORRELATION_TIME``: so both
    pass the same high-pass filter of this time. ``share`` is the slope of the regression, in
    [0, 1]: the part of the acceleration that is motion. The rest, beyond the slip by changes of
    the speed, is the effect of white noise of the acceleration of ``density`` [(m/s2)^2 s].

    The prior is a perfect sensor on a robot whose speed is a random walk of ``walk`` [m/s per
    sqrt(s)]; it stays in the slope, so that a steady drive does not forget it.
    """

    def __init__(self, walk: float) -> None:
        self.share, self.density = 1.0, 0.0
        self._prior = 0.5 * walk ** 2 * SLIP_CORRELATION_TIME  # (m/s)^2, of the filtered walk
        self._integral = 0.0              # m/s, filtered
        self._sum = self._time = 0.0      # m and s, of the integral since the last speed
        self._reference = 0.0             # m/s, filtered
        self._speed: float | None = None  # m/s, last one
        self._moments = [0.0, 0.0, 0.0]   # (m/s)^2, of reference, both, integral

    def add_acceleration(self, acceleration: float, dt: float) -> None:
        """Add the acceleration [m/s2] over a step of ``dt`` [s]."""
        before = self._integral
        self._integral = math.exp(-dt / SLIP_CORRELATION_TIME) * before + acceleration * dt
        self._sum += 0.5 * dt * (before + self._integral)
        self._time += dt

    def add_speed(self, speed: float, dt: float, *, learn: bool) -> None:
        """Add the mean reference speed [m/s] over the past ``dt`` [s]."""
        if self._speed is not None and self._time > 0.0:
            self._reference = (math.exp(-dt / SLIP_CORRELATION_TIME) * self._reference
                               + speed - self._speed)
            if learn:
                self._learn(self._reference, self._sum / self._time,
                            min(dt / LEARNING_TIME, 1.0))
        self._speed, self._sum, self._time = speed, 0.0, 0.0

    def _learn(self, reference: float, integral: float, gain: float) -> None:
        products = reference * reference, reference * integral, integral * integral
        self._moments = [old + gain * (new - old) for old, new in zip(self._moments, products)]
        square, mixed, own = self._moments
        self.share = min(max((mixed + self._prior) / (own + self._prior), 0.0), 1.0)
        residual = ((1.0 - SLIP_CHANGE_SHARE ** 2) * square
                    - self.share * (2.0 * mixed - self.share * own))
        self.density = 2.0 * max(residual, 0.0) / SLIP_CORRELATION_TIME
