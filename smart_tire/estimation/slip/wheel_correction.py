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

"""Corrections of the slip EKF at a wheel sample: wheels, standstill, free rolling, ICR."""

from __future__ import annotations

import math

from smart_tire.estimation.slip.ekf import SlipFilter
from smart_tire.estimation.slip.odometry_buffer import Motion
from smart_tire.estimation.slip.prediction import SlipPredictor
from smart_tire.estimation.slip.radius_estimator import RadiusEstimator
from smart_tire.estimation.slip.state import ImuReading, State, WheelMeasurement
from smart_tire.estimation.slip.wheel_odometry import WheelOdometry, WheelSpeeds
from smart_tire.estimation.slip.zero_velocity import (
    StationaryInterval, UNWINDING_TIME, ZeroVelocityDetector)
from smart_tire.parameters import RobotParams
from smart_tire.samples import WheelSample

TRUSTED_STANDSTILL = 3.0  # s; longer standstill overrules a state that has diverged


class WheelCorrector:
    """Applies all corrections that a wheel sample allows."""

    def __init__(self, robot: RobotParams, slip_filter: SlipFilter,
                 predictor: SlipPredictor) -> None:
        self._robot, self._filter, self._predictor = robot, slip_filter, predictor
        self.odometry = WheelOdometry(robot)
        self.radius = RadiusEstimator(robot)
        self.standstill = ZeroVelocityDetector(robot.imu.gyro_noise, robot.imu.accel_noise)
        self.stationary = False
        self.period_center = 0.0  # s, of the period of the last wheel sample

    def correct(self, time: float, sample: WheelSample) -> bool:
        """Use a wheel sample of ``time`` [s], latency removed; False if it is not newer."""
        wheels = self.odometry.update(time, sample)
        if wheels is None:
            return False
        imu = self._predictor.imu.reading
        self._predictor.wheel_residual = self.odometry.wheel_residual
        if imu is None:
            return True
        self.period_center = time - 0.5 * wheels.duration
        self._correct_standstill(time, wheels)
        self._update_slope(time, wheels)
        mean = self._predictor.odometry.mean(time - wheels.duration, time)
        if mean is not None:
            self._correct_wheels(time, wheels, mean)
        if self._filter.forces.active:  # they replace the priors on common slip and S
            if sample.effort is not None:
                self._filter.forces.correct_torques(
                    sample.effort, self.odometry.wheel_residual, self.odometry.accelerations)
            return True
        if mean is not None and not self.stationary:
            self._correct_free_rolling(wheels, imu)
        self._filter.correct_lateral(imu.yaw_rate, wheels.duration)
        return True

    def _update_slope(self, time: float, wheels: WheelSpeeds) -> None:
        """Learn the spread of the slope; a larger one casts doubt on slip that was estimated."""
        imu = self._predictor.imu
        imu.tilt_rates.finish_period(wheels.duration, self.stationary)
        before = imu.slope_sigma
        imu.slope.update(time, wheels, self._filter.P, self.stationary)
        if imu.slope_sigma > before:
            self._filter.inflate_slope(before, imu.slope_sigma)

    def _correct_standstill(self, time: float, wheels: WheelSpeeds) -> None:
        standstill = self.standstill.detect(time, max(map(abs, wheels.wheel_speeds)))
        self.stationary = standstill is not None and (
            standstill.duration > TRUSTED_STANDSTILL or self._is_slow())
        if standstill is not None and self.stationary:
            self._filter.correct_zero_velocity()
            if standstill.rate_settled:
                self._correct_gyro_bias(standstill, wheels.duration)

    def _correct_gyro_bias(self, standstill: StationaryInterval, duration: float) -> None:
        """Correct with the mean rate; as means overlap, its weight is that of the new part."""
        sigma = self._robot.imu.gyro_noise * math.sqrt(self._predictor.imu.period / duration)
        unwinding = standstill.unwinding_sigma * math.sqrt(UNWINDING_TIME / duration)
        self._filter.correct_gyro_bias(
            standstill.rate, math.hypot(max(sigma, standstill.sigma), unwinding))

    def _correct_wheels(self, time: float, wheels: WheelSpeeds, mean: Motion) -> None:
        ground_speed, yaw_rate = mean.v_x, mean.yaw_rate
        self._predictor.blind.learn(wheels.side_speeds, yaw_rate, wheels.duration)
        half = 0.5 * self._robot.track_width * yaw_rate
        center = ground_speed + self._robot.imu.position[1] * yaw_rate
        self._predictor.unobserved_slip.ground_speeds = center - half, center + half
        self._filter.correct_wheels(WheelMeasurement(
            wheels.duration, wheels.side_speeds, ground_speed, yaw_rate, wheels.variance,
            self._predictor.time - time, self._predictor.travel_change(time),
            wheels.from_positions))

    def _correct_free_rolling(self, wheels: WheelSpeeds, imu: ImuReading) -> None:
        """Correct slip and wheel radius with the free-rolling prior."""
        prior = self._filter.correct_free_rolling(
            wheels.duration, imu.yaw_rate, self.radius.variance)
        if prior is not None:
            forward = math.copysign(1.0, sum(wheels.side_speeds))
            self.radius.update(forward * prior.slip, prior.variance + prior.prior_variance,
                               prior.firm_probability, wheels.duration)
            self.odometry.radius = self.radius.radius

    def _is_slow(self) -> bool:
        """Return whether the estimated speed is compatible with standstill."""
        x, P = self._filter.x, self._filter.P
        limit = self._robot.slip.standstill_speed
        return all(abs(x[row]) < limit + 3.0 * math.sqrt(P[row, row])
                   for row in (State.V_X, State.V_Y))
