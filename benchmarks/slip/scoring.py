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
Scores of an estimate against the ground truth of a simulated run.

A side is steady, as defined for the reference filter, if it rolls faster than
``MIN_ROLLING_SPEED``, later than ``SETTLING_TIME`` after the start, and more than
``MIN_STEADY_DISTANCE`` from any fast change of wheel speed. If the slip estimate is undefined but
the true slip is not, the error counts as 1 with a sigma of 1. The slip of a side is the mean of
its two wheels.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from benchmarks.slip.series import EstimateSeries, side_means, Truth
import numpy as np
from numpy.typing import NDArray
from smart_tire.analysis.metrics import aligned, distance, rms, Score, score
from smart_tire.analysis.series import at, Floats, Stamps
from smart_tire.samples import NS_PER_S

MIN_ROLLING_SPEED = 0.1     # m/s, |r w| of a steady side
SETTLING_TIME = 3.0         # s, after the start of the run
MIN_STEADY_DISTANCE = 0.4   # s, from any fast change
FAST_ACCELERATION = 1.5     # rad/s2, of a wheel; these four are those of the reference filter
ACCELERATION_WINDOW = 0.05  # s, for dw/dt; longer than the control period of 0.02 s
AVERAGING_WINDOW = 0.125    # s, for averaged truth
MAX_GAP = 0.5               # s, between two estimates for interpolation
ELLIPSE_95 = -2.0 * math.log(0.05)  # squared Mahalanobis distance, 95 % of planar errors
MIN_ICR_YAW_RATE = 0.1      # rad/s, for scoring the ICR

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Parts:
    """Scores of one quantity over the selected times and over all times."""

    selected: Score   # steady intervals, or all times against averaged truth
    all_times: Score  # including changes of speed


@dataclass(frozen=True)
class PathScore:
    """Errors of the pose, aligned with the true one at the start."""

    distance_m: float
    rms_m: float
    end_m: float
    nees: float        # of the position, per degree of freedom: 1 if consistent
    inside: float      # share within the 95 % ellipse
    heading: Score     # rad
    heading_end: float  # rad

    @property
    def rms_percent(self) -> float:
        """Return the rms position error in percent of the distance; NaN without distance."""
        return _percent(self.rms_m, self.distance_m)

    @property
    def end_percent(self) -> float:
        """Return the final position error in percent of the distance."""
        return _percent(self.end_m, self.distance_m)


@dataclass(frozen=True)
class RunScore:
    """All scores of one estimate of one run; NaN without data."""

    left: Parts
    right: Parts
    speed: Parts         # m/s, forward, of base_link
    path: PathScore
    icr_x: float         # m, rms error of S in selected turns
    nis: float           # mean normalized innovation squared: 1 if consistent
    step_us: float


def score_run(estimate: EstimateSeries, truth: Truth, *, averaged: bool = False) -> RunScore:
    """
    Return the scores of ``estimate``.

    By default the selected times are the steady ones; with ``averaged`` they are all times, and
    the truth is averaged over ``AVERAGING_WINDOW``.
    """
    slips = slip_errors(estimate, truth)
    speeds = _speed_errors(estimate, truth, truth.poses.twist[:, 0])
    if averaged:
        selected_slips = slip_errors(estimate, truth, AVERAGING_WINDOW)
        speed = moving_mean(truth.poses.twist[:, :1], truth.stamp_ns, AVERAGING_WINDOW)
        selected_speed = _speed_errors(estimate, truth, speed[:, 0])
        steady = np.ones((len(truth.stamp_ns), 2), bool)
    else:
        selected_slips, selected_speed, steady = slips, speeds, steady_sides(truth)
    left, right = (Parts(_score(selected_slips, side, steady[:, side]), _score(slips, side))
                   for side in (0, 1))
    whole: Mask = np.asarray(steady.all(axis=1))
    forward = Parts(score(selected_speed[0][whole], selected_speed[1][whole]), score(*speeds))
    return RunScore(left, right, forward, path_score(estimate, truth),
                    _icr_error(estimate, truth, whole), _mean(estimate.innovations.value),
                    estimate.step_us)


def steady_slips(estimate: EstimateSeries, truth: Truth) -> tuple[Floats, Floats]:
    """Return errors and sigmas (n,) of the slips of both sides while steady."""
    steady = steady_sides(truth)
    error, sigma = slip_errors(estimate, truth)
    return error[steady], sigma[steady]


def steady_sides(truth: Truth) -> Mask:
    """Return when each side is steady, shape (n, 2)."""
    time = (truth.stamp_ns - truth.stamp_ns[0]) / NS_PER_S
    undisturbed = (time > SETTLING_TIME) & ~_near(time, _is_fast(truth), MIN_STEADY_DISTANCE)
    rolling = np.abs(side_means(truth.rolling)) > MIN_ROLLING_SPEED
    steady: Mask = rolling & undisturbed[:, np.newaxis]
    return steady


def _is_fast(truth: Truth) -> Mask:
    """Return when any wheel acceleration exceeds ``FAST_ACCELERATION``."""
    return np.asarray((np.abs(wheel_accelerations(truth)) > FAST_ACCELERATION).any(axis=1))


def wheel_accelerations(truth: Truth) -> Floats:
    """Return the accelerations [rad/s2] of the wheels (n, 4) over ``ACCELERATION_WINDOW``."""
    half = round(0.5 * ACCELERATION_WINDOW * NS_PER_S)
    speed = truth.rolling / truth.radius
    ends = [np.clip(truth.stamp_ns + step, truth.stamp_ns[0], truth.stamp_ns[-1])
            for step in (-half, half)]
    before, after = (at(end, truth.stamp_ns, speed) for end in ends)
    change: Floats = (after - before) * NS_PER_S / (ends[1] - ends[0])[:, np.newaxis]
    return change


def _near(time: Floats, event: Mask, reach: float) -> Mask:
    """Return which of ``time`` (sorted) are within ``reach`` of a time with ``event`` set."""
    events = np.concatenate([[-math.inf], time[event], [math.inf]])
    right = np.searchsorted(events, time)
    near: Mask = np.minimum(events[right] - time, time - events[right - 1]) <= reach
    return near


def moving_mean(values: Floats, stamp_ns: Stamps, width: float) -> Floats:
    """
    Return the means of ``values`` (n, m) over ``width`` [s] around each stamp.

    NaN values are excluded from the means and stay NaN.
    """
    half = round(0.5 * width * NS_PER_S)
    first = np.searchsorted(stamp_ns, stamp_ns - half)
    last = np.searchsorted(stamp_ns, stamp_ns + half, side='right')
    known = np.isfinite(values)
    zero = np.zeros((1, values.shape[1]))
    sums = np.concatenate([zero, np.cumsum(np.where(known, values, 0.0), axis=0)])
    counts = np.concatenate([zero, np.cumsum(known, axis=0)])
    with np.errstate(invalid='ignore', divide='ignore'):
        means = (sums[last] - sums[first]) / (counts[last] - counts[first])
    return np.where(known, means, math.nan)


def estimated_at(wanted_ns: Stamps, stamp_ns: Stamps, values: Floats) -> Floats:
    """
    Return ``values`` (n, m) interpolated at ``wanted_ns``; next to a NaN the nearest value.

    NaN outside the timestamps and in gaps.
    """
    between = at(wanted_ns, stamp_ns, values)
    if len(stamp_ns) < 2:
        return between
    right = np.clip(np.searchsorted(stamp_ns, wanted_ns), 1, len(stamp_ns) - 1)
    left = right - 1
    before, after = wanted_ns - stamp_ns[left], stamp_ns[right] - wanted_ns
    near = np.where((before <= after)[:, np.newaxis], values[left], values[right])
    close = (np.minimum(before, after) >= 0) & (before + after <= MAX_GAP * NS_PER_S)
    return np.where(np.isnan(between) & close[:, np.newaxis], near, between)


def slip_errors(estimate: EstimateSeries, truth: Truth, width: float = 0.0
                ) -> tuple[Floats, Floats]:
    """Return errors and sigmas (n, 2) of the slips of both sides; NaN if undefined."""
    true = side_means(truth.ratio)
    if width:
        true = moving_mean(true, truth.stamp_ns, width)
    slips = estimate.slips
    error = estimated_at(truth.stamp_ns, slips.stamp_ns, side_means(slips.ratio)) - true
    sigma = estimated_at(truth.stamp_ns, slips.stamp_ns, side_means(slips.sigma))
    missed = np.isfinite(true) & np.isnan(error)
    return np.where(missed, 1.0, error), np.where(missed, 1.0, sigma)


def _speed_errors(estimate: EstimateSeries, truth: Truth, true: Floats) -> tuple[Floats, Floats]:
    poses = estimate.poses
    error = estimated_at(truth.stamp_ns, poses.stamp_ns, poses.twist[:, :1])[:, 0] - true
    variance = at(truth.stamp_ns, poses.stamp_ns, poses.twist_variance[:, 0])
    return error, np.sqrt(variance)


def _score(errors: tuple[Floats, Floats], side: int, when: Mask | None = None) -> Score:
    error, sigma = errors[0][:, side], errors[1][:, side]
    return score(error, sigma) if when is None else score(error[when], sigma[when])


def path_score(estimate: EstimateSeries, truth: Truth) -> PathScore:
    """Return the pose errors at times when both poses are known."""
    estimated, true, stamps = aligned(truth.poses, estimate.poses)
    if not len(estimated):
        return PathScore(*(math.nan,) * 5, score(np.empty(0), np.empty(0)), math.nan)
    error = estimated - true
    covariance = at(stamps, estimate.poses.stamp_ns, estimate.poses.pose_covariance)
    position_error = np.linalg.norm(error[:, :2], axis=1)
    squares = _squares(error[:, :2], covariance[:, :2, :2])
    return PathScore(
        distance(true[:, :2]), rms(position_error), float(position_error[-1]),
        0.5 * _mean(squares), _mean((squares <= ELLIPSE_95).astype(float)),
        score(error[:, 2], np.sqrt(covariance[:, 2, 2])), float(error[-1, 2]))


def _squares(error: Floats, covariance: Floats) -> Floats:
    """Return squared Mahalanobis distances of errors (n, 2) with regular covariances."""
    known = np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(error).all(axis=1)
    error, covariance = error[known], covariance[known]
    regular = np.linalg.det(covariance) > 0.0
    error, covariance = error[regular], covariance[regular]
    squares: Floats = np.einsum(
        'ni,ni->n', error, np.linalg.solve(covariance, error[..., np.newaxis])[..., 0])
    return squares


def _icr_error(estimate: EstimateSeries, truth: Truth, when: Mask) -> float:
    turning = when & (np.abs(truth.poses.twist[:, 2]) > MIN_ICR_YAW_RATE)
    own, true = estimate.icr, truth.icr.position[turning, 0]
    error = at(truth.stamp_ns[turning], own.stamp_ns, own.position)[:, 0] - true
    return rms(error[np.isfinite(error)])


def _mean(values: Floats) -> float:
    return float(np.mean(values)) if len(values) else math.nan


def _percent(part: float, whole: float) -> float:
    return 100.0 * part / whole if whole > 0.0 else math.nan
