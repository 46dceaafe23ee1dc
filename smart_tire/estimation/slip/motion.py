# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True, infer_types=True, show_performance_hints=False

"""
Motion of the slip filter: state, Jacobian and noise over a step of the IMU, and outputs.

The motion is driven by the IMU, B(5), with the slip of both sides about their ICRs. A side yaws
about its instantaneous center of rotation (Pentzer): its slip velocity is the yaw rate times the
distance ``ICR_L``, ``ICR_R`` of that center beyond the wheels. The rest of the slip is a
first-order Gauss-Markov process, common to both sides and different.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler (types:
``motion.pxd``). States are ``array('d')``: fast to index in Python, and memory that C and numpy
share.
"""

from __future__ import annotations

from array import array
from collections import deque
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip import state
from smart_tire.estimation.slip.state import ImuReading, ImuStep, N, State
from smart_tire.parameters import RobotParams
from smart_tire.samples import Four, four, GRAVITY as G

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.libc.math import cos, exp, sin, sqrt
else:
    from math import cos, exp, sin, sqrt

COMPILED: bool = cython.compiled

NAN, GRAVITY, MIN_SLIP_SPEED = math.nan, G, state.MIN_SLIP_SPEED
SLIP_CORRELATION_TIME, SLOPE_LENGTH = state.SLIP_CORRELATION_TIME, state.SLOPE_LENGTH
MAX_SAMPLE_GAP = state.MAX_SAMPLE_GAP

(X, Y, YAW, ROLL, PITCH, V_X, V_Y, GYRO_BIAS_Z, ACCEL_BIAS_X, ACCEL_BIAS_Y, SLIP_VEL_L,
 SLIP_VEL_R, TRAVEL_L, _, ICR_X, ICR_L, ICR_R, _, IMU_X, IMU_Y) = map(
     int, list(State)[:State.IMU_Y + 1])


class Noise(NamedTuple):
    """Learned noise levels."""

    slope: tuple[float, float]  # rad, of roll and pitch
    slip_common: float       # -, of the slip of both sides
    slip_difference: float   # -, of half the difference
    icr: float               # m per sqrt(rad), random walk of the ICRs


def slip_speed(left: float, right: float) -> float:
    """Return the speed [m/s] that slip ratios refer to, from r w of both sides."""
    return max(0.5 * (abs(left) + abs(right)), MIN_SLIP_SPEED)


def wheel_slip_ratio(rolling: float, ground: float, standstill_speed: float) -> float:
    """
    Return ``skid_steer.slip_ratio`` of one wheel from numbers.

    >>> print(f'{wheel_slip_ratio(-1.0, -0.9, 0.05):.2f}')
    0.10
    """
    if abs(rolling) < standstill_speed:
        if abs(ground) < standstill_speed:
            return NAN
        if rolling * ground <= 0.0:
            return -1.0
    return min(max(1.0 - ground / rolling, -1.0), 1.0)


class RollingHistory:
    """
    Predicted r w of both sides over the latest time, for wheel samples that arrive late.

    It is without the steps of corrections. A correction holds for the past, too: going back from
    the present state, only the predicted changes are undone.
    """

    def __init__(self) -> None:
        # time [s], r w [m/s] and distance [m] of both sides, all by predictions alone
        self._points: deque[tuple[float, float, float, float, float]] = deque()
        self._last = (0.0, 0.0, 0.0, 0.0, 0.0)

    def add_step(self, time: float, dt: float, left: float, right: float) -> None:
        """Add a prediction over ``dt`` [s] to ``time`` [s] that changes r w [m/s] of the sides."""
        points = self._points
        if not points:
            points.append((time - dt, 0.0, 0.0, 0.0, 0.0))
        _, left_before, right_before, left_travel, right_travel = self._last
        u_left: cython.double = left_before
        u_right: cython.double = right_before
        s_left: cython.double = left_travel
        s_right: cython.double = right_travel
        self._last = (time, u_left + left, u_right + right, s_left + dt * (u_left + 0.5 * left),
                      s_right + dt * (u_right + 0.5 * right))
        points.append(self._last)
        while points[0][0] < time - MAX_SAMPLE_GAP:
            points.popleft()

    def travel_change(self, since: cython.double) -> tuple[float, float]:
        """Return the distances [m] since a time [s] beyond those at the present speeds."""
        if not self._points or since >= self._last[0]:
            return 0.0, 0.0
        points = self._points
        i: cython.int = len(points) - 1
        while i > 1 and points[i - 1][0] > since:
            i -= 1
        before, after, last = points[i - 1], points[i], self._last
        t0: cython.double = before[0]
        t1: cython.double = after[0]
        now: cython.double = last[0]
        h = min(max(since - t0, 0.0), t1 - t0)
        found = []
        for side in range(2):
            u0: cython.double = before[1 + side]
            u1: cython.double = after[1 + side]
            u: cython.double = last[1 + side]
            s0: cython.double = before[3 + side]
            s: cython.double = last[3 + side]
            found.append(s - (s0 + h * (u0 + 0.5 * (u1 - u0) * h / (t1 - t0)))
                         - (now - t0 - h) * u)
        return found[0], found[1]


class MotionModel:
    """
    Motion of the state ``x`` (N numbers) over ``dt`` [s].

    ``F`` and ``Q`` (N, N) are Jacobian and noise of the last prediction.
    """

    def __init__(self, robot: RobotParams) -> None:
        self._x_imu, self._y_imu = robot.imu.position[:2]
        self._gyro_walk = (state.BIAS_WALK_SHARE * robot.imu.gyro_bias) ** 2
        self._accel_walk = (state.BIAS_WALK_SHARE * robot.imu.accel_bias) ** 2
        self._arms = [self._y_imu + sign * 0.5 * robot.track_width for sign in (-1.0, 1.0)]
        self.F, self.Q = np.eye(N), np.zeros((N, N))

    def arm(self, x: array[float], side: cython.int) -> float:
        """Return the derivative [m] of v_x of the left (0) or right (1) side by the yaw rate."""
        return self._arms[side] + x[IMU_Y]

    def rolling_rate(self, x: array[float], W: float, side: cython.int) -> float:
        """Return r w [m/s] of the left (0) or right (1) side."""
        return x[V_X] + (self._arms[side] + x[IMU_Y]) * W + x[SLIP_VEL_L + side]

    def steady_force(self, x: array[float], W: float) -> tuple[float, float]:
        """Return the specific force [m/s2] x, y that the IMU measures at constant velocity."""
        return (x[ACCEL_BIAS_X] - W * x[V_Y] - GRAVITY * x[PITCH],
                x[ACCEL_BIAS_Y] + W * x[V_X] + GRAVITY * x[ROLL])

    def extrapolate(self, x: array[float], imu: ImuReading, dt: float) -> array[float]:
        """Return the state after ``dt`` [s]."""
        moved = x[:]
        rate, force_x, force_y = imu
        self._move(x, moved, rate - moved[GYRO_BIAS_Z], force_x, force_y, dt)
        return moved

    def wheel_slips(self, x: array[float], P: Array, W: float, residual: Four, hidden: Four,
                    standstill_speed: float) -> tuple[Four, Four, Four]:
        """
        Return slip ratio, slip velocity [m/s] and standard deviation of the ratio of the wheels.

        ``residual`` [m/s] is r w of the wheels beyond that of their sides, ``hidden`` NaN for
        those that are not measured and 0 for others.
        """
        ratios, velocities, sigmas = [], [], []
        for i in range(4):
            side_speed = self.rolling_rate(x, W, i % 2)
            ground = side_speed - x[SLIP_VEL_L + i % 2]
            rest: cython.double = residual[i]
            unmeasured: cython.double = hidden[i]
            rolling = side_speed + rest + unmeasured
            ratio = wheel_slip_ratio(rolling, ground, standstill_speed)
            ratios.append(ratio)
            velocities.append(rolling - ground)
            sigmas.append(self._slip_sigma(x, P, W, i % 2) if ratio == ratio else 1.0)
        return four(ratios), four(velocities), four(sigmas)

    def _slip_sigma(self, x: array[float], P: Array, W: float, side: cython.int) -> float:
        """
        Return the standard deviation [-] of the slip ratio of a side, at most 1.

        Slip ratio = slip velocity / u, with u = v + slip velocity.
        """
        slip, u = SLIP_VEL_L + side, self.rolling_rate(x, W, side)
        v, by_v = u - x[slip], -x[slip]
        arm = self._arms[side] + x[IMU_Y]
        speed_variance = (P[V_X, V_X] - 2.0 * arm * P[V_X, GYRO_BIAS_Z]
                          + W * (2.0 * P[V_X, IMU_Y] + W * P[IMU_Y, IMU_Y]))
        variance = (v * v * P[slip, slip] + by_v * by_v * speed_variance
                    + 2.0 * v * by_v * (P[slip, V_X] + W * P[slip, IMU_Y]))
        return min(1.0, sqrt(max(0.0, variance)) / max(u * u, 1e-9))

    def predict(self, x: array[float], step: ImuStep, noise: Noise) -> array[float]:
        """Return the state after a step; set its Jacobian and noise."""
        moved = x[:]
        old: cython.double[::1] = x
        new: cython.double[::1] = moved
        Q = self.Q
        dt: cython.double = step.dt
        yaw_rate, force_x, force_y = step.mean
        W: cython.double = yaw_rate - old[GYRO_BIAS_Z]
        way: cython.double = self._move(old, new, W, force_x, force_y, dt)
        roll_sigma, pitch_sigma = noise.slope
        self._predict_slope(old, new, W, dt, way, ROLL, roll_sigma)
        self._predict_slope(old, new, W, dt, way, PITCH, pitch_sigma)
        self._predict_slip(old, new, step.begin_rate, step.end_rate, W, dt, noise)
        gyro: cython.double = step.gyro_variance * dt
        speed: cython.double = step.accel_variance * dt
        Q[YAW, YAW] = gyro
        Q[V_X, V_X] = speed + gyro * old[V_Y] * old[V_Y]
        Q[V_Y, V_Y] = speed + gyro * old[V_X] * old[V_X]
        Q[GYRO_BIAS_Z, GYRO_BIAS_Z] = self._gyro_walk * dt
        Q[ACCEL_BIAS_X, ACCEL_BIAS_X] = self._accel_walk * dt
        Q[ACCEL_BIAS_Y, ACCEL_BIAS_Y] = Q[ACCEL_BIAS_X, ACCEL_BIAS_X]
        Q[ICR_X, ICR_X] = Q[ICR_L, ICR_L] = Q[ICR_R, ICR_R] = noise.icr ** 2 * abs(W) * dt
        return moved

    def _move(self, x: array[float], moved: array[float], W: float, force_x: float,
              force_y: float, dt: float) -> float:
        """
        Write pose and velocity after ``dt`` to ``moved``; return the way of base_link [m].

        The Jacobian is without terms of second order in ``dt``.
        """
        F = self.F
        steady_x, steady_y = self.steady_force(x, W)
        a_x, a_y = force_x - steady_x, force_y - steady_y
        x_imu, y_imu = self._x_imu + x[IMU_X], self._y_imu + x[IMU_Y]
        b_x = x[V_X] + 0.5 * a_x * dt + y_imu * W  # m/s, of base_link
        b_y = x[V_Y] + 0.5 * a_y * dt - x_imu * W
        c, s = cos(x[YAW] + 0.5 * W * dt), sin(x[YAW] + 0.5 * W * dt)
        moved[X] += (c * b_x - s * b_y) * dt
        moved[Y] += (s * b_x + c * b_y) * dt
        moved[YAW] += W * dt
        moved[V_X] += a_x * dt
        moved[V_Y] += a_y * dt
        F[X, YAW], F[Y, YAW] = (-s * b_x - c * b_y) * dt, (c * b_x - s * b_y) * dt
        F[X, V_X], F[Y, V_X] = c * dt, s * dt
        F[X, V_Y], F[Y, V_Y] = -s * dt, c * dt
        F[X, GYRO_BIAS_Z] = (-c * y_imu - s * x_imu) * dt
        F[Y, GYRO_BIAS_Z] = (-s * y_imu + c * x_imu) * dt
        F[X, IMU_X], F[Y, IMU_X] = s * W * dt, -c * W * dt
        F[X, IMU_Y], F[Y, IMU_Y] = c * W * dt, s * W * dt
        F[YAW, GYRO_BIAS_Z], F[V_X, ACCEL_BIAS_X], F[V_Y, ACCEL_BIAS_Y] = -dt, -dt, -dt
        F[V_X, V_Y], F[V_Y, V_X] = W * dt, -W * dt
        F[V_X, GYRO_BIAS_Z], F[V_Y, GYRO_BIAS_Z] = -x[V_Y] * dt, x[V_X] * dt
        F[V_X, PITCH], F[V_Y, ROLL] = GRAVITY * dt, -GRAVITY * dt
        return sqrt(b_x * b_x + b_y * b_y) * dt

    def _predict_slope(self, x: array[float], moved: array[float], W: float, dt: float,
                       way: float, row: cython.int, sigma: float) -> None:
        """Predict roll or pitch: fixed to the ground, a Gauss-Markov process along the path."""
        other, keep = ROLL + PITCH - row, exp(-way / SLOPE_LENGTH)
        turn = W * dt if row == ROLL else -W * dt
        moved[row] = keep * (x[row] + turn * x[other])
        self.F[row, row], self.F[row, other] = keep, keep * turn
        self.Q[row, row] = sigma * sigma * (1.0 - keep * keep)

    def _predict_slip(self, x: array[float], moved: array[float], begin_rate: float,
                      end_rate: float, W: float, dt: float, noise: Noise) -> None:
        """Predict slip velocities and travels of both sides."""
        F, Q = self.F, self.Q
        decay = exp(-dt / SLIP_CORRELATION_TIME)
        speed = slip_speed(self.rolling_rate(x, W, 0), self.rolling_rate(x, W, 1))
        innovation = (1.0 - decay * decay) * speed * speed
        common: cython.double = innovation * noise.slip_common ** 2
        difference: cython.double = innovation * noise.slip_difference ** 2
        gain = 0.0  # rad/s, of the slip by an ICR; at rest the yaw rate is noise
        if speed > MIN_SLIP_SPEED:
            gain = end_rate - x[GYRO_BIAS_Z] - decay * (begin_rate - x[GYRO_BIAS_Z])
        for side in range(2):
            slip, icr, travel = SLIP_VEL_L + side, ICR_L + side, TRAVEL_L + side
            sign = 2.0 * side - 1.0
            moved[slip] = decay * x[slip] + sign * gain * x[icr]
            moved[travel] += dt * (self.rolling_rate(x, W, side) + 0.5 * (
                moved[V_X] - x[V_X] + moved[slip] - x[slip]))
            F[slip, slip], F[slip, icr] = decay, sign * gain
            F[slip, GYRO_BIAS_Z] = -sign * (1.0 - decay) * x[icr] * (gain != 0.0)
            F[travel, slip] = F[travel, V_X] = dt
            F[travel, GYRO_BIAS_Z] = -(self._arms[side] + x[IMU_Y]) * dt
            F[travel, IMU_Y] = W * dt
            Q[slip, slip] = common + difference
        Q[SLIP_VEL_L, SLIP_VEL_R] = Q[SLIP_VEL_R, SLIP_VEL_L] = common - difference


def fill_covariances(P: Array, W: float, x_imu: float, y_imu: float, pose: array[float],
                     twist: array[float]) -> None:
    """
    Write the covariance of pose and twist of base_link into those of ROS, each 36 numbers.

    ``P`` is that of at least the estimated states, (x_imu, y_imu) [m] the position of the IMU and
    W [rad/s] the yaw rate.
    """
    poses: cython.int[5] = [X, Y, ROLL, PITCH, YAW]
    pose_rows: cython.int[5] = [0, 1, 3, 4, 5]
    # the twist is linear in the states: three of them for each of v_x and v_y, one for the rate
    states: cython.int[9] = [V_X, GYRO_BIAS_Z, IMU_Y, V_Y, GYRO_BIAS_Z, IMU_X,
                             GYRO_BIAS_Z, GYRO_BIAS_Z, GYRO_BIAS_Z]
    T: cython.double[9] = [1.0, -y_imu, W, 1.0, x_imu, -W, -1.0, 0.0, 0.0]
    twist_rows: cython.int[3] = [0, 1, 5]
    for i in range(5):
        for j in range(5):
            pose[6 * pose_rows[i] + pose_rows[j]] = P[poses[i], poses[j]]
    for i in range(3):
        for j in range(i + 1):
            total = 0.0
            for k in range(3 * i, 3 * i + 3):
                for m in range(3 * j, 3 * j + 3):
                    total += T[k] * P[states[k], states[m]] * T[m]
            twist[6 * twist_rows[i] + twist_rows[j]] = total
            twist[6 * twist_rows[j] + twist_rows[i]] = total
