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
Accuracy and consistency of slip and pose estimates against a reference.

The reference is ground truth or a measurement: its covariances are added to those of the
estimates. Those of ground truth are zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.analysis.figure import MAX_SLIP_SIGMA
from smart_tire.arrays import Array, Instants
from smart_tire.estimates import at, PoseEstimate, SlipEstimate
from smart_tire.samples import LEFT, NS_PER_S, RIGHT, WHEELS

# m; shorter steps are not added to the distance, so that noise of a stationary robot does not
# count.
MIN_DISTANCE_STEP = 0.05
RELATIVE_POSE_INTERVAL_NS = NS_PER_S  # over which relative pose errors are taken
RELATIVE_POSE_DISTANCE = 1.0  # m, estimated, over which the drift per meter is taken
START, SE2, UNALIGNED = ALIGNMENTS = 'start', 'se2', 'none'  # of a reference with an estimate
SIDES = {'left': LEFT, 'right': RIGHT}
TWIST = 'v_x', 'v_y', 'yaw_rate'
Intervals = Mapping[str, Sequence[tuple[int, int]]]  # name -> time intervals [ns]


@dataclass(frozen=True, eq=False)
class Compared:
    """Estimates and a reference at its timestamps, one column per quantity; NaN if unknown."""

    stamp_ns: Instants  # (n,)
    estimated: Array    # (n, k)
    true: Array         # (n, k)
    sigma: Array        # (n, k), standard deviation of the error: of estimate and reference

    @property
    def error(self) -> Array:
        """Return estimate minus reference."""
        return self.estimated - self.true


@dataclass(frozen=True, eq=False)
class ComparedPoses(Compared):
    """Compared x, y [m] and yaw [rad]."""

    covariance: Array  # (n, 3, 3) of the errors


@dataclass(frozen=True)
class Score:
    """Errors and their ratio to their standard deviations; NaN if ``count`` is 0."""

    count: int
    mean: float            # error, in the unit of the estimate
    rms: float
    normalized_rms: float  # of error / sigma: 1 if consistent
    within_one: float      # share of errors below sigma: 0.68 if Gaussian and consistent
    within_two: float      # below 2 sigma: 0.95


@dataclass(frozen=True)
class SlipScore:
    """Slip score of a wheel or side while it moves."""

    estimated_mean: float
    true_mean: float
    error: Score


@dataclass(frozen=True)
class PoseScore:
    """Errors of pose, aligned with the reference, and of twist."""

    duration_s: float
    distance_m: float              # of the path of the reference
    position_rms_m: float
    position_end_m: float
    position_max_m: float
    end_percent_of_distance: float
    position_normalized_rms: float  # 1 if consistent
    position_within_two: float     # share of the errors along x and y below 2 sigma: 0.95
    drift_per_meter_m: float       # rms error of the displacement within one meter of path
    yaw: Score                     # rad
    yaw_end_rad: float
    relative_position_rms_m: float     # of the displacement within one second
    relative_yaw_rms_rad: float        # of the yaw change within one second
    twist: dict[str, Score] | None  # v_x, v_y [m/s], yaw_rate [rad/s]; None without true twist


def score(error: Array, sigma: Array) -> Score:
    """Return the score of the finite values of ``error``; a sigma that is NaN is unknown."""
    known = np.isfinite(error)
    error, sigma = error[known], sigma[known]
    if not len(error):
        return Score(0, *(math.nan,) * 5)
    with np.errstate(divide='ignore', invalid='ignore'):
        normalized = np.abs(error) / sigma
    normalized[error == 0.0] = 0.0
    normalized = normalized[~np.isnan(sigma)]
    return Score(len(error), float(np.mean(error)), rms(error), rms(normalized),
                 mean(normalized <= 1.0), mean(normalized <= 2.0))


def mean(values: Array | NDArray[np.bool_]) -> float:
    """Return the mean; NaN without values."""
    return float(np.mean(values)) if len(values) else math.nan


def rms(values: Array) -> float:
    """Return the root mean square; NaN without values."""
    return math.sqrt(mean(values ** 2))


def median(values: Array) -> float:
    """Return the median of the finite ``values``; NaN without any."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else math.nan


def compared_slips(estimate: SlipEstimate, truth: SlipEstimate) -> Compared:
    """Return the slips of the four wheels; NaN where the reference does not observe them."""
    stamps, known = truth.stamp_ns, truth.sigma <= MAX_SLIP_SIGMA
    return Compared(stamps, at(stamps, estimate.stamp_ns, estimate.ratio),
                    np.where(known, truth.ratio, math.nan),
                    np.hypot(at(stamps, estimate.stamp_ns, estimate.sigma), truth.sigma))


def measured(ratio: Array, wheels: Sequence[int]) -> list[int]:
    """Return those of ``wheels`` (indices) that have a slip ratio (n, 4); all if none has."""
    return [wheel for wheel in wheels if np.isfinite(ratio[:, wheel]).any()] or list(wheels)


def slip_scores(slips: Compared, intervals: Sequence[tuple[int, int]] | None = None
                ) -> dict[str, SlipScore]:
    """
    Return the scores of each side and wheel at the true timestamps, within ``intervals`` if given.

    Only times at which both slips are defined count. The slip of a side is the mean of its
    measured wheels. Their errors are fully correlated, so the sigma of a side is the mean of both.
    """
    members = {**{side: measured(slips.estimated, wheels) for side, wheels in SIDES.items()},
               **{wheel: [index] for index, wheel in enumerate(WHEELS)}}
    chosen = within(slips.stamp_ns, intervals)
    return {name: _slip_score(*(values[chosen][:, wheels] for values in (
        slips.estimated, slips.sigma, slips.true))) for name, wheels in members.items()}


def _slip_score(ratio: Array, sigma: Array, truth: Array) -> SlipScore:
    estimated, true = np.mean(ratio, axis=1), np.mean(truth, axis=1)
    moving = np.isfinite(estimated - true)
    estimated, true = estimated[moving], true[moving]
    error = score(estimated - true, np.mean(sigma, axis=1)[moving])
    if not error.count:
        return SlipScore(math.nan, math.nan, error)
    return SlipScore(float(np.mean(estimated)), float(np.mean(true)), error)


def within(stamp_ns: Instants, intervals: Sequence[tuple[int, int]] | None) -> NDArray[np.bool_]:
    """Return which timestamps are within ``intervals``; all if ``intervals`` is None."""
    if intervals is None:
        return np.ones(len(stamp_ns), bool)
    inside = np.zeros(len(stamp_ns), bool)
    for start, end in intervals:
        inside |= (stamp_ns >= start) & (stamp_ns <= end)
    return inside


def compared_poses(estimate: PoseEstimate, truth: PoseEstimate, align: str = START
                   ) -> ComparedPoses:
    """
    Return x, y and yaw where the estimate is known.

    The path of the reference is transformed, because its frame is unrelated to ``odom``: so that
    both start at the same pose (``START``), or that the sum of the squared distances is least
    (``SE2``), which leaves the covariance of the errors unknown; ``UNALIGNED`` is for one frame.
    """
    estimated = at(truth.stamp_ns, estimate.stamp_ns, estimate.pose)
    known = np.isfinite(estimated[:, 0])
    stamps, estimated, true = truth.stamp_ns[known], estimated[known], truth.pose[known]
    covariance = at(stamps, estimate.stamp_ns, estimate.covariance)
    if len(stamps):
        if align == START:
            true, spread = aligned(true, estimated[0], truth.covariance[known])
        else:
            true, spread = (
                (_fitted(true, estimated), np.full_like(covariance, math.nan)) if align == SE2
                else (true, given_covariance(truth.covariance[known])))
            true[:, 2] += math.tau * np.round(median(estimated[:, 2] - true[:, 2]) / math.tau)
        covariance = covariance + spread
    return ComparedPoses(stamps, estimated, true,
                         np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)), covariance)


def aligned(poses: Array, start: Array, covariance: Array) -> tuple[Array, Array]:
    """
    Return poses (n, 3) transformed so that they begin at ``start``, and their covariances.

    An error of the first pose moves and turns all of them.
    """
    given, carried_poses = given_covariance(covariance), carried(poses, poses[0], start)
    moved = carried_poses[:, :2] - start[:2]
    own = np.eye(3)
    own[:2, :2] = rotated(np.eye(2), start[2] - poses[0, 2]).T
    first = np.repeat(own[None], len(poses), axis=0)  # minus the derivative by the first pose
    first[:, 0, 2], first[:, 1, 2] = -moved[:, 1], moved[:, 0]
    spread = own @ given @ own.T + first @ given[0] @ first.transpose(0, 2, 1)
    return carried_poses, spread


def carried(poses: Array, first: Array, second: Array) -> Array:
    """Return ``poses`` (n, 3) moved and turned as from the pose ``first`` to ``second``."""
    turn = second[2] - first[2]
    return np.column_stack([rotated(poses[:, :2] - first[:2], turn) + second[:2],
                            poses[:, 2] + turn])


def given_covariance(covariance: Array) -> Array:
    """Return covariances; one that is not given, which begins with -1 in ROS, counts as zero."""
    return np.where(covariance[:, :1, :1] >= 0.0, covariance, 0.0)


def _fitted(poses: Array, others: Array) -> Array:
    """Return ``poses`` (n, 3) moved and turned to the least squared distances from ``others``."""
    centers = [one[:, :2].mean(axis=0) for one in (poses, others)]
    (x, y), (u, v) = ((one[:, :2] - center).T for one, center in zip((poses, others), centers))
    turn = math.atan2(float(x @ v - y @ u), float(x @ u + y @ v))
    return carried(poses, np.append(centers[0], 0.0), np.append(centers[1], turn))


def rotated(points: Array, angle: float | Array) -> Array:
    """Return ``points`` (n, 2), rotated counter-clockwise by one or n angles [rad]."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = points[:, 0], points[:, 1]
    return np.column_stack([cos * x - sin * y, sin * x + cos * y])


def distance(position: Array) -> float:
    """Return the length [m] of a path (n, 2) without steps below ``MIN_DISTANCE_STEP``."""
    total, anchor = 0.0, position[0]
    for point in position[1:]:
        step = math.dist(point, anchor)
        if step >= MIN_DISTANCE_STEP:
            total, anchor = total + step, point
    return total


def pose_score(poses: ComparedPoses, twist: Compared | None = None) -> PoseScore | None:
    """Return the errors of pose and twist; None if estimate and reference do not overlap."""
    if len(poses.stamp_ns) < 2:
        return None
    error = poses.error
    distances = np.linalg.norm(error[:, :2], axis=1)
    end, length = float(distances[-1]), distance(poses.true[:, :2])
    step_position, step_yaw = _relative_errors(poses)
    return PoseScore(
        float(np.ptp(poses.stamp_ns)) / NS_PER_S, length, rms(distances), end,
        float(distances.max()), 100.0 * end / length if length else math.nan,
        _normalized(error[:, :2], poses.covariance[:, :2, :2]),
        score(error[:, :2].ravel(), poses.sigma[:, :2].ravel()).within_two, _drift(poses),
        score(error[:, 2], poses.sigma[:, 2]), float(error[-1, 2]), step_position, step_yaw,
        {name: score(*columns) for name, *columns in zip(TWIST, twist.error.T, twist.sigma.T)}
        if twist is not None and len(twist.stamp_ns) else None)


def _normalized(error: Array, covariance: Array) -> float:
    """Return the rms of errors (n, 2) normalized by their covariances; NaN if all singular."""
    known = np.isfinite(covariance).all(axis=(1, 2))
    error, covariance = error[known], covariance[known]
    regular = np.linalg.det(covariance) > 0.0
    error, covariance = error[regular], covariance[regular]
    if not len(error):
        return math.nan
    squares = np.einsum('ni,ni->n', error, np.linalg.solve(covariance, error[..., None])[..., 0])
    return math.sqrt(float(np.mean(squares)) / error.shape[1])


def _drift(poses: ComparedPoses) -> float:
    """Return the rms error [m] of displacements over ``RELATIVE_POSE_DISTANCE``, one by one."""
    steps = np.linalg.norm(np.diff(poses.estimated[:, :2], axis=0), axis=1)
    rows, travel = [0], 0.0
    for row, step in enumerate(steps.tolist(), 1):
        travel += step
        if travel >= RELATIVE_POSE_DISTANCE:
            rows.append(row)
            travel = 0.0
    return rms(np.linalg.norm(_change_errors(*(
        (pose[rows[:-1]], pose[rows[1:]]) for pose in (poses.estimated, poses.true)))[:, :2],
        axis=1))


def _change_errors(*pairs: tuple[Array, Array]) -> Array:
    """Return the difference between estimated and true changes of the pose, in body axes."""
    estimated, true = (np.column_stack([
        rotated(later[:, :2] - pose[:, :2], -pose[:, 2]), later[:, 2] - pose[:, 2]])
        for pose, later in pairs)
    return estimated - true


def _relative_errors(poses: ComparedPoses) -> tuple[float, float]:
    """Return rms relative pose errors [m], [rad] over one second, in body axes."""
    later = poses.stamp_ns + RELATIVE_POSE_INTERVAL_NS
    error = _change_errors(*((pose, at(later, poses.stamp_ns, pose))
                             for pose in (poses.estimated, poses.true)))
    error = error[np.isfinite(error[:, 0])]
    return rms(np.linalg.norm(error[:, :2], axis=1)), rms(error[:, 2])


def compared_twist(estimate: PoseEstimate, truth: PoseEstimate) -> Compared:
    """Return v_x, v_y and yaw rate where the reference knows them."""
    known = np.isfinite(truth.twist[:, 0])
    stamps = truth.stamp_ns[known]
    return Compared(stamps, at(stamps, estimate.stamp_ns, estimate.twist), truth.twist[known],
                    np.sqrt(at(stamps, estimate.stamp_ns, estimate.twist_sigma ** 2)
                            + truth.twist_sigma[known] ** 2))


def stamp_score(stamp_ns: Instants, true_ns: Instants, sigma: float) -> Score:
    """
    Return the score [s] of timestamps against the nearest true times (sorted).

    Errors above half the period between true times are not observable.
    """
    if not len(true_ns):
        return score(np.empty(0), np.empty(0))
    right = np.clip(np.searchsorted(true_ns, stamp_ns), 1, max(len(true_ns) - 1, 1))
    neighbors = np.stack([true_ns[right - 1], true_ns[np.minimum(right, len(true_ns) - 1)]])
    errors = (stamp_ns - neighbors) / NS_PER_S
    error = np.where(np.abs(errors[0]) <= np.abs(errors[1]), errors[0], errors[1])
    return score(error, np.full(len(error), sigma))
