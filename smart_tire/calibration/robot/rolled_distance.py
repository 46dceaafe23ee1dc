"""What the wheels rolled between any two times, and what may be lost of it by sliding."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.calibration.recording import angles_between, WheelRecord
from smart_tire.samples import LEFT, RIGHT

PIVOT = 0.8  # difference of the sides over their sum: more is a turn in place


@dataclass(frozen=True)
class Rolled:
    """What the wheels rolled over a stretch of time."""

    angle: float    # rad, mean of the four
    lost: float     # rad, integral of (w_R - w_L)^2 / (4 w): what sides that slide alike may lose
    pivoted: float  # rad, of half the sides' difference in turns in place
    gained: float   # rad2/s2, half of the change of w |w|


class RolledWheels:
    """Reads a recording of the wheels between any two times [s] by its stamps."""

    def __init__(self, wheels: WheelRecord) -> None:
        turned, whole = angles_between(wheels)
        gap, mean = np.diff(wheels.time), turned.mean(axis=1)
        apart = 0.5 * np.abs(turned[:, RIGHT].mean(axis=1) - turned[:, LEFT].mean(axis=1))
        lost = np.sign(mean) * apart * np.minimum(1.0, apart / np.maximum(np.abs(mean), 1e-9))
        pivoted = np.where(apart > PIVOT * np.abs(mean), apart, 0.0)
        steps = np.stack([mean, lost, pivoted], axis=1)
        self._time = wheels.time
        self._sums = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
        self._holes = np.concatenate([[0], np.cumsum(~whole)])
        self._middle, self._speed = wheels.time[1:] - 0.5 * gap, mean / gap

    def between(self, begin: float, end: float) -> Rolled | None:
        """Return what was rolled; None where it was not recorded throughout."""
        before, after = np.searchsorted(self._time, (begin, end))
        if before == 0 or after == len(self._time) or (
                self._holes[after] > self._holes[before - 1]):
            return None
        angle, lost, pivoted = (
            float(np.diff(np.interp((begin, end), self._time, sums))[0]) for sums in self._sums.T)
        slow, fast = np.interp((begin, end), self._middle, self._speed).tolist()
        gained = 0.5 * (math.copysign(fast * fast, fast) - math.copysign(slow * slow, slow))
        return Rolled(angle, lost, pivoted, gained)
