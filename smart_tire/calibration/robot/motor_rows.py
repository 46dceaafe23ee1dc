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
Rows of the torque balance: means of torque, duty, motion and force over windows in motion.

A torque is measured at the instant of a wheel sample, a wheel speed is the mean over a period, and
the IMU is faster than both. All are averaged over the same window, a triangle of some periods
before and after a wheel sample. The second difference of the wheel angles at its ends and center
is exactly this mean of the wheel acceleration; the same holds for specific force and duty with
their double integrals. So no signal lags behind another one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from smart_tire.arrays import Array
from smart_tire.calibration.recording import period, Recording, rotation_increments
from smart_tire.calibration.robot.motor_signals import (
    DELAY_STEP, Duty, Force, Indices, trapezoids, Windows)
from smart_tire.errors import EstimatorError
from smart_tire.models.tire.shared_slip import linear_tire_force
from smart_tire.models.vehicle.skid_steer import normal_loads
from smart_tire.parameters import RobotParams

REACH = 0.25        # s from the center of a window to its ends: a start or stop lasts longer
MIN_PERIODS = 2     # of the wheels in this time
MIN_SAMPLES = 4     # of the wheels
MIN_SPEED = 0.1     # m/s at the circumference; at lower speeds static friction may act
MAX_LENGTHENING = 1.25  # of a window against its number of periods; beyond, a sample is missing
TYPICAL_FRICTION = 0.45  # -, mu of firm ground; assumed
MAX_SLIP = 0.5      # -, in both directions; beyond, wheels slide
MAX_IMU_GAP = 0.05  # s between IMU samples; over longer gaps the force is not integrated
MAX_TORQUE_GAP = 0.15  # s between torques of a wheel; longer ones are not interpolated
COMMAND_DELAY = 0.003  # s from a command's timestamp until the boards apply it; assumed


@dataclass(frozen=True)
class MotorRows:
    """
    Means over n windows that overlap, and values at their centers.

    Lists of wheels are in the order of ``WHEELS``. Values that are not available are NaN.
    """

    time: Array           # (n,) s, centers
    speed: Array          # (n, 4) rad/s, of one sign within a window
    speed_sigma: Array    # (n, 4) rad/s, of ``speed``: its course between samples is not known
    acceleration: Array   # (n, 4) rad/s2
    torque: Array         # (n, 4) N m, mean of the measurements
    duty: Array           # (n, 4) mean of the commands
    duty_rate: Array      # (n, 4) 1/s, its rate of change
    force: Array          # (n,) m/s2, forward specific force at the center of mass
    force_rate: Array     # (n,) m/s3, its rate of change
    # (n, 2) m/s2, means of the force at the wheel samples, as of the torque, and a quarter of a
    # period of the wheels later minus earlier, halved
    sampled_force: Array
    center_torque: Array  # (n, 4) N m, measured at the center
    center_duty: Array    # (n, 4) in force at the center; NaN close to a change
    center_speed: Array   # (n, 4) rad/s, at the center
    center_slip: Array    # (n, 4) rad/s, share of it from the slip at the center
    period: float         # s, of the wheel samples
    force_noise: float    # m/s2, standard deviation of ``force`` from noise and vibration
    lags: int             # neighbors on each side that share samples with a row

    def where(self, selected: NDArray[np.bool_]) -> MotorRows:
        """Return the ``selected`` rows."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        rows: dict[str, Any] = {name: value[selected] for name, value in values.items()
                                if isinstance(value, np.ndarray)}
        return replace(self, **rows)

    @property
    def direction(self) -> Array:
        """Return the direction of rotation of each wheel, 1 or -1, shape (n, 4)."""
        return np.asarray(np.sign(self.speed))


def motor_rows(recording: Recording, robot: RobotParams) -> MotorRows:
    """
    Return the rows of a recording in which every wheel rotates in one direction.

    There are none if its wheels are never in motion for long enough.
    """
    wheels = recording.wheels
    time = wheels.time - robot.encoder.latency
    if len(time) < MIN_SAMPLES:
        raise EstimatorError(f'{len(time)} readings of the wheels, expected {MIN_SAMPLES}')
    n = max(MIN_PERIODS, round(REACH / period(time)))
    windows = Windows(time, _centers(recording, robot, time, n), n)
    increments, _ = rotation_increments(wheels)
    angle = np.concatenate([np.zeros((1, 4)), np.cumsum(increments, axis=0)])
    nowhere = np.full_like(angle, np.nan)
    torque = wheels.torque if wheels.torque is not None else nowhere
    force = Force(recording, robot)
    mean_force, center = force.mean(windows, time), time[windows.center]
    # the mean of an angle between two samples depends on the change of the speed between them
    speed = windows.second_difference(CubicSpline(time, angle).antiderivative()(time))
    linear = windows.second_difference(trapezoids(time, angle))
    duties = recording.duties
    command = None if duties is None else Duty(duties, time[0], time[-1])
    empty = nowhere[windows.center]
    body_ripple, slip_ripple = _speed_ripple(force, windows, time, speed, mean_force, robot)
    return MotorRows(
        center, speed, np.abs(speed - linear), windows.second_difference(angle),
        windows.mean(_filled(time, torque)),
        empty if command is None else command.mean(windows, time),
        empty if command is None else command.rate(windows, time),
        mean_force, force.rate(windows, time),
        windows.mean(force.around(time, 0.25 * period(time))), torque[windows.center],
        empty if command is None else command.at(center - COMMAND_DELAY),
        speed + body_ripple + slip_ripple, slip_ripple, period(time),
        force.noise * math.sqrt(2.0 / 3.0 * period(recording.imu.time) / (n * period(time))),
        2 * n)


def _filled(time: Array, torque: Array) -> Array:
    """Return the torques (m, 4), interpolated over short gaps: boards may be read in turn."""
    filled = torque.copy()
    for column in filled.T:
        known = np.flatnonzero(~np.isnan(column))
        if len(known) < 2:
            continue
        after = np.clip(np.searchsorted(known, np.arange(len(column))), 1, len(known) - 1)
        short = time[known[after]] - time[known[after - 1]] <= MAX_TORQUE_GAP
        inside = short & (time >= time[known[0]]) & (time <= time[known[-1]]) & np.isnan(column)
        column[inside] = np.interp(time[inside], time[known], column[known])
    return filled


def _speed_ripple(force: Force, windows: Windows, time: Array, speed: Array, mean_force: Array,
                  robot: RobotParams) -> tuple[Array, Array]:
    """
    Return the wheel speeds [rad/s] (n, 4) at the centers minus their means: of body, and slip.

    The IMU resolves the periods of the wheels: the speed of the body is the integral of its
    specific force, and the force on the tires requires slip.
    """
    center = time[windows.center]
    body = force.speed(center) - force.mean_speed(windows, time)
    direction = np.sign(speed.mean(axis=1))
    now, mean = (np.clip(direction * _slip(values, robot), -MAX_SLIP, MAX_SLIP)
                 for values in (force.at(center), mean_force))
    ripple = (1.0 - mean) / (1.0 - now) - 1.0
    return np.repeat(body[:, None] / robot.wheel_radius, 4, axis=1), speed * ripple[:, None]


def _slip(force: Array, robot: RobotParams) -> Array:
    """Return the slip of the tires at a specific ``force`` [m/s2] (n,), with its sign."""
    loads = normal_loads(robot.mass, robot.center_of_mass, robot.wheelbase, robot.track_width,
                         force, np.zeros_like(force), radius=robot.wheel_radius)
    linear = linear_tire_force(robot.mass * force, TYPICAL_FRICTION, loads.T)
    return linear / robot.tire.longitudinal_stiffness


def _centers(recording: Recording, robot: RobotParams, time: Array, n: int) -> Indices:
    """Return the wheel samples whose window is complete and in motion, with one period around."""
    wheels, imu = recording.wheels, recording.imu
    increments, valid = rotation_increments(wheels)
    speed = increments / np.diff(time)[:, None]
    min_speed = MIN_SPEED / robot.wheel_radius
    center = np.arange(n + 1, max(len(time) - n - 2, n + 1))
    count = 2 * n + 2  # periods of a window, with one before and one after
    usable = np.ones(len(center), bool)
    for wheel in range(4):
        forward, backward = (_all_of_next(valid & (sign * speed[:, wheel] > min_speed), count)
                             for sign in (1.0, -1.0))
        usable &= (forward | backward)[center - n - 1]
    usable &= time[center + n] - time[center - n] < MAX_LENGTHENING * 2 * n * period(time)
    margin = MAX_IMU_GAP + DELAY_STEP
    usable &= (time[center - n] > imu.time[0] + margin) & (
        time[center + n] < imu.time[-1] - margin)
    gaps = np.concatenate([[0], np.cumsum(np.diff(imu.time) > MAX_IMU_GAP)])
    first, last = (np.clip(np.searchsorted(imu.time, time[center + offset]), 0, len(gaps) - 1)
                   for offset in (-n, n))
    return np.asarray(center[usable & (gaps[first] == gaps[last])])


def _all_of_next(mask: NDArray[np.bool_], count: int) -> NDArray[np.bool_]:
    """Return at each index whether ``count`` elements from there on are True."""
    total = np.concatenate([[0], np.cumsum(mask)])
    return np.asarray(total[count:] - total[:-count] == count)


def own_columns(runs: Sequence[MotorRows]) -> Array:
    """Return a column for each run, 1 in its own rows, shape (n, len(runs))."""
    numbers = np.repeat(np.arange(len(runs)), [len(rows.time) for rows in runs])
    return np.asarray(np.eye(len(runs))[numbers])
