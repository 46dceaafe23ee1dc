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

"""Wheel rotation between two times, and the slip of turns that goes with it."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.calibration.recording import rotation_increments, side_slip, WheelRecord
from smart_tire.samples import LEFT, RIGHT

PIVOT_RATIO = 0.8  # half difference of the sides over their mean: above, the robot turns in place


@dataclass(frozen=True)
class WheelRotation:
    """Wheel rotation over a time interval."""

    angle: float         # rad, mean of the four wheels
    side_slip: float     # rad, integral of (w_R - w_L)^2 / (4 w): lost if both sides slip equally
    pivot_angle: float   # rad, half the difference of the sides in turns in place
    speed_change: float  # rad2/s2, half the change of w |w|


class WheelRotationLog:
    """Wheel rotation of a recording between any two times [s] of its timestamps."""

    def __init__(self, wheels: WheelRecord) -> None:
        rotation, complete = rotation_increments(wheels)
        gap, mean = np.diff(wheels.time), rotation.mean(axis=1)
        half_difference = 0.5 * np.abs(
            rotation[:, RIGHT].mean(axis=1) - rotation[:, LEFT].mean(axis=1))
        pivot_angle = np.where(half_difference > PIVOT_RATIO * np.abs(mean), half_difference, 0.0)
        steps = np.stack([mean, side_slip(mean, half_difference), pivot_angle], axis=1)
        self._time = wheels.time
        self._sums = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
        self._missing = np.concatenate([[0], np.cumsum(~complete)])
        self._center, self._speed = wheels.time[1:] - 0.5 * gap, mean / gap

    def between(self, begin: float, end: float) -> WheelRotation | None:
        """Return the rotation; None if a part of it is not recorded."""
        before, after = np.searchsorted(self._time, (begin, end))
        if before == 0 or after == len(self._time) or (
                self._missing[after] > self._missing[before - 1]):
            return None
        angle, slip, pivot_angle = (
            float(np.diff(np.interp((begin, end), self._time, sums))[0]) for sums in self._sums.T)
        slow, fast = np.interp((begin, end), self._center, self._speed).tolist()
        speed_change = 0.5 * (math.copysign(fast * fast, fast) - math.copysign(slow * slow, slow))
        return WheelRotation(angle, slip, pivot_angle, speed_change)
