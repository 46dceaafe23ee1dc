# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Odometry as it is published: a continuous pose (REP-105), and increments at a lower rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.reorder_buffer import GRID_NS
from smart_tire.estimation.slip.state import (
    SLIP_CORRELATION_TIME)
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.parameters.tuning import INCREMENTS
from smart_tire.rotation import yaw_of
from smart_tire.samples import NS_PER_S, Odometry, PLANAR, PLANAR_COVARIANCE

Pose = tuple[float, float, float]  # x, y [m], yaw [rad]


class OdometryOutput:
    """
    Messages of ``odom`` at the rate and with the twist that their consumers need.

    Increments: the twist is the mean velocity of the pose since the last message. A filter that
    takes the errors of consecutive messages as independent, such as ``ekf_node`` of
    robot_localization, adds up their covariances, while errors of the estimated twist are
    correlated over a second and more. So the covariance of an increment is what the covariance of
    such a filter lacks to that of the pose; negative parts are zero, which it then makes up for.
    """

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._every = math.ceil(NS_PER_S / GRID_NS / params.odom_rate - 1e-6)  # instants
        self._increments = params.odom_twist == INCREMENTS
        self.reset()

    def reset(self) -> None:
        """Forget the last message: the pose makes a step."""
        self._last: Odometry | None = None
        self._covariance = np.zeros((3, 3))  # of the pose in a filter that adds up increments

    def message(self, odometry: Odometry) -> Odometry | None:
        """Return what is published of an instant of the grid, None if nothing is."""
        if odometry.stamp_ns // GRID_NS % self._every:
            return None
        last, self._last = self._last, odometry
        if not self._increments:
            return odometry
        if last is None or odometry.stamp_ns - last.stamp_ns != self._every * GRID_NS:
            self._covariance = planar(odometry.pose_covariance)
            return odometry
        return self._increment(last, odometry)

    def _increment(self, last: Odometry, odometry: Odometry) -> Odometry:
        dt = self._every * GRID_NS / NS_PER_S
        old, new = (planar_pose(one) for one in (last, odometry))
        dx, dy, turn = new[0] - old[0], new[1] - old[1], math.remainder(new[2] - old[2], math.tau)
        c, s = math.cos(old[2] + 0.5 * turn), math.sin(old[2] + 0.5 * turn)
        v_x, v_y = (c * dx + s * dy) / dt, (c * dy - s * dx) / dt
        F = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        G = dt * np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        carried = F @ self._covariance @ F.T
        own = planar(odometry.twist_covariance)
        inverse = G.T / dt ** 2
        lacking = inverse @ (planar(odometry.pose_covariance) - carried) @ inverse.T - own
        values, vectors = np.linalg.eigh(lacking)
        share = 1.0 - math.exp(-dt / SLIP_CORRELATION_TIME)
        covariance = own + share * vectors * np.maximum(values, 0.0) @ vectors.T
        self._covariance = carried + G @ covariance @ G.T
        whole = np.array(odometry.twist_covariance).reshape(6, 6)
        whole[np.ix_(PLANAR, PLANAR)] = 0.5 * (covariance + covariance.T)
        return replace(odometry, linear=(v_x, v_y, 0.0), angular=(0.0, 0.0, turn / dt),
                       twist_covariance=tuple(whole.ravel().tolist()))


def planar(covariance: Sequence[float]) -> Array:
    """Return the covariance (3, 3) of x, y and yaw in one of ROS, 36 numbers."""
    return np.array([covariance[entry] for entry in PLANAR_COVARIANCE]).reshape(3, 3)


def planar_pose(odometry: Odometry) -> Pose:
    """Return x, y [m] and yaw [rad]."""
    return *odometry.position[:2], yaw_of(odometry.orientation)
