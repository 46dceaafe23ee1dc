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

"""Accelerations and angles that a slope explains, from the recent motion of IMU and wheels."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
import math
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.slope_spread import (
    change_sensitivity, mean_sensitivity, SlopeResidual)
from smart_tire.estimation.slip.state import ImuStep, State
from smart_tire.estimation.slip.wheel_model import WHEEL_SPEED_SIGMA
from smart_tire.estimation.slip.wheel_odometry import WheelSpeeds
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import RobotParams

HISTORY_LENGTH = 7.0       # s
MIN_WHEEL_SAMPLES = 4      # for a trend
MIN_TREND_TIME = 0.6       # s, between the first and the last of them
SLIP_CHANGE_SHARE = 0.3    # of a change of wheel speed that becomes slip velocity
SETTLING_TIME = 0.8        # s, of slip after a change of the speeds, on soft ground
WHEEL_NOISE_RANGE = 3.0    # standard deviations between the extremes of constant wheel speeds
SLIP_RANDOM_WALK = 0.02    # of the wheel speed, per sqrt(s)
LATERAL_SPEED_SIGMA = 0.02  # m/s, of its change in an interval
TURN_SHARE = 0.1           # of the centripetal acceleration: position and mounting of the IMU
WEAKEST_TREND_NOISE = 4.5  # squared deviation of the weakest of three, means of unit variance
LINE_FIT_NOISE = 1.2       # variance of the trend of a random walk, over its rate / duration


class MotionIntegral(NamedTuple):
    """Integrals of the IMU without its biases, but with the slope."""

    time: float      # s
    speed: float     # m/s, forward
    lateral: float   # m/s
    yaw: float       # rad
    roll: float      # rad
    pitch: float     # rad
    distance: float  # m


@dataclass(frozen=True, slots=True)
class WheelExcess:
    """Speeds of the wheels beyond those of the IMU, at the center of a wheel period."""

    time: float         # s
    common: float       # m/s, mean of both sides
    difference: float   # m/s, right minus left
    wheel_speed: float  # m/s, mean of both sides
    variance: float     # (m/s)^2, of a side


class SlopeResiduals:
    """
    Recent history of IMU and wheels, and the residuals of any interval [s] in it.

    ``P`` is the covariance of the filter state.
    """

    def __init__(self, robot: RobotParams) -> None:
        self._jitter = robot.encoder.stamp_jitter
        self._track_width, self._y_imu = robot.track_width, robot.imu.position[1]
        self._motion = deque([MotionIntegral(*(0.0,) * 7)])
        self._wheels: deque[WheelExcess] = deque()
        self.accel_density = self.tilt_density = 0.0  # of the last step

    @property
    def latest(self) -> MotionIntegral:
        """Return the integrals after the last step."""
        return self._motion[-1]

    def discard_wheels(self) -> None:
        """Forget the wheel samples."""
        self._wheels.clear()

    def record_step(self, time: float, dt: float, step: ImuStep, x: Sequence[float]) -> None:
        """Add a prediction step of ``dt`` [s] that ends at ``time`` [s] in the state ``x``."""
        last, imu = self._motion[-1], step.mean
        W = imu.yaw_rate - x[State.GYRO_BIAS_Z]
        rates = (imu.force_x - x[State.ACCEL_BIAS_X] + W * x[State.V_Y],
                 imu.force_y - x[State.ACCEL_BIAS_Y] - W * x[State.V_X],
                 W, imu.roll_rate, imu.pitch_rate, abs(x[State.V_X]))
        self._motion.append(MotionIntegral(time, *(
            value + rate * dt for value, rate in zip(last[1:], rates))))
        while self._motion[0].time < time - HISTORY_LENGTH:
            self._motion.popleft()
        self.accel_density, self.tilt_density = step.accel_variance, step.tilt_variance

    def add_wheels(self, time: float, wheels: WheelSpeeds) -> None:
        """Add a wheel sample of ``time`` [s]."""
        begin, center, end = (self.at(time - share * wheels.duration) for share in (1.0, 0.5, 0.0))
        yaw_rate = (end.yaw - begin.yaw) / wheels.duration
        left, right = wheels.side_speeds
        wheel_speed = 0.5 * (left + right)
        jitter = math.sqrt(2.0) * self._jitter / wheels.duration
        self._wheels.append(WheelExcess(
            center.time, wheel_speed - center.speed - self._y_imu * yaw_rate,
            right - left - self._track_width * yaw_rate, wheel_speed,
            wheels.variance + WHEEL_SPEED_SIGMA ** 2 + (jitter * wheel_speed) ** 2))
        while self._wheels[0].time < time - HISTORY_LENGTH:
            self._wheels.popleft()

    def at(self, time: float) -> MotionIntegral:
        """Interpolate the integrals; after the last point, extrapolate its step."""
        points = self._motion
        if len(points) < 2:
            return points[0]
        index = min(max(bisect_right(points, time, key=attrgetter('time')), 1), len(points) - 1)
        before, after = points[index - 1], points[index]
        share = (time - before.time) / (after.time - before.time)
        return MotionIntegral(time, *(old + share * (new - old)
                                      for old, new in zip(before[1:], after[1:])))

    def longitudinal(self, begin: float, end: float, P: Array) -> SlopeResidual | None:
        """
        Return the trend of the wheels' excess; None if there are too few samples.

        Its noise contains the disagreement of the two sides, and slip that changes with speed.
        """
        points = [point for point in self._wheels if point.time >= begin]
        if len(points) < MIN_WHEEL_SAMPLES or points[-1].time - points[0].time < MIN_TREND_TIME:
            return None
        time, common, difference = np.array(
            [(point.time, point.common, point.difference) for point in points]).T
        duration = float(time[-1] - time[0])
        time = time - time.mean()
        square = float(time @ time)
        trend, disagreement = float(time @ common) / square, float(time @ difference) / square
        scatter = float(np.sum((common - common.mean() - trend * time) ** 2)) / (len(points) - 2)
        scatter = max(scatter, *(point.variance for point in points))
        speed = max(abs(point.wheel_speed) for point in points)
        noise = (scatter / square + _unsteadiness(points, trend)
                 + float(P[State.ACCEL_BIAS_X, State.ACCEL_BIAS_X])
                 + self.slip_change_noise(begin) + (0.5 * disagreement) ** 2
                 + LINE_FIT_NOISE / duration * (
                     self.accel_density + (SLIP_RANDOM_WALK * speed) ** 2))
        return SlopeResidual(trend, noise, mean_sensitivity(
            self.at(end).distance - self.at(begin).distance))

    def slip_change_noise(self, begin: float) -> float:
        """Return the variance [(m/s2)^2] of a trend due to slip that changes with the speeds."""
        points = [point for point in self._wheels if point.time >= begin - SETTLING_TIME]
        if len(points) < 2:
            return 0.0
        speeds = [point.wheel_speed for point in points]
        change = max(speeds) - min(speeds) - WHEEL_NOISE_RANGE * math.sqrt(points[-1].variance)
        return (SLIP_CHANGE_SHARE * max(0.0, change) / (points[-1].time - begin)) ** 2

    def lateral(self, begin: float, end: float, P: Array) -> SlopeResidual:
        """Return the mean lateral acceleration beyond that of the turn."""
        first, last, duration = self.at(begin), self.at(end), end - begin
        yaw_rate = (last.yaw - first.yaw) / duration
        distance = last.distance - first.distance
        noise = (self.accel_density / duration + float(P[State.ACCEL_BIAS_Y, State.ACCEL_BIAS_Y])
                 + (LATERAL_SPEED_SIGMA / duration) ** 2
                 + yaw_rate ** 2 * float(P[State.V_X, State.V_X])
                 + (TURN_SHARE * yaw_rate * distance / duration) ** 2)
        return SlopeResidual((last.lateral - first.lateral) / duration, noise,
                             mean_sensitivity(distance))

    def gyroscope(self, begin: float, end: float) -> list[SlopeResidual]:
        """Return gravity times the changes of mean roll and pitch between two halves."""
        points = [point for point in self._motion if begin <= point.time <= end]
        half = len(points) // 2
        if not half:
            return []
        noise = GRAVITY ** 2 * self.tilt_density * 0.5 * (end - begin)
        sensitivity = change_sensitivity(0.5 * (points[-1].distance - points[0].distance))
        first, second = np.array(points)[:2 * half].reshape(2, half, -1).mean(axis=1)
        change = MotionIntegral(*(second - first).tolist())
        return [SlopeResidual(GRAVITY * tilt, noise, sensitivity)
                for tilt in (change.roll, change.pitch)]

    def mean_tilts(self, begin: float, end: float) -> tuple[float, float]:
        """Return gravity times mean pitch and roll [m/s2], by Simpson's rule."""
        first, middle, last = self.at(begin), self.at(0.5 * (begin + end)), self.at(end)
        return (GRAVITY * (first.pitch + 4.0 * middle.pitch + last.pitch) / 6.0,
                GRAVITY * (first.roll + 4.0 * middle.roll + last.roll) / 6.0)


def _unsteadiness(points: Sequence[WheelExcess], trend: float) -> float:
    """
    Return the variance [(m/s2)^2] of a ``trend`` that does not last, as after a change of slip.

    It is the square of what the weakest of three consecutive trends lacks, beyond its noise.
    """
    count = len(points) // 4
    time, common = np.array([(point.time, point.common) for point in points[-4 * count:]]).reshape(
        4, count, 2).mean(axis=1).T
    step = np.diff(time)
    weakest = float((math.copysign(1.0, trend) * np.diff(common) / step).min())
    noise = WEAKEST_TREND_NOISE * points[-1].variance / count / float(step.mean()) ** 2
    return max(0.0, max(0.0, abs(trend) - weakest) ** 2 - noise)
