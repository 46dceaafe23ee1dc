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
Estimated and true motion of a simulated run, and the errors of slip, velocity and pose.

A side is steady if it rolls faster than ``MIN_ROLLING_SPEED``, later than ``SETTLING_TIME`` after
the start, and more than ``MIN_STEADY_DISTANCE`` from any fast change of wheel speed. If the slip
estimate is undefined but the true slip is not, the error counts as 1 with a sigma of 1. The slip
of a side is the mean of its two wheels.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
import math

from benchmarks.scoring import Errors, Run
import numpy as np
from numpy.typing import NDArray
from smart_tire.analysis.metrics import compared_poses, distance, rms
from smart_tire.arrays import Array, Instants
from smart_tire.estimates import at, PoseEstimate, SlipEstimate
from smart_tire.models.vehicle.skid_steer import icr, SIDE_SIGNS
from smart_tire.parameters import RobotParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import Icr, LEFT, NS_PER_S, RIGHT, Sample, WheelSlip

MIN_ROLLING_SPEED = 0.1     # m/s, |r w| of a steady side
SETTLING_TIME = 3.0         # s, after the start of the run
MIN_STEADY_DISTANCE = 0.4   # s, from any fast change
FAST_ACCELERATION = 1.5     # rad/s2, of a wheel
ACCELERATION_WINDOW = 0.05  # s, for dw/dt; longer than the control period of 0.02 s
MAX_GAP = 0.5               # s, between two estimates for interpolation
MIN_ICR_YAW_RATE = 0.1      # rad/s, for scoring the ICR
EXCLUDED_END = 0.5          # s, at the end of a run, for which estimates may be missing
SIDES = {'left': 0, 'right': 1}

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Estimate:
    """
    Estimates of a run by one method.

    Covariances and sigmas are NaN if the method does not provide them.
    """

    poses: PoseEstimate
    slips: SlipEstimate
    icr: tuple[Instants, Array] = (np.empty(0, np.int64), np.empty((0, 2)))  # m, in turns
    nis: float = math.nan      # mean normalized innovation squared: 1 if consistent
    step_us: float = math.nan  # CPU time per step of the grid


@dataclass(frozen=True)
class Truth:
    """Ground truth of a run; all arrays share the timestamps."""

    stamp_ns: Instants
    poses: PoseEstimate
    ratio: Array    # (n, 4), NaN at standstill
    rolling: Array  # (n, 4) m/s, r w
    radius: float    # m


def as_estimate(records: Iterable[Sample], nis: float = math.nan, step_us: float = math.nan
                ) -> Estimate:
    """Return the estimates in ``records`` (Odometry, WheelSlip, Icr) as series."""
    series = SampleArrays(records)
    centers = series.stream(Icr).ordered
    return Estimate(series.poses(), series.slips(), (centers.stamp_ns, centers['position']), nis,
                    step_us)


def as_truth(records: Iterable[Sample], robot: RobotParams) -> Truth:
    """
    Return the ground truth in ``records``: an Odometry and a WheelSlip at every timestamp.

    The last ``EXCLUDED_END`` is excluded.
    """
    series = SampleArrays(records)
    poses, slips, sliding = series.poses(), series.slips(), series.stream(WheelSlip).ordered
    stamps, slip_velocity = sliding.stamp_ns, sliding['velocity']
    count = (np.searchsorted(stamps, stamps[-1] - round(EXCLUDED_END * NS_PER_S), side='right')
             if len(stamps) else 0)
    if not (np.array_equal(poses.stamp_ns, stamps) and count > 1):
        raise ValueError('ground truth needs at least two timestamps with odometry and slip')
    v_x, W = poses.twist[:, 0], poses.twist[:, 2]
    ground = v_x[:, np.newaxis] - 0.5 * robot.track_width * SIDE_SIGNS * W[:, np.newaxis]
    kept = PoseEstimate(*(getattr(poses, one.name)[:count] for one in fields(poses)))
    return Truth(stamps[:count], kept, slips.ratio[:count], (slip_velocity + ground)[:count],
                 robot.wheel_radius)


def side_means(values: Array) -> Array:
    """Return the means (n, 2) of the two wheels of each side of ``values`` (n, 4)."""
    return np.stack([values[:, wheels].mean(axis=1) for wheels in (LEFT, RIGHT)], axis=1)


def score_motion(row: str, seed: int, estimate: Estimate, truth: Truth, *, prefix: str = ''
                 ) -> Run:
    """
    Return the errors of slip and speed while steady and ('all') at all times, of pose and ICR.

    Positions have the sigma along their error. Names begin with ``prefix``.
    """
    steady, (error, sigma) = steady_sides(truth), slip_errors(estimate, truth)
    errors: dict[str, Errors] = {}
    for suffix, when in (('', steady), ('_all', np.ones_like(steady))):
        errors |= {f'slip_{side}{suffix}': Errors(error[when[:, i], i], sigma[when[:, i], i])
                   for side, i in SIDES.items()}
        both = when[:, 0] & when[:, 1]
        errors[f'v{suffix}'] = speed_errors(estimate, truth, 0, both)
    errors['icr'] = _icr_errors(estimate, truth, steady[:, 0] & steady[:, 1])
    path, values = path_errors(estimate, truth)
    values |= {'nis': estimate.nis, 'step_us': estimate.step_us}
    return Run(row, seed, {prefix + name: one for name, one in (errors | path).items()},
               {prefix + name: value for name, value in values.items()})


def steady_sides(truth: Truth) -> Mask:
    """Return when each side is steady, shape (n, 2)."""
    time = (truth.stamp_ns - truth.stamp_ns[0]) / NS_PER_S
    fast = (np.abs(wheel_accelerations(truth)) > FAST_ACCELERATION).any(axis=1)
    events = np.concatenate([[-math.inf], time[fast], [math.inf]])
    right = np.searchsorted(events, time)
    near = np.minimum(events[right] - time, time - events[right - 1]) <= MIN_STEADY_DISTANCE
    undisturbed = (time > SETTLING_TIME) & ~near
    rolling = np.abs(side_means(truth.rolling)) > MIN_ROLLING_SPEED
    steady: Mask = rolling & undisturbed[:, np.newaxis]
    return steady


def wheel_accelerations(truth: Truth) -> Array:
    """Return the accelerations [rad/s2] of the wheels (n, 4) over ``ACCELERATION_WINDOW``."""
    half = round(0.5 * ACCELERATION_WINDOW * NS_PER_S)
    speed = truth.rolling / truth.radius
    ends = [np.clip(truth.stamp_ns + step, truth.stamp_ns[0], truth.stamp_ns[-1])
            for step in (-half, half)]
    before, after = (at(end, truth.stamp_ns, speed) for end in ends)
    change: Array = (after - before) * NS_PER_S / (ends[1] - ends[0])[:, np.newaxis]
    return change


def in_motion(truth: Truth) -> Mask:
    """Return when any wheel rolls."""
    return np.asarray(np.abs(truth.rolling).max(axis=1) > MIN_ROLLING_SPEED)


def slip_errors(estimate: Estimate, truth: Truth) -> tuple[Array, Array]:
    """Return errors and sigmas (n, 2) of the slips of both sides; NaN if undefined."""
    true = side_means(truth.ratio)
    slips = estimate.slips
    error = estimated_at(truth.stamp_ns, slips.stamp_ns, side_means(slips.ratio)) - true
    sigma = estimated_at(truth.stamp_ns, slips.stamp_ns, side_means(slips.sigma))
    missed = np.isfinite(true) & np.isnan(error)
    return np.where(missed, 1.0, error), np.where(missed, 1.0, sigma)


def speed_errors(estimate: Estimate, truth: Truth, axis: int, when: Mask) -> Errors:
    """Return the errors of a component of the velocity of ``base_link`` at times ``when`` (n,)."""
    poses, one = estimate.poses, slice(axis, axis + 1)
    value, variance = (estimated_at(truth.stamp_ns, poses.stamp_ns, values[:, one])[:, 0]
                       for values in (poses.twist, poses.twist_sigma ** 2))
    return Errors((value - truth.poses.twist[:, axis])[when], np.sqrt(variance)[when])


def estimated_at(wanted_ns: Instants, stamp_ns: Instants, values: Array) -> Array:
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


def _icr_errors(estimate: Estimate, truth: Truth, when: Mask) -> Errors:
    """Return the errors of S, the x of the ICR [m], in turns at times ``when``."""
    turning = when & (np.abs(truth.poses.twist[:, 2]) > MIN_ICR_YAW_RATE)
    true, _ = icr(*truth.poses.twist[turning].T)
    return Errors.without_sigma(at(truth.stamp_ns[turning], *estimate.icr)[:, 0] - true)


def path_errors(estimate: Estimate, truth: Truth) -> tuple[dict[str, Errors], dict[str, float]]:
    """Return the pose errors at times when both poses are known, and those at the end."""
    found = compared_poses(estimate.poses, truth.poses)
    estimated, true, stamps = found.estimated, found.true, found.stamp_ns
    if not len(estimated):
        return {}, {}
    error = estimated - true
    covariance = at(stamps, estimate.poses.stamp_ns, estimate.poses.covariance)
    length = np.linalg.norm(error[:, :2], axis=1)
    errors = {'position': Errors(length, _sigma_along(error[:, :2], covariance[:, :2, :2])),
              'heading': Errors(error[:, 2], np.sqrt(covariance[:, 2, 2]))}
    way = distance(true[:, :2])
    return errors, {'distance': way, 'position_share': rms(length) / max(way, 1e-9),
                    'position_end_share': float(length[-1]) / max(way, 1e-9),
                    'heading_end': abs(float(error[-1, 2]))}


def _sigma_along(error: Array, covariance: Array) -> Array:
    """Return the standard deviation (n,) with which (error / sigma)^2 is the NEES per axis."""
    sigma = np.full(len(error), math.nan)
    known = np.isfinite(covariance).all(axis=(1, 2)) & (error != 0.0).any(axis=1)
    known[known] = np.linalg.det(covariance[known]) > 0.0
    squares = np.einsum('ni,ni->n', error[known], np.linalg.solve(
        covariance[known], error[known][..., np.newaxis])[..., 0])
    sigma[known] = np.linalg.norm(error[known], axis=1) / np.sqrt(0.5 * squares)
    return sigma
