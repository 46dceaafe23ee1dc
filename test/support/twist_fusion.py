# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The extended Kalman filter of robot_localization with the twist of an odometry as its input."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from smart_tire.arrays import Array
from smart_tire.estimation.slip.odometry import planar, planar_pose
from smart_tire.samples import NS_PER_S, Odometry


def planar_twist(odometry: Odometry) -> tuple[float, float, float]:
    """Return v_x, v_y [m/s] and yaw rate [rad/s]."""
    return *odometry.linear[:2], odometry.angular[2]


class TwistFusion:
    """
    ``ekf_node`` with ``two_d_mode`` and one input, of which v_x, v_y and the yaw rate are fused.

    State: x, y, yaw, v_x, v_y, yaw rate; the velocities are random walks. ``noise`` (6,) is the
    diagonal of its ``process_noise_covariance``, per second. Accelerations, which it has in
    addition, are without an input.
    """

    def __init__(self, first: Odometry, noise: Sequence[float]) -> None:
        self.x = np.array([*planar_pose(first), *planar_twist(first)])
        self.P = np.zeros((6, 6))
        self.P[:3, :3] = planar(first.pose_covariance)
        self.P[3:, 3:] = planar(first.twist_covariance)
        self._noise, self._stamp_ns = np.diag(noise), first.stamp_ns

    def fuse(self, message: Odometry) -> None:
        """Predict to the stamp of a message and correct with its twist."""
        dt = (message.stamp_ns - self._stamp_ns) / NS_PER_S
        self._stamp_ns = message.stamp_ns
        c, s = np.cos(self.x[2]), np.sin(self.x[2])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        v_x, v_y = self.x[3:5]
        F = np.eye(6)
        F[:3, 3:] = dt * turn
        F[:2, 2] = dt * (-s * v_x - c * v_y), dt * (c * v_x - s * v_y)
        self.x[:3] += dt * turn @ self.x[3:]
        self.P = F @ self.P @ F.T + dt * self._noise
        S = self.P[3:, 3:] + planar(message.twist_covariance)
        K = self.P[:, 3:] @ np.linalg.inv(S)
        self.x += K @ (np.array(planar_twist(message)) - self.x[3:])
        self.P -= K @ S @ K.T

    def nees(self, place: Array) -> float:
        """Return the normalized squared error of the position per dimension; truth (2,) in m."""
        error = self.x[:2] - place
        return float(error @ np.linalg.solve(self.P[:2, :2], error)) / 2.0
