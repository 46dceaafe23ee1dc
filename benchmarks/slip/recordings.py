"""
Real recordings: poses by lidar or motion capture are the truth, and there is none of the slip.

Nothing is learnt from what is scored: a recording's beginning is for identifying parameters and
for the filter to settle, the rest is judged. There, the true path is laid over each estimate by
the mean differences of heading and position over the last ``ALIGNED_OVER`` of the beginning: one
pose alone would carry its own noise along the whole path. Only the fitted constants of the
rivals are fitted to the very stretch that is scored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.slip.comparison import compare_methods
from benchmarks.slip.scoring import PathScore
from benchmarks.slip.series import EstimateSeries
from smart_tire.analysis.calibrate_robot import identify_geometry
from smart_tire.analysis.metrics import distance, rms, rotated, score
from smart_tire.analysis.series import at, Floats, PoseSeries, Series, Stamps
from smart_tire.bags import Bag
from smart_tire.calibration.robot.geometry import parameters
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, SlipEstimatorParams, specs
from smart_tire.samples import NS_PER_S, Sample

TRUTH = 'ground_truth/odom'
TOPICS = ('imu/data', 'wheel_states', TRUTH)
ALIGNED_OVER = 2.0  # s

Aligned = tuple[Floats, Floats, Stamps]  # estimated poses, true poses in their frame, stamps


@dataclass(frozen=True)
class Recording:
    """A recording, and what is known of its robot beforehand."""

    name: str
    folder: str
    title: str
    beginning: float        # s, not scored
    known: dict[str, Any]   # parameters, flat
    identified: bool        # whether parameters are identified from the beginning


# Geometry as measured, units whose place in the robot is not told, ground that is firm and not
# quite level, stamps by a network.
_COMMON = {'imu.position': [0.0, 0.0, 0.0], 'imu.accel_bias': 0.5, 'slip_sigma': 0.05,
           'slope_sigma': 0.02}
_WARTHOG = {**_COMMON, 'wheel_radius': 0.30, 'track_width': 1.08, 'wheelbase': 1.05,
            'encoder.stamp_jitter': 0.02}
_HUSKY = {**_COMMON, 'wheel_radius': 0.1651, 'track_width': 0.555, 'wheelbase': 0.540}
RECORDINGS = (
    # It stands still until 134 s: the first 120 s tell no more than biases and noise. At 240 s
    # it stands again.
    Recording('warthog_120', 'warthog_asphalt', 'Warthog on asphalt, identified from 120 s',
              120.0, _WARTHOG, True),
    Recording('warthog_240', 'warthog_asphalt', 'Warthog on asphalt, identified from 240 s',
              240.0, _WARTHOG, True),
    Recording('husky', 'husky_rectangle', 'Husky, only the mean wheel speed known',
              ALIGNED_OVER, _HUSKY, False),
)


@dataclass(frozen=True)
class RecordedRun:
    """What came of a recording: estimates, and the poses after the beginning beside the truth."""

    estimates: dict[str, EstimateSeries]
    tracks: dict[str, Aligned]

    def scores(self) -> dict[str, PathScore]:
        """Return the scores of all methods over the rest of the recording."""
        return {name: rest_score(track) for name, track in self.tracks.items()}


def learned(path: Path, recording: Recording) -> SlipEstimatorParams:
    """Return what is known of the robot, bettered by what the beginning of the bag tells."""
    known = build(SlipEstimatorParams, recording.known)
    if not recording.identified:
        return known
    found = identify_geometry(path, known.robot, until=recording.beginning)
    names = specs(SlipEstimatorParams).keys()
    told = {item.name: item.value for item in parameters(found, known.robot)
            if item.name in names}
    return build(SlipEstimatorParams, {**recording.known, **told})


def run_recording(path: Path, recording: Recording) -> RecordedRun:
    """
    Return what each method makes of the bag at ``path``.

    Raises BagError if it can not be read, EstimatorError if it lacks inputs or the truth.
    """
    params = learned(path, recording)
    samples, truth = read(path)
    if not len(truth.stamp_ns):
        raise EstimatorError(f'{path}: has no {TRUTH}')
    begin_ns = int(truth.stamp_ns[0]) + round(recording.beginning * NS_PER_S)
    rest = stretch(truth, begin_ns)
    estimates = compare_methods(samples, params, rest)
    tracks = {name: track_after(estimate.poses, truth, begin_ns)
              for name, estimate in estimates.items()}
    return RecordedRun(estimates, tracks)


def read(path: Path) -> tuple[list[Sample], PoseSeries]:
    """Return the inputs in the order of reception, and the true poses."""
    samples, truth = list[Sample](), Series()
    with Bag(path) as bag:
        for _, topic, sample in bag.samples(TOPICS):
            if topic == TRUTH:
                truth.add(sample)
            else:
                samples.append(sample)
    return samples, truth.poses()


def stretch(poses: PoseSeries, begin_ns: int) -> PoseSeries:
    """Return ``poses`` from ``begin_ns`` on."""
    first = int(np.searchsorted(poses.stamp_ns, begin_ns))
    return PoseSeries(poses.stamp_ns[first:], poses.pose[first:], poses.twist[first:],
                      poses.pose_covariance[first:], poses.twist_variance[first:])


def track_after(estimate: PoseSeries, truth: PoseSeries, begin_ns: int) -> Aligned:
    """
    Return estimated and true poses after ``begin_ns``, the truth laid over the estimate.

    Raises EstimatorError where nothing is known of either just before.
    """
    guess = at(truth.stamp_ns, estimate.stamp_ns, estimate.pose)
    known = np.isfinite(guess[:, 0])
    guess, true, stamps = guess[known], truth.pose[known], truth.stamp_ns[known]
    window = (stamps <= begin_ns) & (stamps >= begin_ns - round(ALIGNED_OVER * NS_PER_S))
    if not window.any():
        raise EstimatorError('no pose within the time over which paths are aligned')
    turn = float(np.mean((guess - true)[window, 2]))
    moved = rotated(true[:, :2], turn)
    moved += np.mean(guess[window, :2] - moved[window], axis=0)
    after = stamps >= begin_ns
    return guess[after], np.column_stack([moved, true[:, 2] + turn])[after], stamps[after]


def rest_score(track: Aligned) -> PathScore:
    """Return the errors of a path; without normalised ones, for they begin in the middle."""
    guess, true, _ = track
    error = guess - true
    off = np.linalg.norm(error[:, :2], axis=1)
    return PathScore(distance(true[:, :2]), rms(off), float(off[-1]), math.nan, math.nan,
                     score(error[:, 2], np.full(len(error), math.nan)), float(error[-1, 2]))


def bags(folder: Path) -> tuple[dict[str, Path], list[str]]:
    """Return name -> bag of the recordings in ``folder``, and the names of the absent ones."""
    paths: Mapping[str, Path] = {one.name: folder / one.folder for one in RECORDINGS}
    return ({name: path for name, path in paths.items() if path.exists()},
            [name for name, path in paths.items() if not path.exists()])
