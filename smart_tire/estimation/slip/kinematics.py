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

"""Body and side speeds with their standard deviations, from the state of the slip EKF."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.state import N, SIDE_SIGNS, SLIP_VELS, State
from smart_tire.parameters import RobotParams
from smart_tire.samples import Vector3


class SlipKinematics:
    """
    Speeds that follow from a state ``x`` (N numbers) with covariance ``P`` (N, N).

    ``gyro_z`` is the measured yaw rate [rad/s] in base axes, bias included.
    """

    def __init__(self, robot: RobotParams) -> None:
        self._half_track = 0.5 * robot.track_width
        self._x_imu, self._y_imu = robot.imu.position[0], robot.imu.position[1]
        self._jacobian = J = np.zeros((3, N))  # of the twist of base_link
        J[0, State.V_X] = J[1, State.V_Y] = 1.0
        J[:3, State.GYRO_BIAS_Z] = -self._y_imu, self._x_imu, -1.0

    def side_speeds(self, x: Sequence[float], gyro_z: float) -> tuple[float, float]:
        """Return v_x [m/s] of the left and of the right wheel centers, B(2)."""
        W = gyro_z - x[State.GYRO_BIAS_Z]
        v_x = x[State.V_X] + self._y_imu * W
        return v_x - self._half_track * W, v_x + self._half_track * W

    def wheel_speeds(self, x: Sequence[float], gyro_z: float) -> tuple[float, float]:
        """Return the estimated r w [m/s] of the left and of the right side."""
        left, right = self.side_speeds(x, gyro_z)
        return left + x[State.SLIP_VEL_L], right + x[State.SLIP_VEL_R]

    def base_twist(self, x: Sequence[float], P: Array, gyro_z: float) -> tuple[Vector3, Array]:
        """Return v_x, v_y [m/s] and yaw rate [rad/s] of base_link, and their covariance (3, 3)."""
        W = gyro_z - x[State.GYRO_BIAS_Z]
        twist = (x[State.V_X] + self._y_imu * W, x[State.V_Y] - self._x_imu * W, W)
        covariance = self._jacobian @ P @ self._jacobian.T
        return twist, 0.5 * (covariance + covariance.T)

    def slip_sigmas(self, x: Sequence[float], P: Array, gyro_z: float) -> tuple[float, float]:
        """Return the standard deviations [-] of the left and right slip ratio, at most 1."""
        ground, wheels = self.side_speeds(x, gyro_z), self.wheel_speeds(x, gyro_z)
        sigmas = []
        for side, row, v, u in zip(SIDE_SIGNS, SLIP_VELS, ground, wheels):
            # slip ratio = slip velocity / u, with u = v + slip velocity
            by_slip_velocity, by_v = v, -x[row]
            arm = self._y_imu + side * self._half_track
            variance = (by_slip_velocity ** 2 * P[row, row] + by_v ** 2 * (
                P[State.V_X, State.V_X] - 2.0 * arm * P[State.V_X, State.GYRO_BIAS_Z])
                + 2.0 * by_slip_velocity * by_v * P[row, State.V_X])
            sigmas.append(min(1.0, math.sqrt(max(0.0, variance)) / max(u * u, 1e-9)))
        return sigmas[0], sigmas[1]

    def slip_covariances(self, x: Sequence[float], P: Array, gyro_z: float, state: State
                         ) -> tuple[float, float]:
        """Return the covariances of the left and right slip ratio with one of the states."""
        left, right = (
            float(v * P[row, state] - x[row] * P[State.V_X, state]) / max(u * u, 1e-9)
            for row, v, u in zip(SLIP_VELS, self.side_speeds(x, gyro_z),
                                 self.wheel_speeds(x, gyro_z)))
        return left, right
