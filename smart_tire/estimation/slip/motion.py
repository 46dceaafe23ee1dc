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
Motion of the robot driven by the IMU, B(5), with the slip of both sides about their ICRs.

A side yaws about its instantaneous center of rotation (Pentzer): its slip velocity is the yaw rate
times the distance ``ICR_L``, ``ICR_R`` of that center beyond the wheels. The rest of the slip is a
first-order Gauss-Markov process, common to both sides and different.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.state import (
    ICRS, ImuReading, ImuStep, N, SIDE_SIGNS, SLIP_VELS, State, TRAVELS)
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import RobotParams

SPEED_RANDOM_WALK = 0.002      # m/s per sqrt(s), errors of the planar model; assumed
GYRO_BIAS_RANDOM_WALK = 2e-5   # rad/s per sqrt(s): 10 degrees per hour after five minutes
ACCEL_BIAS_RANDOM_WALK = 5e-4  # m/s2 per sqrt(s), data sheets of industrial IMUs
SLIP_CORRELATION_TIME = 1.0    # s, of the slip beyond the ICR kinematics; assumed
SLOPE_LENGTH = 2.0             # m, correlation length of the slope; some robot lengths
MIN_SLIP_SPEED = 0.1           # m/s, below which the noise of slip velocities is constant


class Noise(NamedTuple):
    """Learned noise levels."""

    slope: tuple[float, float]  # rad, of roll and pitch
    slip_common: float       # -, of the slip of both sides
    slip_difference: float   # -, of half the difference
    icr: float               # m per sqrt(m), random walk of ICR_L, ICR_R
    icr_x: float             # m per sqrt(m), of ICR_X


def slip_speed(rates: Sequence[float]) -> float:
    """Return the speed [m/s] that slip ratios refer to, from r w of both sides."""
    return max(0.5 * (abs(rates[0]) + abs(rates[1])), MIN_SLIP_SPEED)


class MotionModel:
    """Motion of the state ``x`` (N numbers) over ``dt`` [s]."""

    def __init__(self, robot: RobotParams) -> None:
        self._x_imu, self._y_imu = robot.imu.position[:2]
        self.arms = [self._y_imu + sign * 0.5 * robot.track_width for sign in SIDE_SIGNS]
        self._F, self._Q = np.eye(N), np.zeros((N, N))

    def yaw_rate(self, x: Sequence[float], gyro_z: float) -> float:
        """Return the yaw rate [rad/s] without bias."""
        return gyro_z - x[State.GYRO_BIAS_Z]

    def icr_slip(self, x: Sequence[float], W: float) -> list[float]:
        """Return the slip velocities [m/s] of the ICR kinematics at the yaw rate [rad/s]."""
        return [sign * x[row] * W for sign, row in zip(SIDE_SIGNS, ICRS)]

    def rolling_rates(self, x: Sequence[float], W: float) -> list[float]:
        """Return r w [m/s] of both sides."""
        return [x[State.V_X] + arm * W + x[row] for arm, row in zip(self.arms, SLIP_VELS)]

    def steady_force(self, x: Sequence[float], W: float) -> tuple[float, float]:
        """Return the specific force [m/s2] x, y that the IMU measures at constant velocity."""
        return (x[State.ACCEL_BIAS_X] - W * x[State.V_Y] - GRAVITY * x[State.PITCH],
                x[State.ACCEL_BIAS_Y] + W * x[State.V_X] + GRAVITY * x[State.ROLL])

    def extrapolate(self, x: Sequence[float], imu: ImuReading, dt: float) -> list[float]:
        """Return the state after a short ``dt`` at the present acceleration."""
        W, moved = self.yaw_rate(x, imu.yaw_rate), list(x)
        steady_x, steady_y = self.steady_force(x, W)
        self._move(x, moved, W, imu.force_x - steady_x, imu.force_y - steady_y, dt)
        return moved

    def _move(self, x: Sequence[float], moved: list[float], W: float, a_x: float, a_y: float,
              dt: float) -> tuple[float, float, float, float]:
        """Write pose and velocity after ``dt`` to ``moved``; return b_x, b_y, cos and sin."""
        b_x = x[State.V_X] + 0.5 * a_x * dt + self._y_imu * W
        b_y = x[State.V_Y] + 0.5 * a_y * dt - (self._x_imu + x[State.IMU_X]) * W
        yaw = x[State.YAW] + 0.5 * W * dt
        cos, sin = math.cos(yaw), math.sin(yaw)
        moved[State.X] += (cos * b_x - sin * b_y) * dt
        moved[State.Y] += (sin * b_x + cos * b_y) * dt
        moved[State.YAW] += W * dt
        moved[State.V_X] += a_x * dt
        moved[State.V_Y] += a_y * dt
        return b_x, b_y, cos, sin

    def predict(self, x: list[float], step: ImuStep, noise: Noise
                ) -> tuple[list[float], Array, Array]:
        """Return the state after a step, its Jacobian and noise (N, N), to be used at once."""
        dt, imu, F, Q = step.dt, step.mean, self._F, self._Q
        W, after = self.yaw_rate(x, imu.yaw_rate), list(x)
        steady_x, steady_y = self.steady_force(x, W)
        b_x, b_y, cos, sin = self._move(
            x, after, W, imu.force_x - steady_x, imu.force_y - steady_y, dt)
        self._fill_motion(x, W, b_x, b_y, cos, sin, dt)
        self._predict_slope(x, after, W, dt, math.hypot(b_x, b_y) * dt, noise.slope)
        self._predict_slip(x, after, W, step, noise)
        turned = abs(W) * dt
        gyro, accel = step.gyro_variance * dt, step.accel_variance * dt
        walk = SPEED_RANDOM_WALK ** 2 * dt
        for row, variance in (
                (State.YAW, gyro), (State.V_X, accel + gyro * x[State.V_Y] ** 2 + walk),
                (State.V_Y, accel + gyro * x[State.V_X] ** 2 + walk),
                (State.GYRO_BIAS_Z, GYRO_BIAS_RANDOM_WALK ** 2 * dt),
                (State.ACCEL_BIAS_X, ACCEL_BIAS_RANDOM_WALK ** 2 * dt),
                (State.ACCEL_BIAS_Y, ACCEL_BIAS_RANDOM_WALK ** 2 * dt),
                (State.ICR_X, noise.icr_x ** 2 * turned), (State.ICR_L, noise.icr ** 2 * turned),
                (State.ICR_R, noise.icr ** 2 * turned)):
            Q[row, row] = variance
        return after, F, Q

    def _fill_motion(self, x: Sequence[float], W: float, b_x: float, b_y: float, cos: float,
                     sin: float, dt: float) -> None:
        """Write the Jacobian of pose and velocity, without terms of second order in ``dt``."""
        F, x_imu = self._F, self._x_imu + x[State.IMU_X]
        F[State.X, State.YAW] = (-sin * b_x - cos * b_y) * dt
        F[State.X, State.V_X] = F[State.Y, State.V_Y] = cos * dt
        F[State.Y, State.V_X] = sin * dt
        F[State.X, State.V_Y] = -sin * dt
        F[State.X, State.GYRO_BIAS_Z] = (-cos * self._y_imu - sin * x_imu) * dt
        F[State.X, State.IMU_X] = sin * W * dt
        F[State.Y, State.YAW] = (cos * b_x - sin * b_y) * dt
        F[State.Y, State.GYRO_BIAS_Z] = (-sin * self._y_imu + cos * x_imu) * dt
        F[State.Y, State.IMU_X] = -cos * W * dt
        F[State.YAW, State.GYRO_BIAS_Z] = -dt
        F[State.V_X, State.V_Y] = W * dt
        F[State.V_X, State.GYRO_BIAS_Z] = -x[State.V_Y] * dt
        F[State.V_X, State.ACCEL_BIAS_X] = F[State.V_Y, State.ACCEL_BIAS_Y] = -dt
        F[State.V_X, State.PITCH] = GRAVITY * dt
        F[State.V_Y, State.V_X] = -W * dt
        F[State.V_Y, State.GYRO_BIAS_Z] = x[State.V_X] * dt
        F[State.V_Y, State.ROLL] = -GRAVITY * dt

    def _predict_slope(self, x: Sequence[float], after: list[float], W: float, dt: float,
                       moved: float, sigmas: tuple[float, float]) -> None:
        """Predict roll and pitch: fixed to the ground, a Gauss-Markov process along the path."""
        keep, turn = math.exp(-moved / SLOPE_LENGTH), W * dt
        for row, other, sign, sigma in ((State.ROLL, State.PITCH, 1.0, sigmas[0]),
                                        (State.PITCH, State.ROLL, -1.0, sigmas[1])):
            after[row] = keep * (x[row] + sign * turn * x[other])
            self._F[row, row], self._F[row, other] = keep, sign * keep * turn
            self._Q[row, row] = sigma ** 2 * (1.0 - keep ** 2)

    def _predict_slip(self, x: Sequence[float], after: list[float], W: float, step: ImuStep,
                      noise: Noise) -> None:
        """Predict slip velocities and travels."""
        F, Q, dt = self._F, self._Q, step.dt
        decay = math.exp(-dt / SLIP_CORRELATION_TIME)
        rates = self.rolling_rates(x, W)
        speed = slip_speed(rates)
        innovation = (1.0 - decay ** 2) * speed ** 2
        common, difference = (innovation * sigma ** 2 for sigma in (
            noise.slip_common, noise.slip_difference))
        gain = 0.0  # rad/s, of the slip by an ICR; at rest the yaw rate is noise
        if speed > MIN_SLIP_SPEED:
            gain = self.yaw_rate(x, step.end_rate) - decay * self.yaw_rate(x, step.begin_rate)
        for sign, slip, icr, travel, arm, rate in zip(
                SIDE_SIGNS, SLIP_VELS, ICRS, TRAVELS, self.arms, rates):
            after[slip] = decay * x[slip] + sign * gain * x[icr]
            after[travel] += dt * (rate + 0.5 * (
                after[State.V_X] - x[State.V_X] + after[slip] - x[slip]))
            F[slip, slip], F[slip, icr] = decay, sign * gain
            F[slip, State.GYRO_BIAS_Z] = -sign * (1.0 - decay) * x[icr] * (gain != 0.0)
            F[travel, slip] = F[travel, State.V_X] = dt
            F[travel, State.GYRO_BIAS_Z] = -arm * dt
            Q[slip, slip] = common + difference
        left, right = SLIP_VELS
        Q[left, right] = Q[right, left] = common - difference
