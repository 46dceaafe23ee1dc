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

"""Vibration level from the vertical accelerometer, which planar motion does not excite."""

from __future__ import annotations

import math

VIBRATION_WINDOW = 1.0  # s, time constant of mean and variance
MIN_NOISE_RATIO = 1.5   # standard deviation over the IMU's noise below which none is reported


class VibrationMonitor:
    """
    Standard deviation of the vertical specific force in excess of the IMU's noise.

    Cleats, grooves and rough ground vibrate a robot with a hundred times the noise of its IMU,
    along all axes alike. In the horizontal axes vibration and acceleration cannot be separated.
    """

    def __init__(self, noise: float) -> None:
        self._noise = noise  # m/s2, standard deviation of a sample
        self._last: tuple[float, float] | None = None  # time [s], mean [m/s2]
        self._variance = 0.0

    def update(self, time: float, force_z: float) -> None:
        """Add the vertical specific force [m/s2] at ``time`` [s]."""
        if self._last is None:
            self._last = time, force_z
            return
        before, mean = self._last
        gain = 1.0 - math.exp(-max(0.0, time - before) / VIBRATION_WINDOW)
        self._last = time, mean + gain * (force_z - mean)
        self._variance += gain * ((force_z - mean) ** 2 - self._variance)

    @property
    def sigma(self) -> float:
        """Return the standard deviation [m/s2] of the vibration; 0 if hidden by noise."""
        if self._variance < (MIN_NOISE_RATIO * self._noise) ** 2:
            return 0.0
        return math.sqrt(self._variance - self._noise ** 2)
