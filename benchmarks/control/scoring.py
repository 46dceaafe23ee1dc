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
YAW_STEP = 0.05        # s, the period of the trajectory controller
MATCH_NS = 5_000_000   # from an estimated to the true pose at the same time


@dataclass(frozen=True)
class TrackingScore:
    """Errors of one run, from the start of following to its end."""

    rms: float           # m, control error: distance of the pose that was followed from the path
    maximum: float       # m, of it
    true_rms: float      # m, distance of the true pose from the path
    localization: float  # m, distance of the pose that was followed from the true one
    length: float        # m, of the path
    yaw_acceleration: float  # rad/s2, rms, true, over steps of ``YAW_STEP``
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

    ``truth`` are the true poses, ``followed`` those of the controller, maybe the same.
    """
    within, given = ([one for one in poses if start_ns <= one.stamp_ns <= end_ns]
                     for poses in (truth, followed))
    true, control = (path_errors(wanted, np.array([one.position[:2] for one in poses]))
                     for poses in (within, given))
    final = math.dist(within[-1].position[:2], wanted.poses[-1][:2])
    return TrackingScore(
        rms(control), float(control.max()), rms(true), _localization(within, given),
        SPACING * (len(dense_points(wanted)) - 1), _yaw_acceleration(within), final,
        (end_ns - start_ns) / NS_PER_S, arrived)


def _yaw_acceleration(truth: Sequence[Odometry]) -> float:
    """Return the rms of the change of the mean yaw rate [rad/s2]."""
    time = np.array([one.stamp_ns for one in truth], dtype=np.float64) / NS_PER_S
    step = ((time - time[0]) / YAW_STEP).astype(int)
    count = np.maximum(np.bincount(step), 1)
    mean = np.bincount(step, [one.angular[2] for one in truth]) / count
    return rms(np.diff(mean) / YAW_STEP) if len(mean) > 1 else 0.0


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
