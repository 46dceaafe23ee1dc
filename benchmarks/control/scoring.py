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

"""Tracking error of a run: true position of ``base_link`` relative to the wanted path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from smart_tire.analysis.metrics import rms
from smart_tire.analysis.series import Floats
from smart_tire.samples import NS_PER_S, Odometry, PlannedPath

SPACING = 0.001        # m, of the points of the wanted path
BACKWARD, FORWARD = 0.1, 0.5  # m along the path, in which the next projection is searched
MATCH_NS = 5_000_000   # from an estimated to the true pose at the same time


@dataclass(frozen=True)
class TrackingScore:
    """Errors of one run, from the start of following to its end."""

    rms: float           # m, distance from the path
    maximum: float       # m
    localization: float  # m, rms error of the pose that was followed
    final: float         # m, from the end of the path
    duration: float      # s
    arrived: bool


def path_errors(wanted: PlannedPath, position: Floats) -> Floats:
    """
    Return the distances [m] of positions (n, 2), in order, from the path.

    Each is projected near the projection before it, so that crossing parts of the path are not
    mixed up.
    """
    points = dense_points(wanted)
    errors, index = np.empty(len(position)), 0
    back, ahead = round(BACKWARD / SPACING), round(FORWARD / SPACING)
    for n, (x, y) in enumerate(position):
        first = max(index - back, 0)
        part = points[first:index + ahead + 1]
        distances = np.hypot(part[:, 0] - x, part[:, 1] - y)
        nearest = int(distances.argmin())
        errors[n], index = distances[nearest], first + nearest
    return errors


def dense_points(wanted: PlannedPath) -> Floats:
    """Return points (n, 2) on the path, ``SPACING`` apart."""
    corners = np.array([pose[:2] for pose in wanted.poses])
    steps = np.hypot(*np.diff(corners, axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, arc[-1], max(math.ceil(arc[-1] / SPACING), 1) + 1)
    points: Floats = np.column_stack([np.interp(at, arc, corners[:, i]) for i in (0, 1)])
    return points


def score_tracking(wanted: PlannedPath, truth: Sequence[Odometry], followed: Sequence[Odometry],
                   *, start_ns: int, end_ns: int, arrived: bool) -> TrackingScore:
    """
    Return the score from ``start_ns`` to ``end_ns``.

    ``truth`` are the true poses, ``followed`` the estimated ones, empty if the true ones were
    followed.
    """
    within = [one for one in truth if start_ns <= one.stamp_ns <= end_ns]
    position = np.array([one.position[:2] for one in within])
    errors = path_errors(wanted, position)
    final = math.dist(position[-1], wanted.poses[-1][:2])
    return TrackingScore(rms(errors), float(errors.max()), _localization(within, followed),
                         final, (end_ns - start_ns) / NS_PER_S, arrived)


def _localization(truth: Sequence[Odometry], followed: Sequence[Odometry]) -> float:
    """Return the rms distance [m] of ``followed`` from the true position at the same time."""
    stamps = np.array([one.stamp_ns for one in truth])
    known = [one for one in followed
             if stamps[0] - MATCH_NS <= one.stamp_ns <= stamps[-1] + MATCH_NS]
    if not known:
        return 0.0
    at = np.array([one.stamp_ns for one in known])
    error = [np.interp(at, stamps, [one.position[i] for one in truth])
             - [one.position[i] for one in known] for i in (0, 1)]
    return rms(np.hypot(*error))
