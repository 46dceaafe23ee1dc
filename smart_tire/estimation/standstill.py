"""Standstill, seen by wheels and inertial unit together, never assumed."""

from __future__ import annotations

from collections import deque
import math

WINDOW = 0.4        # s that the inertial unit must have been quiet
MIN_SAMPLES = 4     # in the window
NOISE_FACTOR = 3.0  # times the unit's own noise counts as quiet
STILL_WHEEL = 0.01  # m/s of wheel surface; less is a count of the encoder

Reading = tuple[float, float, float]  # rate about z [rad/s], specific force x, y [m/s2]


class Standstill:
    """
    Tells whether the robot stands: wheels at rest and the inertial unit quiet for a while.

    A robot that is pushed evenly with locked wheels looks the same to the unit; its owner must
    also believe the speed to be small, or wait.
    """

    def __init__(self, gyro_noise: float, accel_noise: float) -> None:
        self._limits = (NOISE_FACTOR * gyro_noise, *(NOISE_FACTOR * accel_noise,) * 2)
        self.reset()

    def reset(self) -> None:
        """Forget all readings."""
        self._window: deque[tuple[float, Reading]] = deque()
        self._quiet_since: float | None = None

    def push(self, time: float, reading: Reading) -> None:
        """Take in a reading of the inertial unit at ``time`` [s]."""
        window = self._window
        window.append((time, reading))
        while window[0][0] < time - WINDOW:
            window.popleft()

    def rest(self, time: float, wheel_speed: float) -> tuple[float, float] | None:
        """
        Return (mean rate about z [rad/s], seconds of rest so far), or None if something moves.

        ``wheel_speed`` [m/s] is the fastest wheel's; to be called at each wheel reading.
        """
        quiet = wheel_speed < STILL_WHEEL and self._is_quiet()
        if not quiet:
            self._quiet_since = None
            return None
        if self._quiet_since is None:
            self._quiet_since = time
        rate = sum(reading[0] for _, reading in self._window) / len(self._window)
        return rate, time - self._quiet_since

    def _is_quiet(self) -> bool:
        count = len(self._window)
        if count < MIN_SAMPLES or self._window[-1][0] - self._window[0][0] < 0.75 * WINDOW:
            return False
        columns = zip(*(reading for _, reading in self._window))
        return all(_spread(column, count) < limit
                   for column, limit in zip(columns, self._limits))


def _spread(values: tuple[float, ...], count: int) -> float:
    mean = sum(values) / count
    return math.sqrt(sum((value - mean) ** 2 for value in values) / count)
