"""How far estimates of slip and pose lie from the truth, and whether their sigmas say so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.analysis.series import at, Floats, PoseSeries, SlipSeries, Stamps
from smart_tire.samples import LEFT, NS_PER_S, RIGHT, WHEELS

# Poses closer than this [m] are not added up to a distance: a standing robot goes nowhere,
# whatever the noise of its reference.
DISTANCE_STEP = 0.05
STEP_NS = NS_PER_S  # drift is judged over one second
SIDES = {'left': LEFT, 'right': RIGHT}
Spans = Mapping[str, Sequence[tuple[int, int]]]  # name -> stretches of time [ns]


@dataclass(frozen=True)
class Score:
    """Errors of an estimate against its own sigmas; NaN where ``count`` is 0."""

    count: int
    mean: float            # of the errors, in their unit
    rms: float
    normalised_rms: float  # of error / sigma: 1 where the sigmas are right
    within_one: float      # share of errors up to one sigma: 0.68 where they are right
    within_two: float      # 0.95


@dataclass(frozen=True)
class SlipScore:
    """Slip of a wheel or side while it moves."""

    estimated_mean: float
    true_mean: float
    error: Score


@dataclass(frozen=True)
class PoseScore:
    """Pose, brought together with the truth at the start, and twist."""

    duration_s: float
    distance_m: float              # that the truth covers
    position_rms_m: float
    position_end_m: float
    position_max_m: float
    end_percent_of_distance: float
    position_normalised_rms: float  # 1 where the covariances are right
    yaw: Score                     # rad
    yaw_end_rad: float
    step_position_rms_m: float     # error of the way gone within one second
    step_yaw_rms_rad: float        # error of the turn within one second
    twist: dict[str, Score] | None  # v_x, v_y [m/s], yaw_rate [rad/s]; None: truth has none


def score(error: Floats, sigma: Floats) -> Score:
    """Return the score of ``error`` where it is finite."""
    known = np.isfinite(error)
    error, sigma = error[known], sigma[known]
    if not len(error):
        return Score(0, *(math.nan,) * 5)
    with np.errstate(divide='ignore', invalid='ignore'):
        normalised = np.abs(error) / sigma
    normalised[error == 0.0] = 0.0
    return Score(len(error), float(np.mean(error)), rms(error), rms(normalised),
                 float(np.mean(normalised <= 1.0)), float(np.mean(normalised <= 2.0)))


def rms(values: Floats) -> float:
    """Return the root of the mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values ** 2))) if len(values) else math.nan


def slip_scores(estimate: SlipSeries, truth: SlipSeries,
                spans: Sequence[tuple[int, int]] | None = None) -> dict[str, SlipScore]:
    """
    Return the scores of each side and wheel at the truth's stamps, within ``spans`` if given.

    Only times count at which both slips are defined. The slip of a side is the mean of its two
    wheels; their errors are common, so its sigma is their mean.
    """
    ratio = at(truth.stamp_ns, estimate.stamp_ns, estimate.ratio)
    sigma = at(truth.stamp_ns, estimate.stamp_ns, estimate.sigma)
    members = {**SIDES, **{wheel: (index,) for index, wheel in enumerate(WHEELS)}}
    chosen = within(truth.stamp_ns, spans)
    return {name: _slip_score(ratio[chosen][:, wheels], sigma[chosen][:, wheels],
                              truth.ratio[chosen][:, wheels])
            for name, wheels in members.items()}


def _slip_score(ratio: Floats, sigma: Floats, truth: Floats) -> SlipScore:
    estimated, true = np.mean(ratio, axis=1), np.mean(truth, axis=1)
    moving = np.isfinite(estimated - true)
    estimated, true = estimated[moving], true[moving]
    error = score(estimated - true, np.mean(sigma, axis=1)[moving])
    if not error.count:
        return SlipScore(math.nan, math.nan, error)
    return SlipScore(float(np.mean(estimated)), float(np.mean(true)), error)


def within(stamp_ns: Stamps, spans: Sequence[tuple[int, int]] | None) -> NDArray[np.bool_]:
    """Return which stamps lie in one of ``spans``; all of them where it is None."""
    if spans is None:
        return np.ones(len(stamp_ns), bool)
    inside = np.zeros(len(stamp_ns), bool)
    for start, end in spans:
        inside |= (stamp_ns >= start) & (stamp_ns <= end)
    return inside


def aligned(truth: PoseSeries, estimate: PoseSeries) -> tuple[Floats, Floats, Stamps]:
    """
    Return estimated and true poses (n, 3) at the truth's stamps, and these stamps.

    The truth is moved and turned so that both start from the same pose: the frame in which the
    truth was measured has nothing to do with ``odom``.
    """
    guess = at(truth.stamp_ns, estimate.stamp_ns, estimate.pose)
    known = np.isfinite(guess[:, 0])
    guess, true = guess[known], truth.pose[known]
    if not len(guess):
        return guess, true, truth.stamp_ns[known]
    turn = guess[0, 2] - true[0, 2]
    moved = rotated(true[:, :2] - true[0, :2], turn) + guess[0, :2]
    return guess, np.column_stack([moved, true[:, 2] + turn]), truth.stamp_ns[known]


def rotated(points: Floats, angle: float | Floats) -> Floats:
    """Return ``points`` (n, 2), turned counter-clockwise by one angle [rad] or one each."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = points[:, 0], points[:, 1]
    return np.column_stack([cos * x - sin * y, sin * x + cos * y])


def distance(position: Floats) -> float:
    """Return the length of a path (n, 2) in m; less than ``DISTANCE_STEP`` is standing still."""
    total, anchor = 0.0, position[0]
    for point in position[1:]:
        step = math.dist(point, anchor)
        if step >= DISTANCE_STEP:
            total, anchor = total + step, point
    return total


def pose_score(estimate: PoseSeries, truth: PoseSeries) -> PoseScore | None:
    """Return pose and twist errors at the truth's stamps; None if the two never overlap."""
    guess, true, stamp_ns = aligned(truth, estimate)
    if len(guess) < 2:
        return None
    error = guess - true
    covariance = at(stamp_ns, estimate.stamp_ns, estimate.pose_covariance)
    off = np.linalg.norm(error[:, :2], axis=1)
    length = distance(true[:, :2])
    step_position, step_yaw = _steps(guess, true, stamp_ns)
    return PoseScore(
        float(stamp_ns[-1] - stamp_ns[0]) / NS_PER_S, length, rms(off), float(off[-1]),
        float(off.max()), 100.0 * float(off[-1]) / length if length else math.nan,
        _normalised(error[:, :2], covariance[:, :2, :2]),
        score(error[:, 2], np.sqrt(covariance[:, 2, 2])), float(error[-1, 2]),
        step_position, step_yaw, _twist(estimate, truth))


def _normalised(error: Floats, covariance: Floats) -> float:
    """Return the rms of errors (n, 2) over what their covariances expect; NaN if singular."""
    determinant = np.linalg.det(covariance)
    solid = np.isfinite(determinant) & (determinant > 0.0)
    error, covariance = error[solid], covariance[solid]
    if not len(error):
        return math.nan
    squares = np.einsum('ni,ni->n', error, np.linalg.solve(covariance, error[..., None])[..., 0])
    return math.sqrt(float(np.mean(squares)) / error.shape[1])


def _steps(guess: Floats, true: Floats, stamp_ns: Stamps) -> tuple[float, float]:
    """Return rms errors of way [m] and turn [rad] within one second, seen from the robot."""
    later = stamp_ns + STEP_NS
    moved = []
    for pose in (guess, true):
        change = at(later, stamp_ns, pose) - pose
        moved.append(np.column_stack([rotated(change[:, :2], -pose[:, 2]), change[:, 2]]))
    error = moved[0] - moved[1]
    error = error[np.isfinite(error[:, 0])]
    return rms(np.linalg.norm(error[:, :2], axis=1)), rms(error[:, 2])


def _twist(estimate: PoseSeries, truth: PoseSeries) -> dict[str, Score] | None:
    known = np.isfinite(truth.twist[:, 0])
    if not known.any():
        return None
    stamps = truth.stamp_ns[known]
    error = at(stamps, estimate.stamp_ns, estimate.twist) - truth.twist[known]
    sigma = np.sqrt(at(stamps, estimate.stamp_ns, estimate.twist_variance))
    return {name: score(error[:, i], sigma[:, i])
            for i, name in enumerate(('v_x', 'v_y', 'yaw_rate'))}


def stamp_score(stamp_ns: Stamps, true_ns: Stamps, sigma: float) -> Score:
    """
    Return the score [s] of stamps against the nearest of the true instants (sorted).

    An error of more than half the period between true instants can not be seen.
    """
    if not len(true_ns):
        return score(np.empty(0), np.empty(0))
    right = np.clip(np.searchsorted(true_ns, stamp_ns), 1, max(len(true_ns) - 1, 1))
    near = np.stack([true_ns[right - 1], true_ns[np.minimum(right, len(true_ns) - 1)]])
    errors = (stamp_ns - near) / NS_PER_S
    error = np.where(np.abs(errors[0]) <= np.abs(errors[1]), errors[0], errors[1])
    return score(error, np.full(len(error), sigma))
