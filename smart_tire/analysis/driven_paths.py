# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Paths that a robot was given, how it has driven them, and the simulated ground below.

A driven track is compared with its path such that progress never decreases: where a path crosses
itself, as a figure-eight does, a point of the track is compared with the part of the path that
belongs to it, not with the nearest one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from smart_tire.analysis.metrics import compared_poses, rms, rotated
from smart_tire.analysis.summary import plain, Tree
from smart_tire.arrays import Array
from smart_tire.control.trajectory_control import PathState
from smart_tire.estimates import PoseEstimate
from smart_tire.parameters import load_node
from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.samples import NS_PER_S, PathProgress, PlannedPath, Sample

PATH = 'path'
PATH_TOPICS = (PATH, 'path_progress')
SPACING = 0.01      # m between compared points of path and track
MAX_POINTS = 3000   # of path and track each; longer ones are compared at a larger spacing
FRAME = 'odom'  # of the estimates, after any prefix; other paths are refused by the controller


@dataclass(frozen=True)
class DrivenPath:
    """A path and the part of the recording in which it was followed; positions in ``odom``."""

    begin_ns: int
    end_ns: int
    state: PathState        # at the end
    wanted: Array      # (n, 2) m
    estimated: Array   # (m, 2) m
    true: Array        # (k, 2) m, aligned with the estimate at the begin; empty without truth

    @property
    def duration(self) -> float:
        """Return how long [s] the path was followed."""
        return (self.end_ns - self.begin_ns) / NS_PER_S


class PathLog:
    """The messages on ``path`` and ``path_progress`` of a recording."""

    def __init__(self) -> None:
        self._paths: list[tuple[int, PlannedPath]] = []  # begin [ns], path
        self._progress: list[PathProgress] = []

    def add_message(self, receive_ns: int, sample: Sample) -> None:
        """Add one sample; other sample types are ignored."""
        if isinstance(sample, PlannedPath) and sample.frame.rpartition('/')[2] == FRAME:
            self._paths.append((sample.stamp_ns or receive_ns, sample))
        elif isinstance(sample, PathProgress):
            self._progress.append(sample)

    def driven(self, estimates: PoseEstimate, truth: PoseEstimate) -> list[DrivenPath]:
        """Return the paths that were followed, in order."""
        limits = [begin for begin, _ in self._paths[1:]] + [np.iinfo(np.int64).max]
        found = (self._followed(path, begin, limit)
                 for (begin, path), limit in zip(self._paths, limits))
        return [replace(drive, estimated=_between(estimates, drive).pose[:, :2],
                        true=_true_positions(drive, estimates, truth))
                for drive in found if drive is not None]

    def wanted(self) -> list[Array]:
        """Return the positions (n, 2) [m] of each path."""
        return [_positions(path) for _, path in self._paths]

    def _followed(self, path: PlannedPath, begin: int, limit: int) -> DrivenPath | None:
        reports = [report for report in self._progress if begin <= report.stamp_ns < limit]
        first = next((index for index, report in enumerate(reports)
                      if report.state == PathState.FOLLOWING), None)
        if first is None:
            return None
        later = [report for report in reports[first:] if report.state != PathState.FOLLOWING]
        last = later[0] if later else reports[-1]
        return DrivenPath(begin, last.stamp_ns, PathState(last.state), _positions(path),
                          np.empty((0, 2)), np.empty((0, 2)))


def _positions(path: PlannedPath) -> Array:
    return np.array([pose[:2] for pose in path.poses], float).reshape(-1, 2)


def _true_positions(drive: DrivenPath, estimates: PoseEstimate, truth: PoseEstimate) -> Array:
    return compared_poses(_between(estimates, drive), _between(truth, drive)).true[:, :2]


def _between(poses: PoseEstimate, drive: DrivenPath) -> PoseEstimate:
    chosen = (poses.stamp_ns >= drive.begin_ns) & (poses.stamp_ns <= drive.end_ns)
    return PoseEstimate(poses.stamp_ns[chosen], poses.pose[chosen], poses.twist[chosen],
                        poses.covariance[chosen], poses.twist_sigma[chosen])


def driven_tree(drive: DrivenPath) -> Tree:
    """Return the tracking errors, also in truth if it is known, as JSON-compatible values."""
    scores = {name: tracking_score(drive.wanted, positions)
              for name, positions in (('in_odom', drive.estimated), ('in_truth', drive.true))}
    return plain({'state': drive.state.name.lower(), 'duration_s': drive.duration,
                  **{name: None if score is None else asdict(score)
                     for name, score in scores.items()}})


def driven_lines(name: str, tree: Tree) -> Iterator[str]:
    """Yield the result of ``driven_tree`` as lines of text."""
    known = tree['in_truth'] or tree['in_odom']
    if known is None:
        yield f'{name}: {tree["state"]} after {tree["duration_s"]:.1f} s'
        return
    yield (f'{name}: {tree["state"]} after {tree["duration_s"]:.1f} s, '
           f'{known["driven_m"]:.1f} m driven, {known["completed"]:.0%} of the path')
    for key, where in (('in_truth', 'in truth'), ('in_odom', 'as estimated')):
        if (score := tree[key]) is not None:
            yield (f'distance from the path {where}: {score["rms_m"]:.3f} m rms, '
                   f'{score["max_m"]:.3f} m at most, {score["end_m"]:.3f} m at the end')


@dataclass(frozen=True)
class GroundArea:
    """A patch of one surface."""

    surface: str
    corners: Array  # (4, 2) m, in odom


@dataclass(frozen=True)
class Grounds:
    """The simulated ground: patches, and the surface around them."""

    base: str
    areas: tuple[GroundArea, ...]


def load_grounds(files: Iterable[Path]) -> Grounds:
    """Return the ground in the parameter files of a simulation; raise ParameterError."""
    return grounds_of(load_node(files, 'robot_simulator'))


def grounds_of(params: SimulatorParams) -> Grounds:
    """Return the ground of a simulation, in the frame in which the robot starts."""
    x, y, yaw = params.start
    return Grounds(params.ground.base, tuple(
        GroundArea(patch.surface, rotated(np.array(
            [(patch.x[i] - x, patch.y[j] - y) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]),
            -yaw)) for patch in params.ground.patches))


@dataclass(frozen=True)
class Tracking:
    """Comparison of a track with a path, one row per ``spacing`` of driven distance."""

    position: Array   # (n, 2) m, of the track
    driven: Array     # (n,) m, driven distance
    progress: Array   # (n,) m along the path, never decreasing
    error: Array      # (n,) m from the path, positive to the left of its direction


@dataclass(frozen=True)
class TrackingScore:
    """Tracking errors over the driven distance; they do not depend on speed or standstill."""

    path_length_m: float
    driven_m: float
    completed: float  # share of the path, 0 to 1
    rms_m: float
    max_m: float
    end_m: float      # distance of the last point of the track from the end of the path


def track(path: Array, position: Array) -> Tracking | None:
    """
    Return the comparison of the driven ``position`` (m, 2) with ``path`` (n, 2), both in m.

    Each point of the track is assigned a point of the path such that progress never decreases
    and the sum of the squared distances is minimal. None if the path has no length, or without
    positions.
    """
    if not len(position) or not np.any(path != path[:1]):
        return None
    driven_length = float(np.sum(np.linalg.norm(np.diff(position, axis=0), axis=1)))
    spacing = max(SPACING, max(path_length(path), driven_length) / MAX_POINTS)
    wanted, along = resampled(path, spacing)
    found = thinned(position, spacing)
    index = assign(wanted, found)
    error, progress = _project(wanted, along, found, index)
    driven = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(found, axis=0), axis=1)))
    return Tracking(found, driven, progress, error)


def tracking_score(path: Array, position: Array) -> TrackingScore | None:
    """Return the tracking errors of the driven ``position`` (m, 2); None as in ``track``."""
    tracking = track(path, position)
    if tracking is None:
        return None
    length = path_length(path)
    return TrackingScore(
        length, float(tracking.driven[-1]), min(1.0, float(tracking.progress[-1]) / length),
        rms(tracking.error), float(np.max(np.abs(tracking.error))),
        float(np.linalg.norm(position[-1] - path[-1])))


def path_length(path: Array) -> float:
    """Return the length [m] of a polyline (n, 2)."""
    return float(np.sum(np.linalg.norm(np.diff(path, axis=0), axis=1)))


def resampled(path: Array, spacing: float) -> tuple[Array, Array]:
    """
    Return points (k, 2) on a polyline and their distances (k,) [m] along it.

    The vertices are kept, so no corner is cut; in between, points are at most ``spacing`` apart.
    """
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    path = path[np.append(True, steps > 0.0)]
    ends = np.append(0.0, np.cumsum(steps[steps > 0.0]))
    along = np.concatenate([
        np.linspace(begin, end, int(np.ceil((end - begin) / spacing)), endpoint=False)
        for begin, end in zip(ends[:-1], ends[1:])] + [ends[-1:]])
    return np.column_stack([np.interp(along, ends, column) for column in path.T]), along


def thinned(position: Array, spacing: float) -> Array:
    """Return the points that are at least ``spacing`` [m] from the one kept before."""
    kept = [0]
    for index, point in enumerate(position):
        if np.hypot(*(point - position[kept[-1]])) >= spacing:
            kept.append(index)
    return position[kept]


def assign(path: Array, position: Array) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """
    Return the index into ``path`` (n, 2) of each ``position`` (m, 2), never decreasing.

    The sum of the squared distances is minimal (dynamic programming); m * n cells of memory.
    """
    columns = np.arange(len(path))
    best = np.empty((len(position), len(path)), np.int32)  # index with the least cost up to column
    cost = np.zeros(len(path))
    for row, point in enumerate(position):
        least = np.minimum.accumulate(cost)
        is_new = np.append(True, least[1:] < least[:-1])
        best[row] = np.maximum.accumulate(np.where(is_new, columns, 0))
        cost = least + np.sum((path - point) ** 2, axis=1)
    index = np.empty(len(position), np.int64)
    column = int(np.argmin(cost))
    for row in range(len(position) - 1, -1, -1):
        index[row] = column
        column = int(best[row, column])
    return index


def _project(path: Array, along: Array, position: Array,
             index: np.ndarray[tuple[int], np.dtype[np.int64]]) -> tuple[Array, Array]:
    """Return the signed distance from the segments next to ``index``, and the progress."""
    found = []
    for first in (np.maximum(index - 1, 0), np.minimum(index, len(path) - 2)):
        begin, step = path[first], path[first + 1] - path[first]
        offset, size = position - begin, np.sum(step ** 2, axis=1)
        share = np.clip(np.sum(offset * step, axis=1) / size, 0.0, 1.0)
        away = offset - share[:, None] * step
        side = np.where(step[:, 0] * offset[:, 1] - step[:, 1] * offset[:, 0] < 0.0, -1.0, 1.0)
        found.append((side * np.linalg.norm(away, axis=1),
                      along[first] + share * np.sqrt(size)))
    (error, progress), (later_error, later_progress) = found
    later = np.abs(later_error) < np.abs(error)
    return (np.where(later, later_error, error),
            np.maximum.accumulate(np.where(later, later_progress, progress)))
