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
Centers of rotation: S (their x coordinate) and the effective track, from turns.

Paper B fits S to experimental data. In the axes of REP-103 B(4) is ``v_y = -S W``, so the lateral
displacement over an interval is ``-S`` times the change of yaw: this is fitted if there is a pose
reference. Without one, the IMU at x_M, y_M measures the derivative of B(8)'s
``v_y,M = (x_M - S) W``: ``a_y = (x_M - S) dW/dt + W (v_x - y_M W)``, with the wheel speed for v_x.
Other contributions to both are nuisance parameters with priors. An error of x_M, or of the
position of the reference, is an error of S of the same size. S is not quite constant: tires slip
sideways to carry the centripetal force, so it moves forward with the square of the speed. The
spread of S between turns is reported as well.

The effective track is the speed difference of the sides over the yaw rate, without the lag of the
body (``latency``); on one ground all turns have the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.latency import (
    MANEUVER_TIME, moving_intervals, yaw_motion, YawRateFit)
from smart_tire.calibration.priors import LIMITS, PRIORS, require
from smart_tire.calibration.recording import (
    CalibrationRecording, Mask, MIN_RATE, Signal, SMOOTH_TIME)
from smart_tire.calibration.reference import usable_reference
from smart_tire.calibration.results import Found
from smart_tire.errors import EstimatorError
from smart_tire.estimation.slip.state import MODEL_TIME
from smart_tire.numerics.least_squares import Errors, Prior, regression, Rows
from smart_tire.numerics.robust import mad_sigma
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.uncertain import Uncertain, weighted_mean

BY_IMU = 'lateral acceleration of the IMU'

Turn = tuple[float, float]  # begin and end [s]


@dataclass(frozen=True)
class IcrFit:
    """S of the whole recording and of each turn."""

    icr: Uncertain     # m, in base_link
    source: str        # measurement that it is estimated from
    spread: float      # m, standard deviation between turns, without their standard errors
    turn_time: Array   # (k,) s, centers of the turns
    turn_icr: Array    # (k,) m
    turn_sigma: Array  # (k,) m
    regressor: Array   # (n,) rad or rad/s2, factor of S
    response: Array    # (n,) m or m/s2, lateral motion without the nuisance parameters
    unit: str          # of the response

    @property
    def initial_sigma(self) -> float:
        """Return the standard deviation [m] of S at the start of another recording."""
        return math.hypot(self.icr.sigma, self.spread)

    def report(self) -> Found:
        """Return what is printed."""
        found = Found(notes=[f'the spread over all turns is {self.spread:.4f} m'])
        for time, value, sigma in zip(self.turn_time, self.turn_icr, self.turn_sigma):
            found.add(f'turn at {time:.1f} s', Uncertain(value, sigma), 'm')
        found.add('S', self.icr, 'm', f'from {self.source}')
        return found

    def parameters(self, robot: RobotParams) -> list[Identified]:
        """Return the entries of a parameter file; the sigma is relative to the wheelbase."""
        return [Identified('icr_x', self.icr.value, self.icr.sigma, f'from {self.source}'),
                Identified('icr_x_sigma', self.initial_sigma / robot.wheelbase,
                           note='standard error and spread over the wheelbase')]


def turns_of(time: Array, yaw_rate: Array) -> list[Turn]:
    """Return begin and end [s] of the turns (constant sign of the yaw rate [rad/s]), (n,) each."""
    sign = np.where(np.abs(yaw_rate) > MIN_RATE, np.sign(yaw_rate), 0.0)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(sign)) + 1, [len(sign)]])
    return [(float(time[first]), float(time[last - 1]))
            for first, last in zip(edges[:-1], edges[1:]) if sign[first]]


def identify_icr(recording: CalibrationRecording, robot: RobotParams) -> IcrFit:
    """
    Return S from the reference, or from the IMU if the reference does not make it observable.

    Raises EstimatorError with both reasons if neither does.
    """
    time, gyro = recording.imu.time, Signal(recording.imu.time, recording.imu.rate[:, 2])
    turns = turns_of(time, gyro.centered_mean(time, MODEL_TIME))
    reasons = []
    for source, unit, rows_of in (
            ('lateral displacement of the reference', 'm', _displacements),
            (BY_IMU, 'm/s2', _accelerations)):
        try:
            return _fit_icr(source, unit, *rows_of(recording, robot), turns, robot)
        except EstimatorError as error:
            reasons.append(f'{source}: {error}')
    raise EstimatorError('; '.join(reasons))


def combine(fits: Sequence[IcrFit]) -> IcrFit:
    """Return the combined result of recordings; regression data and source are of the first."""
    time, value, sigma = (np.concatenate([getattr(fit, name) for fit in fits])
                          for name in ('turn_time', 'turn_icr', 'turn_sigma'))
    return replace(fits[0], icr=weighted_mean([fit.icr for fit in fits]), turn_time=time,
                   turn_icr=value, turn_sigma=sigma, spread=_spread(value, sigma))


def _displacements(recording: CalibrationRecording, robot: RobotParams) -> tuple[Rows, Prior]:
    """Return the regression of the reference's lateral displacement on the change of yaw."""
    poses = usable_reference(recording)
    first, last = poses.intervals(SMOOTH_TIME)
    if not len(first):
        raise EstimatorError('the reference is too short')
    forward, left = (path[last] - path[first] for path in poses.path_components())
    matrix = np.column_stack([poses.yaw[first] - poses.yaw[last], forward])
    return (Rows(0.5 * (poses.time[first] + poses.time[last]), matrix, left, np.zeros(len(first))),
            Prior.of(None, PRIORS['yaw misalignment of the reference'].prior))


def _accelerations(recording: CalibrationRecording, robot: RobotParams) -> tuple[Rows, Prior]:
    """Return the regression of the lateral specific force on the yaw acceleration."""
    imu, latency = recording.imu, robot.encoder.latency
    intervals = moving_intervals(recording, robot, latency, MODEL_TIME)
    begin, end = intervals.begin - latency, intervals.end - latency
    rate, change = yaw_motion(Signal(imu.time, imu.rate[:, 2]), begin, end)
    speed, time = robot.wheel_radius * intervals.sides.mean(axis=1), 0.5 * (begin + end)
    x, y, _ = robot.imu.position
    # a delay of the force by body roll; with one speed only it cannot be separated from S
    delayed = -(change * speed + rate * np.gradient(speed, time))
    matrix = np.column_stack([-change, rate * speed, -rate ** 2, np.ones(len(rate)), delayed])
    lateral = Signal(imu.time, imu.force[:, 1]).mean(begin, end) - x * change + y * rate ** 2
    slip = PRIORS['ground speed over wheel speed']
    return (Rows(time, matrix, lateral, slip.sigma * np.abs(rate * speed)), Prior.of(
        None, slip.prior, PRIORS['lateral effects of the squared yaw rate'].prior, None,
        PRIORS['delay of body roll'].prior))


def _fit_icr(source: str, unit: str, rows: Rows, prior: Prior, turns: list[Turn],
             robot: RobotParams) -> IcrFit:
    """Return S of the recording and of each turn; raise EstimatorError if not observable."""
    selected = np.zeros(len(rows.time), bool)
    for turn in turns:
        selected |= _near(turn, rows.time)
    if selected.sum() < 2 * len(prior.mean):
        raise EstimatorError(f'{int(selected.sum())} intervals in turns, expected at least '
                             f'{2 * len(prior.mean)}')
    errors, rows = Errors(rows.lags(MANEUVER_TIME)), rows.where(selected)
    fit = regression(rows, prior, errors)
    estimate, regressor = fit.estimate(0), rows.matrix[:, 0]
    response = rows.target - rows.matrix[:, 1:] @ fit.values[1:]
    time, value, sigma = _per_turn(turns, rows.time, regressor, response, fit.row_sigma)
    spread = _spread(value, sigma)
    # S depends on the speed: all turns count, and the mean of others would differ by the spread
    mean = float(np.average(value, weights=1.0 / (sigma ** 2 + spread ** 2))) if (
        spread > 0.0) else estimate.value
    icr = Uncertain(mean, math.hypot(
        estimate.sigma, spread / math.sqrt(max(len(time), 1)),
        robot.imu.position_sigma if source == BY_IMU else 0.0))
    require('S', icr, f'imu.position_sigma is {robot.imu.position_sigma:.2g} m' if (
        source == BY_IMU and robot.imu.position_sigma) else '', scale=robot.wheelbase)
    return IcrFit(icr, source, spread, time, value, sigma,
                  regressor, response, unit)


def _near(turn: Turn, time: Array, margin: float = MODEL_TIME) -> Mask:
    begin, end = turn
    return np.asarray((time > begin - margin) & (time < end + margin))


def _per_turn(turns: Sequence[Turn], time: Array, regressor: Array, response: Array,
              sigma: Array) -> Array:
    """Return time [s], value and standard error (3, k) of response over regressor in turns."""
    found = []
    for turn in turns:
        inside = _near(turn, time)
        weight = (regressor / sigma)[inside]
        information = float(weight @ weight)
        if information > 0.0 and turn[1] - turn[0] > MODEL_TIME and inside.sum() > 2:
            value = float(weight @ (response / sigma)[inside]) / information
            found.append((0.5 * sum(turn), value, information ** -0.5))
    return np.array(found).reshape(-1, 3).T


def _spread(values: Array, sigmas: Array) -> float:
    """Return the standard deviation of values beyond their standard errors; 0 if there is none."""
    if len(values) < 2:
        return 0.0
    weight = sigmas ** -2.0
    mean = np.average(values, weights=weight)
    return math.sqrt(max(0.0, float(np.average(
        (values - mean) ** 2 - sigmas ** 2, weights=weight))))


def effective_track(fits: Sequence[YawRateFit], radius: Uncertain) -> Uncertain:
    """
    Return the effective track [m] of the turns in ``fits``, for a wheel ``radius`` [m].

    It is the radius times the total wheel difference over the total yaw, without the first and
    last interval of each turn; the standard error includes the spread between turns. Raises
    EstimatorError if it is large, without turns in both directions, or if turns differ by much:
    the track depends on the ground.
    """
    turns = [(fit.wheel_difference[inside], fit.yaw_rate[inside]) for fit in fits
             for turn in turns_of(fit.time, fit.yaw_rate)
             if (inside := _near(turn, fit.time, 0.0)).any()]
    left = sum(rate.sum() > 0.0 for _, rate in turns)
    if not 0 < left < len(turns):
        raise EstimatorError(f'{left} turns to the left and {len(turns) - left} to the '
                             'right, expected at least one each')
    difference, yaw = (np.array([np.abs(one[i].sum()) for one in turns]) for i in range(2))
    slope = float(difference.sum() / yaw.sum())
    noise = [rate - rolled / slope for rolled, rate in turns]
    spread = math.sqrt(np.average((difference / yaw / slope - 1.0) ** 2, weights=yaw))
    if spread > LIMITS['effective track'].sigma:
        values = ', '.join(f'{radius.value * one:.2f}' for one in difference / yaw)
        raise EstimatorError(f'the turns give {values} m: several grounds in one recording')
    relative = math.hypot(
        mad_sigma(np.concatenate(noise)) * math.sqrt(sum(map(len, noise))) / float(yaw.sum()),
        radius.sigma / radius.value, spread / math.sqrt(len(turns)))
    return require('effective track',
                   Uncertain(slope * radius.value, relative * slope * radius.value))
