# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Geometry of a path: segments without stop, and turns in place."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.control import constants as c

FORWARD, REVERSE = 1, -1


@dataclass(frozen=True)
class Spin:
    """Turn in place to ``yaw`` [rad]."""

    yaw: float
    length: float = 0.0


@dataclass(frozen=True)
class PathPoint:
    """Point of a segment, and the position of the robot relative to it."""

    distance: float   # m, arc length from the begin of the segment
    along: float      # m, robot ahead of the point; not zero beyond the ends only
    lateral: float    # m, robot left of the path (seen along the direction of travel)
    heading: float    # rad, direction of travel
    curvature: float  # 1/m, positive to the left

    def offset(self) -> float:
        """Return the distance [m] of the robot from the point."""
        return math.hypot(self.along, self.lateral)


class Segment:
    """
    Part of a path that is driven without stop; arrays (n,) are on a uniform grid of arc length.

    The path is the polygon through the given points, of which those on a grid, as of planners
    without smoother, are averaged. Direction and curvature are those of the polygon after two
    moving averages over ``SMOOTHING_WINDOW``, which are shorter near the ends.
    """

    def __init__(self, x: Array, y: Array, direction: int = FORWARD) -> None:
        x, y = without_stairs(x, y)
        lengths = np.hypot(np.diff(x), np.diff(y))
        arc = np.concatenate([[0.0], np.cumsum(lengths)])
        self.length = float(arc[-1])
        count = math.ceil(self.length / c.GRID_STEP) + 1
        self.direction = direction
        self.distance = np.linspace(0.0, self.length, max(count, 2))
        self.x, self.y = np.interp(self.distance, arc, x), np.interp(self.distance, arc, y)
        self._step = float(self.distance[1])
        half = int(0.5 * c.SMOOTHING_WINDOW / self._step)
        edges = np.unwrap(np.arctan2(np.diff(self.y), np.diff(self.x)))
        heading = np.concatenate([edges[:1], 0.5 * (edges[1:] + edges[:-1]), edges[-1:]])
        self.heading = moving_average(moving_average(heading, half), half)
        self.curvature = np.gradient(self.heading, self._step)
        self.curvature_rate = np.abs(np.gradient(self.curvature, self._step))
        self._points = list(zip(*(values.tolist() for values in (
            self.x, self.y, self.heading, self.curvature))))
        # at each of them: distance [m], magnitudes of curvature [1/m] and its rate [1/m2], not 0
        self.bends = list(zip(*(values.tolist() for values in (
            self.distance, *np.maximum(np.abs((self.curvature, self.curvature_rate)), c.TINY)))))

    @property
    def end(self) -> tuple[float, float]:
        """Position [m] of the end."""
        return float(self.x[-1]), float(self.y[-1])

    def index(self, distance: float) -> int:
        """Return the index of the last grid point that is not further than ``distance`` [m]."""
        return min(max(int(distance / self._step), 0), self.distance.size - 1)

    def project(self, x: float, y: float, low: float, high: float) -> PathPoint:
        """Return the point nearest to (x, y) with an arc length [m] from ``low`` to ``high``."""
        first = min(self.index(low), self.distance.size - 2)
        least, nearest = math.inf, 0.0
        for i in range(first, min(self.index(high), self.distance.size - 2) + 1):
            (px, py, *_), (qx, qy, *_) = self._points[i:i + 2]
            ex, ey = qx - px, qy - py
            share = min(max(((x - px) * ex + (y - py) * ey) / max(
                ex * ex + ey * ey, c.TINY ** 2), 0.0), 1.0)
            dx, dy = px + share * ex - x, py + share * ey - y
            if (off := dx * dx + dy * dy) < least:
                least, nearest = off, i + share
        return self.point(min(max(nearest * self._step, low), high, self.length), x, y)

    def point(self, distance: float, x: float, y: float) -> PathPoint:
        """Return the point at an arc length [m], with the position of (x, y) relative to it."""
        start = min(self.index(distance), self.distance.size - 2)
        share = distance / self._step - start
        px, py, heading, curvature = [
            one + share * (two - one) for one, two in zip(*self._points[start:start + 2])]
        cos, sin = math.cos(heading), math.sin(heading)
        return PathPoint(distance, (x - px) * cos + (y - py) * sin,
                         (y - py) * cos - (x - px) * sin, heading, curvature)


Maneuver = Segment | Spin


def moving_average(values: Array, half: int) -> Array:
    """Return means (n,) of up to ``half`` neighbors on each side, as many on both."""
    index = np.arange(values.size)
    reach = np.minimum(np.minimum(index, index[::-1]), half)
    total = np.concatenate([[0.0], np.cumsum(values)])
    means: Array = (total[index + reach + 1] - total[index - reach]) / (2 * reach + 1)
    return means


def without_stairs(x: Array, y: Array) -> tuple[Array, Array]:
    """
    Return points (n,) of a grid averaged twice over ``SMOOTHED_CELLS``; others as they are.

    They are continued by their reflection at the ends, which remain where they are.
    """
    steps = np.abs(np.stack([np.diff(x), np.diff(y)]))
    cell = max(float(np.median(steps.max(axis=0))), c.TINY)
    off_grid = np.abs(steps - cell * np.round(steps / cell)).max(axis=0) > c.CELL_TOLERANCE * cell
    # the robot and its goal are not on it
    if cell > (1.0 + c.CELL_TOLERANCE) * c.MAX_CELL or off_grid[1:-1].any():
        return x, y
    reach = min(c.SMOOTHED_CELLS // 2, x.size - 1)
    for _ in range(2):
        x, y = (moving_average(np.concatenate([
            2.0 * values[0] - values[reach:0:-1], values,
            2.0 * values[-1] - values[-2:-reach - 2:-1]]), reach)[reach:values.size + reach]
            for values in (x, y))
    return x, y
