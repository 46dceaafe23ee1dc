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

"""Noise levels that the filter learns from its own innovations and estimates."""

from __future__ import annotations

import math

MAX_NIS = 9.0  # of an innovation that a level is learned from: three sigma
ACCEL_BLOCK_TIME = 1.0      # s, beyond which an accelerometer says less than the wheels; assumed
ACCEL_LEARNING_TIME = 10.0  # s, over which the level of its errors is learned


class LearnedScale:
    """
    Standard deviation of a process noise that grows and shrinks until innovations agree with it.

    White innovations (Mehra): those of the same sign in a row show that the filter follows too
    slowly, alternating ones that it follows noise. ``rate`` is the change of the log of the
    variance per unit of disagreement.
    """

    def __init__(self, sigma: float, low: float, high: float, rate: float) -> None:
        self.sigma = sigma
        self._low, self._high, self._rate = low, high, rate
        self._last = 0.0

    def add_innovation(self, normalized: float, weight: float = 1.0) -> None:
        """Add an innovation in units of its standard deviation, that should be white."""
        limit = math.sqrt(MAX_NIS)
        normalized = min(max(normalized, -limit), limit)
        growth = math.exp(0.5 * self._rate * weight * normalized * self._last)
        self.sigma = min(max(self._low, self.sigma * growth), self._high)
        self._last = normalized


class LearnedVariance:
    """Exponential mean of a variance over ``time`` [s], from a prior standard deviation."""

    def __init__(self, sigma: float, floor: float, time: float) -> None:
        self._variance, self._floor, self._time = sigma ** 2, floor ** 2, time
        self.variance = max(self._variance, self._floor)  # at least the square of the floor

    def add(self, square: float, duration: float) -> None:
        """Add a squared value that held for ``duration`` [s]."""
        gain = min(duration / self._time, 1.0)
        self._variance += gain * (square - self._variance)
        self.variance = max(self._variance, self._floor)


class AccelError:
    """
    Level of the error of an accelerometer axis, from the wheels: tilt, slope and suspension.

    Low-passed specific force minus low-passed acceleration by the wheels. Slip that varies is
    taken for an error, too: which of both it is cannot be seen without a known ground.
    """

    def __init__(self, sigma: float, floor: float) -> None:
        self._level = LearnedVariance(sigma, floor, ACCEL_LEARNING_TIME)
        self._density = LearnedVariance(0.0, 0.0, ACCEL_LEARNING_TIME)
        self._force = self._error = 0.0  # m/s2, low-passed force and error
        self._changes = [0.0, 0.0]       # m/s, by the forces in this and the last wheel period
        self._speeds: tuple[float, float] | None = None  # m/s, by the wheels: last, low-passed

    @property
    def variance(self) -> float:
        """Return the variance [(m/s2)^2] of the lasting error."""
        return self._level.variance

    @property
    def density(self) -> float:
        """Return the noise density [(m/s2)^2 s] within wheel periods: bouncing, pitching."""
        return self._density.variance

    def add_force(self, force: float, dt: float) -> None:
        """Add the mean specific force [m/s2] without bias and centripetal part over ``dt``."""
        self._force += -math.expm1(-dt / ACCEL_BLOCK_TIME) * (force - self._force)
        self._changes[0] += dt * force

    def add_speed(self, speed: float, dt: float) -> None:
        """Add the mean speed by the wheels [m/s] over ``dt`` [s]."""
        last, smooth = self._speeds or (speed, speed)
        smooth += -math.expm1(-dt / ACCEL_BLOCK_TIME) * (speed - smooth)
        # means of two periods differ by the mean of the changes in both
        change = 0.5 * sum(self._changes) - (speed - last) - self._error * dt
        self._density.add(min(change ** 2 / dt, MAX_NIS * max(
            self._density.variance, self._level.variance * dt)), dt)
        self._error = self._force - (speed - smooth) / ACCEL_BLOCK_TIME
        self._level.add(self._error ** 2, dt)
        self._speeds, self._changes = (speed, smooth), [0.0, self._changes[0]]
