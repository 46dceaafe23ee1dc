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
Noise, bias and mounting of the IMU at standstill, and jitter of the ``wheel_states`` timestamps.

The robot is stationary while the wheels do not rotate and the IMU is about as quiet as ever: after
a stop the body may settle, and it may be pushed. The tilt cannot be separated from the
accelerometer bias and from the slope of the ground: its standard error includes both.

The jitter is seen in motion. Over five samples angles are a polynomial of third order in time, of
which fourth differences are zero; those of timestamps minus angles over speed show the timestamp
errors, the same on both sides, whatever their speeds; fluctuations of the speeds and counts of the
encoders differ between the sides, but for starts and stops, which are left out. Messages at more
than 100 Hz, which the reader merges by the distance of their timestamps, do not show the jitter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import (
    CalibrationRecording, MAX_GAP_PERIODS, MIN_RATE, SMOOTH_TIME, WheelRecord)
from smart_tire.calibration.results import MIN_ROBUST, MIN_ROWS, SIGNIFICANT_SIGMAS
from smart_tire.errors import EstimatorError
from smart_tire.estimation.ground.unknowns import SLOPE_SIGMA
from smart_tire.estimation.slip.state import (
    IMU_WINDOW, MAX_STATIONARY_WHEEL_SPEED, MIN_SLIP_SPEED, OUTLIER_SIGMAS)
from smart_tire.numerics.robust import mad_sigma, noise_level, winsorized_mean
from smart_tire.parameters import RobotParams
from smart_tire.samples import GRAVITY, LEFT, RIGHT
from smart_tire.uncertain import Uncertain, UNKNOWN, weighted_mean

QUIET_QUANTILE = 0.1   # of the windows' noise that serves as reference for quiet ones
ORDER = 4              # of the differences of angles and timestamps
MAD_VARIANCE = 2.7     # of a variance by the median absolute deviation, over that by squares
MAX_SPEED_CHANGE = 0.1  # relative, in five samples: less is timestamp errors
MAX_REPEATED_SHARE = 0.05  # of samples that are late or repeated: more is not chance


@dataclass(frozen=True)
class RestFit:
    """Result of a calibration at standstill, in the axes of ``base_link``."""

    seconds: float              # of standstill
    intervals: int              # at standstill, with motion in between
    gyro_bias: list[Uncertain]  # rad/s, about x, y, z
    roll: Uncertain             # rad, of the mounting relative to the configured one
    pitch: Uncertain            # rad
    gyro_noise: Uncertain       # rad/s, of a sample about z
    accel_noise: Uncertain      # m/s2, of a sample along x and y
    repeated_share: float       # share of samples equal to the previous one


def fit_rest(recording: CalibrationRecording, robot: RobotParams) -> RestFit:
    """Return the IMU parameters; raise EstimatorError if the robot is never stationary."""
    imu, windows, number = recording.imu, [], []
    values = np.column_stack([imu.rate, imu.force])
    fresh = np.append(True, (np.diff(values, axis=0) != 0.0).any(axis=1))
    for interval, (begin, end) in enumerate(stationary_intervals(recording.wheels, robot)):
        begin += IMU_WINDOW if interval else 0.0  # settled if the recording begins stationary
        for first in np.arange(begin, end - SMOOTH_TIME - IMU_WINDOW, IMU_WINDOW):
            rows = values[fresh & (imu.time >= first) & (imu.time < first + IMU_WINDOW)]
            if len(rows) >= MIN_ROBUST:
                windows.append(rows)
                number.append(interval)
    if not windows:
        raise EstimatorError('the robot is never stationary for '
                             f'{2.0 * IMU_WINDOW + SMOOTH_TIME:g} s')
    spread = np.array([rows.std(axis=0) for rows in windows])
    quiet = (spread <= OUTLIER_SIGMAS * np.maximum(
        np.quantile(spread, QUIET_QUANTILE, axis=0), 1e-9)).all(axis=1)
    windows = [rows for rows, kept in zip(windows, quiet) if kept]
    means, intervals = np.array([rows.mean(axis=0) for rows in windows]), np.array(number)[quiet]
    per_stop = np.array([means[intervals == one].mean(axis=0) for one in np.unique(intervals)])
    variances = np.array([rows.var(axis=0, ddof=1) for rows in windows])
    freedom = sum(len(rows) - 1 for rows in windows)
    bias_sigma = np.max([np.sqrt(variances.mean(axis=0) / (freedom + len(windows))),
                         _standard_error(means), _standard_error(per_stop)], axis=0)
    roll, pitch = _tilt(per_stop[:, 3:], robot)
    return RestFit(
        IMU_WINDOW * len(windows), len(per_stop),
        [Uncertain(*pair) for pair in zip(means.mean(axis=0)[:3].tolist(), bias_sigma.tolist())],
        roll, pitch, _noise(variances[:, 2:3], freedom), _noise(variances[:, 3:5], freedom),
        float(1.0 - fresh.mean()))


def stationary_intervals(wheels: WheelRecord, robot: RobotParams,
                         limit: float = MAX_STATIONARY_WHEEL_SPEED) -> list[tuple[float, float]]:
    """Return begin and end [s] of times with all wheels slower than ``limit`` [m/s]."""
    still = np.concatenate([
        [0], np.abs(wheels.velocity).max(axis=1) < limit / robot.wheel_radius, [0]])
    begin, end = (np.flatnonzero(np.diff(still) == sign) for sign in (1, -1))
    return list(zip(wheels.time[begin].tolist(), wheels.time[end - 1].tolist()))


def _standard_error(rows: Array) -> Array:
    """Return the standard errors (p,) of the means of rows (n, p), 0 for too few rows."""
    if len(rows) < MIN_ROBUST:
        return np.zeros(rows.shape[1])
    return np.asarray(rows.std(axis=0, ddof=1) / math.sqrt(len(rows)))


def _noise(variances: Array, freedom: int) -> Uncertain:
    """Return the rms noise of axes from variances (n, axes) of windows, maybe of colored noise."""
    variance, axes = float(variances.mean()), variances.shape[1]
    sigma = max(variance * math.sqrt(2.0 / (freedom * axes)), float(
        _standard_error(variances.mean(axis=1, keepdims=True))[0]))
    return Uncertain(math.sqrt(variance), 0.5 * sigma / math.sqrt(max(variance, 1e-18)))


def _tilt(force: Array, robot: RobotParams) -> tuple[Uncertain, Uncertain]:
    """Return roll and pitch [rad] from the specific forces (n, 3) of n standstills."""
    x, y, z = (force / np.linalg.norm(force, axis=1)[:, None]).T
    tilts = np.stack([np.arctan2(y, z), -np.arcsin(x)], axis=1)
    # standstills close to each other are on the same slope
    sigma = math.hypot(robot.imu.accel_bias / GRAVITY, SLOPE_SIGMA)
    roll, pitch = tilts.mean(axis=0).tolist()
    return Uncertain(roll, sigma), Uncertain(pitch, sigma)


def motion_noise(recordings: Sequence[CalibrationRecording]) -> tuple[Uncertain, Uncertain]:
    """
    Return the noise of gyro z [rad/s] and of accelerometer x, y [m/s2] in motion.

    It is the mean of windows in which a wheel rotates all the time, without outliers; infinitely
    uncertain if there are none.
    """
    levels = []
    for recording in recordings:
        imu, wheels = recording.imu, recording.wheels
        speed = np.abs(wheels.velocity).max(axis=1)
        for begin in np.arange(wheels.time[0], wheels.time[-1] - IMU_WINDOW, IMU_WINDOW):
            first, last = np.searchsorted(wheels.time, (begin, begin + IMU_WINDOW))
            inside = (imu.time >= begin) & (imu.time < begin + IMU_WINDOW)
            if last > first and speed[first:last].min() > MIN_RATE:
                rows = np.column_stack([imu.rate[inside, 2], imu.force[inside, :2]])
                fresh = np.append(True, (np.diff(rows, axis=0) != 0.0).any(axis=1))
                levels.append([noise_level(column) for column in rows[fresh[:len(rows)]].T])
    if not levels:
        return UNKNOWN, UNKNOWN
    gyro, x, y = np.array(levels).T
    return (winsorized_mean(gyro.tolist(), SIGNIFICANT_SIGMAS),
            winsorized_mean(np.sqrt(0.5 * (x ** 2 + y ** 2)).tolist(), SIGNIFICANT_SIGMAS))


def fit_jitter(wheels: WheelRecord, robot: RobotParams) -> Uncertain:
    """Return the standard deviation of a timestamp [s]; EstimatorError if not observable."""
    if wheels.position is None:
        raise EstimatorError('wheel_states have no positions')
    if len(wheels.time) <= 2 * ORDER:
        raise EstimatorError(f'{len(wheels.time)} samples')
    gaps = np.diff(wheels.time)
    step = float(np.median(gaps))
    if ORDER * step > SMOOTH_TIME:
        raise EstimatorError(f'five samples last {ORDER * step:.2g} s, expected at most '
                             f'{SMOOTH_TIME:g} s: the wheels change their speed meanwhile')
    merged = float(np.mean(gaps > MAX_GAP_PERIODS * step))
    if merged > MAX_REPEATED_SHARE:
        raise EstimatorError(f'{merged:.0%} of the messages are merged or lost')
    angle = np.stack([wheels.position[:, side].mean(axis=1) for side in (LEFT, RIGHT)], axis=1)
    time = wheels.time[:, np.newaxis]
    speed = _slope(angle) / _slope(time)
    even = np.abs(np.lib.stride_tricks.sliding_window_view(gaps, ORDER) - step).max(axis=1)
    usable = (even < 0.5 * step) & (
        np.abs(speed).min(axis=1) > MIN_SLIP_SPEED / robot.wheel_radius)
    reach = ORDER // 2
    change = np.abs(speed[ORDER:] - speed[:-ORDER])
    usable[:reach] = usable[-reach:] = False
    usable[reach:-reach] &= (change < MAX_SPEED_CHANGE * np.abs(speed[reach:-reach])).all(axis=1)
    if usable.sum() < MIN_ROWS:
        raise EstimatorError(f'{int(usable.sum())} samples with both sides in motion, expected at '
                             f'least {MIN_ROWS}')
    errors = np.diff(time, ORDER, axis=0)[usable] - (
        np.diff(angle, ORDER, axis=0)[usable] / speed[usable])
    return _common_sigma(errors / math.sqrt(math.comb(2 * ORDER, ORDER)))


def _slope(values: Array) -> Array:
    """Return ten times the least-squares slope of five samples each, (n, p) -> (n - 4, p)."""
    return np.asarray(2.0 * (values[4:] - values[:-4]) + values[3:-1] - values[1:-3])


def mean_jitter(recordings: Sequence[CalibrationRecording], robot: RobotParams) -> Uncertain:
    """Return the jitter [s] of recordings; EstimatorError with all reasons if none shows it."""
    values, reasons = [], []
    for recording in recordings:
        try:
            values.append(fit_jitter(recording.wheels, robot))
        except EstimatorError as error:
            reasons.append(str(error))
    if not values:
        raise EstimatorError('; '.join(dict.fromkeys(reasons)) or 'no recording in motion')
    return weighted_mean(values)


def _common_sigma(errors: Array) -> Uncertain:
    """Return the standard deviation of the common part of two columns of errors [s] (n, 2)."""
    common, differential = (mad_sigma(errors @ sign) ** 2 for sign in ((1, 1), (1, -1)))
    variance = (common - differential) / 4.0
    # fourth differences of white noise are correlated: sum of their squared autocorrelations
    repeats = math.comb(4 * ORDER, 2 * ORDER) / math.comb(2 * ORDER, ORDER) ** 2
    # standard error of a variance by the median absolute deviation
    variance_sigma = (common + differential) / 4.0 * math.sqrt(
        2.0 * MAD_VARIANCE * repeats / len(errors))
    if variance < SIGNIFICANT_SIGMAS * variance_sigma:
        limit = math.sqrt(max(variance, 0.0) + SIGNIFICANT_SIGMAS * variance_sigma)
        raise EstimatorError(f'speed fluctuations exceed the jitter (below {limit:.2g} s)')
    return Uncertain(math.sqrt(variance), 0.5 * variance_sigma / math.sqrt(variance))
