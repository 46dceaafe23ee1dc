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
An extended Kalman filter in the style of the ROS package robot_localization.

For comparison: its ``two_d_mode``, an omnidirectional body with constant acceleration. As its
documentation recommends, the inputs are the twist of wheel odometry (v_x, v_y = 0, yaw rate) and
the IMU (yaw rate, accelerations). It models neither slip nor biases. In addition to what the
package does, biases from the initial standstill are removed, the wheel yaw rate uses the track
that fits the run best, and all messages are processed in order of their timestamps.
"""

from __future__ import annotations

from enum import IntEnum
import math

from benchmarks.motion import Estimate
from benchmarks.slip.odometry import Inputs, side_slips
import numpy as np
from smart_tire.arrays import Array, Instants
from smart_tire.recording import at, PoseSeries
from smart_tire.samples import NS_PER_S


class State(IntEnum):
    """Rows of the filter state."""

    X = 0      # m
    Y = 1      # m
    YAW = 2    # rad
    V_X = 3    # m/s, body axes
    V_Y = 4    # m/s
    RATE = 5   # rad/s
    A_X = 6    # m/s2, body axes
    A_Y = 7    # m/s2


N = len(State)
# Default variances per second of the package, in the order of the state.
PROCESS_NOISE = np.array([0.05, 0.05, 0.06, 0.025, 0.025, 0.02, 0.01, 0.01])
START_VARIANCE = 1e-9     # of every state, default of the package
# (m/s)^2, (m/s)^2, (rad/s)^2: variances of v_x, v_y and yaw rate of wheel odometry in the
# controller configuration of the skid-steer robot Husky.
TWIST_VARIANCE = np.array([0.001, 0.001, 0.03])
TWIST = [State.V_X, State.V_Y, State.RATE]
INERTIAL = [State.RATE, State.A_X, State.A_Y]


class PlainEkf:
    """EKF that predicts to the timestamp of each measurement, then corrects."""

    def __init__(self) -> None:
        self.x: Array = np.zeros(N)
        self.P: Array = START_VARIANCE * np.eye(N)

    def predict(self, dt: float) -> None:
        """Advance by ``dt`` [s] with constant acceleration in body axes."""
        x, y, yaw, v_x, v_y, rate, a_x, a_y = self.x.tolist()
        cos, sin = math.cos(yaw), math.sin(yaw)
        d_x, d_y = v_x * dt + 0.5 * a_x * dt * dt, v_y * dt + 0.5 * a_y * dt * dt
        F = np.eye(N)
        F[State.X, [State.V_X, State.V_Y]] = cos * dt, -sin * dt
        F[State.Y, [State.V_X, State.V_Y]] = sin * dt, cos * dt
        F[State.X, [State.A_X, State.A_Y]] = 0.5 * dt * dt * cos, -0.5 * dt * dt * sin
        F[State.Y, [State.A_X, State.A_Y]] = 0.5 * dt * dt * sin, 0.5 * dt * dt * cos
        F[State.X, State.YAW], F[State.Y, State.YAW] = (
            -sin * d_x - cos * d_y, cos * d_x - sin * d_y)
        F[State.YAW, State.RATE] = F[State.V_X, State.A_X] = F[State.V_Y, State.A_Y] = dt
        self.x = np.array([x + cos * d_x - sin * d_y, y + sin * d_x + cos * d_y, yaw + rate * dt,
                           v_x + a_x * dt, v_y + a_y * dt, rate, a_x, a_y])
        self.P = F @ self.P @ F.T + np.diag(PROCESS_NOISE * dt)

    def correct(self, rows: list[State], z: Array, variance: Array) -> None:
        """Correct with a direct measurement ``z`` of ``rows``, in Joseph form."""
        H = np.eye(N)[rows]
        R = np.diag(variance)
        K = np.linalg.solve(H @ self.P @ H.T + R, H @ self.P).T
        self.x = self.x + K @ (z - self.x[rows])
        rest = np.eye(N) - K @ H
        self.P = rest @ self.P @ rest.T + K @ R @ K.T


def plain_ekf(inputs: Inputs, track: float) -> Estimate:
    """Return the estimates of the filter; the wheel yaw rate uses ``track`` [m]."""
    robot, ekf = inputs.robot, PlainEkf()
    readings = np.column_stack([inputs.rate, inputs.force])
    if inputs.stationary:
        readings = readings - readings[:inputs.stationary].mean(axis=0)
    seconds = np.diff(inputs.wheel_ns) / NS_PER_S
    left, right = (np.diff(inputs.travel, axis=0) / seconds[:, np.newaxis]).T
    twists = np.column_stack([0.5 * (left + right), np.zeros(len(left)), (right - left) / track])
    noise = np.array([robot.imu.gyro_noise, *(robot.imu.accel_noise,) * 2]) ** 2
    stamps = np.concatenate([inputs.imu_ns, inputs.wheel_ns[1:]])
    order = np.argsort(stamps, kind='stable')
    states, covariances = np.empty((len(stamps), N)), np.empty((len(stamps), N, N))
    last_ns = stamps[order[0]]
    for row, index in enumerate(order.tolist()):
        ekf.predict((stamps[index] - last_ns) / NS_PER_S)
        last_ns = stamps[index]
        wheel = index - len(readings)
        if wheel < 0:
            ekf.correct(INERTIAL, readings[index], noise)
        else:
            ekf.correct(TWIST, twists[wheel], TWIST_VARIANCE)
        states[row], covariances[row] = ekf.x, ekf.P
    last = np.append(np.diff(stamps[order]) > 0, True)
    return _as_estimate(inputs, stamps[order][last], states[last], covariances[last])


def _as_estimate(inputs: Inputs, stamps: Instants, states: Array, covariances: Array
                 ) -> Estimate:
    pose, twist = [State.X, State.Y, State.YAW], TWIST
    diagonal = np.diagonal(covariances, axis1=1, axis2=2)
    poses = PoseSeries(stamps, states[:, pose], states[:, twist],
                       covariances[:, pose][:, :, pose], diagonal[:, twist])
    half = 0.5 * inputs.robot.track_width
    v_x, rate = states[:, State.V_X], states[:, State.RATE]
    mixed = covariances[:, State.V_X, State.RATE]
    ground, sigma = [], []
    for side in (-1.0, 1.0):
        ground.append(v_x + side * half * rate)
        sigma.append(np.sqrt(diagonal[:, State.V_X] + half ** 2 * diagonal[:, State.RATE]
                             + 2.0 * side * half * mixed))
    rolling = at(stamps, inputs.wheel_ns, inputs.rolling)
    return Estimate(poses, side_slips(
        stamps, rolling, np.column_stack(ground), inputs.robot.slip.standstill_speed,
        np.column_stack(sigma)))
