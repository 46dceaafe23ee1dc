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

"""Paths that begin at the origin along +x: for benchmarks and ``smart_tire drive``."""

from __future__ import annotations

from collections.abc import Iterable
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.samples import NAN, PlannedPath, Vector3

SPACING = 0.02  # m, between poses of a curve
FRAME = 'odom'


def line(length: float) -> PlannedPath:
    """Return a straight path of ``length`` [m]; negative: backward, in reverse."""
    if length < 0.0:
        return _path([(0.0, 0.0, 0.0), (length, 0.0, 0.0)])
    return _path([(0.0, 0.0, NAN), (length, 0.0, NAN)])


def figure_eight(radius: float) -> PlannedPath:
    """
    Return a figure-eight of ``radius`` [m], the smallest radius of curvature: first to the left.

    It is a lemniscate of Bernoulli: its curvature is proportional to the distance from the
    crossing, where it begins and ends. It is 15.7 radii long, and 6 radii wide.
    """
    scale = 3.0 * radius
    count = math.ceil(5.2441 * scale / SPACING)
    t = np.linspace(-0.5 * math.pi, 1.5 * math.pi, max(count, 100) + 1)
    x = scale * np.cos(t) / (1.0 + np.sin(t) ** 2)
    y = x * np.sin(t)
    half = math.sqrt(0.5)  # the first tangent is at -45 degrees
    return _path(_curve(half * (x - y), half * (x + y)))


def square(side: float) -> PlannedPath:
    """Return a square with corners, counter-clockwise, each ``side`` [m] long."""
    corners = ((0.0, 0.0), (side, 0.0), (side, side), (0.0, side), (0.0, 0.0))
    return _path([(x, y, NAN) for x, y in corners])


def lane_change(length: float, width: float) -> PlannedPath:
    """
    Return a lane change to the left by ``width`` [m] within ``length`` [m].

    Straight parts of a quarter of ``length`` come before and after it. Its shape is the quintic
    polynomial with neither slope nor curvature at both ends.
    """
    run = 0.25 * length
    u = np.linspace(0.0, 1.0, max(math.ceil(length / SPACING), 2) + 1)
    x, y = run + length * u, width * u ** 3 * (10.0 - 15.0 * u + 6.0 * u ** 2)
    return _path([(0.0, 0.0, NAN), *_curve(x, y), (2.0 * run + length, width, NAN)])


def u_turn(radius: float, lead: float = 1.0) -> PlannedPath:
    """Return a half circle of ``radius`` [m] to the left, between straights of ``lead`` [m]."""
    angle = np.linspace(0.0, math.pi, math.ceil(math.pi * radius / SPACING) + 1)
    x, y = lead + radius * np.sin(angle), radius - radius * np.cos(angle)
    return _path([(0.0, 0.0, NAN), *_curve(x, y), (0.0, 2.0 * radius, NAN)])


def slalom(length: float, width: float, count: int = 3) -> PlannedPath:
    """Return ``count`` cosine waves to the left, each ``length`` [m] long and ``width`` wide."""
    x = np.linspace(0.0, count * length, math.ceil(count * length / SPACING) + 1)
    return _path(_curve(x, 0.5 * width * (1.0 - np.cos(math.tau / length * x))))


def spiral(radius: float, length: float) -> PlannedPath:
    """Return a clothoid to the left, which tightens to ``radius`` [m] after ``length`` [m]."""
    edges = np.linspace(0.0, length, math.ceil(length / SPACING) + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    heading = 0.5 * middle ** 2 / (radius * length)
    step = float(edges[1])
    x, y = (np.concatenate([[0.0], np.cumsum(step * part(heading))]) for part in (np.cos, np.sin))
    return _path(_curve(x, y))


def reverse_parking(radius: float, lead: float = 1.0) -> PlannedPath:
    """
    Return a way forward by ``lead`` [m] and ``radius``, then in reverse into a bay on the right.

    The quarter circle of ``radius`` [m] begins at the change of direction; half of ``lead`` is
    straight in the bay. The robot arrives with its front to the left.
    """
    x, y = lead + radius, -radius
    angle = np.linspace(0.0, 0.5 * math.pi, math.ceil(0.5 * math.pi * radius / SPACING) + 1)
    curve = zip((x - radius * np.sin(angle)).tolist(), (y + radius * np.cos(angle)).tolist(),
                angle.tolist())
    return _path([(0.0, 0.0, 0.0), *curve, (lead, y - 0.5 * lead, 0.5 * math.pi)])


def _curve(x: Array, y: Array) -> list[Vector3]:
    return [(px, py, NAN) for px, py in zip(x.tolist(), y.tolist())]


def _path(poses: Iterable[Vector3]) -> PlannedPath:
    return PlannedPath(0, FRAME, tuple(poses))
