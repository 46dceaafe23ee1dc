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

from array import array
from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.motion import fill_covariances, MotionModel
from smart_tire.estimation.slip.state import ImuReading, State
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.rotation import quaternion
from smart_tire.samples import Four, Icr, Odometry, Vector3, WheelSlip

MIN_YAW_RATE = 0.05        # rad/s; below, the ICR is too far away to be observable
PLANAR_VARIANCE = 1e-6     # m^2, rad^2 and per s: height and its rate, zero in the plane

EstimateRecord = Odometry | WheelSlip | Icr


class OutputContext(NamedTuple):
    """Values needed for an output in addition to the state."""

    instant_ns: int       # of the output grid
    extrapolation: float  # s, from the time of the state to the instant
    imu: ImuReading       # last yaw rate, and forces without vibration
    wheel_residual: Four  # m/s, speed of each wheel minus the mean of its side


class SlipOutputBuilder:
    """Builds the output records of the slip estimator."""

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._standstill_speed = params.robot.slip.standstill_speed
        self._gyro_variance = params.robot.imu.gyro_noise ** 2
        self._hidden = _four([0.0 if one else math.nan for one in params.robot.joints.measured])
        self._motion = MotionModel(params.robot)
        self._x_imu, self._y_imu = params.robot.imu.position[:2]
        # of pose and twist in the order of ROS; the planar part is overwritten
        self._covariances = [array('d', np.ravel(PLANAR_VARIANCE * np.eye(6))) for _ in range(2)]

    def build(self, context: OutputContext, x: Sequence[float], P: Array
              ) -> list[EstimateRecord]:
        """Return the records for at least the estimated states ``x`` with covariance ``P``."""
        x = self._motion.extrapolate(array('d', x), context.imu, context.extrapolation)
        W = context.imu.yaw_rate - x[State.GYRO_BIAS_Z]
        twist = (x[State.V_X] + self._y_imu * W,
                 x[State.V_Y] - (self._x_imu + x[State.IMU_X]) * W, W)
        slips = self._motion.wheel_slips(
            x, P, W, context.wheel_residual, self._hidden, self._standstill_speed)
        records: list[EstimateRecord] = [
            self._odometry(context, x, P, twist),
            WheelSlip(context.instant_ns, *map(_four, zip(*slips)))]
        if abs(W) > MIN_YAW_RATE:
            records.append(Icr(context.instant_ns, -twist[1] / W, twist[0] / W))
        return records

    def _odometry(self, context: OutputContext, x: array[float], P: Array, twist: Vector3
                  ) -> Odometry:
        v_x, v_y, W = twist
        pose, rates = self._covariances
        fill_covariances(P, W, self._x_imu, self._y_imu, pose, rates)
        rates[35] += self._gyro_variance  # of the sample that is published
        return Odometry(
            context.instant_ns, (x[State.X], x[State.Y], 0.0),
            quaternion(x[State.ROLL], x[State.PITCH], x[State.YAW]),
            (v_x, v_y, 0.0), (0.0, 0.0, W), tuple(pose), tuple(rates))


def _four(values: Sequence[float]) -> Four:
    a, b, c, d = values
    return a, b, c, d
