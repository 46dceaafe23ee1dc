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
Rows of the torque balance: means of torque, duty, motion and force over windows in motion.

A torque is measured at the instant of a wheel sample, a wheel speed is the mean over a period, and
the IMU is faster than both. All are averaged over the same window, a triangle of some periods
before and after a wheel sample. The second difference of the wheel angles at its ends and center
is exactly this mean of the wheel acceleration; the same holds for all other signals with their
double integrals, which splines give. So no signal lags behind another one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
import math
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline, PPoly

from smart_tire.arrays import Array
from smart_tire.calibration.priors import PRIORS
from smart_tire.calibration.recording import (
    CalibrationRecording, covered, DutyRecord, Indices, Mask, MAX_GAP_PERIODS, period,
    rotation_increments, Samples, SMOOTH_TIME)
from smart_tire.calibration.results import SIGNIFICANT_SIGMAS
from smart_tire.calibration.sensor_noise import stationary_intervals
from smart_tire.errors import EstimatorError
from smart_tire.estimation.ground.unknowns import SLOPE_SIGMA
from smart_tire.estimation.slip.state import IMU_DROPOUT, MIN_SLIP_SPEED
from smart_tire.models.tire.brush_tire import linear_tire_force, LN_FRICTION
from smart_tire.models.vehicle.skid_steer import normal_loads
from smart_tire.numerics.robust import noise_level
from smart_tire.parameters import RobotParams
from smart_tire.samples import GRAVITY

MAX_SLIP = 0.5           # -, in both directions; beyond, wheels slide
# s, of a command from its timestamp to its application, and of a current after the encoders
BOARD_DELAY, DELAY_SIGMA = PRIORS['delay of boards'].prior
EDGE_MARGIN = SIGNIFICANT_SIGMAS * DELAY_SIGMA  # s around a change of the duty in force


@dataclass(frozen=True)
class MotorRows(Samples):
    """
    Means over n windows that overlap, and values at their centers.

    Lists of wheels are in the order of ``WHEELS``. Values that are not available are NaN.
    """

    time: Array           # (n,) s, centers
    speed: Array          # (n, 4) rad/s, of one sign within a window
    acceleration: Array   # (n, 4) rad/s2
    torque: Array         # (n, 4) N m, mean of the measurements
    duty: Array           # (n, 4) mean of the commands
    duty_rate: Array      # (n, 4) 1/s, its rate of change
    force: Array          # (n,) m/s2, forward specific force at the center of mass, minus at rest
    # (n, 2) m/s2, mean of the force from its values at the wheel samples, as of the torque, minus
    # its mean; and the change of this from a quarter of a period before to after, halved
    ripple: Array
    center_torque: Array  # (n, 4) N m, measured at the center
    center_duty: Array    # (n, 4) in force at the center; NaN close to a change
    center_speed: Array   # (n, 4) rad/s, at the reading of the center
    center_slip: Array    # (n, 4) rad/s, share of it from the slip at the center
    rest_sigma: float     # m/s2, of the force at rest: bias, slope and tilt
    force_noise: Array    # (n,) m/s2, standard deviation of ``force`` from noise and vibration
    lags: int             # neighbors on each side that share samples with a row

    @property
    def direction(self) -> Array:
        """Return the direction of rotation of each wheel, 1 or -1, shape (n, 4)."""
        return np.asarray(np.sign(self.speed))

    @classmethod
    def joined(cls, runs: Sequence[MotorRows]) -> MotorRows:
        """Return the rows of all runs."""
        first, *_ = runs
        values: dict[str, Any] = {
            item.name: np.concatenate([getattr(rows, item.name) for rows in runs])
            for item in fields(cls) if isinstance(getattr(first, item.name), np.ndarray)}
        return replace(first, **values)


class _Windows:
    """Windows around wheel samples ``center``, from sample ``center - n`` to ``center + n``."""

    def __init__(self, time: Array, center: Indices, n: int) -> None:
        self.time, self.center, self._edges = time, center, (center - n, center, center + n)
        self.begin, _, self.end = (time[edge] for edge in self._edges)

    def mean(self, integral: Array) -> Array:
        """Return the means of a signal from its double integral (m,) or (m, 4) at all samples."""
        shape = (-1,) + (1,) * (integral.ndim - 1)
        begin, middle, end = (integral[edge] for edge in self._edges)
        t0, t1, t2 = (self.time[edge].reshape(shape) for edge in self._edges)
        return np.asarray(2.0 * ((end - middle) / (t2 - t1) - (middle - begin) / (t1 - t0))
                          / (t2 - t0))

    def mean_of_samples(self, value: Array, max_gap: float = math.inf) -> Array:
        """Return the means of a signal from its samples (m,), NaN where some are missing."""
        known = ~np.isnan(value)
        if known.sum() < 2:
            return np.full(len(self.center), np.nan)
        time = self.time[known]
        means = self.mean(CubicSpline(time, value[known]).antiderivative(2)(self.time))
        return np.where(covered(time, self.begin, self.end, max_gap), means, np.nan)


def motor_rows(recording: CalibrationRecording, robot: RobotParams) -> MotorRows:
    """
    Return the rows of a recording in which every wheel rotates in one direction.

    There are none if its wheels are never in motion for long enough.
    """
    wheels, imu, duties = recording.wheels, recording.imu, recording.duties
    time, step = wheels.time - robot.encoder.latency, period(wheels.time)
    if len(time) < 4:
        raise EstimatorError(f'{len(time)} readings of the wheels, expected 4')
    n = max(2, round(0.5 * SMOOTH_TIME / step))  # a start or stop lasts longer
    windows = _Windows(time, _centers(recording, robot, time, n), n)
    center, nowhere = time[windows.center], np.full((len(windows.center), 4), np.nan)
    angle = np.concatenate([np.zeros((1, 4)), np.cumsum(rotation_increments(wheels)[0], axis=0)])
    # the mean of an angle between two samples depends on the change of the speed between them
    speed = windows.mean(CubicSpline(time, angle).antiderivative()(time))
    arm_x, arm_y = (robot.imu.position[i] - robot.center_of_mass[i] for i in range(2))
    force = make_interp_spline(imu.time, imu.force[:, 0] + arm_x * imu.rate[:, 2] ** 2, k=1)
    yaw = make_interp_spline(imu.time, imu.rate[:, 2], k=1).antiderivative()
    distance = force.antiderivative(2)
    acting = windows.mean(distance(time) + arm_y * yaw(time))
    early, ripple, late = (
        windows.mean_of_samples(force(time + delay)) - windows.mean(distance(time + delay))
        for delay in (-0.25 * step, 0.0, 0.25 * step))
    # the IMU resolves the periods of the wheels: the speed of the body is the integral of its
    # force, and the force on the tires requires slip
    body = force.antiderivative()(center) - windows.mean(force.antiderivative(3)(time))
    rolling, mean_rolling = (1.0 - np.clip(
        np.sign(speed.mean(axis=1)) * _slip(values, robot), -MAX_SLIP, MAX_SLIP)
        for values in (force(center), acting))
    acceleration, slip = windows.mean(angle), speed * (mean_rolling / rolling - 1.0)[:, None]
    torque = nowhere if wheels.torque is None else np.stack([
        windows.mean_of_samples(column, 2.0 * MAX_GAP_PERIODS * step)  # boards read in turn
        for column in wheels.torque.T], axis=1)
    duty, duty_rate, held = (nowhere,) * 3 if duties is None else _duty(duties, windows)
    rest, rest_sigma = _rest_force(recording, robot)
    return MotorRows(
        center, speed, acceleration, torque, duty, duty_rate, acting - rest,
        np.column_stack([ripple, 0.5 * (late - early)]),
        nowhere if wheels.torque is None else wheels.torque[windows.center], held,
        speed + slip + body[:, None] / robot.wheel_radius + BOARD_DELAY * acceleration, slip,
        rest_sigma,
        np.full(len(center), noise_level(force.c, 2) * math.sqrt(
            2.0 / 3.0 * period(imu.time) / (n * step))), 2 * n)


def _slip(force: Array, robot: RobotParams) -> Array:
    """Return the slip of the tires at a specific ``force`` [m/s2] (n,), with its sign."""
    linear, _ = linear_tire_force(
        robot.mass * force, math.exp(LN_FRICTION.value) * normal_loads(robot, force, 0.0).T)
    return linear / robot.tire.longitudinal_stiffness


def _duty(duties: DutyRecord, windows: _Windows) -> tuple[Array, Array, Array]:
    """Return mean, rate of change [1/s], and value at the center (NaN close to a change)."""
    time = windows.time - BOARD_DELAY
    ends = np.concatenate([[min(time[0], duties.time[0]) - 1.0], duties.time,
                           [max(time[-1], duties.time[-1]) + 1.0]])
    values = np.vstack([np.zeros((1, 4)), duties.duty])
    once = PPoly(values[None], ends).antiderivative()
    rate, mean = (windows.mean(part(time)) for part in (once, once.antiderivative()))
    before, after = (values[np.clip(
        np.searchsorted(ends, time[windows.center] + margin, side='right') - 1, 0,
        len(values) - 1)] for margin in (-EDGE_MARGIN, EDGE_MARGIN))
    return mean, rate, np.where(before == after, before, np.nan)


def _rest_force(recording: CalibrationRecording, robot: RobotParams) -> tuple[float, float]:
    """Return the forward specific force [m/s2] at rest: accelerometer bias, slope and tilt."""
    imu, means = recording.imu, []
    for begin, end in stationary_intervals(recording.wheels, robot):
        chosen = (imu.time > begin + SMOOTH_TIME) & (imu.time < end - SMOOTH_TIME)
        if chosen.any():
            means.append(float(imu.force[chosen, 0].mean()))
    slope = GRAVITY * SLOPE_SIGMA
    if not means:
        return 0.0, math.hypot(slope, robot.imu.accel_bias)
    return float(np.mean(means)), slope / math.sqrt(len(means))


def _centers(recording: CalibrationRecording, robot: RobotParams, time: Array, n: int) -> Indices:
    """Return the wheel samples whose window is complete and in motion, with one period around."""
    wheels, imu, step = recording.wheels, recording.imu, period(time)
    increments, valid = rotation_increments(wheels)
    speed = increments / np.diff(time)[:, None]
    center = np.arange(n + 1, max(len(time) - n - 2, n + 1))
    count = 2 * n + 2  # periods of a window, with one before and one after
    usable = covered(time, time[center - n], time[center + n], MAX_GAP_PERIODS * step)
    slowest = MIN_SLIP_SPEED / robot.wheel_radius
    for column in speed.T:
        moving = [_all_of_next(valid & (sign * column > slowest), count)
                  for sign in (1.0, -1.0)]
        usable &= (moving[0] | moving[1])[center - n - 1]
    return np.asarray(center[usable & covered(
        imu.time, time[center - n] - step, time[center + n] + step, IMU_DROPOUT)])


def _all_of_next(mask: Mask, count: int) -> Mask:
    """Return at each index whether ``count`` elements from there on are True."""
    total = np.concatenate([[0], np.cumsum(mask)])
    return np.asarray(total[count:] - total[:-count] == count)
