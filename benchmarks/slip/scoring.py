"""
Scores of an estimate against the truth of a simulated run.

Steady is what the published targets mean by it: a side that rolls faster than ``ROLLING``, later
than ``SETTLED`` after the start and more than ``APART`` from any fast change of a wheel's speed.
A slip that is undefined where the true one is not counts as an error of 1 with a sigma of 1.
The slip of a side is the mean of its two wheels.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.slip.series import EstimateSeries, side_means, Truth
from smart_tire.analysis.metrics import aligned, distance, rms, Score, score
from smart_tire.analysis.series import at, Floats, Stamps
from smart_tire.samples import NS_PER_S

ROLLING = 0.1        # m/s, |r w| of a steady side
SETTLED = 3.0        # s after the start of the run
APART = 0.4          # s from any fast change
FAST = 1.5           # rad/s2, of a wheel; the four numbers are those of the published targets
SMOOTHED = 0.05      # s, over which dw/dt is taken: longer than the control's step of 0.02 s
AVERAGED = 0.125     # s, over which the truth is averaged where all times count
MAX_GAP = 0.5        # s between two estimates; longer, nothing is known in between
ELLIPSE = -2.0 * math.log(0.05)  # squared distance with 95 % of a plane's normal errors inside
TURNING = 0.1        # rad/s, above which the centre of rotation is judged

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Parts:
    """Scores of one quantity where the run is judged, and over all times."""

    judged: Score  # steady parts, or all times by averaged truth
    always: Score  # all times, changes of speed included


@dataclass(frozen=True)
class PathScore:
    """Errors of the pose, which starts from the true one."""

    distance_m: float
    rms_m: float
    end_m: float
    nees: float        # mean squared position error over its covariance and 2: 1 is right
    inside: float      # share within the 95 % ellipse
    heading: Score     # rad
    heading_end: float  # rad

    @property
    def rms_percent(self) -> float:
        """Return the rms position error in per cent of the distance; NaN without distance."""
        return _percent(self.rms_m, self.distance_m)

    @property
    def end_percent(self) -> float:
        """Return the position error at the end in per cent of the distance."""
        return _percent(self.end_m, self.distance_m)


@dataclass(frozen=True)
class RunScore:
    """All scores of one estimate of one run; NaN where there is nothing to judge."""

    left: Parts
    right: Parts
    speed: Parts         # m/s, forward, of base_link
    path: PathScore
    icr_x: float         # m, rms error of S while judged and turning
    nis: float           # mean normalised innovation squared: 1 is right
    step_us: float


def score_run(estimate: EstimateSeries, truth: Truth, *, averaged: bool = False) -> RunScore:
    """
    Return the scores of ``estimate``.

    With ``averaged`` all times are judged, by the truth averaged over ``AVERAGED``, and not
    only the steady ones.
    """
    slips = _slip_errors(estimate, truth)
    speeds = _speed_errors(estimate, truth, truth.poses.twist[:, 0])
    if averaged:
        judged_slips = _slip_errors(estimate, truth, AVERAGED)
        judged_speed = _speed_errors(
            estimate, truth, moving_mean(truth.poses.twist[:, :1], truth.stamp_ns, AVERAGED)[:, 0])
        steady = np.ones((len(truth.stamp_ns), 2), bool)
    else:
        judged_slips, judged_speed, steady = slips, speeds, steady_sides(truth)
    left, right = (Parts(_score(judged_slips, side, steady[:, side]), _score(slips, side))
                   for side in (0, 1))
    whole: Mask = np.asarray(steady.all(axis=1))
    speed = Parts(score(judged_speed[0][whole], judged_speed[1][whole]), score(*speeds))
    return RunScore(left, right, speed, path_score(estimate, truth),
                    _icr_error(estimate, truth, whole), _mean(estimate.innovations.value),
                    estimate.step_us)


def steady_slips(estimate: EstimateSeries, truth: Truth) -> tuple[Floats, Floats]:
    """Return errors and sigmas (n,) of the slips of both sides while these are steady."""
    steady = steady_sides(truth)
    error, sigma = _slip_errors(estimate, truth)
    return error[steady], sigma[steady]


def steady_sides(truth: Truth) -> Mask:
    """Return when each side is steady, shape (n, 2)."""
    time = (truth.stamp_ns - truth.stamp_ns[0]) / NS_PER_S
    calm = (time > SETTLED) & ~_near(time, _is_fast(truth), APART)
    steady: Mask = (np.abs(side_means(truth.rolling)) > ROLLING) & calm[:, np.newaxis]
    return steady


def _is_fast(truth: Truth) -> Mask:
    """Return when any wheel changes its speed fast: by its change over ``SMOOTHED``."""
    half = round(0.5 * SMOOTHED * NS_PER_S)
    speed = truth.rolling / truth.radius
    ends = [np.clip(truth.stamp_ns + step, truth.stamp_ns[0], truth.stamp_ns[-1])
            for step in (-half, half)]
    before, after = (at(end, truth.stamp_ns, speed) for end in ends)
    change = (after - before) * NS_PER_S / (ends[1] - ends[0])[:, np.newaxis]
    return np.asarray((np.abs(change) > FAST).any(axis=1))


def _near(time: Floats, event: Mask, reach: float) -> Mask:
    """Return which of ``time`` (sorted) lie within ``reach`` of one at which ``event`` is set."""
    events = np.concatenate([[-math.inf], time[event], [math.inf]])
    right = np.searchsorted(events, time)
    near: Mask = np.minimum(events[right] - time, time - events[right - 1]) <= reach
    return near


def moving_mean(values: Floats, stamp_ns: Stamps, width: float) -> Floats:
    """
    Return the means of ``values`` (n, m) over ``width`` [s] around each stamp.

    What is NaN is left out of the means of its neighbours and stays NaN itself.
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
    Return ``values`` (n, m) at ``wanted_ns``: between their stamps, beside a NaN the nearest.

    NaN outside of the stamps and in their gaps.
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


def _slip_errors(estimate: EstimateSeries, truth: Truth, width: float = 0.0
                 ) -> tuple[Floats, Floats]:
    """Return errors and sigmas (n, 2) of the sides' slips; NaN where no slip is defined."""
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
    """Return the errors of the pose where both are known."""
    guess, true, stamps = aligned(truth.poses, estimate.poses)
    if not len(guess):
        return PathScore(*(math.nan,) * 5, score(np.empty(0), np.empty(0)), math.nan)
    error = guess - true
    covariance = at(stamps, estimate.poses.stamp_ns, estimate.poses.pose_covariance)
    off = np.linalg.norm(error[:, :2], axis=1)
    squares = _squares(error[:, :2], covariance[:, :2, :2])
    return PathScore(
        distance(true[:, :2]), rms(off), float(off[-1]), 0.5 * _mean(squares),
        _mean((squares <= ELLIPSE).astype(float)),
        score(error[:, 2], np.sqrt(covariance[:, 2, 2])), float(error[-1, 2]))


def _squares(error: Floats, covariance: Floats) -> Floats:
    """Return squares of errors (n, 2) over their covariances, where these are solid."""
    known = np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(error).all(axis=1)
    error, covariance = error[known], covariance[known]
    solid = np.linalg.det(covariance) > 0.0
    error, covariance = error[solid], covariance[solid]
    squares: Floats = np.einsum(
        'ni,ni->n', error, np.linalg.solve(covariance, error[..., np.newaxis])[..., 0])
    return squares


def _icr_error(estimate: EstimateSeries, truth: Truth, when: Mask) -> float:
    turning = when & (np.abs(truth.poses.twist[:, 2]) > TURNING)
    own, true = estimate.icr, truth.icr.place[turning, 0]
    error = at(truth.stamp_ns[turning], own.stamp_ns, own.place)[:, 0] - true
    return rms(error[np.isfinite(error)])


def _mean(values: Floats) -> float:
    return float(np.mean(values)) if len(values) else math.nan


def _percent(part: float, whole: float) -> float:
    return 100.0 * part / whole if whole > 0.0 else math.nan
