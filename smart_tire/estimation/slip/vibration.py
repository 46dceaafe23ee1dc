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
        """Standard deviation [m/s2] of the vibration; 0 if not distinguishable from noise."""
        if self._variance < (MIN_NOISE_RATIO * self._noise) ** 2:
            return 0.0
        return math.sqrt(self._variance - self._noise ** 2)
