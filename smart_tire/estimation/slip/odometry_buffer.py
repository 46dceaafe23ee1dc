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

"""Short history of integrated motion, for measurements over a past interval."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from typing import NamedTuple

HISTORY_LENGTH = 3.0  # s


class Motion(NamedTuple):
    """Motion over an interval: integrals, or means over its duration."""

    v_x: float        # m/s or m, forward
    yaw_rate: float   # rad/s or rad
    left: float       # m/s or m, r w of the left side, as predicted: without corrections
    right: float      # m/s or m, r w of the right side


class OdometryBuffer:
    """Integrals of the motion over time, with their means over any interval."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, Motion]] = deque()

    def restart(self, time: float) -> None:
        """Clear the history and start integrating at ``time`` [s]."""
        self._points = deque([(time, Motion(0.0, 0.0, 0.0, 0.0))])

    def append(self, time: float, mean: Motion) -> None:
        """Append a step that ends at ``time`` [s] with the given mean motion."""
        last, integrals = self._points[-1]
        dt = time - last
        self._points.append((time, Motion(*(total + rate * dt
                                            for total, rate in zip(integrals, mean)))))
        while self._points[0][0] < time - HISTORY_LENGTH:
            self._points.popleft()

    def mean(self, begin: float, end: float) -> Motion | None:
        """Return the mean motion; None if ``begin`` is out of range."""
        if end <= begin or len(self._points) < 2 or begin < self._points[0][0] - 1e-9:
            return None
        points = list(self._points)
        return Motion(*((after - before) / (end - begin) for before, after in zip(
            self._at(points, begin), self._at(points, end))))

    @staticmethod
    def _at(points: list[tuple[float, Motion]], time: float) -> Motion:
        """Interpolate the integrals; after the last point, extrapolate its step."""
        index = min(max(bisect_right(points, time, key=lambda point: point[0]), 1),
                    len(points) - 1)
        (t0, first), (t1, second) = points[index - 1], points[index]
        share = (time - t0) / (t1 - t0) if t1 > t0 else 1.0
        return Motion(*(a + share * (b - a) for a, b in zip(first, second)))
