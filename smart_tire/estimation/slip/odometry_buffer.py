"""Short history of integrated speed and yaw rate, for measurements over a past interval."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque

HISTORY_LENGTH = 3.0  # s


class OdometryBuffer:
    """Integrals of forward speed and yaw rate over time, with their means over any interval."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, float, float]] = deque()

    def restart(self, time: float) -> None:
        """Clear the history and start integrating at ``time`` [s]."""
        self._points = deque([(time, 0.0, 0.0)])

    def append(self, time: float, v_x: float, yaw_rate: float) -> None:
        """Append a step that ends at ``time`` [s], with mean speed [m/s] and yaw rate [rad/s]."""
        last, distance, angle = self._points[-1]
        dt = time - last
        self._points.append((time, distance + v_x * dt, angle + yaw_rate * dt))
        while self._points[0][0] < time - HISTORY_LENGTH:
            self._points.popleft()

    def mean(self, begin: float, end: float) -> tuple[float, float] | None:
        """Return mean speed [m/s] and yaw rate [rad/s]; None if ``begin`` is out of range."""
        if end <= begin or len(self._points) < 2 or begin < self._points[0][0] - 1e-9:
            return None
        points = list(self._points)
        (x0, a0), (x1, a1) = self._at(points, begin), self._at(points, end)
        return (x1 - x0) / (end - begin), (a1 - a0) / (end - begin)

    @staticmethod
    def _at(points: list[tuple[float, float, float]], time: float) -> tuple[float, float]:
        """Interpolate the integrals; after the last point, extrapolate its step."""
        index = min(max(bisect_right(points, (time,)), 1), len(points) - 1)
        (t0, x0, a0), (t1, x1, a1) = points[index - 1], points[index]
        share = (time - t0) / (t1 - t0) if t1 > t0 else 1.0
        return x0 + share * (x1 - x0), a0 + share * (a1 - a0)
