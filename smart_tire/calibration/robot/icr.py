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
ICR position S (x of the centers of rotation) from lateral motion and yaw rate: B(4), B(8).

The paper fits a curve to experimental data. In the axes of REP-103 B(4) is ``v_y = -S W``, so the
lateral displacement over an interval is ``-S`` times the change of yaw: this is fitted if there is
a pose reference. Without one, the IMU at x_M, y_M measures the derivative of B(8)'s
``v_y,M = (x_M - S) W``: ``a_y = (x_M - S) dW/dt + W (v_x - y_M W)``, with the wheel speed for v_x.
Other contributions to both are nuisance parameters with priors. An error of x_M, or of the
position of the reference, is an error of S of the same size.

S is not quite constant: tires slip sideways to carry the centripetal force, so it moves forward
with the square of the speed. The spread of S between turns is reported as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.recording import period, Recording, Signal
from smart_tire.calibration.robot.gyro_scale import usable_reference
from smart_tire.calibration.robot.wheel_latency import min_interval
from smart_tire.errors import EstimatorError
from smart_tire.numerics.regression import Prior, robust_regression
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.uncertain import Uncertain, weighted_mean

DISPLACEMENT_INTERVAL = 0.5   # s, of the displacements of the reference: shorter than a turn
MAX_POSE_GAP = 0.5            # s between poses of an interval
MIN_YAW_RATE = 0.1            # rad/s, of a turn
TURN_MARGIN = 0.3             # s before and after a turn, where the yaw rate changes
MIN_TOTAL_YAW = 2.0           # rad of yaw in a recording: a third of a circle
MAX_ICR_SIGMA = 0.2           # wheelbases, standard error above which S is not reported
REFERENCE_YAW_SIGMA = 0.05    # rad, yaw misalignment of the reference; assumed
SPEED_RELATIVE_SIGMA = 0.1  # relative sigma of the mean wheel speed as speed over ground, in turns
ROLL_DELAY = 0.03             # s by which body roll delays or advances the measured force; assumed
YAW_RATE_SQUARED_SIGMA = 0.2  # m, sigma of y_M and of other effects proportional to W^2
HAC_TIME = 2.0                # s over which errors may be correlated: the duration of a turn


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

    def parameters(self, robot: RobotParams) -> list[Identified]:
        """Return the entries of a parameter file; the sigma is relative to the wheelbase."""
        return [Identified('icr_x', self.icr.value, self.icr.sigma, f'from {self.source}'),
                Identified('icr_x_sigma', self.initial_sigma / robot.wheelbase,
                           note='standard error and spread over the wheelbase')]


@dataclass(frozen=True)
class _Rows:
    """Linear system ``target = matrix @ (S, ...)``, one row per time interval."""

    time: Array         # (n,) s
    matrix: Array       # (n, p)
    target: Array       # (n,)
    model_sigma: Array  # (n,) standard deviation of effects that the model omits
    prior: Prior        # of the coefficients
    source: str
    unit: str


def identify_icr(recording: Recording, robot: RobotParams) -> IcrFit:
    """
    Return S from the reference, or from the IMU if the reference does not make it observable.

    Raises EstimatorError with both reasons if neither does.
    """
    gyro = Signal(recording.imu.time, recording.imu.rate[:, 2])
    turns = turns_of(recording)
    total_yaw = sum(abs(float(gyro.integral(np.array([end]))[0] - gyro.integral(
        np.array([begin]))[0])) for begin, end in turns)
    if total_yaw < MIN_TOTAL_YAW:
        raise EstimatorError(f'total yaw of {total_yaw:.2g} rad, expected at least '
                             f'{MIN_TOTAL_YAW:g}')
    reasons = []
    for rows_of in (_from_reference, _from_imu):
        try:
            return _fit(rows_of(recording, robot), turns, robot)
        except EstimatorError as error:
            reasons.append(str(error))
    raise EstimatorError('; '.join(reasons))


def combine(fits: Sequence[IcrFit]) -> IcrFit:
    """Return the combined result of several recordings; regression data are those of the first."""
    time, value, sigma = (np.concatenate([getattr(fit, name) for fit in fits])
                          for name in ('turn_time', 'turn_icr', 'turn_sigma'))
    return replace(fits[0], icr=weighted_mean([fit.icr for fit in fits]), turn_time=time,
                   turn_icr=value, turn_sigma=sigma, spread=_spread(value, sigma))


def turns_of(recording: Recording) -> list[tuple[float, float]]:
    """Return begin and end [s] of the turns (constant sign of the yaw rate)."""
    imu = recording.imu
    smooth = Signal(imu.time, imu.rate[:, 2]).centered_mean(imu.time, TURN_MARGIN)
    sign = np.where(np.abs(smooth) > MIN_YAW_RATE, np.sign(smooth), 0.0)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(sign)) + 1, [len(sign)]])
    return [(float(imu.time[first]), float(imu.time[last - 1]))
            for first, last in zip(edges[:-1], edges[1:]) if sign[first]]


def _from_reference(recording: Recording, robot: RobotParams) -> _Rows:
    """Return the regression of the reference's lateral displacement on the change of yaw."""
    poses = usable_reference(recording)
    ends = np.array(
        list(poses.intervals(DISPLACEMENT_INTERVAL, MAX_POSE_GAP)), int).reshape(-1, 2)
    if not len(ends):
        raise EstimatorError('the reference is too short')
    first, last = ends.T
    forward, left = poses.path_components()
    matrix = np.column_stack([
        poses.yaw[first] - poses.yaw[last], forward[last] - forward[first]])
    return _Rows(0.5 * (poses.time[first] + poses.time[last]), matrix, left[last] - left[first],
                 np.zeros(len(first)), Prior(np.zeros(2), np.array([np.inf, REFERENCE_YAW_SIGMA])),
                 'lateral displacement of the reference', 'm')


def _from_imu(recording: Recording, robot: RobotParams) -> _Rows:
    """Return the regression of the lateral specific force on the yaw acceleration."""
    imu, latency = recording.imu, robot.encoder.latency
    intervals = recording.moving_intervals(
        min_interval(recording), robot.slip.standstill_speed / robot.wheel_radius, TURN_MARGIN,
        latency)
    begin, end = intervals.begin - latency, intervals.end - latency
    gyro, force = Signal(imu.time, imu.rate[:, 2]), Signal(imu.time, imu.force[:, 1])
    rate = gyro.mean(begin, end)
    reach = 2.0 * period(imu.time)
    yaw_acceleration = (gyro.centered_mean(end, reach) - gyro.centered_mean(begin, reach)) / (
        end - begin)
    speed = robot.wheel_radius * intervals.sides.mean(axis=1)
    centripetal = rate * speed  # m/s2
    x, y, _ = robot.imu.position
    time = 0.5 * (begin + end)
    # a delay of the force by body roll; with one speed only it cannot be separated from S
    delayed = -(yaw_acceleration * speed + rate * np.gradient(speed, time))
    matrix = np.column_stack([-yaw_acceleration, centripetal, -rate ** 2, np.ones(len(rate)),
                              delayed])
    return _Rows(
        time, matrix,
        force.mean(begin, end) - x * yaw_acceleration + y * rate ** 2,
        SPEED_RELATIVE_SIGMA * np.abs(centripetal),
        Prior(np.array([0.0, 1.0, 0.0, 0.0, 0.0]),
              np.array([np.inf, SPEED_RELATIVE_SIGMA, YAW_RATE_SQUARED_SIGMA, np.inf,
                        ROLL_DELAY])),
        'lateral acceleration of the IMU', 'm/s2')


def _fit(rows: _Rows, turns: list[tuple[float, float]], robot: RobotParams) -> IcrFit:
    """Return S of the recording and of each turn; raise EstimatorError if not observable."""
    of_turn = np.array([(rows.time > begin - TURN_MARGIN) & (rows.time < end + TURN_MARGIN)
                        for begin, end in turns])
    selected = np.asarray(of_turn.any(axis=0))
    if selected.sum() < 2 * len(rows.prior.mean):
        raise EstimatorError(f'{rows.source}: {int(selected.sum())} intervals in turns')
    matrix, target = rows.matrix[selected], rows.target[selected]
    fit = robust_regression(
        matrix, target, rows.prior, model_sigma=rows.model_sigma[selected],
        initial_sigma=float(np.std(target)),
        hac_lags=math.ceil(HAC_TIME / float(np.median(np.diff(rows.time)))))
    estimate = fit.estimate(0)
    response = target - matrix[:, 1:] @ fit.coefficients[1:]
    table = _turn_by_turn(of_turn[:, selected], matrix[:, 0], response, fit.row_sigma, turns)
    spread = _spread(table[1], table[2])
    # S depends on the speed: all turns count, and the mean of others would differ by the spread
    mean = float(np.average(table[1], weights=1.0 / (table[2] ** 2 + spread ** 2))) if (
        spread > 0.0) else estimate.value
    icr = Uncertain(mean, math.hypot(
        estimate.sigma, spread / math.sqrt(max(len(table[0]), 1))))
    limit = MAX_ICR_SIGMA * robot.wheelbase
    if not icr.sigma <= limit:
        raise EstimatorError(f'{rows.source}: standard error of {icr.sigma:.2g} m, expected at '
                             f'most {limit:.2g} m')
    return IcrFit(icr, rows.source, spread, *table, matrix[:, 0], response, rows.unit)


def _turn_by_turn(of_turn: NDArray[np.bool_], regressor: Array, response: Array, row_sigma: Array,
                  turns: list[tuple[float, float]]) -> tuple[Array, Array, Array]:
    """Return center [s], S and standard error [m] of the turns that make S observable."""
    estimates = []
    for inside, (begin, end) in zip(of_turn, turns):
        weight = (regressor / row_sigma)[inside]
        information = float(weight @ weight)
        if information > 0.0 and end - begin > TURN_MARGIN and inside.sum() > 2:
            value = float(weight @ (response / row_sigma)[inside]) / information
            estimates.append((0.5 * (begin + end), value, information ** -0.5))
    time, value, sigma = np.array(estimates).reshape(-1, 3).T
    return time, value, sigma


def _spread(values: Array, sigmas: Array) -> float:
    """Return the standard deviation of values beyond their standard errors; 0 if there is none."""
    if len(values) < 2:
        return 0.0
    weight = sigmas ** -2.0
    mean = np.sum(weight * values) / np.sum(weight)
    excess = np.sum(weight * ((values - mean) ** 2 - sigmas ** 2)) / np.sum(weight)
    return math.sqrt(max(0.0, float(excess)))
