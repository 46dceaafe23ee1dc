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
Latency of the ``wheel_states`` timestamps against the IMU, from turns and from speed changes.

In turns the yaw rate W follows the speed difference of the sides: ``B W = r (w_R - w_L)`` with the
effective track B. On straight lines the change of the mean forward specific force follows that of
the mean wheel speed. Slip disturbs the motion of the body, so that is the response. It also lags
behind the wheels, because a force requires slip: by yaw inertia or mass over stiffness, in
proportion to the wheel speed u (``I u / (4 C_x (h^2 + l^2))`` for a brush tire in its linear
range, h and l half of track and wheelbase). Unmodeled, this lag would look like early timestamps.
It is estimated together with the delay, with the value from the parameters as prior; rows in which
it may be large have lower weight, and the lag counts as a standard error.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.priors import PRIORS
from smart_tire.calibration.recording import (
    CalibrationRecording, period, side_slip, Signal, wheel_intervals, WheelIntervals)
from smart_tire.calibration.results import SIGNIFICANT_SIGMAS
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay import DelayFit, fit_delay
from smart_tire.numerics.least_squares import Errors, Prior, regression, Rows
from smart_tire.parameters import RobotParams, specs
from smart_tire.uncertain import Uncertain

MIN_INTERVAL = 0.15  # s; over shorter times the yaw rate changes little and noise dominates
IMU_SAMPLES_PER_INTERVAL = 3.0  # minimum; between samples the rate is interpolated; warthog
MAX_DELAY = specs(RobotParams)['encoder.latency'].high  # s
DELAYS = np.linspace(-MAX_DELAY, MAX_DELAY, 101)  # s, of the coarse search
CHANGE_INTERVAL = 1.0    # s between compared speeds: duration of a speed change or a turn
MANEUVER_TIME = 2.0      # s, over which slips, and thereby the effective track, are correlated


@dataclass(frozen=True)
class YawRateFit:
    """Wheel latency and effective track from the gyro, with the data for figures."""

    latency: Uncertain            # s
    slope: Uncertain              # rad of wheel difference per rad of yaw: track over radius
    radius_difference: Uncertain  # (r_R - r_L) / r
    time: Array                   # (n,) s, centers of the intervals by the timestamps
    yaw_rate: Array               # (n,) rad/s, gyro, shifted by the latency, without bias and lag
    wheel_difference: Array       # (n,) rad/s, right minus left


@dataclass(frozen=True)
class SpeedChangeFit:
    """Wheel latency and rolling radius from speed changes; the radius is a rough estimate."""

    latency: Uncertain  # s
    radius: Uncertain   # m, mean of the sides
    rolled: Array       # (n,) m/s, speed changes of the wheels, without slip


def moving_intervals(recording: CalibrationRecording, robot: RobotParams, latency: float = 0.0,
                     margin: float = MAX_DELAY, least: float = MIN_INTERVAL) -> WheelIntervals:
    """
    Return the wheel intervals near motion, inside the IMU samples by ``margin`` [s].

    They last ``least`` [s] or more, and so long that the IMU resolves them; ``latency`` [s] is
    that of the wheels. Raises EstimatorError if there are fewer than two.
    """
    time = recording.imu.time
    found = wheel_intervals(recording.wheels, max(least, IMU_SAMPLES_PER_INTERVAL * period(time)))
    found = found.where(found.near_motion(robot.slip.standstill_speed / robot.wheel_radius)
                        & (found.begin - latency > time[0] + margin)
                        & (found.end - latency < time[-1] - margin))
    if len(found.end) < 2:
        raise EstimatorError('the wheels do not rotate')
    return found


def yaw_motion(gyro: Signal, begin: Array, end: Array) -> tuple[Array, Array]:
    """Return yaw rate [rad/s] and yaw acceleration [rad/s2] in intervals between times [s]."""
    reach = max(0.5 * float(np.median(end - begin)), 2.0 * period(gyro.time))
    change = gyro.centered_mean(end, reach) - gyro.centered_mean(begin, reach)
    return gyro.mean(begin, end), change / (end - begin)


def fit_yaw_rate(recording: CalibrationRecording, robot: RobotParams) -> YawRateFit:
    """Return latency and slope; raise EstimatorError with the reason if not observable."""
    gyro = Signal(recording.imu.time, recording.imu.rate[:, 2])
    intervals = moving_intervals(recording, robot)
    begin, end, sides = intervals.begin, intervals.end, intervals.sides
    time, radius = intervals.center, robot.wheel_radius
    difference, mean = sides[:, 1] - sides[:, 0], sides.mean(axis=1)
    speed = radius * np.abs(sides).mean(axis=1)  # m/s, of the surfaces
    nominal = robot.track_width / radius
    stiffness = 4.0 * robot.tire.longitudinal_stiffness
    lag = robot.yaw_inertia / (
        stiffness * 0.25 * (robot.track_width ** 2 + robot.wheelbase ** 2))  # s per m/s
    accel_slip = robot.mass / stiffness  # s2/m
    # acceleration, which adds slip to the faster side
    uneven = (np.abs(sides[:, 1]) - np.abs(sides[:, 0])) * np.gradient(
        radius * mean, time) / nominal

    def rows(delay: float) -> Rows:
        yaw_rate, change = yaw_motion(gyro, begin - delay, end - delay)
        return Rows(time, np.column_stack([
            difference, -speed * change, -uneven, mean / nominal, np.ones(len(time))]), yaw_rate,
            np.hypot(lag * speed * change, accel_slip * uneven))

    prior = Prior.of(None, (lag, lag), (accel_slip, accel_slip),
                     PRIORS['radius difference of the sides'].prior, (0.0, robot.imu.gyro_bias))
    fit = fit_delay(rows, prior, DELAYS)
    # the delay is determined by changes of the yaw rate, the track by sustained turns, in which
    # errors may be correlated for longer
    steady = regression(fit.rows, prior, Errors(fit.rows.lags(MANEUVER_TIME)))
    response, asymmetry = steady.estimate(0), steady.estimate(3)
    if not response.value > SIGNIFICANT_SIGMAS * response.sigma:
        raise EstimatorError('the yaw rate does not follow the wheel difference: are left and '
                             'right swapped?')
    slope = Uncertain(1.0 / response.value, response.sigma / response.value ** 2)
    scale = slope.value / nominal
    _, change = yaw_motion(gyro, begin - fit.delay, end - fit.delay)
    return YawRateFit(
        _with_lag(fit, speed, change), slope,
        Uncertain(scale * asymmetry.value, scale * asymmetry.sigma), time, fit.explained,
        difference)


def fit_speed_changes(recording: CalibrationRecording, robot: RobotParams) -> SpeedChangeFit:
    """
    Return latency and radius; raise EstimatorError with the reason if not observable.

    The integral of the forward specific force is the speed over ground plus a slow drift from bias
    and slope; its mean over an interval is compared with that ``CHANGE_INTERVAL`` before.
    """
    imu, intervals = recording.imu, moving_intervals(recording, robot)
    force = recording.forward_force(robot.imu.position[0])
    gained = Signal(imu.time, Signal(imu.time, force - float(np.median(force))).integral(imu.time))
    after = np.arange(len(intervals.end))
    before = np.searchsorted(intervals.end, intervals.end - CHANGE_INTERVAL)
    distance = intervals.end - intervals.end[before]
    usable = np.abs(distance - CHANGE_INTERVAL) < 0.5 * CHANGE_INTERVAL
    before, after = before[usable], after[usable]
    if len(after) < 2:
        raise EstimatorError('the wheels do not rotate')

    def changes(values: Array) -> Array:
        return values[after] - values[before]

    radius, sides = robot.wheel_radius, intervals.sides
    mean, speed = radius * sides.mean(axis=1), radius * np.abs(sides).mean(axis=1)
    rolled = changes(mean)
    slipped = changes(speed * np.gradient(mean, intervals.center))  # m2/s3
    turned = changes(side_slip(mean, 0.5 * radius * np.abs(sides[:, 1] - sides[:, 0])))
    lag = robot.mass / (4.0 * robot.tire.longitudinal_stiffness)    # s2/m
    lost = PRIORS['share of side slip lost in turns']
    sigma = np.hypot(lag * slipped, lost.sigma * turned)
    matrix = np.column_stack([rolled, -slipped, changes(intervals.center), -turned])

    def rows(delay: float) -> Rows:
        return Rows(intervals.center[after], matrix, changes(gained.mean(
            intervals.begin - delay, intervals.end - delay)), sigma)

    prior = Prior.of(None, (lag, lag), None, lost.prior)
    fit = fit_delay(rows, prior, DELAYS, overlapping=True)
    scale = fit.estimate(0)
    return SpeedChangeFit(
        _with_lag(fit, speed[after], rolled),
        Uncertain(radius * scale.value, radius * math.hypot(
            scale.sigma, PRIORS['acceleration on straight lines'].sigma * scale.value)),
        scale.value * rolled)


def _with_lag(fit: DelayFit, speed: Array, signal: Array) -> Uncertain:
    """
    Return the delay [s] with the lag of the body in its sigma.

    The lag per ``speed`` [m/s] (n,) is the second value of the fit; rows determine the delay by
    their ``signal`` (n,).
    """
    weight = (signal / fit.row_sigma) ** 2
    lag = float(fit.values[1] * np.average(speed, weights=weight))
    return Uncertain(fit.delay, math.hypot(fit.estimate(-1).sigma, lag))
