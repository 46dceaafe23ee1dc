"""The way that the filter went, remembered for readings that describe a stretch of the past."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque

MEMORY = 3.0  # s


class OdometryBuffer:
    """Integrals of forward speed and yaw rate over time, to be read between any two times."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, float, float]] = deque()

    def start(self, time: float) -> None:
        """Begin anew at ``time`` [s]."""
        self._points = deque([(time, 0.0, 0.0)])

    def add(self, time: float, v_x: float, yaw_rate: float) -> None:
        """Append the stretch up to ``time`` [s] with its mean speed [m/s] and rate [rad/s]."""
        last, distance, angle = self._points[-1]
        dt = time - last
        self._points.append((time, distance + v_x * dt, angle + yaw_rate * dt))
        while self._points[0][0] < time - MEMORY:
            self._points.popleft()

    def mean(self, begin: float, end: float) -> tuple[float, float] | None:
        """Return mean speed [m/s] and rate [rad/s]; None if ``begin`` lies before the memory."""
        if end <= begin or len(self._points) < 2 or begin < self._points[0][0] - 1e-9:
            return None
        points = list(self._points)
        (x0, a0), (x1, a1) = self._at(points, begin), self._at(points, end)
        return (x1 - x0) / (end - begin), (a1 - a0) / (end - begin)

    @staticmethod
    def _at(points: list[tuple[float, float, float]], time: float) -> tuple[float, float]:
        """Interpolate; beyond the last point the last stretch goes on."""
        index = min(max(bisect_right(points, (time,)), 1), len(points) - 1)
        (t0, x0, a0), (t1, x1, a1) = points[index - 1], points[index]
        share = (time - t0) / (t1 - t0) if t1 > t0 else 1.0
        return x0 + share * (x1 - x0), a0 + share * (a1 - a0)
