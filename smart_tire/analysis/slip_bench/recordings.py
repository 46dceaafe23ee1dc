"""
Real recordings: poses by lidar or motion capture are the truth, and there is none of the slip.

Nothing is learnt from what is scored: a recording's beginning is for learning parameters and for
the filter to settle, the rest is judged. There, the true path is laid over each estimate by the
mean differences of heading and position over the last ``ALIGNED_OVER`` of the beginning: one
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

from smart_tire.analysis.metrics import distance, rms, rotated, score
from smart_tire.analysis.series import at, Floats, PoseSeries, Series, Stamps
from smart_tire.analysis.slip_bench.contest import contest
from smart_tire.analysis.slip_bench.scoring import PathScore
from smart_tire.analysis.slip_bench.tracks import Estimate
from smart_tire.bags import Bag
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.samples import NS_PER_S, Sample

TRUTH = 'ground_truth/odom'
TOPICS = ('imu/data', 'wheel_states', TRUTH)
ALIGNED_OVER = 2.0  # s

Aligned = tuple[Floats, Floats, Stamps]  # estimated poses, true poses in their frame, stamps


@dataclass(frozen=True)
class Recording:
    """A recording, and what is known of its robot beforehand."""

    name: str
    title: str
    beginning: float        # s, not scored
    known: dict[str, Any]   # parameters, flat


# Geometry as measured, wheels that roll over a radius a little less than that, units whose
# place in the robot is not told, ground that is firm and not quite level; Warthog's wheel
# messages are late.
_COMMON = {'imu.position': [0.0, 0.0, 0.0], 'imu.accel_bias': 0.5, 'slip_sigma': 0.05,
           'slope_sigma': 0.02}
RECORDINGS = (
    Recording('warthog_asphalt', 'Warthog on asphalt', 120.0, {
        **_COMMON, 'wheel_radius': 0.285, 'track_width': 1.08, 'wheelbase': 1.05,
        'encoder.latency': 0.17, 'encoder.stamp_jitter': 0.02}),
    Recording('husky_rectangle', 'Husky, only the mean wheel speed known', ALIGNED_OVER, {
        **_COMMON, 'wheel_radius': 0.1651, 'track_width': 0.555, 'wheelbase': 0.540}),
)


@dataclass(frozen=True)
class RecordedRun:
    """What came of a recording: estimates, and the poses after the beginning beside the truth."""

    estimates: dict[str, Estimate]
    tracks: dict[str, Aligned]

    def scores(self) -> dict[str, PathScore]:
        """Return the scores of all methods over the rest of the recording."""
        return {name: rest_score(track) for name, track in self.tracks.items()}


def learned(path: Path, recording: Recording) -> SlipEstimatorParams:
    """Return the parameters of the robot: known beforehand, or learnt from the beginning."""
    return build(SlipEstimatorParams, recording.known)


def run_recording(path: Path, recording: Recording) -> RecordedRun:
    """Return what each method makes of the bag at ``path``; raise BagError if it is none."""
    samples, truth = read(path)
    begin_ns = int(truth.stamp_ns[0]) + round(recording.beginning * NS_PER_S)
    rest = stretch(truth, begin_ns)
    estimates = contest(samples, learned(path, recording), rest)
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
    """Return estimated and true poses after ``begin_ns``, the truth laid over the estimate."""
    guess = at(truth.stamp_ns, estimate.stamp_ns, estimate.pose)
    known = np.isfinite(guess[:, 0])
    guess, true, stamps = guess[known], truth.pose[known], truth.stamp_ns[known]
    window = (stamps <= begin_ns) & (stamps >= begin_ns - round(ALIGNED_OVER * NS_PER_S))
    if not window.any():
        raise ValueError('no true pose within the time over which paths are aligned')
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


def found(folder: Path) -> tuple[dict[str, Path], list[str]]:
    """Return name -> bag of the recordings in ``folder``, and the names of the absent ones."""
    paths: Mapping[str, Path] = {one.name: folder / one.name for one in RECORDINGS}
    return ({name: path for name, path in paths.items() if path.exists()},
            [name for name, path in paths.items() if not path.exists()])
