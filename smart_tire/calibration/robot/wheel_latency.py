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
Latency of the ``wheel_states`` timestamps, and the effective track, from wheels and gyro.

The yaw rate W follows the speed difference of the sides: ``B W = r (w_R - w_L)`` with the
effective track B. Slip disturbs W, so W is the response of the regression. W also lags behind the
wheels, because a force requires slip: the yaw inertia delays the body in proportion to the wheel
speed u (by ``I u / (4 C_x (h^2 + l^2))`` for a brush tire in its linear range, h and l half of
track and wheelbase). Unmodeled, this lag would look like early timestamps. It is estimated
together with the delay, with the value from the parameters as prior; rows in which it may be large
have lower weight, and a share of it remains in the standard error.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import period, Recording, Signal, WheelIntervals
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay_regression import DelayFit, DelayProblem, fit_delay, Rows
from smart_tire.numerics.regression import Prior, robust_regression
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain

MIN_INTERVAL = 0.15  # s; over shorter times the yaw rate changes little and noise dominates
IMU_SAMPLES_PER_INTERVAL = 3.0  # minimum; between samples the rate is interpolated
MAX_DELAY = 1.0                 # s, range of the search: that of the parameter
MAX_GRID_STEP = 0.02            # s, of the search, or a quarter of the period of the wheels
LAG_RELATIVE_SIGMA = 1.0        # of the lag from the parameters: C_x depends on the ground
LAG_SYSTEMATIC_SHARE = 1.0  # of the estimated lag in the standard error: tires slide in fast turns
RADIUS_DIFFERENCE_SIGMA = 0.05  # relative sigma of the difference of the sides' radii; assumed
MAX_LATENCY_SIGMA = 0.03        # s, standard error above which a latency is refused: half of 16 Hz
MIN_SLOPE_SIGMAS = 3.0          # standard errors; below, yaw rate and wheels are not correlated
SLIP_CORRELATION_TIME = 2.0     # s over which slip, and thereby the effective track, is correlated
# columns of the regression matrix
SLOPE_COLUMN, LAG_COLUMN, ACCEL_SLIP_COLUMN, RADIUS_DIFFERENCE_COLUMN, OFFSET_COLUMN = range(5)


@dataclass(frozen=True)
class YawRateFit:
    """Wheel latency and effective track from the gyro, with the data for figures."""

    latency: Uncertain            # s
    slope: Uncertain              # rad of wheel difference per rad of yaw: track over radius
    radius_difference: Uncertain  # (r_R - r_L) / r
    time: Array                   # (n,) s, centers of the intervals by the timestamps
    yaw_rate: Array               # (n,) rad/s, gyro, shifted by the latency, without bias and lag
    wheel_difference: Array       # (n,) rad/s, right minus left


def fit_yaw_rate(recording: Recording, robot: RobotParams) -> YawRateFit:
    """Return latency and slope; raise EstimatorError with the reason if not observable."""
    regression = _YawRateRegression(recording, robot)
    fit = fit_delay(regression.problem(), delay_grid(recording))
    latency = Uncertain(fit.delay, math.hypot(
        fit.sigma, LAG_SYSTEMATIC_SHARE * regression.lag_sigma(fit)))
    if not latency.sigma <= MAX_LATENCY_SIGMA:
        raise EstimatorError(
            f'standard error of {latency.sigma:.2g} s, expected at most {MAX_LATENCY_SIGMA:g} s: '
            'yaw rate and wheel difference hardly change together')
    return regression.result(fit, latency)


def yaw_rate_problem(recording: Recording, robot: RobotParams) -> DelayProblem:
    """Return the regression of the yaw rate on the wheels; EstimatorError without motion."""
    return _YawRateRegression(recording, robot).problem()


def delay_grid(recording: Recording) -> Array:
    """Return the delays [s] of the coarse search."""
    step = min(MAX_GRID_STEP, 0.25 * max(min_interval(recording), period(recording.wheels.time)))
    return np.asarray(np.arange(-MAX_DELAY, MAX_DELAY + step, step))


def min_interval(recording: Recording) -> float:
    """Return the minimum length [s] of intervals that the IMU resolves."""
    return max(MIN_INTERVAL, IMU_SAMPLES_PER_INTERVAL * period(recording.imu.time))


class _YawRateRegression:
    """The intervals in which the robot moves, as a problem for ``fit_delay``."""

    def __init__(self, recording: Recording, robot: RobotParams) -> None:
        imu = recording.imu
        self._gyro = Signal(imu.time, imu.rate[:, 2])
        self._robot = robot
        intervals = recording.moving_intervals(
            min_interval(recording), robot.slip.standstill_speed / robot.wheel_radius, MAX_DELAY)
        self._set_rows(intervals, 2.0 * period(imu.time))

    def _set_rows(self, intervals: WheelIntervals, min_reach: float) -> None:
        robot = self._robot
        self._begin, self._end = intervals.begin, intervals.end
        self.time = 0.5 * (intervals.begin + intervals.end)
        self._reach = max(0.5 * float(np.median(intervals.duration)), min_reach)
        sides = intervals.sides
        self.wheel_difference, self._mean = sides[:, 1] - sides[:, 0], sides.mean(axis=1)
        self._surface_speed = robot.wheel_radius * np.abs(sides).mean(axis=1)   # m/s
        acceleration = np.gradient(robot.wheel_radius * self._mean, self.time)  # m/s2
        self._accel_difference = (np.abs(sides[:, 1]) - np.abs(sides[:, 0])) * acceleration
        self._nominal = robot.track_width / robot.wheel_radius
        half_track, half_base = 0.5 * robot.track_width, 0.5 * robot.wheelbase
        stiffness = 4.0 * robot.tire.longitudinal_stiffness
        self._nominal_lag = robot.yaw_inertia / (stiffness * (half_track ** 2 + half_base ** 2))
        self._slip_per_acceleration = robot.mass / stiffness  # s2/m

    def rows(self, delay: float) -> Rows:
        """Return the regression of the yaw rate on the wheels at a ``delay`` [s]."""
        yaw_rate = self._gyro.mean(self._begin - delay, self._end - delay)
        matrix = np.column_stack([
            self.wheel_difference, -self._surface_speed * self._yaw_acceleration(delay),
            -self._accel_difference / self._nominal, self._mean / self._nominal,
            np.ones(len(yaw_rate))])
        return Rows(matrix, yaw_rate)

    def _yaw_acceleration(self, delay: float) -> Array:
        """Return the yaw acceleration [rad/s2] in each interval."""
        begin, end = self._begin - delay, self._end - delay
        change = self._gyro.centered_mean(end, self._reach) - self._gyro.centered_mean(
            begin, self._reach)
        return change / (end - begin)

    def model_sigma(self, delay: float) -> Array:
        """Return the standard deviation [rad/s] of each row from slip that the lag omits."""
        return np.hypot(self._nominal_lag * self._surface_speed * self._yaw_acceleration(delay),
                        self._slip_per_acceleration * self._accel_difference / self._nominal)

    def problem(self) -> DelayProblem:
        """Return the regression with the priors of its coefficients."""
        mean = np.array([0.0, self._nominal_lag, self._slip_per_acceleration, 0.0, 0.0])
        sigma = np.array([
            np.inf, LAG_RELATIVE_SIGMA * self._nominal_lag,
            LAG_RELATIVE_SIGMA * self._slip_per_acceleration, RADIUS_DIFFERENCE_SIGMA,
            self._robot.imu.gyro_bias])
        return DelayProblem(self.rows, self.model_sigma, self.time, Prior(mean, sigma))

    def lag_sigma(self, fit: DelayFit) -> float:
        """Return the mean lag [s] of the body, weighted as the rows that determine the delay."""
        weight = (self._yaw_acceleration(fit.delay) / np.hypot(
            fit.noise, self.model_sigma(fit.delay))) ** 2
        return abs(float(fit.coefficients[LAG_COLUMN] * np.average(
            self._surface_speed, weights=weight)))

    def result(self, fit: DelayFit, latency: Uncertain) -> YawRateFit:
        """Return the result; the standard error of the slope includes its slow changes."""
        rows = self.rows(fit.delay)
        response, asymmetry = self._steady_turning(fit, rows)
        if not response.value > MIN_SLOPE_SIGMAS * response.sigma:
            raise EstimatorError('the yaw rate does not follow the wheel difference: are left '
                                 'and right swapped?')
        slope = Uncertain(1.0 / response.value, response.sigma / response.value ** 2)
        scale = slope.value / self._nominal
        radius_difference = Uncertain(scale * asymmetry.value, scale * asymmetry.sigma)
        nuisance = rows.matrix[:, SLOPE_COLUMN + 1:] @ fit.coefficients[SLOPE_COLUMN + 1:]
        return YawRateFit(latency, slope, radius_difference, self.time, rows.target - nuisance,
                          self.wheel_difference)

    def _steady_turning(self, fit: DelayFit, rows: Rows) -> tuple[Uncertain, Uncertain]:
        """
        Return yaw per wheel difference, and per mean rotation over the nominal slope.

        The delay is determined by changes of the yaw rate, the track by sustained turns: here
        rows are not differenced, and errors may be correlated over ``SLIP_CORRELATION_TIME``.
        """
        lags = math.ceil(SLIP_CORRELATION_TIME / float(np.median(np.diff(self.time))))
        steady = robust_regression(
            rows.matrix, rows.target, self.problem().prior,
            model_sigma=self.model_sigma(fit.delay), initial_sigma=fit.noise, hac_lags=lags)
        return steady.estimate(SLOPE_COLUMN), steady.estimate(RADIUS_DIFFERENCE_COLUMN)
