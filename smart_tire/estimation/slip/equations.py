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

# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True, infer_types=True, show_performance_hints=False

"""
Equations of the slip filter: motion, balance of forces, covariance and outputs.

The motion is driven by the IMU, B(5), with the slip of both sides about their ICRs. A side yaws
about its instantaneous center of rotation (Pentzer): its slip velocity is the yaw rate times the
distance ``ICR_L``, ``ICR_R`` of that center beyond the wheels. The rest of the slip is a
first-order Gauss-Markov process, common to both sides and different.

The forces of the ground minus the rolling resistance equal mass times specific force at the center
of mass: the slope cancels. Tire forces are B(17) to B(22) with a stiffness of its own sideways::

    s = (r w - v_x, -k v_y) / |r w|,  F = C_x s g(t),  t = C_x |s| / (3 mu F_z)
    g = 1 - t + t^2 / 3 for t < 1, above 1 / (3 t)

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler. Without one,
numpy takes the place of loops over the covariance. States are ``array('d')``: fast to index in
Python, and memory that C and numpy share.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.state import ImuReading, ImuStep, N, State
from smart_tire.models import constants
from smart_tire.models.vehicle.skid_steer import AXLE_SIGNS, SIDE_SIGNS
from smart_tire.parameters import RobotParams
from smart_tire.samples import Four

try:
    import cython
except ImportError:  # as plain Python, without Cython: decorators that do nothing
    cython = SimpleNamespace(
        compiled=False, double=float, int=int, cclass=lambda c: c, cfunc=lambda f: f,
        ccall=lambda f: f, declare=lambda *_, **__: None)

if cython.compiled:
    from cython.cimports.libc.math import copysign, cos, exp, sin, sqrt
else:
    from math import copysign, cos, exp, sin, sqrt

COMPILED: bool = cython.compiled
LOOPS = COMPILED  # over the covariance; as Python they would take milliseconds

# constants and rows of the state that are numbers of C
cython.declare(
    GRAVITY=cython.double, SPEED_RANDOM_WALK=cython.double, GYRO_BIAS_RANDOM_WALK=cython.double,
    ACCEL_BIAS_RANDOM_WALK=cython.double, SLOPE_LENGTH=cython.double,
    MIN_SLIP_SPEED=cython.double, SLIP_FLOOR=cython.double, MIN_RESISTED_SPEED=cython.double,
    SQRT_3=cython.double,
    X=cython.int, Y=cython.int, YAW=cython.int, ROLL=cython.int, PITCH=cython.int,
    V_X=cython.int, V_Y=cython.int, GYRO_BIAS_Z=cython.int, ACCEL_BIAS_X=cython.int,
    ACCEL_BIAS_Y=cython.int, SLIP_VEL_L=cython.int, SLIP_VEL_R=cython.int, TRAVEL_L=cython.int,
    TRAVEL_R=cython.int, ICR_X=cython.int, ICR_L=cython.int, ICR_R=cython.int, IMU_X=cython.int,
    LN_STIFFNESS=cython.int, LN_FRICTION=cython.int, RESISTANCE=cython.int,
    LATERAL_SHARE=cython.int, LN_LATERAL=cython.int, COM_X=cython.int, COM_Y=cython.int)
GRAVITY = constants.GRAVITY
SPEED_RANDOM_WALK = 0.002      # m/s per sqrt(s), errors of the planar model; assumed
GYRO_BIAS_RANDOM_WALK = 2e-5   # rad/s per sqrt(s): 10 degrees per hour after five minutes
ACCEL_BIAS_RANDOM_WALK = 5e-4  # m/s2 per sqrt(s), data sheets of industrial IMUs
SLIP_CORRELATION_TIME = 1.0    # s, of the slip beyond the ICR kinematics; assumed
SLOPE_LENGTH = 2.0             # m, correlation length of the slope; some robot lengths
MIN_SLIP_SPEED = 0.1           # m/s, below which the noise of slip velocities is constant
SLIP_FLOOR = 0.05              # m/s, smallest denominator of a slip
MIN_RESISTED_SPEED = 0.02      # m/s, below which rolling resistance is proportional to the speed
SQRT_3 = 3.0 ** 0.5             # of the points of a Gauss-Hermite quadrature
OUTLIER_SIGMAS = 3.0  # beyond, the variance of an innovation grows with its square; Huber's share

(X, Y, YAW, ROLL, PITCH, V_X, V_Y, GYRO_BIAS_Z, ACCEL_BIAS_X, ACCEL_BIAS_Y, SLIP_VEL_L,
 SLIP_VEL_R, TRAVEL_L, TRAVEL_R, ICR_X, ICR_L, ICR_R, _, IMU_X, LN_STIFFNESS, LN_FRICTION,
 RESISTANCE, LATERAL_SHARE, LN_LATERAL, COM_X, COM_Y) = map(int, State)


class Noise(NamedTuple):
    """Learned noise levels."""

    slope: tuple[float, float]  # rad, of roll and pitch
    slip_common: float       # -, of the slip of both sides
    slip_difference: float   # -, of half the difference
    icr: float               # m per sqrt(m), random walk of ICR_L, ICR_R
    icr_x: float             # m per sqrt(m), of ICR_X


@cython.ccall
def slip_speed(left: cython.double, right: cython.double) -> cython.double:
    """Return the speed [m/s] that slip ratios refer to, from r w of both sides."""
    return max(0.5 * (abs(left) + abs(right)), MIN_SLIP_SPEED)


@cython.ccall
def wheel_slip_ratio(rolling: cython.double, ground: cython.double,
                     standstill_speed: cython.double) -> cython.double:
    """
    Return ``skid_steer.slip_ratio`` of one wheel from numbers.

    >>> print(f'{wheel_slip_ratio(-1.0, -0.9, 0.05):.2f}')
    0.10
    """
    if abs(rolling) < standstill_speed:
        if abs(ground) < standstill_speed:
            return np.nan
        if rolling * ground <= 0.0:
            return -1.0
    return min(max(1.0 - ground / rolling, -1.0), 1.0)


@cython.cclass
class MotionModel:
    """Motion of the state ``x`` (N numbers) over ``dt`` [s]."""

    arms = cython.declare(list, visibility='readonly')  # m, v_x of the sides by the yaw rate
    _arms: cython.double[2]
    _x_imu: cython.double
    _y_imu: cython.double
    _jacobian: Array
    _noise: Array
    _F: cython.double[:, ::1]  # the same memory
    _Q: cython.double[:, ::1]

    def __init__(self, robot: RobotParams) -> None:
        self._x_imu, self._y_imu = robot.imu.position[:2]
        self.arms = [self._y_imu + sign * 0.5 * robot.track_width for sign in (-1.0, 1.0)]
        self._arms = self.arms
        self._jacobian, self._noise = np.eye(N), np.zeros((N, N))
        self._F, self._Q = self._jacobian, self._noise

    @cython.cfunc
    def _rolling_rate(self, x: cython.double[::1], W: cython.double, side: cython.int
                      ) -> cython.double:
        """Return r w [m/s] of the left (0) or right (1) side."""
        return x[V_X] + self._arms[side] * W + x[SLIP_VEL_L + side]

    def rolling_rates(self, x: cython.double[::1], W: cython.double) -> list[float]:
        """Return r w [m/s] of both sides."""
        return [self._rolling_rate(x, W, 0), self._rolling_rate(x, W, 1)]

    def icr_slip(self, x: cython.double[::1], W: cython.double) -> list[float]:
        """Return the slip velocities [m/s] of the ICR kinematics at the yaw rate [rad/s]."""
        return [-x[ICR_L] * W, x[ICR_R] * W]

    @cython.ccall
    def steady_force(self, x: cython.double[::1], W: cython.double
                     ) -> tuple[cython.double, cython.double]:
        """Return the specific force [m/s2] x, y that the IMU measures at constant velocity."""
        return (x[ACCEL_BIAS_X] - W * x[V_Y] - GRAVITY * x[PITCH],
                x[ACCEL_BIAS_Y] + W * x[V_X] + GRAVITY * x[ROLL])

    def extrapolate(self, x: array[float], imu: ImuReading, dt: cython.double) -> array[float]:
        """Return the state after a short ``dt`` at the present acceleration."""
        moved = x[:]
        W: cython.double = imu.yaw_rate - moved[GYRO_BIAS_Z]
        self._move(x, moved, W, imu.force_x, imu.force_y, dt)
        return moved

    def wheel_slips(self, x: cython.double[::1], P: cython.double[:, :], W: cython.double,
                    residual: Four, hidden: Four, standstill_speed: cython.double
                    ) -> list[tuple[float, float, float]]:
        """
        Return slip ratio, slip velocity [m/s] and standard deviation of the ratio of each wheel.

        ``residual`` [m/s] is r w of the wheels beyond that of their sides, ``hidden`` NaN for
        those that are not measured and 0 for others.
        """
        slips = []
        for i in range(4):
            side_speed: cython.double = self._rolling_rate(x, W, i % 2)
            ground: cython.double = side_speed - x[SLIP_VEL_L + i % 2]
            rolling: cython.double = side_speed + residual[i] + hidden[i]
            ratio: cython.double = wheel_slip_ratio(rolling, ground, standstill_speed)
            slips.append((ratio, rolling - ground,
                          self._slip_sigma(x, P, W, i % 2) if ratio == ratio else 1.0))
        return slips

    @cython.cfunc
    def _slip_sigma(self, x: cython.double[::1], P: cython.double[:, :], W: cython.double,
                    side: cython.int) -> cython.double:
        """
        Return the standard deviation [-] of the slip ratio of a side, at most 1.

        Slip ratio = slip velocity / u, with u = v + slip velocity.
        """
        slip, u = SLIP_VEL_L + side, self._rolling_rate(x, W, side)
        v, by_v = u - x[slip], -x[slip]
        speed_variance = P[V_X, V_X] - 2.0 * self._arms[side] * P[V_X, GYRO_BIAS_Z]
        variance = (v * v * P[slip, slip] + by_v * by_v * speed_variance
                    + 2.0 * v * by_v * P[slip, V_X])
        return min(1.0, sqrt(max(0.0, variance)) / max(u * u, 1e-9))

    def predict(self, x: array[float], step: ImuStep, noise: Noise
                ) -> tuple[array[float], Array, Array]:
        """Return the state after a step, its Jacobian and noise (N, N), to be used at once."""
        moved = x[:]
        old: cython.double[::1] = x
        new: cython.double[::1] = moved
        Q: cython.double[:, ::1] = self._Q
        dt: cython.double = step.dt
        yaw_rate, force_x, force_y = step.mean
        W: cython.double = yaw_rate - old[GYRO_BIAS_Z]
        way: cython.double = self._move(old, new, W, force_x, force_y, dt)
        roll_sigma, pitch_sigma = noise.slope
        self._predict_slope(old, new, W, dt, way, ROLL, roll_sigma)
        self._predict_slope(old, new, W, dt, way, PITCH, pitch_sigma)
        self._predict_slip(old, new, step.begin_rate, step.end_rate, W, dt, noise)
        gyro: cython.double = step.gyro_variance * dt
        speed: cython.double = step.accel_variance * dt + SPEED_RANDOM_WALK ** 2 * dt
        Q[YAW, YAW] = gyro
        Q[V_X, V_X] = speed + gyro * old[V_Y] * old[V_Y]
        Q[V_Y, V_Y] = speed + gyro * old[V_X] * old[V_X]
        Q[GYRO_BIAS_Z, GYRO_BIAS_Z] = GYRO_BIAS_RANDOM_WALK ** 2 * dt
        Q[ACCEL_BIAS_X, ACCEL_BIAS_X] = ACCEL_BIAS_RANDOM_WALK ** 2 * dt
        Q[ACCEL_BIAS_Y, ACCEL_BIAS_Y] = Q[ACCEL_BIAS_X, ACCEL_BIAS_X]
        Q[ICR_X, ICR_X] = noise.icr_x ** 2 * abs(W) * dt
        Q[ICR_L, ICR_L] = Q[ICR_R, ICR_R] = noise.icr ** 2 * abs(W) * dt
        return moved, self._jacobian, self._noise

    @cython.cfunc
    def _move(self, x: cython.double[::1], moved: cython.double[::1], W: cython.double,
              force_x: cython.double, force_y: cython.double, dt: cython.double) -> cython.double:
        """
        Write pose and velocity after ``dt`` to ``moved``; return the way of base_link [m].

        The Jacobian is without terms of second order in ``dt``.
        """
        F: cython.double[:, ::1] = self._F
        steady_x, steady_y = self.steady_force(x, W)
        a_x, a_y = force_x - steady_x, force_y - steady_y
        x_imu, y_imu = self._x_imu + x[IMU_X], self._y_imu
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
        F[YAW, GYRO_BIAS_Z] = F[V_X, ACCEL_BIAS_X] = F[V_Y, ACCEL_BIAS_Y] = -dt
        F[V_X, V_Y], F[V_Y, V_X] = W * dt, -W * dt
        F[V_X, GYRO_BIAS_Z], F[V_Y, GYRO_BIAS_Z] = -x[V_Y] * dt, x[V_X] * dt
        F[V_X, PITCH], F[V_Y, ROLL] = GRAVITY * dt, -GRAVITY * dt
        return sqrt(b_x * b_x + b_y * b_y) * dt

    @cython.cfunc
    def _predict_slope(self, x: cython.double[::1], moved: cython.double[::1], W: cython.double,
                       dt: cython.double, way: cython.double, row: cython.int,
                       sigma: cython.double) -> cython.void:
        """Predict roll or pitch: fixed to the ground, a Gauss-Markov process along the path."""
        other, keep = ROLL + PITCH - row, exp(-way / SLOPE_LENGTH)
        turn = W * dt if row == ROLL else -W * dt
        moved[row] = keep * (x[row] + turn * x[other])
        self._F[row, row], self._F[row, other] = keep, keep * turn
        self._Q[row, row] = sigma * sigma * (1.0 - keep * keep)

    @cython.cfunc
    def _predict_slip(self, x: cython.double[::1], moved: cython.double[::1],
                      begin_rate: cython.double, end_rate: cython.double, W: cython.double,
                      dt: cython.double, noise: Noise) -> cython.void:
        """Predict slip velocities and travels of both sides."""
        F: cython.double[:, ::1] = self._F
        Q: cython.double[:, ::1] = self._Q
        decay: cython.double = exp(-dt / SLIP_CORRELATION_TIME)
        speed = slip_speed(self._rolling_rate(x, W, 0), self._rolling_rate(x, W, 1))
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
            moved[travel] += dt * (self._rolling_rate(x, W, side) + 0.5 * (
                moved[V_X] - x[V_X] + moved[slip] - x[slip]))
            F[slip, slip], F[slip, icr] = decay, sign * gain
            F[slip, GYRO_BIAS_Z] = -sign * (1.0 - decay) * x[icr] * (gain != 0.0)
            F[travel, slip] = F[travel, V_X] = dt
            F[travel, GYRO_BIAS_Z] = -self._arms[side] * dt
            Q[slip, slip] = common + difference
        Q[SLIP_VEL_L, SLIP_VEL_R] = Q[SLIP_VEL_R, SLIP_VEL_L] = common - difference


@cython.ccall
def brush_force(s_x: cython.double, s_y: cython.double, stiffness: cython.double,
                limit: cython.double, spread: cython.double = 0.0) -> tuple[
                    cython.double, cython.double, cython.double, cython.double, cython.double,
                    cython.double, cython.double]:
    """
    Return the force of a brush tire with slip (s_x, s_y) [-] and stiffness [N], with derivatives.

    ``limit`` [N] is mu F_z. The numbers are the force [N] along x and y, its derivatives x by s_x,
    x by s_y (and y by s_x), y by s_y, and those of x and y by ln mu; the remaining part is linear
    in C_x. ``spread`` [-] is the standard deviation of the slip along itself: the force is that of
    a statistical linearization with three points, which beyond the limit is flat.

    >>> print(f'{brush_force(0.1, 0.0, 52.7, 0.47 * 26.7)[0]:.2f} N')
    4.60 N
    """
    square = max(s_x * s_x + s_y * s_y, 1e-18)
    size = sqrt(square)
    scale = stiffness / (3.0 * limit)
    t = scale * size
    slope, bend = stiffness * (1.0 - t + t * t / 3.0), stiffness * t * (t / 1.5 - 1.0)
    if t >= 1.0:
        slope, bend = stiffness / (3.0 * t), -stiffness / (3.0 * t)
    by_friction = -bend
    if size > spread > 0.0:
        low, high = (_saturation(t - scale * SQRT_3 * spread),
                     _saturation(t + scale * SQRT_3 * spread))
        slope = slope / 1.5 + limit * (low + high) / (6.0 * size)
        bend = limit * (high - low) / (2.0 * SQRT_3 * spread) - slope
    k = bend / square
    return (slope * s_x, slope * s_y, slope + k * s_x * s_x, k * s_x * s_y, slope + k * s_y * s_y,
            by_friction * s_x, by_friction * s_y)


@cython.cfunc
def _saturation(t: cython.double) -> cython.double:
    """Return the force over its limit at the normalized slip ``t``, odd in it."""
    t = max(-1.0, min(1.0, t))
    return t * (3.0 - 3.0 * abs(t) + t * t)


@cython.cclass
class TireForces:
    """Balance of forces at an IMU reading, on a given ground."""

    H = cython.declare(object, visibility='readonly')  # (2, N), Jacobian of the last forces
    _H: cython.double[:, ::1]  # the same memory
    _P: cython.double[:, ::1]  # covariance of the state
    _wheel_x: cython.double[4]
    _wheel_y: cython.double[4]
    _x_imu: cython.double
    _y_imu: cython.double
    _height: cython.double  # m, of the center of mass
    _mass: cython.double
    _wheelbase: cython.double
    _track: cython.double
    _stiffness: cython.double
    _friction: cython.double
    _resistance: cython.double
    _share: cython.double
    _ratio: cython.double
    _com_x: cython.double
    _com_y: cython.double

    def __init__(self, robot: RobotParams, P: Array) -> None:
        self.H = np.zeros((2, N))
        self._H, self._P = self.H, P
        self._wheel_x = (0.5 * robot.wheelbase * AXLE_SIGNS).tolist()
        self._wheel_y = (0.5 * robot.track_width * SIDE_SIGNS).tolist()
        self._x_imu, self._y_imu = robot.imu.position[:2]
        self._height = robot.center_of_mass[2] + robot.wheel_radius
        self._mass, self._wheelbase = robot.mass, robot.wheelbase
        self._track = robot.track_width

    def rolling_speeds(self, x: cython.double[::1], W: cython.double, residual: Four
                       ) -> list[float]:
        """Return r w [m/s] of the wheels from those of the sides; ``residual`` is the rest."""
        rolling = []
        for i in range(4):
            rolling.append(x[V_X] + (self._y_imu - self._wheel_y[i]) * W
                           + x[SLIP_VEL_L + i % 2] + residual[i])
        return rolling

    def set_ground(self, ground: Sequence[float]) -> None:
        """
        Set the ground.

        It is C_x [N], mu, rolling resistance, its lateral share, C_y / C_x, center of mass [m].
        """
        (self._stiffness, self._friction, self._resistance, self._share, self._ratio,
         self._com_x, self._com_y) = ground

    @cython.cfunc
    def _load(self, i: cython.int, a_x: cython.double, a_y: cython.double) -> cython.double:
        """Return the load [N] of a wheel at a specific force [m/s2]."""
        pitch = (GRAVITY * self._com_x - self._height * a_x) / self._wheelbase
        roll = (GRAVITY * self._com_y - self._height * a_y) / self._track
        return max(0.01, 0.25 * GRAVITY + 0.5 * pitch * copysign(1.0, self._wheel_x[i])
                   + 0.5 * roll * copysign(1.0, self._wheel_y[i])) * self._mass

    def loads(self, x: cython.double[::1], force_x: cython.double, force_y: cython.double
              ) -> list[float]:
        """Return the loads [N] of the wheels at a specific force [m/s2] as measured."""
        return [self._load(i, force_x - x[ACCEL_BIAS_X], force_y - x[ACCEL_BIAS_Y])
                for i in range(4)]

    def tractions(self, x: cython.double[::1], rolling: list[float], W: cython.double,
                  loads: list[float]) -> list[float]:
        """Return the forces [N] along x on the wheels of both sides; set their Jacobian."""
        H: cython.double[:, ::1] = self._H
        H[:, :] = 0.0
        forces = [0.0, 0.0]
        for i in range(4):
            side = i % 2
            roll: cython.double = rolling[i]
            inverse = 1.0 / max(abs(roll), SLIP_FLOOR)
            s_x = (roll - x[V_X] - (self._y_imu - self._wheel_y[i]) * W) * inverse
            s_y = -(x[V_Y] + (self._wheel_x[i] - self._x_imu) * W) * self._ratio * inverse
            f_x, _, xx, xy, _, x_by_friction, _ = self._tire(side, s_x, s_y, inverse, loads[i])
            by_rolling = inverse * (xx - copysign(1.0, roll) * (xx * s_x + xy * s_y))
            forces[side] += f_x
            H[side, SLIP_VEL_L + side] += by_rolling
            H[side, V_X] += by_rolling - xx * inverse
            H[side, V_Y] -= xy * self._ratio * inverse
            H[side, LN_STIFFNESS] += f_x - x_by_friction
            H[side, LN_FRICTION] += x_by_friction
        return forces

    def balance(self, x: cython.double[::1], rolling: list[float], W: cython.double,
                yaw_accel: cython.double, force_x: cython.double, force_y: cython.double
                ) -> tuple[float, float]:
        """Return model minus measurement [m/s2] along x and y, and set its Jacobian."""
        a_x, a_y = force_x - x[ACCEL_BIAS_X], force_y - x[ACCEL_BIAS_Y]
        arm_x, arm_y = self._com_x - self._x_imu, self._com_y - self._y_imu
        sum_x = -self._mass * (a_x - yaw_accel * arm_y - W * W * arm_x)
        sum_y = -self._mass * (a_y + yaw_accel * arm_x - W * W * arm_y)
        H: cython.double[:, ::1] = self._H
        H[:, :] = 0.0
        H[0, ACCEL_BIAS_X] = H[1, ACCEL_BIAS_Y] = 1.0
        H[0, COM_X] = H[1, COM_Y] = W * W
        H[0, COM_Y], H[1, COM_X] = yaw_accel, -yaw_accel
        for i in range(4):
            f_x, f_y = self._add_wheel(
                i % 2, rolling[i], self._load(i, a_x, a_y), x[V_X], x[V_Y], W,
                self._y_imu - self._wheel_y[i], self._wheel_x[i] - self._x_imu)
            sum_x += f_x
            sum_y += f_y
        return sum_x / self._mass, sum_y / self._mass

    @cython.cfunc
    def _tire(self, side: cython.int, s_x: cython.double, s_y: cython.double,
              inverse: cython.double, load: cython.double) -> tuple[
                  cython.double, cython.double, cython.double, cython.double, cython.double,
                  cython.double, cython.double]:
        """
        Return the force of a wheel as ``brush_force``, linearized over the error of its slip.

        ``inverse`` [s/m] is the slip by a velocity.
        """
        P: cython.double[:, ::1] = self._P
        slip, lateral = s_x * s_x * P[SLIP_VEL_L + side, SLIP_VEL_L + side], self._ratio * s_y
        spread = inverse * sqrt((slip + lateral * lateral * P[V_Y, V_Y]) / (
            s_x * s_x + s_y * s_y + 1e-18))
        return brush_force(s_x, s_y, self._stiffness, self._friction * load, spread)

    @cython.cfunc
    def _add_wheel(self, side: cython.int, rolling: cython.double, load: cython.double,
                   u: cython.double, v: cython.double, W: cython.double, arm_x: cython.double,
                   arm_y: cython.double) -> tuple[cython.double, cython.double]:
        """
        Return the force [N] on a wheel and add its derivatives to the Jacobian.

        Its velocity is that of the IMU (u, v) [m/s] plus the yaw rate W times its arms [m].
        """
        resistance, share = self._resistance, self._share
        v_x, v_y = u + arm_x * W, v + arm_y * W
        inverse = 1.0 / max(abs(rolling), SLIP_FLOOR)
        lateral = self._ratio * inverse
        s_x, s_y = (rolling - v_x) * inverse, -v_y * lateral
        f_x, f_y, xx, xy, yy, x_by_friction, y_by_friction = self._tire(
            side, s_x, s_y, inverse, load)
        speed = max(sqrt(v_x * v_x + v_y * v_y), MIN_RESISTED_SPEED)
        heading = max(-1.0, min(1.0, v_x / MIN_RESISTED_SPEED))
        along_x, along_y = load * v_x / speed, load * v_y / speed
        drag_x, drag_y = (1.0 - share) * load * heading + share * along_x, share * along_y
        # of the slip by r w at constant velocity; of the forces by r w, v_x and v_y
        sign = copysign(1.0, rolling)
        d_x, d_y = inverse * (1.0 - sign * s_x), -inverse * sign * s_y
        x_by_rolling, y_by_rolling = xx * d_x + xy * d_y, xy * d_x + yy * d_y
        x_by_u, y_by_u = x_by_rolling - xx * inverse, y_by_rolling - xy * inverse
        x_by_v, y_by_v = -xy * lateral, -yy * lateral - resistance * share * load / speed
        self._add(SLIP_VEL_L + side, x_by_rolling, y_by_rolling)
        self._add(V_X, x_by_u, y_by_u)
        self._add(V_Y, x_by_v, y_by_v)
        self._add(GYRO_BIAS_Z, -x_by_u * arm_x - x_by_v * arm_y, -y_by_u * arm_x - y_by_v * arm_y)
        self._add(LN_STIFFNESS, f_x - x_by_friction, f_y - y_by_friction)
        self._add(LN_FRICTION, x_by_friction, y_by_friction)
        self._add(RESISTANCE, -drag_x, -drag_y)
        self._add(LATERAL_SHARE, resistance * (load * heading - along_x), -resistance * along_y)
        self._add(LN_LATERAL, xy * s_y, yy * s_y)
        return f_x - resistance * drag_x, f_y - resistance * drag_y

    @cython.cfunc
    def _add(self, row: cython.int, x: cython.double, y: cython.double) -> cython.void:
        """Add derivatives of the forces [N] along x and y by a state to the Jacobian."""
        self._H[0, row] += x / self._mass
        self._H[1, row] += y / self._mass


@cython.cclass
class Correction:
    """
    Predictions and corrections of mean ``x`` (n,) and covariance ``P`` (n, n), in place.

    ``held`` (n,) is 1 for states that are considered, not corrected (Schmidt).
    """

    _x: cython.double[::1]
    _P: cython.double[:, ::1]
    _A: cython.double[:, ::1]
    _G: cython.double[:, ::1]  # rows: gains of two innovations, the part that is not applied
    ground = cython.declare(list, visibility='readonly')  # (3,), see ``correct``

    def __init__(self, x: array[float], P: Array) -> None:
        self._x, self._P = x, P
        self.ground = [0.0] * 3
        self._A, self._G = np.empty_like(P), np.empty((3, len(x)))

    def propagate(self, F: cython.double[:, ::1], Q: cython.double[:, ::1]) -> None:
        """Replace the covariance by F P F' + Q."""
        A: cython.double[:, ::1] = self._A
        P: cython.double[:, ::1] = self._P
        if not LOOPS:
            full = np.asarray(F) @ np.asarray(P) @ np.asarray(F).T + np.asarray(Q)
            np.asarray(P)[:] = 0.5 * (full + full.T)  # rounding errors would grow
            return
        A[:, :] = 0.0
        for i in range(P.shape[0]):
            for k in range(P.shape[0]):
                if F[i, k] != 0.0:
                    for j in range(P.shape[0]):
                        A[i, j] += F[i, k] * P[k, j]
        P[:, :] = Q
        for j in range(P.shape[0]):
            self._fill_column(F, j)

    @cython.cfunc
    def _fill_column(self, F: cython.double[:, ::1], j: cython.Py_ssize_t) -> cython.void:
        """Add (F P) F' to the lower half of a column of Q, and copy it to the row."""
        A: cython.double[:, ::1] = self._A
        P: cython.double[:, ::1] = self._P
        for k in range(P.shape[0]):
            if F[j, k] != 0.0:
                for i in range(j, P.shape[0]):
                    P[i, j] += F[j, k] * A[i, k]
        for i in range(j, P.shape[0]):
            P[j, i] = P[i, j]

    def correct(self, y: cython.double, h: cython.double[::1], variance: cython.double,
                held: cython.double[::1], shared: tuple[int, float] = (0, 0.0)) -> float:
        """
        Correct with an innovation ``y`` with Jacobian ``h`` (n,); return its variance.

        ``shared`` is a row and the covariance of its error with that of the measurement. An
        innovation beyond ``OUTLIER_SIGMAS`` counts less, the more the larger it is. Its
        covariances with ln C_x, ln mu and rolling resistance are in ``ground``.
        """
        row: cython.int = shared[0]
        covariance: cython.double = shared[1]
        g: cython.double[::1] = self._G[0]
        self._project(h, g)
        total = variance + _dot(h, g) + 2.0 * covariance * h[row]
        g[row] += covariance
        self.ground = [g[LN_STIFFNESS], g[LN_FRICTION], g[RESISTANCE]]
        self._apply(g, y, max(total, _least_variance(y)), held, False)
        return total

    def correct_jointly(self, y: cython.double[::1], H: cython.double[:, ::1],
                        R: cython.double[:, ::1], held: cython.double[::1],
                        slip_held: cython.bint) -> float:
        """
        Correct with two innovations ``y`` with Jacobian ``H`` (2, n); return the NIS over 2.

        First with one of them, then with what is new in the other. With ``slip_held`` the mean of
        both slips is considered, only their difference corrected.
        """
        g: cython.double[::1] = self._G[0]
        other: cython.double[::1] = self._G[1]
        first, both, second = self.covariance(H, R)
        first = max(first, _least_variance(y[0]))
        scale = 1.0 / sqrt(first)
        root = both * scale
        second = max(second, _least_variance(y[1])) - root * root
        share = root * scale
        new = y[1] - share * y[0]
        for i in range(g.shape[0]):
            other[i] -= share * g[i]
        self._apply(g, y[0], first, held, slip_held)
        self._apply(other, new, second, held, slip_held)
        return 0.5 * (y[0] * y[0] / first + new * new / second)

    @cython.ccall
    def covariance(self, H: cython.double[:, ::1], R: cython.double[:, ::1]
                   ) -> tuple[cython.double, cython.double, cython.double]:
        """Return variance, covariance and variance of two innovations: H P H' + R."""
        self._project(H[0], self._G[0])
        self._project(H[1], self._G[1])
        return (_dot(H[0], self._G[0]) + R[0, 0], _dot(H[0], self._G[1]) + R[0, 1],
                _dot(H[1], self._G[1]) + R[1, 1])

    @cython.cfunc
    def _project(self, h: cython.double[::1], out: cython.double[::1]) -> cython.void:
        """Set ``out`` to P h."""
        P: cython.double[:, ::1] = self._P
        if not LOOPS:
            np.matmul(P, h, out=np.asarray(out))
            return
        out[:] = 0.0
        for i in range(h.shape[0]):
            if h[i] != 0.0:
                for j in range(h.shape[0]):
                    out[j] += h[i] * P[i, j]

    @cython.cfunc
    def _apply(self, g: cython.double[::1], y: cython.double, variance: cython.double,
               held: cython.double[::1], slip_held: cython.bint) -> cython.void:
        """Correct with an innovation ``y`` whose covariance with the states is ``g``."""
        x: cython.double[::1] = self._x
        P: cython.double[:, ::1] = self._P
        d: cython.double[::1] = self._G[2]  # of g, the part that is not applied
        scale = 1.0 / sqrt(variance)
        for i in range(g.shape[0]):
            g[i] *= scale
            d[i] = held[i] * g[i]
        if slip_held:
            d[SLIP_VEL_L] = d[SLIP_VEL_R] = 0.5 * (g[SLIP_VEL_L] + g[SLIP_VEL_R])
        for i in range(g.shape[0]):
            x[i] += (g[i] - d[i]) * (y * scale)
        if not LOOPS:
            np.asarray(P)[:] -= np.outer(g, g) - np.outer(d, d)
            return
        for i in range(g.shape[0]):
            for j in range(g.shape[0]):
                P[i, j] -= g[i] * g[j] - d[i] * d[j]


@cython.cfunc
def _least_variance(y: cython.double) -> cython.double:
    """Return the least variance of an innovation: outliers count less, the larger they are."""
    return (y / OUTLIER_SIGMAS) * (y / OUTLIER_SIGMAS)


@cython.cfunc
def _dot(a: cython.double[::1], b: cython.double[::1]) -> cython.double:
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


def fill_covariances(P: cython.double[:, :], W: cython.double, x_imu: cython.double,
                     y_imu: cython.double, pose: cython.double[::1], twist: cython.double[::1]
                     ) -> None:
    """
    Write the covariance of pose and twist of base_link into those of ROS, each 36 numbers.

    ``P`` is that of at least the estimated states, (x_imu, y_imu) [m] the position of the IMU and
    W [rad/s] the yaw rate.
    """
    poses: cython.int[5] = [X, Y, ROLL, PITCH, YAW]
    pose_rows: cython.int[5] = [0, 1, 3, 4, 5]
    # the twist is linear in four states: T (3, 4)
    states: cython.int[4] = [V_X, V_Y, GYRO_BIAS_Z, IMU_X]
    T: cython.double[12] = [1.0, 0.0, -y_imu, 0.0, 0.0, 1.0, x_imu, -W, 0.0, 0.0, -1.0, 0.0]
    twist_rows: cython.int[3] = [0, 1, 5]
    for i in range(5):
        for j in range(5):
            pose[6 * pose_rows[i] + pose_rows[j]] = P[poses[i], poses[j]]
    for i in range(3):
        for j in range(i + 1):
            total = 0.0
            for k in range(4):
                for m in range(4):
                    total += T[4 * i + k] * P[states[k], states[m]] * T[4 * j + m]
            twist[6 * twist_rows[i] + twist_rows[j]] = total
            twist[6 * twist_rows[j] + twist_rows[i]] = total
