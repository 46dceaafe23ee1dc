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
Latency and rolling radius from changes of speed: wheels against the accelerometer.

The integral of the forward specific force is the speed over ground plus a slow drift from bias
and slope. From one interval to the next its mean changes by the rolling radius times the change of
the mean wheel speed. The body lags behind its wheels because of slip, by mass over stiffness times
speed. This lag is larger than in turns (``wheel_latency``) and tires slide more, so all of it
counts as an error of the latency. Pitching of the body under acceleration changes the measured
force: the radius is a rough estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.recording import Recording, side_slip, Signal, WheelIntervals
from smart_tire.calibration.robot.rolling_radius import TURN_SLIP
from smart_tire.calibration.robot.wheel_latency import (
    delay_grid, LAG_RELATIVE_SIGMA, MAX_DELAY, MAX_LATENCY_SIGMA, min_interval)
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay_regression import DelayFit, DelayProblem, fit_delay, Rows
from smart_tire.numerics.regression import Prior
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain

CHANGE_INTERVAL = 1.0  # s between the compared intervals: typical duration of a speed change
PITCHING_ERROR = 0.1              # relative error from pitching of the body: 0.6 degrees at 1 m/s2
RADIUS_COLUMN, LAG_COLUMN = 0, 1  # of the coefficients


@dataclass(frozen=True)
class SpeedChangeFit:
    """Wheel latency and rolling radius from speed changes, with the data for figures."""

    latency: Uncertain  # s
    radius: Uncertain   # m, mean of the sides
    time: Array         # (n,) s, center of the later interval
    gained: Array       # (n,) m/s, from the accelerometer, shifted by the latency, without bias
    rolled: Array       # (n,) m/s, from the wheels, without slip


def fit_speed_changes(recording: Recording, robot: RobotParams) -> SpeedChangeFit:
    """Return latency and radius; raise EstimatorError with the reason if not observable."""
    changes = _SpeedChanges(recording, robot)
    fit = fit_delay(changes.problem(), delay_grid(recording))
    latency = Uncertain(fit.delay, math.hypot(fit.sigma, changes.lag_sigma(fit)))
    if not latency.sigma <= MAX_LATENCY_SIGMA:
        raise EstimatorError(f'standard error of {latency.sigma:.2g} s, expected at most '
                             f'{MAX_LATENCY_SIGMA:g} s: the speed hardly changes')
    scale = Uncertain(float(fit.coefficients[RADIUS_COLUMN]),
                      fit.coefficient_sigma(RADIUS_COLUMN))
    radius = Uncertain(robot.wheel_radius * scale.value, robot.wheel_radius * math.hypot(
        scale.sigma, PITCHING_ERROR * scale.value))
    rows = changes.rows(fit.delay)
    nuisance = rows.matrix[:, RADIUS_COLUMN + 1:] @ fit.coefficients[RADIUS_COLUMN + 1:]
    return SpeedChangeFit(latency, radius, changes.time, rows.target - nuisance,
                          rows.matrix[:, RADIUS_COLUMN] * scale.value)


def speed_change_problem(recording: Recording, robot: RobotParams) -> DelayProblem:
    """Return the regression of speed changes on the wheels; EstimatorError without motion."""
    return _SpeedChanges(recording, robot).problem()


class _SpeedChanges:
    """Changes of speed between intervals, as a problem for ``fit_delay``."""

    def __init__(self, recording: Recording, robot: RobotParams) -> None:
        imu = recording.imu
        force = recording.forward_force(robot.imu.position[0])
        force = force - float(np.median(force))
        rate = Signal(imu.time, force)
        self._speed = Signal(imu.time, rate.integral(imu.time))
        intervals = recording.moving_intervals(
            min_interval(recording), robot.slip.standstill_speed / robot.wheel_radius, MAX_DELAY)
        self._begin, self._end = intervals.begin, intervals.end
        center = 0.5 * (intervals.begin + intervals.end)
        self._before, self._after = _pairs(intervals)
        if len(self._after) < 2:
            raise EstimatorError('the wheels do not rotate')
        mean = robot.wheel_radius * intervals.sides.mean(axis=1)
        half_difference = 0.5 * robot.wheel_radius * np.abs(
            np.diff(intervals.sides, axis=1)[:, 0])
        surface_speed = robot.wheel_radius * np.abs(intervals.sides).mean(axis=1)
        self._wheel_change = self._differences(mean)
        self._accel_slip = self._differences(surface_speed * np.gradient(mean, center))  # m2/s3
        self._side_slip = self._differences(side_slip(mean, half_difference))
        self._elapsed, self.time = self._differences(center), center[self._after]
        self._surface_speed = surface_speed[self._after]
        self._slip_per_acceleration = robot.mass / (
            4.0 * robot.tire.longitudinal_stiffness)  # s2/m

    def _differences(self, values: Array) -> Array:
        return values[self._after] - values[self._before]

    def rows(self, delay: float) -> Rows:
        """Return the regression of the speed change on that of the wheels at a ``delay`` [s]."""
        gained = self._differences(self._speed.mean(self._begin - delay, self._end - delay))
        return Rows(np.column_stack(
            [self._wheel_change, -self._accel_slip, self._elapsed, -self._side_slip]), gained)

    def model_sigma(self, delay: float) -> Array:
        """Return the standard deviation [m/s] of each row from slip that the lag omits."""
        return np.hypot(self._slip_per_acceleration * self._accel_slip,
                        TURN_SLIP * self._side_slip)

    def problem(self) -> DelayProblem:
        """Return the regression with the priors of its coefficients."""
        lag = self._slip_per_acceleration
        mean = np.array([1.0, lag, 0.0, TURN_SLIP])
        sigma = np.array([np.inf, LAG_RELATIVE_SIGMA * lag, np.inf, TURN_SLIP])
        return DelayProblem(
            self.rows, self.model_sigma, self.time, Prior(mean, sigma), overlapping=True)

    def lag_sigma(self, fit: DelayFit) -> float:
        """Return the standard deviation [s] of the delay from the lag of the body: all of it."""
        weight = (self._wheel_change / np.hypot(fit.noise, self.model_sigma(fit.delay))) ** 2
        return abs(float(fit.coefficients[LAG_COLUMN] * np.average(
            self._surface_speed, weights=weight)))


def _pairs(intervals: WheelIntervals) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return indices of interval pairs about ``CHANGE_INTERVAL`` apart in time."""
    after = np.arange(len(intervals.end))
    before = np.searchsorted(intervals.end, intervals.end - CHANGE_INTERVAL)
    distance = intervals.end - intervals.end[before]
    usable = (distance > 0.5 * CHANGE_INTERVAL) & (distance < 1.5 * CHANGE_INTERVAL)
    return before[usable], after[usable]
