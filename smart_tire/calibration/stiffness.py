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
Longitudinal stiffness C_x of the tires from acceleration and braking on straight lines.

The motion of the wheels follows from the accelerometer: its integral is the speed v of the body,
and the force that it shows requires a slip of the tires, by the inverse of the brush model, so
that the wheels roll with ``u = v / (1 - slip)``. The fit compares this with the distances that the
wheels rolled between their timestamps. Jitter of the timestamps is then an error of the response,
and the noise of the accelerometer, small against the accelerations, hardly one of the regressor.

Parameters with similar effects are estimated as well: friction, which bends the curve at larger
slips; drag; errors of the wheel latency (one millisecond corresponds to 2.4 % of C_x for the
paper's robot at 0.8 m/s, with another share at other speeds), of the accelerometer (bias and
scale, and slow changes by the slope of the ground and by its noise).

The stiffness is proportional to the configured mass; it is that of the tire-ground pair.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
import math

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import block_diag

from smart_tire.arrays import Array
from smart_tire.calibration.priors import PRIORS
from smart_tire.calibration.recording import CalibrationRecording, Indices, MIN_ROLLING_SPEED
from smart_tire.calibration.results import CONTRADICTION_SIGMAS, Found
from smart_tire.calibration.straight_segments import (
    MIN_SEGMENT_INTERVALS, MIN_SPEED, straight_segments, StraightSegment)
from smart_tire.errors import EstimatorError
from smart_tire.models.tire.brush_tire import linear_tire_force
from smart_tire.models.vehicle.skid_steer import normal_loads
from smart_tire.numerics.least_squares import (
    anticorrelated, Errors, Fit, HAC_TIME, nonlinear_fit, Prior)
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.samples import GRAVITY
from smart_tire.uncertain import MAX_RELATIVE_SIGMA, Uncertain, weighted_mean

KNOT_INTERVAL = 0.5         # s, of the changes of the accelerometer error
DRAG_SPEED = 0.02           # m/s, below which drag is linear in the speed
DIFFERENCE = 1e-6           # of a value, for its derivative
LOAD_FILTER = 13            # samples, of the acceleration that transfers load
MAX_FORCE_SHARE = 0.9999    # of friction times load
MAX_NOISE_SHARE = 0.08      # of accelerations; more noise makes a tire seem too stiff
MAX_LATENCY_ERROR = 0.04    # s, of the configured latency
MAX_RESIDUAL = 0.1            # of the rolled distances, of the residuals


class Common(IntEnum):
    """Parameters of all segments; initial speed, bias and slopes of each segment follow."""

    STIFFNESS = 0      # ln of C_x [N]
    DRAG = 1           # share of the weight, against the motion
    FRICTION = 2       # ln of mu
    LATENCY_ERROR = 3  # s, of the wheel timestamps in addition to the configured latency
    ACCEL_SCALE = 4    # relative error of measured accelerations: scale, and pitching of the body


@dataclass(frozen=True, kw_only=True)
class StiffnessCurve:
    """Stiffness, with the data of its figure."""

    stiffness: Uncertain      # N, C_x of one wheel
    slip: Array                 # (n,) -, of the wheels against the fitted speed of the body
    force: Array                # (n,) N, of one wheel, positive when driving, as measured
    curve: tuple[Array, Array]  # slip [-] and force [N] of one wheel as fitted


@dataclass(frozen=True, kw_only=True)
class StiffnessFit(StiffnessCurve):
    """Stiffness and the parameters estimated with it."""

    friction: Uncertain       # -, mu, from the bend of the curve
    drag: Uncertain           # N, of all wheels
    latency_error: Uncertain  # s, of the wheel timestamps in addition to the configured latency
    segments: int
    duration: float             # s, of all segments
    excess: float               # rms residual over the configured timestamp jitter

    def report(self) -> Found:
        """Return what is printed."""
        found = Found(notes=[
            f'{self.segments} straight segments, {self.duration:.1f} s in total; residuals '
            f'{self.excess:.2g} times the configured timestamp jitter'])
        found.add('stiffness', self.stiffness, 'N', 'C_x of one wheel, proportional to the mass')
        found.add('rolling drag', self.drag, 'N', 'of all wheels, not written')
        found.add('friction', self.friction, '-', 'from the curvature over slip, not written')
        found.add('latency', self.latency_error, 's',
                  'in addition to encoder.latency, not written')
        return found

    def parameters(self) -> list[Identified]:
        """Return the entries of a parameter file."""
        value, sigma = self.stiffness
        return [Identified('tire.longitudinal_stiffness', value, sigma),
                Identified('tire.longitudinal_stiffness_sigma', sigma / value,
                           note='of this tire on the recorded surface')]


@dataclass(frozen=True)
class _Motion:
    """Motion of one segment as a function of common and own parameters."""

    segment: StraightSegment
    robot: RobotParams
    hats: Array   # (m, k) piecewise linear functions of slope and accelerometer noise
    lost: Array   # (m, k + 2) speeds at an initial speed, slope and changes of one
    loads: Array  # (2, m) N, of the axle with less and of that with more
    used: Indices  # (r,) intervals in motion

    @classmethod
    def of(cls, segment: StraightSegment, robot: RobotParams) -> _Motion:
        time = segment.time
        count = max(2, round(float(np.ptp(time)) / KNOT_INTERVAL) + 1)
        knots = np.linspace(time[0], time[-1], count)
        hats = np.maximum(1.0 - np.abs(time[:, None] - knots) / (knots[1] - knots[0]), 0.0)
        slopes = np.column_stack([np.ones(len(time)), hats])
        lost = np.column_stack([np.ones(len(time)), -cumulative_trapezoid(
            slopes, time, axis=0, initial=0.0)])
        window = np.full(LOAD_FILTER, 1.0 / LOAD_FILTER)
        force = np.convolve(np.pad(segment.force, LOAD_FILTER // 2, 'edge'), window, 'valid')
        loads = normal_loads(robot, force, 0.0)
        axles = np.maximum(np.stack([loads[:, :2].sum(axis=1), loads[:, 2:].sum(axis=1)]), 1e-3)
        return cls(segment, robot, hats, lost, np.sort(axles, axis=0),
                   np.flatnonzero(np.abs(segment.speed) > MIN_ROLLING_SPEED))

    @property
    def prior(self) -> list[tuple[float, float] | None]:
        """Return the prior of initial speed, accelerometer bias, mean slope and its changes."""
        segment, step = self.segment, float(np.median(np.diff(self.segment.time)))
        sigma = math.hypot(segment.noise * math.sqrt(step / KNOT_INTERVAL),
                           PRIORS['changes of that'].sigma * math.sqrt(KNOT_INTERVAL))
        return [PRIORS['speed at rest'].prior if segment.stationary[0] else None,
                PRIORS['bias of the accelerometer'].prior,
                PRIORS['g times the slope of a segment'].prior,
                *[(0.0, sigma)] * self.hats.shape[1]]

    def wheels(self, common: Array, own: Array) -> tuple[Array, Array, Array, Array]:
        """Return speeds of body and wheels [m/s], force over mass [m/s2] and slip of the tires."""
        scale = 1.0 + common[Common.ACCEL_SCALE]
        initial, bias, slope, changes = own[0], own[1], own[2], self.hats @ own[3:]
        felt = (self.segment.force - bias) / scale
        body = initial + cumulative_trapezoid(felt - slope - changes, self.segment.time,
                                              initial=0.0)
        force = felt + GRAVITY * common[Common.DRAG] * np.tanh(body / DRAG_SPEED)
        slip = self._slip(common, force)[0]
        return body, body / (1.0 - np.clip(slip * np.sign(body), -1.0, 0.9)), force, slip

    def _slip(self, common: Array, force: Array) -> tuple[Array, Array]:
        """Return the slip of the tires at a ``force`` over mass [m/s2], and its derivative."""
        stiffness, friction = np.exp(common[[Common.STIFFNESS, Common.FRICTION]])  # of a wheel
        linear, slope = linear_tire_force(
            self.robot.mass * force, friction * self.loads, MAX_FORCE_SHARE)
        scale = 0.5 / stiffness
        return scale * linear, scale * slope * self.robot.mass

    def residual(self, common: Array, own: Array) -> Array:
        """Return by how much the intervals in motion were too long [s], and speeds at rest."""
        body, wheels, _, _ = self.wheels(common, own)
        segment = self.segment
        rolled = np.interp(segment.stamps - common[Common.LATENCY_ERROR], segment.time,
                           cumulative_trapezoid(wheels, segment.time, initial=0.0))
        missing = (segment.distance - np.diff(rolled))[self.used]
        return np.concatenate([missing / segment.speed[self.used], -body[segment.resting]])

    def jacobian(self, common: Array, own: Array) -> Array:
        """Return the derivatives of ``residual`` by the own parameters."""
        body, wheels, _, _ = self.wheels(common, own)
        segment, step = self.segment, np.where(np.arange(len(own)) == 1, DIFFERENCE, 0.0)
        ratio = np.where(body == 0.0, 1.0, wheels / np.where(body == 0.0, 1.0, body))
        rolled = cumulative_trapezoid(ratio[:, None] * self.lost, segment.time, axis=0,
                                      initial=0.0)
        stamps = segment.stamps - common[Common.LATENCY_ERROR]
        left = np.clip(np.searchsorted(segment.time, stamps) - 1, 0, len(segment.time) - 2)
        share = ((stamps - segment.time[left]) / np.diff(segment.time)[left])[:, None]
        missing = -np.diff(rolled[left] + share * (rolled[left + 1] - rolled[left]), axis=0)
        result = np.concatenate([missing[self.used] / segment.speed[self.used, None],
                                 -self.lost[segment.resting]])
        by_bias = (self.residual(common, own + step) - self.residual(common, own)) / DIFFERENCE
        return np.insert(result, 1, by_bias, axis=1)

    def sigma(self, common: Array, own: Array) -> Array:
        """Return the standard deviations of ``residual`` from errors of the force balance."""
        _, _, force, _ = self.wheels(common, own)
        segment, slip = self.segment, PRIORS['force balance'].sigma * self._slip(common, force)[1]
        center = 0.5 * (segment.stamps[1:] + segment.stamps[:-1])
        error = np.interp(center, segment.time, slip) * np.diff(segment.stamps)
        return np.concatenate([error[self.used],
                               np.full(len(segment.resting), PRIORS['speed at rest'].sigma)])

    def contiguous(self) -> Array:
        """Return which rows begin with the timestamp that ended the previous one."""
        return np.concatenate([[False], np.diff(self.used) == 1,
                               np.zeros(len(self.segment.resting), bool)])


def identify_stiffness(recordings: Sequence[CalibrationRecording],
                       robot: RobotParams) -> StiffnessFit:
    """
    Return the stiffness from recordings on the same ground.

    If recordings differ by more than their standard errors, those are scaled up. Raises
    EstimatorError with the reason if the stiffness is not observable.
    """
    motions = [_motions(recording, robot) for recording in recordings]
    fits = [_fit(part, robot) for part in motions]
    separate = [part.stiffness for part in fits]
    fit = fits[0]
    if len(fits) > 1:
        try:
            fit = _fit([one for part in motions for one in part], robot)
        except EstimatorError as error:
            raise EstimatorError(_refusal(separate[0], separate)) from error
    combined = fit.stiffness
    fit = replace(fit, stiffness=_scaled_by_scatter(combined, separate))
    if not (fit.stiffness.value > 0.0 and fit.stiffness.determined):
        known = all(item.determined for item in separate)
        raise EstimatorError(_refusal(fit.stiffness, separate if known else ()))
    return fit


def _scaled_by_scatter(combined: Uncertain, separate: Sequence[Uncertain]) -> Uncertain:
    """Return ``combined`` with its sigma scaled by the scatter of ``separate``."""
    determined = [item for item in separate if item.determined]
    if len(determined) < 2:
        return combined
    expected = sum(item.sigma ** -2 for item in determined) ** -0.5
    return Uncertain(combined.value,
                     combined.sigma * weighted_mean(determined).sigma / expected)


def _refusal(stiffness: Uncertain, separate: Sequence[Uncertain]) -> str:
    """Return the reason why a stiffness is refused; ``separate`` are those that differ."""
    if len(separate) > 1:
        values = ', '.join(f'{item.value:.3g} ± {item.sigma:.2g}' for item in separate)
        return f'the recordings give {values} N: they are not of one tire on one ground'
    return uncertain(stiffness)


def uncertain(stiffness: Uncertain) -> str:
    """Return the reason why a stiffness with a large standard error is refused."""
    return (f'standard error of {stiffness.sigma / abs(stiffness.value):.0%}, expected at most '
            f'{MAX_RELATIVE_SIGMA:.0%}: speed changes too little on straight lines, below '
            'critical slip')


def check_noise(noise: float, acceleration: Array) -> None:
    """Raise EstimatorError if ``noise`` is large against accelerations (n,), both in m/s2."""
    share = noise / max(float(np.std(acceleration)), 1e-9)
    if share > MAX_NOISE_SHARE:
        raise EstimatorError(
            f'the accelerometer noise in motion is {share:.0%} of the accelerations, expected at '
            f'most {MAX_NOISE_SHARE:.0%}: speed changes too little, or the robot vibrates')


def _motions(recording: CalibrationRecording, robot: RobotParams) -> list[_Motion]:
    """Return the straight segments; EstimatorError if there are none, or if they vibrate."""
    segments = straight_segments(recording, robot)
    if not segments:
        raise EstimatorError(f'no straight segment of {MIN_SEGMENT_INTERVALS} wheel samples '
                             f'above {MIN_SPEED:g} m/s')
    moving = np.concatenate([segment.force[~segment.stationary] for segment in segments])
    check_noise(math.sqrt(float(np.mean([  # of the mean over an interval of the wheels
        segment.noise ** 2 * len(segment.distance) / len(segment.time)
        for segment in segments]))), moving)
    return [_Motion.of(segment, robot) for segment in segments]


def _fit(motions: Sequence[_Motion], robot: RobotParams) -> StiffnessFit:
    priors, friction = [motion.prior for motion in motions], PRIORS['friction']
    prior = Prior.of(
        (math.log(robot.tire.longitudinal_stiffness), math.log(PRIORS['stiffness'].sigma)),
        PRIORS['drag'].prior, (math.log(friction.value), math.log(friction.sigma)),
        PRIORS['error of the latency'].prior, PRIORS['acceleration on straight lines'].prior,
        *[item for part in priors for item in part])
    ends = np.cumsum([len(Common), *map(len, priors)])
    start = prior.mean.copy()
    start[ends[:-1]] = [0.0 if motion.segment.stationary[0] else motion.segment.speed[0]
                        for motion in motions]

    def split(values: Array) -> list[tuple[_Motion, Array, Array]]:
        return [(motion, values[:len(Common)], values[first:last])
                for motion, first, last in zip(motions, ends[:-1], ends[1:])]

    step = float(np.median(np.concatenate([np.diff(one.segment.stamps) for one in motions])))

    def residual(values: Array) -> Array:
        return np.concatenate([one.residual(*own) for one, *own in split(values)])

    def jacobian(values: Array) -> Array:
        here, common = residual(values), DIFFERENCE * np.eye(len(values))[:len(Common)]
        by_common = [(residual(values + step) - here) / DIFFERENCE for step in common]
        return np.column_stack([*by_common, block_diag(
            *(one.jacobian(*own) for one, *own in split(values)))])

    fit = nonlinear_fit(
        residual, start, prior,
        lambda values: np.concatenate([one.sigma(*own) for one, *own in split(values)]),
        Errors(math.ceil(HAC_TIME / step), anticorrelated(
            np.concatenate([motion.contiguous() for motion in motions]))), jacobian=jacobian)
    residual_share = float(np.median(fit.row_sigma)) / step
    if residual_share > MAX_RESIDUAL:
        raise EstimatorError(
            f'the wheels roll {residual_share:.0%} more or less than the accelerometer explains, '
            f'expected at most {MAX_RESIDUAL:.0%}: wheels slide, the ground changes, or the axes '
            'of the IMU are wrong')
    _check_plausible(fit)
    return _result(motions, fit, [one.wheels(*own) for one, *own in split(fit.values)], robot)


def _check_plausible(fit: Fit) -> None:
    """Raise EstimatorError if parameters with known limits contradict them."""
    latency, drag = fit.estimate(Common.LATENCY_ERROR), fit.estimate(Common.DRAG)
    if abs(latency.value) > MAX_LATENCY_ERROR:
        raise EstimatorError(f'the wheels are late by {latency.value:.3f} s in addition to '
                             'encoder.latency, or the axes of the IMU are wrong')
    if drag.value < -CONTRADICTION_SIGMAS * drag.sigma:
        raise EstimatorError(f'the drag is negative, {drag.value:.2f} of the weight: the motion '
                             'is not that of a robot on level ground')


def _result(motions: Sequence[_Motion], fit: Fit, wheels: Sequence[tuple[Array, ...]],
            robot: RobotParams) -> StiffnessFit:
    stiffness, friction = (math.exp(fit.values[row])
                           for row in (Common.STIFFNESS, Common.FRICTION))
    slips, forces, curve = [], [], []
    for motion, (body, _, force, slip) in zip(motions, wheels):
        segment = motion.segment
        center = (0.5 * (segment.stamps[1:] + segment.stamps[:-1])
                  - fit.values[Common.LATENCY_ERROR])[motion.used]
        speed, direction = segment.speed[motion.used], np.sign(segment.speed[motion.used])
        slips.append(1.0 - np.interp(center, segment.time, body) / speed)
        forces.append(0.25 * robot.mass * direction * np.interp(center, segment.time, force))
        curve.append([direction * np.interp(center, segment.time, slip), forces[-1]])
    fitted = np.concatenate(curve, axis=1)
    fitted = fitted[:, np.argsort(fitted[0])]
    weight = robot.mass * GRAVITY
    C_x, mu, drag = (fit.estimate(row) for row in (
        Common.STIFFNESS, Common.FRICTION, Common.DRAG))
    return StiffnessFit(
        # a wrong radius scales all speeds, and thereby the forces
        stiffness=Uncertain(stiffness, stiffness * math.hypot(
            PRIORS['rolling radius'].sigma, C_x.sigma)),
        friction=Uncertain(friction, friction * mu.sigma),
        drag=Uncertain(weight * drag.value, weight * drag.sigma),
        latency_error=fit.estimate(Common.LATENCY_ERROR), segments=len(motions),
        duration=sum(float(np.ptp(motion.segment.stamps)) for motion in motions),
        slip=np.concatenate(slips), force=np.concatenate(forces),
        excess=float(np.median(fit.row_sigma)) / max(robot.encoder.stamp_jitter, 1e-4),
        curve=(fitted[0], fitted[1]))
