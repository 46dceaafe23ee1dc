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

"""Planar motion of the robot driven by the IMU, B(5): state, Jacobian and process noise."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.kinematics import SlipKinematics
from smart_tire.estimation.slip.slip_process import MIN_SLIP_VELOCITY
from smart_tire.estimation.slip.slope_spread import SLOPE_CORRELATION_LENGTH
from smart_tire.estimation.slip.state import (
    ImuReading, ImuStep, N, SIDE_SIGNS, SLIP_VEL_ROWS, SLIP_VELS, State, TRAVELS)
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import SlipEstimatorParams

SPEED_RANDOM_WALK = 0.002       # m/s per sqrt(s), errors of the planar model
GYRO_BIAS_RANDOM_WALK = 2e-5    # rad/s per sqrt(s): 10 degrees per hour after five minutes
ACCEL_BIAS_RANDOM_WALK = 5e-4   # m/s2 per sqrt(s)
FORCE_RANDOM_WALK = 10.0        # m/s2 per sqrt(s), of the specific force: 1 m/s2 in 10 ms
YAW_ACCEL_RANDOM_WALK = 20.0    # rad/s2 per sqrt(s), of the yaw acceleration
IDLE_SIGMAS = {                 # of states that are not used while the IMU drives the prediction
    State.FORCE_X: 10.0, State.FORCE_Y: 10.0,      # m/s2
    State.YAW_RATE: 10.0, State.YAW_ACCEL: 10.0}   # rad/s, rad/s2
COMMON_SLIP_RANDOM_WALK = 0.22  # m/s per sqrt(s), of a slip that the force balance follows
SLIP_DIFFERENCE_RANDOM_WALK = 0.022  # m/s per sqrt(s), of each side against the other
GROUND_LENGTH = 300.0           # m, over which properties of the ground return to their priors
DRAG_MEAN, DRAG_SIGMA = 0.02, 0.04  # -, prior of the rolling resistance: concrete to sand
SOFT_GROUND_CORRELATION = -0.6  # of ln C_x and rolling resistance: soft ground; assumed


class _Motion(NamedTuple):
    """Motion over one step, linearized at its center."""

    yaw_rate: float     # rad/s, bias removed
    a_x: float          # m/s2, change of V_X and V_Y, gravity and bias removed
    a_y: float
    b_x: float          # m/s, velocity of base_link in body axes
    b_y: float
    cos: float          # of the yaw angle
    sin: float
    slope_decay: float  # -, factor of roll and pitch
    slip_decay: float   # -, factor of the slip velocities
    roll: float = 0.0             # rad, change of roll and pitch by the gyroscope
    pitch: float = 0.0
    slope_variance: float = 0.0   # rad^2, process noise of roll and pitch


class MotionModel:
    """
    Discrete motion model of the state ``x`` (N numbers) over ``dt`` [s].

    The slip velocities and the slope of the ground decay; all other states that are not driven by
    the IMU are constant. The input holds biased measurements; the biases are states.

    With ``by_forces`` the states of specific force and yaw rate, of which the IMU and the force
    balance are measurements, drive the velocities. The noise of the IMU is then independent of
    that of the prediction, and slip may change within milliseconds.
    """

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._params = params
        self._kinematics = SlipKinematics(params.robot)
        self._x_imu, self._y_imu = params.robot.imu.position[:2]
        self._arms = [self._y_imu + sign * 0.5 * params.robot.track_width for sign in SIDE_SIGNS]
        self.by_forces = False
        # s, correlation time of a slip whose random walk is bounded by differential_slip_sigma
        self._slip_correlation_time = 2.0 * (
            params.differential_slip_sigma / max(params.slip_random_walk, 1e-6)) ** 2

    def predict(self, x: Sequence[float], step: ImuStep, dt: float
                ) -> tuple[list[float], Array, Array]:
        """Return the state after ``dt``, its Jacobian and its process noise, both (N, N)."""
        motion = _with_tilt(self._motion(x, self._driving(x, step.mean), dt, rate=(
            x[State.YAW_RATE] if self.by_forces else None)), step, dt)
        predicted, F = _predicted(x, motion, dt), self._jacobian(x, motion, dt)
        Q = self._noise(x, motion, step, dt)
        for row, slip_vel, arm in zip(TRAVELS, SLIP_VELS, self._arms):
            predicted[row] += dt * (arm * motion.yaw_rate + 0.5 * (
                x[State.V_X] + predicted[State.V_X] + x[slip_vel] + predicted[slip_vel]))
        self._predict_ground(predicted, F, Q, math.hypot(motion.b_x, motion.b_y) * dt)
        if self.by_forces:
            self._add_force_dynamics(x, predicted, F, Q, dt)
        else:
            for row, sigma in IDLE_SIGMAS.items():
                F[row, row], Q[row, row] = 0.0, sigma ** 2
        return predicted, F, Q

    def _driving(self, x: Sequence[float], imu: ImuReading) -> ImuReading:
        """Return the reading that drives the velocities."""
        if not self.by_forces:
            return imu
        return imu._replace(force_x=x[State.FORCE_X] + x[State.ACCEL_BIAS_X],
                            force_y=x[State.FORCE_Y] + x[State.ACCEL_BIAS_Y])

    def _predict_ground(self, predicted: list[float], F: Array, Q: Array,
                        distance: float) -> None:
        """Let the properties of the ground return to their priors over ``distance`` [m]."""
        decay = math.exp(-distance / GROUND_LENGTH)
        for row, mean, sigma in ((State.LN_STIFFNESS, 0.0, self._params.ground_stiffness_sigma),
                                 (State.LN_RATIO, 0.0, self._params.ground_friction_sigma),
                                 (State.DRAG, DRAG_MEAN, DRAG_SIGMA)):
            predicted[row] = mean + decay * (predicted[row] - mean)
            F[row, row], Q[row, row] = decay, (1.0 - decay ** 2) * sigma ** 2

    def _add_force_dynamics(self, x: Sequence[float], predicted: list[float], F: Array, Q: Array,
                            dt: float) -> None:
        """Replace the IMU by the states of specific force and yaw rate."""
        predicted[State.YAW_RATE] += x[State.YAW_ACCEL] * dt
        F[State.YAW_RATE, State.YAW_ACCEL] = dt
        F[State.V_X, State.FORCE_X] = F[State.V_Y, State.FORCE_Y] = dt
        F[State.V_X, State.YAW_RATE], F[State.V_Y, State.YAW_RATE] = (
            x[State.V_Y] * dt, -x[State.V_X] * dt)
        F[State.V_X, State.V_Y], F[State.V_Y, State.V_X] = (
            x[State.YAW_RATE] * dt, -x[State.YAW_RATE] * dt)
        F[State.V_X, State.GYRO_BIAS_Z] = F[State.V_Y, State.GYRO_BIAS_Z] = 0.0
        F[State.V_X, State.ACCEL_BIAS_X] = F[State.V_Y, State.ACCEL_BIAS_Y] = 0.0
        for integral, rate, walk in ((State.V_X, State.FORCE_X, FORCE_RANDOM_WALK),
                                     (State.V_Y, State.FORCE_Y, FORCE_RANDOM_WALK),
                                     (State.YAW_RATE, State.YAW_ACCEL, YAW_ACCEL_RANDOM_WALK)):
            variance = walk ** 2 * dt
            Q[integral, integral] = 0.25 * dt ** 2 * variance
            Q[integral, rate] = Q[rate, integral] = 0.5 * dt * variance
            Q[rate, rate] = variance
        for row in (State.V_X, State.V_Y):
            Q[row, row] += SPEED_RANDOM_WALK ** 2 * dt
        common, own = COMMON_SLIP_RANDOM_WALK ** 2 * dt, SLIP_DIFFERENCE_RANDOM_WALK ** 2 * dt
        Q[SLIP_VEL_ROWS, SLIP_VEL_ROWS] = [[common + own, common - own],
                                           [common - own, common + own]]

    def extrapolate(self, x: Sequence[float], imu: ImuReading, dt: float,
                    accel_share: float = 1.0) -> list[float]:
        """
        Return the state after a short ``dt``, with slope and slip velocities constant.

        ``accel_share`` (0 to 1) scales the acceleration.
        """
        return _moved(x, self._motion(x, imu, dt, accel_share), dt)

    def steady_force(self, x: Sequence[float], yaw_rate: float) -> tuple[float, float]:
        """Return the specific force [m/s2] x, y that the IMU measures at constant velocity."""
        return (x[State.ACCEL_BIAS_X] - yaw_rate * x[State.V_Y] - GRAVITY * x[State.PITCH],
                x[State.ACCEL_BIAS_Y] + yaw_rate * x[State.V_X] + GRAVITY * x[State.ROLL])

    def _motion(self, x: Sequence[float], imu: ImuReading, dt: float,
                accel_share: float = 1.0, rate: float | None = None) -> _Motion:
        W = imu.yaw_rate - x[State.GYRO_BIAS_Z]
        steady_x, steady_y = self.steady_force(x, W if rate is None else rate)
        a_x, a_y = accel_share * (imu.force_x - steady_x), accel_share * (imu.force_y - steady_y)
        b_x = x[State.V_X] + 0.5 * a_x * dt + self._y_imu * W
        b_y = x[State.V_Y] + 0.5 * a_y * dt - self._x_imu * W
        yaw = x[State.YAW] + 0.5 * W * dt
        return _Motion(W, a_x, a_y, b_x, b_y, math.cos(yaw), math.sin(yaw),
                       math.exp(-math.hypot(b_x, b_y) * dt / SLOPE_CORRELATION_LENGTH),
                       math.exp(-dt / self._slip_correlation_time))

    def _jacobian(self, x: Sequence[float], motion: _Motion, dt: float) -> Array:
        """Return the Jacobian (N, N), without terms of second order in ``dt``."""
        F = np.eye(N)
        W, b_x, b_y, cos, sin, decay = (motion.yaw_rate, motion.b_x, motion.b_y, motion.cos,
                                        motion.sin, motion.slope_decay)
        F[State.X, State.YAW] = (-sin * b_x - cos * b_y) * dt
        F[State.X, State.V_X] = cos * dt
        F[State.X, State.V_Y] = -sin * dt
        F[State.X, State.GYRO_BIAS_Z] = (-cos * self._y_imu - sin * self._x_imu) * dt
        F[State.Y, State.YAW] = (cos * b_x - sin * b_y) * dt
        F[State.Y, State.V_X] = sin * dt
        F[State.Y, State.V_Y] = cos * dt
        F[State.Y, State.GYRO_BIAS_Z] = (-sin * self._y_imu + cos * self._x_imu) * dt
        F[State.YAW, State.GYRO_BIAS_Z] = -dt
        F[State.V_X, State.V_Y] = W * dt
        F[State.V_X, State.GYRO_BIAS_Z] = -x[State.V_Y] * dt
        F[State.V_X, State.ACCEL_BIAS_X] = -dt
        F[State.V_X, State.PITCH] = GRAVITY * dt
        F[State.V_Y, State.V_X] = -W * dt
        F[State.V_Y, State.GYRO_BIAS_Z] = x[State.V_X] * dt
        F[State.V_Y, State.ACCEL_BIAS_Y] = -dt
        F[State.V_Y, State.ROLL] = -GRAVITY * dt
        F[State.ROLL, State.ROLL] = F[State.PITCH, State.PITCH] = decay
        F[State.ROLL, State.PITCH] = decay * W * dt
        F[State.PITCH, State.ROLL] = -decay * W * dt
        for row, travel, arm in zip(SLIP_VELS, TRAVELS, self._arms):
            F[row, row] = motion.slip_decay
            F[travel, row] = F[travel, State.V_X] = dt
            F[travel, State.GYRO_BIAS_Z] = -arm * dt
        return F

    def _noise(self, x: Sequence[float], motion: _Motion, step: ImuStep, dt: float) -> Array:
        params, Q = self._params, np.zeros(N)
        gyro, accel = step.gyro_variance * dt, step.accel_variance * dt
        Q[State.YAW] = gyro
        Q[State.ROLL] = Q[State.PITCH] = motion.slope_variance
        Q[State.V_X] = accel + gyro * x[State.V_Y] ** 2 + SPEED_RANDOM_WALK ** 2 * dt
        Q[State.V_Y] = accel + gyro * x[State.V_X] ** 2 + SPEED_RANDOM_WALK ** 2 * dt
        Q[State.GYRO_BIAS_Z] = GYRO_BIAS_RANDOM_WALK ** 2 * dt
        Q[State.ACCEL_BIAS_X] = Q[State.ACCEL_BIAS_Y] = ACCEL_BIAS_RANDOM_WALK ** 2 * dt
        for row, wheel in zip(SLIP_VELS, self._kinematics.wheel_speeds(x, step.mean.yaw_rate)):
            Q[row] = params.slip_random_walk ** 2 * (wheel ** 2 + MIN_SLIP_VELOCITY ** 2) * dt
        Q[State.ICR_X] = (params.icr_x_random_walk * params.robot.wheelbase) ** 2 * dt
        return np.diag(Q)


def _moved(x: Sequence[float], motion: _Motion, dt: float) -> list[float]:
    """Return the state ``x`` with pose and velocity after ``dt``."""
    moved = list(x)
    moved[State.X] += (motion.cos * motion.b_x - motion.sin * motion.b_y) * dt
    moved[State.Y] += (motion.sin * motion.b_x + motion.cos * motion.b_y) * dt
    moved[State.YAW] += motion.yaw_rate * dt
    moved[State.V_X] += motion.a_x * dt
    moved[State.V_Y] += motion.a_y * dt
    return moved


def _with_tilt(motion: _Motion, step: ImuStep, dt: float) -> _Motion:
    """Return ``motion`` with the change of slope: prior of the ground and gyroscope combined."""
    decay, noise = motion.slope_decay, step.tilt_variance * dt
    variance = step.slope_sigma ** 2 * (1.0 - decay ** 2)
    if math.isinf(noise):
        return motion._replace(slope_variance=variance)
    gain = min(variance / (variance + noise), step.tilt_gain)
    return motion._replace(
        slope_decay=decay + gain * (1.0 - decay), roll=gain * step.mean.roll_rate * dt,
        pitch=gain * step.mean.pitch_rate * dt,
        slope_variance=(1.0 - gain) * variance + gain ** 2 * noise)


def _predicted(x: Sequence[float], motion: _Motion, dt: float) -> list[float]:
    """Return the state ``x`` after ``dt``, with the decay of slope and slip velocities."""
    predicted = _moved(x, motion, dt)
    W, decay = motion.yaw_rate, motion.slope_decay
    predicted[State.ROLL] = decay * (x[State.ROLL] + W * x[State.PITCH] * dt) + motion.roll
    predicted[State.PITCH] = decay * (x[State.PITCH] - W * x[State.ROLL] * dt) + motion.pitch
    predicted[State.SLIP_VEL_L] *= motion.slip_decay
    predicted[State.SLIP_VEL_R] *= motion.slip_decay
    return predicted
