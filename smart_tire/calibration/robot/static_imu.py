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
IMU parameters at standstill: noise, gyro bias, and the tilt of the mounting.

The robot is stationary while the wheels do not rotate and the IMU is about as quiet as ever: after
a stop the body may settle, and it may be pushed. On level ground the tilt cannot be separated from
the accelerometer bias, and not from the slope of the ground if the robot always stops with the
same heading: the standard error of the tilt includes both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.recording import ImuRecord, Recording, WheelRecord
from smart_tire.errors import EstimatorError
from smart_tire.estimation.slip.zero_velocity import (
    BIAS_WINDOW, MAX_STATIONARY_WHEEL_SPEED, QUIET_NOISE_RATIO)
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain

MOTION_MARGIN = 0.5  # s before the first wheel motion, whose timestamps may be late
WINDOW_LENGTH = 1.0  # s, over which the noise is estimated
MIN_WINDOW_SAMPLES = 3
GROUND_SLOPE_SIGMA = 0.01  # rad, of the ground with fewer than MIN_INTERVALS intervals; assumed
MIN_INTERVALS = 3          # at standstill, to estimate the spread of ground slopes
MAX_REPEATED_SHARE = 0.05  # of samples equal to the previous one: more is not chance
QUIET_QUANTILE = 0.1       # of the windows' noise that serves as reference for quiet ones


@dataclass(frozen=True)
class StaticImuFit:
    """Result of a calibration at standstill, in the axes of ``base_link``."""

    seconds: float              # of standstill
    intervals: int              # at standstill, with motion in between
    gyro_bias: list[Uncertain]  # rad/s, about x, y, z
    roll: Uncertain             # rad, of the mounting relative to the configured one
    pitch: Uncertain            # rad
    gyro_noise: Uncertain       # rad/s, of a sample about z
    accel_noise: Uncertain      # m/s2, of a sample along x and y
    repeated_share: float       # share of samples equal to the previous one


@dataclass(frozen=True)
class _Window:
    interval: int  # number of the stationary interval
    rate: Array    # (n, 3)
    force: Array   # (n, 3)


def fit_static_imu(recording: Recording, robot: RobotParams) -> StaticImuFit:
    """Return the IMU parameters; raise EstimatorError if the robot is never stationary."""
    imu = recording.imu
    fresh = np.append(True, (np.diff(imu.rate, axis=0) != 0.0).any(axis=1)
                      | (np.diff(imu.force, axis=0) != 0.0).any(axis=1))
    max_wheel_speed = MAX_STATIONARY_WHEEL_SPEED / robot.wheel_radius
    windows = _quiet(list(_windows(
        imu, fresh, stationary_intervals(recording.wheels, max_wheel_speed))))
    if not windows:
        raise EstimatorError('the robot is never stationary for '
                             f'{BIAS_WINDOW + WINDOW_LENGTH + MOTION_MARGIN:g} s')
    gyro, accel = _noise(windows, 'rate', [2]), _noise(windows, 'force', [0, 1])
    intervals = sorted({window.interval for window in windows})
    tilts = np.array([_tilt(_mean(windows, 'force', interval)) for interval in intervals])
    slope = (float(tilts.std(axis=0, ddof=1).max()) if len(intervals) >= MIN_INTERVALS
             else GROUND_SLOPE_SIGMA)
    sigma = math.hypot(robot.imu.accel_bias / GRAVITY, slope / math.sqrt(len(intervals)))
    roll, pitch = (Uncertain(float(value), sigma) for value in tilts.mean(axis=0))
    return StaticImuFit(
        WINDOW_LENGTH * len(windows), len(intervals), _biases(windows, intervals), roll, pitch,
        gyro, accel, float(1.0 - fresh.mean()))


def stationary_intervals(wheels: WheelRecord,
                         max_wheel_speed: float) -> Iterator[tuple[float, float]]:
    """Yield begin and end [s] of times with all wheels below ``max_wheel_speed`` [rad/s]."""
    quiet = np.append(np.abs(wheels.velocity).max(axis=1) < max_wheel_speed, False)
    begin: float | None = None
    for index, stationary in enumerate(quiet.tolist()):
        if stationary and begin is None:
            begin = float(wheels.time[index])
        elif not stationary and begin is not None:
            yield begin, float(wheels.time[index - 1])
            begin = None


def _windows(imu: ImuRecord, fresh: NDArray[np.bool_],
             times: Iterator[tuple[float, float]]) -> Iterator[_Window]:
    """Yield the samples of each second at standstill, without repeated ones."""
    for interval, (begin, end) in enumerate(times):
        if interval:  # no settling if the recording begins stationary
            begin += BIAS_WINDOW
        count = int((end - begin - MOTION_MARGIN) / WINDOW_LENGTH)
        for first in begin + WINDOW_LENGTH * np.arange(max(count, 0)):
            selected = fresh & (imu.time >= first) & (imu.time < first + WINDOW_LENGTH)
            if selected.sum() >= MIN_WINDOW_SAMPLES:
                yield _Window(interval, imu.rate[selected], imu.force[selected])


def _quiet(windows: list[_Window]) -> list[_Window]:
    """Return the windows with noise close to that of the quietest ones."""
    if not windows:
        return []
    spread = np.array([[*w.rate.std(axis=0), *w.force.std(axis=0)] for w in windows])
    limit = QUIET_NOISE_RATIO * np.maximum(np.quantile(spread, QUIET_QUANTILE, axis=0), 1e-9)
    kept = (spread <= limit).all(axis=1)
    return [window for window, quiet in zip(windows, kept) if quiet]


def _noise(windows: list[_Window], name: str, axes: list[int]) -> Uncertain:
    """Return the standard deviation of a sample along ``axes``."""
    values = [getattr(window, name)[:, axes] for window in windows]
    freedom = sum(value.size - len(axes) for value in values)
    squares = sum(float(np.sum((value - value.mean(axis=0)) ** 2)) for value in values)
    noise = math.sqrt(squares / freedom)
    return Uncertain(noise, noise / math.sqrt(2.0 * freedom))


def _mean(windows: list[_Window], name: str, interval: int) -> Array:
    return np.mean([getattr(window, name).mean(axis=0) for window in windows
                    if window.interval == interval], axis=0)


def _biases(windows: list[_Window], intervals: list[int]) -> list[Uncertain]:
    """Return the gyro biases; their errors include noise and changes between intervals."""
    means = np.array([window.rate.mean(axis=0) for window in windows])
    count = sum(len(window.rate) for window in windows)
    noise = np.array([_noise(windows, 'rate', [axis]).value for axis in range(3)])
    error = np.maximum(noise / math.sqrt(count), means.std(axis=0, ddof=min(1, len(means) - 1))
                       / math.sqrt(len(means)))
    if len(intervals) >= MIN_INTERVALS:
        interval_means = np.array([_mean(windows, 'rate', interval) for interval in intervals])
        error = np.maximum(error, interval_means.std(axis=0, ddof=1) / math.sqrt(len(intervals)))
    return [Uncertain(float(mean), float(sigma)) for mean, sigma in zip(means.mean(axis=0), error)]


def _tilt(force: Array) -> tuple[float, float]:
    """Return roll and pitch [rad] of an IMU that measures ``force`` (3,) at standstill."""
    x, y, z = (force / np.linalg.norm(force)).tolist()
    return math.atan2(y, z), -math.asin(x)
