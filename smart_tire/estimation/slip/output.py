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

"""Odometry, slip and ICR from a state of the slip EKF or of its smoother."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.motion import MotionModel
from smart_tire.estimation.slip.state import (
    ImuReading, N, SIDE_SIGNS, SLIP_VELS, State)
from smart_tire.models.vehicle.skid_steer import wheel_slip_ratio
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.rotation import quaternion
from smart_tire.samples import Four, Icr, Odometry, Vector3, WheelSlip

MIN_YAW_RATE = 0.05        # rad/s; below, the ICR is too far away to be observable
PLANAR_VARIANCE = 1e-6     # m^2, rad^2 and per s: height and its rate, zero in the plane

PLANAR_COVARIANCE = PLANAR_VARIANCE * np.eye(6)
POSE_INDICES = np.ix_([0, 1, 3, 4, 5], [0, 1, 3, 4, 5])  # of the planar pose in a ROS covariance
TWIST_INDICES = np.ix_([0, 1, 5], [0, 1, 5])
POSE_STATES = np.ix_(*[[State.X, State.Y, State.ROLL, State.PITCH, State.YAW]] * 2)

EstimateRecord = Odometry | WheelSlip | Icr


@dataclass(frozen=True, slots=True)
class OutputContext:
    """Values needed for an output in addition to the state."""

    instant_ns: int       # of the output grid
    extrapolation: float  # s, from the time of the state to the instant
    imu: ImuReading       # last yaw rate, and forces without vibration
    wheel_residual: Four  # m/s, speed of each wheel minus the mean of its side


class SlipOutputBuilder:
    """Builds the output records of the slip estimator."""

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._robot = params.robot
        self._measured = params.robot.joints.measured
        self._motion = MotionModel(params.robot)
        self._x_imu, self._y_imu = params.robot.imu.position[:2]
        self._twist = T = np.zeros((3, N))  # Jacobian of the twist of base_link
        T[0, State.V_X] = T[1, State.V_Y] = 1.0
        T[:, State.GYRO_BIAS_Z] = -self._y_imu, self._x_imu, -1.0

    def build(self, context: OutputContext, x: Sequence[float], P: Array
              ) -> list[EstimateRecord]:
        """Return the records for at least the estimated states ``x`` with covariance ``P``."""
        x = self._motion.extrapolate(x, context.imu, context.extrapolation)
        W = context.imu.yaw_rate - x[State.GYRO_BIAS_Z]
        T = self._twist[:, :len(P)]
        T[1, State.IMU_X] = -W
        covariance = T @ P @ T.T
        twist = (x[State.V_X] + self._y_imu * W,
                 x[State.V_Y] - (self._x_imu + x[State.IMU_X]) * W, W)
        records: list[EstimateRecord] = [
            self._odometry(context, x, P, twist, 0.5 * (covariance + covariance.T)),
            self._slip(context, x, P, W)]
        if abs(W) > MIN_YAW_RATE:
            records.append(Icr(context.instant_ns, -twist[1] / W, twist[0] / W))
        return records

    def _odometry(self, context: OutputContext, x: Sequence[float], P: Array, twist: Vector3,
                  covariance: Array) -> Odometry:
        v_x, v_y, W = twist
        pose, rates = PLANAR_COVARIANCE.copy(), PLANAR_COVARIANCE.copy()
        pose[POSE_INDICES] = P[POSE_STATES]
        rates[TWIST_INDICES] = covariance
        rates[5, 5] += self._robot.imu.gyro_noise ** 2  # of the sample that is published
        return Odometry(
            context.instant_ns, (x[State.X], x[State.Y], 0.0),
            quaternion(x[State.ROLL], x[State.PITCH], x[State.YAW]),
            (v_x, v_y, 0.0), (0.0, 0.0, W),
            tuple(pose.ravel().tolist()), tuple(rates.ravel().tolist()))

    def _slip(self, context: OutputContext, x: Sequence[float], P: Array, W: float) -> WheelSlip:
        sides = self._motion.rolling_rates(x, W)
        ground = [side - x[row] for side, row in zip(sides, SLIP_VELS)]
        standstill = self._robot.slip.standstill_speed
        # wheel i is on side i % 2: left, right, left, right
        wheels = [sides[i % 2] + context.wheel_residual[i] if measured else math.nan
                  for i, measured in enumerate(self._measured)]
        ratio = [wheel_slip_ratio(wheel, ground[i % 2], standstill)
                 for i, wheel in enumerate(wheels)]
        slip_velocity = [wheel - ground[i % 2] for i, wheel in enumerate(wheels)]
        sigmas = self._slip_sigmas(x, P, ground, sides)
        sigma = [1.0 if math.isnan(ratio[i]) else sigmas[i % 2] for i in range(4)]
        return WheelSlip(
            context.instant_ns, *(_four(values) for values in (ratio, slip_velocity, sigma)))

    def _slip_sigmas(self, x: Sequence[float], P: Array, ground: Sequence[float],
                     sides: Sequence[float]) -> list[float]:
        """Return the standard deviations [-] of the left and right slip ratio, at most 1."""
        v_x, bias = State.V_X, State.GYRO_BIAS_Z
        sigmas = []
        for sign, row, v, u in zip(SIDE_SIGNS, SLIP_VELS, ground, sides):
            # slip ratio = slip velocity / u, with u = v + slip velocity
            arm, by_v = self._y_imu + sign * 0.5 * self._robot.track_width, -x[row]
            speed_variance = P[v_x, v_x] - 2.0 * arm * P[v_x, bias]
            variance = (v * v * P[row, row] + by_v * by_v * speed_variance
                        + 2.0 * v * by_v * P[row, v_x])
            sigmas.append(min(1.0, math.sqrt(max(0.0, float(variance))) / max(u * u, 1e-9)))
        return sigmas


def _four(values: Sequence[float]) -> Four:
    a, b, c, d = values
    return a, b, c, d
