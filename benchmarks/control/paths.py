# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Further paths of the benchmark, which begin at the origin along +x."""

from __future__ import annotations

import math

import numpy as np

from smart_tire.control.constants import GRID_STEP
from smart_tire.control.path_library import curve, planned
from smart_tire.samples import NAN, PlannedPath


def u_turn(radius: float, lead: float = 1.0) -> PlannedPath:
    """Return a half circle of ``radius`` [m] to the left, between straights of ``lead`` [m]."""
    angle = np.linspace(0.0, math.pi, math.ceil(math.pi * radius / GRID_STEP) + 1)
    x, y = lead + radius * np.sin(angle), radius - radius * np.cos(angle)
    return planned([(0.0, 0.0, NAN), *curve(x, y), (0.0, 2.0 * radius, NAN)])


def slalom(length: float, width: float, count: int = 3) -> PlannedPath:
    """Return ``count`` cosine waves to the left, each ``length`` [m] long and ``width`` wide."""
    x = np.linspace(0.0, count * length, math.ceil(count * length / GRID_STEP) + 1)
    return planned(curve(x, 0.5 * width * (1.0 - np.cos(math.tau / length * x))))


def spiral(radius: float, length: float) -> PlannedPath:
    """Return a clothoid to the left, which tightens to ``radius`` [m] after ``length`` [m]."""
    edges = np.linspace(0.0, length, math.ceil(length / GRID_STEP) + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    heading = 0.5 * middle ** 2 / (radius * length)
    step = float(edges[1])
    x, y = (np.concatenate([[0.0], np.cumsum(step * part(heading))]) for part in (np.cos, np.sin))
    return planned(curve(x, y))


def reverse_parking(radius: float, lead: float = 1.0) -> PlannedPath:
    """
    Return a way forward by ``lead`` [m] and ``radius``, then in reverse into a bay on the right.

    The quarter circle of ``radius`` [m] begins at the change of direction; half of ``lead`` is
    straight in the bay. The robot arrives with its front to the left.
    """
    x, y = lead + radius, -radius
    angle = np.linspace(0.0, 0.5 * math.pi, math.ceil(0.5 * math.pi * radius / GRID_STEP) + 1)
    curve = zip((x - radius * np.sin(angle)).tolist(), (y + radius * np.cos(angle)).tolist(),
                angle.tolist())
    return planned([(0.0, 0.0, 0.0), *curve, (lead, y - 0.5 * lead, 0.5 * math.pi)])


def two_cusps(radius: float, lead: float = 0.5) -> PlannedPath:
    """
    Return a turn by 180 degrees to the left in three arcs of ``radius`` [m].

    The second is driven in reverse. Straights of ``lead`` [m] come before and after it.
    """
    x, y, poses = lead, 0.0, [(0.0, 0.0, 0.0)]
    step = GRID_STEP / radius
    for first, direction in ((0.0, 1.0), (1.0, -1.0), (2.0, 1.0)):
        yaw = (first + np.linspace(0.0, 1.0, math.ceil(math.pi / 3.0 / step) + 1)) * math.pi / 3.0
        side = direction * radius
        poses += zip((x + side * (np.sin(yaw) - np.sin(yaw[0]))).tolist(),
                     (y - side * (np.cos(yaw) - np.cos(yaw[0]))).tolist(), yaw.tolist())
        x, y, _ = poses[-1]
    return planned([*poses, (x - lead, y, math.pi)])
