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

"""Paths that a robot was given, how it has driven them, and the simulated ground below."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from smart_tire.analysis.metrics import aligned, rotated
from smart_tire.analysis.summary import plain, Tree
from smart_tire.analysis.tracking import tracking_score
from smart_tire.arrays import Array
from smart_tire.control.trajectory_control import State
from smart_tire.parameters import build, known_names, load_files, NODE_PARAMS, specs
from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.recording import PoseSeries
from smart_tire.samples import NS_PER_S, PathProgress, PlannedPath, Sample

PATH = 'path'
PATH_TOPICS = (PATH, 'path_progress')
SIMULATOR = 'robot_simulator'
FRAME = 'odom'  # of the estimates; a path in another frame is refused by the controller


@dataclass(frozen=True)
class DrivenPath:
    """A path and the part of the recording in which it was followed; positions in ``odom``."""

    begin_ns: int
    end_ns: int
    state: State        # at the end
    wanted: Array      # (n, 2) m
    estimated: Array   # (m, 2) m
    true: Array        # (k, 2) m, aligned with the estimate at the begin; empty without truth
    resumed: int = 0    # times that the rest of the path was sent after a stop

    @property
    def duration(self) -> float:
        """Return how long [s] the path was followed."""
        return (self.end_ns - self.begin_ns) / NS_PER_S


class PathLog:
    """The messages on ``path`` and ``path_progress`` of a recording."""

    def __init__(self) -> None:
        self._paths: list[tuple[int, PlannedPath]] = []  # begin [ns], path
        self._progress: list[PathProgress] = []

    def add(self, receive_ns: int, sample: Sample) -> None:
        """Add one sample; other sample types are ignored."""
        if isinstance(sample, PlannedPath) and sample.frame == FRAME:
            self._paths.append((sample.stamp_ns or receive_ns, sample))
        elif isinstance(sample, PathProgress):
            self._progress.append(sample)

    def driven(self, estimates: PoseSeries, truth: PoseSeries) -> list[DrivenPath]:
        """
        Return the paths that were followed, in order.

        The rest of a path, sent after a stop, is a part of it.
        """
        limits = [begin for begin, _ in self._paths[1:]] + [np.iinfo(np.int64).max]
        found: list[DrivenPath] = []
        for (begin, path), limit in zip(self._paths, limits):
            if (drive := self._followed(path, begin, limit)) is None:
                continue
            if found and found[-1].state == State.STOPPED and _is_rest(drive, found[-1]):
                before = found.pop()
                drive = replace(drive, begin_ns=before.begin_ns, wanted=before.wanted,
                                resumed=before.resumed + 1)
            found.append(drive)
        return [replace(drive, estimated=_between(estimates, drive).pose[:, :2],
                        true=_true_positions(drive, estimates, truth)) for drive in found]

    def wanted(self) -> list[Array]:
        """Return the positions (n, 2) [m] of each path."""
        return [_positions(path) for _, path in self._paths]

    def _followed(self, path: PlannedPath, begin: int, limit: int) -> DrivenPath | None:
        reports = [report for report in self._progress if begin <= report.stamp_ns < limit]
        first = next((index for index, report in enumerate(reports)
                      if report.state == State.FOLLOWING), None)
        if first is None:
            return None
        later = [report for report in reports[first:] if report.state != State.FOLLOWING]
        last = later[0] if later else reports[-1]
        return DrivenPath(begin, last.stamp_ns, State(last.state), _positions(path),
                          np.empty((0, 2)), np.empty((0, 2)))


def _is_rest(drive: DrivenPath, before: DrivenPath) -> bool:
    """Return whether all places of a path but the first are the last ones of ``before``."""
    tail = drive.wanted[1:]
    return np.array_equal(tail, before.wanted[-len(tail):])


def _positions(path: PlannedPath) -> Array:
    return np.array([pose[:2] for pose in path.poses], float).reshape(-1, 2)


def _true_positions(drive: DrivenPath, estimates: PoseSeries, truth: PoseSeries) -> Array:
    return aligned(_between(truth, drive), _between(estimates, drive))[1][:, :2]


def _between(poses: PoseSeries, drive: DrivenPath) -> PoseSeries:
    chosen = (poses.stamp_ns >= drive.begin_ns) & (poses.stamp_ns <= drive.end_ns)
    return PoseSeries(poses.stamp_ns[chosen], poses.pose[chosen], poses.twist[chosen],
                      poses.pose_covariance[chosen], poses.twist_variance[chosen])


def driven_tree(drive: DrivenPath) -> Tree:
    """Return the tracking errors, also in truth if it is known, as JSON-compatible values."""
    scores = {name: tracking_score(drive.wanted, positions)
              for name, positions in (('in_odom', drive.estimated), ('in_truth', drive.true))}
    return plain({'state': drive.state.name.lower(), 'duration_s': drive.duration,
                  'resumed': drive.resumed, **{name: None if score is None else asdict(score)
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
    values = load_files(files, SIMULATOR, known_names(NODE_PARAMS.values()),
                        specs(NODE_PARAMS[SIMULATOR]))
    return grounds_of(build(SimulatorParams, values))


def grounds_of(params: SimulatorParams) -> Grounds:
    """Return the ground of a simulation, in the frame in which the robot starts."""
    x, y, yaw = params.start
    return Grounds(params.ground.base, tuple(
        GroundArea(patch.surface, rotated(np.array(
            [(patch.x[i] - x, patch.y[j] - y) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]),
            -yaw)) for patch in params.ground.patches))
