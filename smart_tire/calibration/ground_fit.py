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
One fit of the unknowns of the ground window to whole recordings on one ground.

The recordings are divided into windows. Slope, bend and start belong to each window; all other
unknowns are constant, and the same in all windows. Each window is linearized by its own fit
(``estimation.ground.window_fit``) around the present estimate of the constants; the sum of their
normal equations, without the unknowns of each window (Schur complement), gives the next estimate.
Two further constants are corrected in the data between two passes: latency of the wheels, which
may be too large for a linear model, and scale of the forward acceleration (pitching of the body).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.priors import PRIORS, UNINFORMATIVE
from smart_tire.calibration.recording import CalibrationRecording
from smart_tire.calibration.sensor_noise import mean_jitter, motion_noise
from smart_tire.errors import EstimatorError
from smart_tire.estimation.ground.measurements import FORCE_X, Measurements, WindowData
from smart_tire.estimation.ground.unknowns import (
    CONVERGED, GROUND, Hypothesis, LENGTH, MAX_GAP, MAX_STEP, OWN, priors, Row, SETTLING, SIZE,
    Tension, Unknown, WindowPrior)
from smart_tire.estimation.ground.window_fit import WindowEstimate, WindowFit
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain

SCALE, COUNT = SIZE, SIZE + 1  # relative error of the forward acceleration: not in the live window
PASSES = 25             # at most
HELD = 1e-3            # of the sigma of its prior: a constant, in the fit of one window
END_MARGIN = 0.1       # s, at both ends of a recording: errors of the latency

_OWN = np.zeros(COUNT, bool)  # unknowns that each window has of its own
_OWN[OWN] = _OWN[Unknown.SLOPE_X:Unknown.SLOPE_Y + 1] = True
CONSTANTS, OWNS = np.flatnonzero(~_OWN), np.flatnonzero(_OWN)


@dataclass(frozen=True, eq=False)
class Equations:
    """Normal equations of a window in the constants, relative to the estimate of the pass."""

    part: int          # half of a recording that it belongs to
    fit: WindowEstimate
    measurements: Measurements
    matrix: Array      # (constants, constants)
    vector: Array      # (constants,)


@dataclass(frozen=True, eq=False)
class GroundFit:
    """Constants of the robot on one ground, with their covariance."""

    robot: RobotParams
    rows: Sequence[Row]      # priors of all unknowns
    x: Array                 # (COUNT,)
    covariance: Array        # (COUNT, COUNT), of the constants
    latency: Uncertain       # s, of the wheels
    noise: float             # m/s2, of a sample of the accelerometer in motion
    windows: Sequence[Equations]

    def estimate(self, row: int) -> Uncertain:
        """Return an unknown with its standard error."""
        return Uncertain(float(self.x[row]), math.sqrt(self.covariance[row, row]))

    def positive(self, row: int) -> Uncertain:
        """Return what the unknown is the logarithm of."""
        value, sigma = self.estimate(row)
        return Uncertain(math.exp(value), math.exp(value) * sigma)

    @property
    def tension(self) -> Tension:
        """Return the nuisance that contradicts its prior most."""
        mean, sigma = self.rows[SCALE][:2]
        scale = Tension('acceleration on straight lines', abs(self.x[SCALE] - mean) / sigma)
        return max(Tension.of(self.x, self.rows), scale, key=lambda one: one.size)

    @property
    def grounds(self) -> list[dict[int, Uncertain]]:
        """
        Return ln C_x, ln mu and ln f of the first and the last windows of each recording alone.

        Of everything else as much is known as from all windows.
        """
        free = np.isin(CONSTANTS, range(GROUND.start, GROUND.stop))
        known = self.covariance[np.ix_(CONSTANTS[~free], CONSTANTS[~free])]
        sigma = np.array([self.rows[row].sigma for row in CONSTANTS[free]])
        off = np.array([self.rows[row].mean for row in CONSTANTS[free]]) - self.x[CONSTANTS[free]]
        prior = np.zeros((len(CONSTANTS), len(CONSTANTS)))
        prior[np.ix_(~free, ~free)] = np.linalg.inv(known)
        prior[free, free] = sigma ** -2.0
        start = np.zeros(len(CONSTANTS))
        start[free] = off / sigma ** 2
        found = []
        for part in sorted({one.part for one in self.windows}):
            own = [one for one in self.windows if one.part == part]
            covariance = np.linalg.inv(prior + sum(one.matrix for one in own))
            value = covariance @ (start + sum(one.vector for one in own))
            found.append({row: Uncertain(float(self.x[row] + value[row]),
                                         math.sqrt(covariance[row, row]))
                          for row in CONSTANTS[free]})
        return found


def calibration_rows(robot: RobotParams) -> list[Row]:
    """Return the priors, wide where the recordings shall determine a value."""
    rows = [*priors(robot), Row(*PRIORS['acceleration on straight lines'].prior)]
    wide = {
        Unknown.STIFFNESS: UNINFORMATIVE, Unknown.TORQUE_SCALE: UNINFORMATIVE,
        Unknown.DELAY: PRIORS['wheel latency'], Unknown.RADIUS: PRIORS['rolling radius'],
        Unknown.MOTOR_INERTIA: PRIORS['motor parameters']}
    for row, known in wide.items():
        rows[row] = rows[row]._replace(mean=0.0, sigma=known.sigma)
    stiffness = math.log(robot.tire.longitudinal_stiffness)
    rows[Unknown.STIFFNESS] = rows[Unknown.STIFFNESS]._replace(mean=stiffness)
    return rows


def fit_ground(recordings: Sequence[CalibrationRecording], robot: RobotParams, *,
               torques: bool) -> GroundFit:
    """
    Return the fit of ``recordings``; with ``torques`` that of the motors, too.

    ``robot`` has what is known; a latency or jitter need not be. Raises EstimatorError with the
    reason without motion, or where the fit does not converge.
    """
    robot = _with_noise(robot, recordings)
    rows = calibration_rows(robot)
    mean, sigma = (np.array([getattr(row, name) for row in rows]) for name in ('mean', 'sigma'))
    window_fit, x, covariance = WindowFit(robot, rows[:SIZE]), mean.copy(), np.diag(sigma ** 2)
    latency, scale, step, gain = robot.encoder.latency, 1.0, math.inf, 1.0
    for _ in range(PASSES):
        # relative to what the data are corrected by
        x[[Unknown.DELAY, SCALE]] = 0.0
        off = mean - x
        off[[Unknown.DELAY, SCALE]] += robot.encoder.latency - latency, 1.0 - scale
        prior = WindowPrior(
            x[:SIZE].copy(), np.diag(np.where(_OWN, sigma, HELD * sigma)[:SIZE] ** 2))
        windows = []
        for number, recording in enumerate(recordings):
            fits = list(_fits(recording, robot, latency, scale, prior, window_fit,
                              torques=torques))
            windows += [_equations(2 * number + (2 * i >= len(fits)), *one, x, window_fit, sigma)
                        for i, one in enumerate(fits)]
        if not windows:
            raise EstimatorError('the wheels do not rotate')
        weight = sigma[CONSTANTS] ** -2.0
        matrix = np.diag(weight) + sum(one.matrix for one in windows)
        own = np.linalg.inv(matrix)
        change = own @ (weight * off[CONSTANTS] + sum(one.vector for one in windows))
        before, step = step, float(change @ matrix @ change)
        gain *= 0.5 if step > before else 1.0
        change *= min(gain, MAX_STEP / max(float(np.abs(change).max()), 1e-9))
        x[CONSTANTS] += change
        covariance = np.diag(sigma ** 2)
        covariance[np.ix_(CONSTANTS, CONSTANTS)] = own
        latency, scale = latency + float(x[Unknown.DELAY]), scale * (1.0 + float(x[SCALE]))
        if step < CONVERGED:
            break
    else:
        raise EstimatorError('the fit of all windows does not converge: speed changes too little, '
                             'wheels slide, the ground changes, or the axes of the IMU are wrong')
    late = Uncertain(latency, math.sqrt(covariance[Unknown.DELAY, Unknown.DELAY]))
    x[[Unknown.DELAY, SCALE]] = latency - robot.encoder.latency, scale - 1.0
    return GroundFit(robot, rows, x, covariance, late, robot.imu.accel_noise, windows)


def _with_noise(robot: RobotParams, recordings: Sequence[CalibrationRecording]) -> RobotParams:
    """Return ``robot`` with jitter and vibration of the recordings, where they are observable."""
    try:
        jitter = mean_jitter(recordings, robot).value
    except EstimatorError:
        jitter = robot.encoder.stamp_jitter
    noise = motion_noise(recordings)[1].value
    return replace(
        robot, encoder=replace(robot.encoder, stamp_jitter=jitter),
        imu=replace(robot.imu, accel_noise=float(np.fmax(noise, robot.imu.accel_noise))))


def _fits(recording: CalibrationRecording, robot: RobotParams, latency: float, scale: float,
          prior: WindowPrior, window_fit: WindowFit, *,
          torques: bool) -> Iterator[tuple[WindowEstimate, Measurements]]:
    """Yield the fits of the windows of a recording, and their measurements."""
    imu, wheels = recording.imu, recording.wheels
    position = wheels.position
    if position is None:
        position = np.cumsum(wheels.velocity * np.gradient(wheels.time)[:, np.newaxis], axis=0)
    torque = wheels.torque if torques and wheels.torque is not None else np.full_like(
        wheels.velocity, math.nan)
    data = WindowData(
        np.column_stack([imu.time, imu.rate[:, 2], imu.force[:, 0] / scale, imu.force[:, 1]]),
        np.column_stack([wheels.time - latency, position, torque]), [])
    # the same windows for all latencies
    begin = max(imu.time[0], wheels.time[0] - robot.encoder.latency) + SETTLING + END_MARGIN
    last = min(imu.time[-1], wheels.time[-1] - robot.encoder.latency) - END_MARGIN
    hypothesis = Hypothesis(prior, prior.mean, heading=(float(data.imu[0, 0]), 0.0))
    count = math.ceil((last - begin) / LENGTH - 0.5)
    for first in begin + LENGTH * np.arange(count):
        end = min(first + LENGTH, last)
        spans = [rows[(rows[:, 0] > first - SETTLING) & (rows[:, 0] < end), 0]
                 for rows in (data.imu, data.wheels)]
        if any(len(span) < 4 or np.ptp(span) < end - first or np.diff(span).max() > MAX_GAP
               for span in spans):
            hypothesis = replace(hypothesis, times=None, velocities=None)
            continue
        measurements = Measurements(robot, data, first - SETTLING, first, end)
        fit = window_fit.fit(hypothesis, measurements, -math.inf, near=True)
        hypothesis = replace(hypothesis, times=measurements.times,
                             velocities=fit.motion.velocities)
        yield fit, measurements


def _equations(part: int, fit: WindowEstimate, measurements: Measurements, x: Array,
               window_fit: WindowFit, sigma: Array) -> Equations:
    """Return the normal equations of a window without its own unknowns."""
    predicted = measurements.predict(fit.x[np.newaxis], fit.motion)[0]
    by_scale = np.zeros((*predicted.shape, 1))
    by_scale[FORCE_X, :, 0] = predicted[FORCE_X] - fit.x[Unknown.ACCEL_BIAS_X]
    jacobian = np.column_stack([fit.rows.jacobian, fit.whiten(
        by_scale, np.zeros((len(measurements.crossing_measured), 1)))])
    at = np.append(fit.x, 0.0)
    at[CONSTANTS] -= x[CONSTANTS]  # own unknowns have a mean of 0
    residual = fit.rows.residual + jacobian @ at
    matrix, vector = jacobian.T @ jacobian, jacobian.T @ residual
    of_own = matrix[np.ix_(OWNS, OWNS)] + np.diag(sigma[OWNS] ** -2.0)
    both = matrix[np.ix_(CONSTANTS, OWNS)]
    return Equations(part, fit, measurements,
                     matrix[np.ix_(CONSTANTS, CONSTANTS)] - both @ np.linalg.solve(of_own, both.T),
                     vector[CONSTANTS] - both @ np.linalg.solve(of_own, vector[OWNS]))
