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

"""Noise of the IMU in motion, which vibration increases."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.calibration.recording import Recording
from smart_tire.numerics.robust import noise_level

WINDOW = 1.0            # s
STATIONARY_SPEED = 0.1  # rad/s, of wheels at standstill


def motion_noise(recordings: Sequence[Recording], signal: str, axes: Sequence[int]) -> float:
    """
    Return the median noise of windows in motion, 0 if there are none.

    ``signal`` is ``rate`` or ``force`` of the IMU, ``axes`` the columns.
    """
    levels = []
    for recording in recordings:
        imu, wheels = recording.imu, recording.wheels
        values = getattr(imu, signal)
        for begin in np.arange(wheels.time[0], wheels.time[-1] - WINDOW, WINDOW):
            first, last = np.searchsorted(wheels.time, (begin, begin + WINDOW))
            speed = np.abs(wheels.velocity[first:last]).max(axis=1)
            if len(speed) and speed.min() > STATIONARY_SPEED:
                inside = (imu.time >= begin) & (imu.time < begin + WINDOW)
                levels.append(math.sqrt(np.mean(
                    [noise_level(values[inside, axis]) ** 2 for axis in axes])))
    return float(np.median(levels)) if levels else 0.0
