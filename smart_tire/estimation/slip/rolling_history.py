# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Predicted rolling of the sides over the latest time, for wheel samples that arrive late."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
import math

from smart_tire.estimation.slip.state import MAX_SAMPLE_GAP


class RollingHistory:
    """
    Predicted r w of both sides over time, without the steps of corrections.

    A correction holds for the past, too: going back from the present state, only the predicted
    changes are undone.
    """

    def __init__(self) -> None:
        # time [s], r w [m/s] and distance [m] of both sides, all by predictions alone
        self._points: deque[tuple[float, float, float, float, float]] = deque()

    def add_step(self, time: float, dt: float, left: float, right: float) -> None:
        """Add a prediction over ``dt`` [s] to ``time`` [s] that changes r w [m/s] of the sides."""
        if not self._points:
            self._points.append((time - dt, 0.0, 0.0, 0.0, 0.0))
        _, u_left, u_right, s_left, s_right = self._points[-1]
        self._points.append((
            time, u_left + left, u_right + right,
            s_left + dt * (u_left + 0.5 * left), s_right + dt * (u_right + 0.5 * right)))
        while self._points[0][0] < time - MAX_SAMPLE_GAP:
            self._points.popleft()

    def travel_change(self, since: float) -> list[float]:
        """Return the distances [m] since a time [s] beyond those at the present speeds."""
        if not self._points or since >= self._points[-1][0]:
            return [0.0, 0.0]
        points = list(self._points)
        i = min(max(bisect_right(points, (since, math.inf)), 1), len(points) - 1)
        (t0, *u0, left, right), (t1, *u1, _, _), (now, *u, s_left, s_right) = (
            points[i - 1], points[i], points[-1])
        h = min(max(since - t0, 0.0), t1 - t0)
        return [end - (s + h * (a + 0.5 * (b - a) * h / (t1 - t0))) - (now - t0 - h) * speed
                for end, s, a, b, speed in zip((s_left, s_right), (left, right), u0, u1, u)]
