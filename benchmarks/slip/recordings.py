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

"""
Real recordings: ground truth are poses by lidar or motion capture; slip has no ground truth.

Training and test data are separate: the initial part of a recording serves to identify
parameters and lets the filter settle, the remaining part is scored. Parameters are those of the
data sheets, and what ``identify geometry`` writes from the initial part; no value is set by hand.
The true path is aligned with each estimate by the mean differences of heading and position over
the last ``ALIGNMENT_WINDOW`` of the initial part, because aligning a single pose would add its
noise to the whole path. Only the fitted constants of the methods for comparison are fitted to the
scored part itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

from benchmarks.slip.comparison import compare_methods
from benchmarks.slip.scoring import PathScore
from benchmarks.slip.series import EstimateSeries
import numpy as np
from smart_tire.analysis.calibrate_robot import identify_geometry
from smart_tire.analysis.metrics import distance, rms, rotated, score
from smart_tire.analysis.series import at, Floats, PoseSeries, Series, Stamps
from smart_tire.bags import Bag
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, SlipEstimatorParams, specs
from smart_tire.samples import NS_PER_S, Sample

TRUTH = 'ground_truth/odom'
TOPICS = ('imu/data', 'wheel_states', TRUTH)
ALIGNMENT_WINDOW = 2.0  # s

AlignedPoses = tuple[Floats, Floats, Stamps]  # estimated, true poses in the same frame, timestamps


@dataclass(frozen=True)
class Recording:
    """A recording, and the known parameters of its robot."""

    name: str
    folder: str
    title: str
    initial_duration: float        # s, not scored
    known: dict[str, Any]   # parameters, flat
    identified: bool        # whether parameters are identified from the initial part


# Data sheet; the position of the IMU is unknown. Nothing else is set: all others are the defaults.
_WARTHOG = {'wheel_radius': 0.30, 'track_width': 1.08, 'wheelbase': 1.05,
            'imu.position': [0.0, 0.0, 0.0]}
_HUSKY = {'wheel_radius': 0.1651, 'track_width': 0.555, 'wheelbase': 0.540,
          'imu.position': [0.0, 0.0, 0.0]}
RECORDINGS = (
    # Stationary until 134 s: nothing can be identified from the first 120 s; again at 240 s.
    Recording('warthog_120', 'warthog_asphalt', 'Warthog on asphalt, from 120 s',
              120.0, _WARTHOG, False),
    Recording('warthog_240', 'warthog_asphalt', 'Warthog on asphalt, from 240 s',
              240.0, _WARTHOG, False),
    Recording('warthog_identified', 'warthog_asphalt',
              'Warthog on asphalt, from 240 s, with identify geometry of the first 240 s',
              240.0, _WARTHOG, True),
    Recording('husky', 'husky_rectangle', 'Husky, only the mean wheel speed known',
              ALIGNMENT_WINDOW, _HUSKY, False),
)


@dataclass(frozen=True)
class RecordedRun:
    """Estimates from a recording, and the scored poses with the aligned truth."""

    estimates: dict[str, EstimateSeries]
    aligned_poses: dict[str, AlignedPoses]

    def scores(self) -> dict[str, PathScore]:
        """Return the scores of all methods over the scored part."""
        return {name: remaining_score(track) for name, track in self.aligned_poses.items()}


def identified_params(path: Path, recording: Recording) -> SlipEstimatorParams:
    """Return the known parameters, updated with those identified from the initial part."""
    known = build(SlipEstimatorParams, recording.known)
    if not recording.identified:
        return known
    return build(SlipEstimatorParams, {**recording.known, **_identified(path, recording)})


def _identified(path: Path, recording: Recording) -> dict[str, Any]:
    """Return what ``identify geometry`` writes from the initial part, without ground truth."""
    robot = build(SlipEstimatorParams, recording.known).robot
    found = identify_geometry(path, robot, until=recording.initial_duration)
    names = specs(SlipEstimatorParams).keys()
    return {item.name: item.value for item in found.parameters(robot) if item.name in names}


def parameter_sources(path: Path, recording: Recording) -> tuple[str, ...]:
    """Return lines on the parameters that differ from the defaults, and where they come from."""
    lines = [f'data sheet: {_listed(recording.known)}']
    if recording.identified:
        values = _listed(_identified(path, recording)) or 'nothing'
        lines.append(f'identified from the first {recording.initial_duration:.0f} s, without '
                     f'ground truth: {values}')
    return (*lines, 'set by hand or fitted to the scored part: none; all others are the defaults')


def _listed(values: Mapping[str, Any]) -> str:
    def text(value: Any) -> str:
        return (f'{value:.4g}' if isinstance(value, float)
                else f'[{", ".join(f"{item:.3g}" for item in value)}]')
    return ', '.join(f'{name} {text(value)}' for name, value in values.items())


def run_recording(path: Path, recording: Recording) -> RecordedRun:
    """
    Return the estimates of all methods from the bag at ``path``.

    Raises BagError if the bag cannot be read, EstimatorError if it lacks inputs or ground truth.
    """
    params = identified_params(path, recording)
    samples, truth = read(path)
    if not len(truth.stamp_ns):
        raise EstimatorError(f'{path}: has no {TRUTH}')
    begin_ns = int(truth.stamp_ns[0]) + round(recording.initial_duration * NS_PER_S)
    rest = poses_from(truth, begin_ns)
    estimates = compare_methods(samples, params, rest)
    aligned_poses = {name: align_after(estimate.poses, truth, begin_ns)
                     for name, estimate in estimates.items()}
    return RecordedRun(estimates, aligned_poses)


def read(path: Path) -> tuple[list[Sample], PoseSeries]:
    """Return the inputs in order of reception, and the true poses."""
    samples, truth = list[Sample](), Series()
    with Bag(path) as bag:
        for _, topic, sample in bag.samples(TOPICS):
            if topic == TRUTH:
                truth.add(sample)
            else:
                samples.append(sample)
    return samples, truth.poses()


def poses_from(poses: PoseSeries, begin_ns: int) -> PoseSeries:
    """Return the ``poses`` at and after ``begin_ns``."""
    first = int(np.searchsorted(poses.stamp_ns, begin_ns))
    return PoseSeries(poses.stamp_ns[first:], poses.pose[first:], poses.twist[first:],
                      poses.pose_covariance[first:], poses.twist_variance[first:])


def align_after(estimate: PoseSeries, truth: PoseSeries, begin_ns: int) -> AlignedPoses:
    """
    Return estimated poses and aligned true poses after ``begin_ns``.

    Raises EstimatorError if there are no poses in the window before ``begin_ns``.
    """
    estimated = at(truth.stamp_ns, estimate.stamp_ns, estimate.pose)
    known = np.isfinite(estimated[:, 0])
    estimated, true, stamps = estimated[known], truth.pose[known], truth.stamp_ns[known]
    window = (stamps <= begin_ns) & (stamps >= begin_ns - round(ALIGNMENT_WINDOW * NS_PER_S))
    if not window.any():
        raise EstimatorError('no pose in the window for alignment')
    turn = float(np.mean((estimated - true)[window, 2]))
    moved = rotated(true[:, :2], turn)
    moved += np.mean(estimated[window, :2] - moved[window], axis=0)
    after = stamps >= begin_ns
    return estimated[after], np.column_stack([moved, true[:, 2] + turn])[after], stamps[after]


def remaining_score(track: AlignedPoses) -> PathScore:
    """Return the errors of an aligned path, without normalized ones."""
    estimated, true, _ = track
    error = estimated - true
    distances = np.linalg.norm(error[:, :2], axis=1)
    return PathScore(distance(true[:, :2]), rms(distances), float(distances[-1]), math.nan,
                     math.nan, score(error[:, 2], np.full(len(error), math.nan)),
                     float(error[-1, 2]))


def bags(folder: Path) -> tuple[dict[str, Path], list[str]]:
    """Return name -> bag of the recordings in ``folder``, and the names of the absent ones."""
    paths: Mapping[str, Path] = {one.name: folder / one.folder for one in RECORDINGS}
    return ({name: path for name, path in paths.items() if path.exists()},
            [name for name, path in paths.items() if not path.exists()])
