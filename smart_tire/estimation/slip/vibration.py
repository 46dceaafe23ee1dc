"""How much a robot shakes, read off the one axis on which a planar motion shows nothing."""

from __future__ import annotations

import math

MEMORY = 1.0   # s, of mean and variance
NOTABLE = 1.5  # times the unit's own noise; less is not told from it


class VibrationMonitor:
    """
    Standard deviation of the vertical specific force beyond the unit's own noise.

    Wheels with cleats, grooves and rough ground shake a robot by a hundred times the noise of
    its unit, along all axes alike. Horizontally that hides among true accelerations.
    """

    def __init__(self, noise: float) -> None:
        self._noise = noise  # m/s2, one sigma of a sample
        self._last: tuple[float, float] | None = None  # time [s], mean [m/s2]
        self._variance = 0.0

    def push(self, time: float, force_z: float) -> None:
        """Take in a specific force [m/s2] along the vertical axis at ``time`` [s]."""
        if self._last is None:
            self._last = time, force_z
            return
        before, mean = self._last
        gain = 1.0 - math.exp(-max(0.0, time - before) / MEMORY)
        self._last = time, mean + gain * (force_z - mean)
        self._variance += gain * ((force_z - mean) ** 2 - self._variance)

    @property
    def sigma(self) -> float:
        """One sigma [m/s2] of the shaking; 0 where it does not stand out of the noise."""
        if self._variance < (NOTABLE * self._noise) ** 2:
            return 0.0
        return math.sqrt(self._variance - self._noise ** 2)
