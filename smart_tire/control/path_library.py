# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Paths that begin at the origin along +x."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.control import constants as c
from smart_tire.samples import NAN, PlannedPath, Vector3

FRAME = 'odom'


def line(length: float) -> PlannedPath:
    """Return a straight path of ``length`` [m]; negative: backward, in reverse."""
    if length < 0.0:
        return planned([(0.0, 0.0, 0.0), (length, 0.0, 0.0)])
    return planned([(0.0, 0.0, NAN), (length, 0.0, NAN)])


def figure_eight(radius: float) -> PlannedPath:
    """
    Return a figure-eight of ``radius`` [m], the smallest radius of curvature: first to the left.

    It is a lemniscate of Bernoulli: its curvature is proportional to the distance from the
    crossing, where it begins and ends. It is 15.7 radii long, and 6 radii wide.
    """
    scale = 3.0 * radius
    count = math.ceil(5.2441 * scale / c.GRID_STEP)
    t = np.linspace(-0.5 * math.pi, 1.5 * math.pi, max(count, 100) + 1)
    x = scale * np.cos(t) / (1.0 + np.sin(t) ** 2)
    y = x * np.sin(t)
    half = math.sqrt(0.5)  # the first tangent is at -45 degrees
    return planned(curve(half * (x - y), half * (x + y)))


def square(side: float) -> PlannedPath:
    """Return a square with corners, counter-clockwise, each ``side`` [m] long."""
    corners = ((0.0, 0.0), (side, 0.0), (side, side), (0.0, side), (0.0, 0.0))
    return planned([(x, y, NAN) for x, y in corners])


def lane_change(length: float, width: float) -> PlannedPath:
    """
    Return a lane change to the left by ``width`` [m] within ``length`` [m].

    Straight parts of a quarter of ``length`` come before and after it. Its shape is the quintic
    polynomial with neither slope nor curvature at both ends.
    """
    run = 0.25 * length
    u = np.linspace(0.0, 1.0, max(math.ceil(length / c.GRID_STEP), 2) + 1)
    x, y = run + length * u, width * u ** 3 * (10.0 - 15.0 * u + 6.0 * u ** 2)
    return planned([(0.0, 0.0, NAN), *curve(x, y), (2.0 * run + length, width, NAN)])


def curve(x: Array, y: Array) -> list[Vector3]:
    """Return poses with any yaw at positions [m]."""
    return [(px, py, NAN) for px, py in zip(x.tolist(), y.tolist())]


def planned(poses: Iterable[Vector3]) -> PlannedPath:
    """Return a path through poses in ``odom``."""
    return PlannedPath(0, FRAME, tuple(poses))


# Paths by name; lengths are multiplied by the argument.
PATHS: Mapping[str, Callable[[float], PlannedPath]] = {
    'figure_eight': lambda scale: figure_eight(0.6 * scale),
    'square': lambda scale: square(2.0 * scale),
    'lane_change': lambda scale: lane_change(3.0 * scale, 1.0 * scale)}
