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
Output records of the slip estimator, and their continuous pose (REP-105).

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler.
"""

from __future__ import annotations

from array import array
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip import state
from smart_tire.estimation.slip.state import (
    common_slip, ImuReading, PLANAR_VARIANCE, State)
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.rotation import quaternion
from smart_tire.samples import Four, four, Icr, NAN, NS_PER_S, Odometry, WheelSlip

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.libc.math import cos, expm1, remainder, sin, sqrt
    from cython.cimports.smart_tire.estimation.slip.motion import fill_covariances, MotionModel
else:
    from math import cos, expm1, remainder, sin, sqrt
    from smart_tire.estimation.slip.motion import fill_covariances, MotionModel

COMPILED: bool = cython.compiled
EstimateRecord = Odometry | WheelSlip | Icr
Pose = tuple[float, float, float]  # x, y [m], yaw [rad]

# constants and rows of the state that are numbers of C
cython.declare(
    SECOND=cython.double, TURN=cython.double, AGREEMENT_SIGMAS=cython.double,
    CORRECTION_TIME=cython.double, MAX_CORRECTION_SPEED=cython.double,
    MIN_YAW_RATE=cython.double, X=cython.int, Y=cython.int, YAW=cython.int, ROLL=cython.int,
    PITCH=cython.int, V_X=cython.int, V_Y=cython.int, GYRO_BIAS_Z=cython.int,
    SLIP_VEL_L=cython.int, SLIP_VEL_R=cython.int, IMU_X=cython.int, IMU_Y=cython.int)
SECOND, TURN = float(NS_PER_S), math.tau
AGREEMENT_SIGMAS, CORRECTION_TIME = state.AGREEMENT_SIGMAS, state.CORRECTION_TIME
MAX_CORRECTION_SPEED, MIN_YAW_RATE = state.MAX_CORRECTION_SPEED, state.MIN_YAW_RATE
X, Y, YAW, ROLL, PITCH, V_X, V_Y, GYRO_BIAS_Z, SLIP_VEL_L, SLIP_VEL_R, IMU_X, IMU_Y = map(int, (
    State.X, State.Y, State.YAW, State.ROLL, State.PITCH, State.V_X, State.V_Y,
    State.GYRO_BIAS_Z, State.SLIP_VEL_L, State.SLIP_VEL_R, State.IMU_X, State.IMU_Y))


class OutputContext(NamedTuple):
    """Values needed for an output in addition to the state."""

    instant_ns: int       # of the output grid
    extrapolation: float  # s, from the time of the state to the instant
    imu: ImuReading       # last yaw rate, and forces without vibration
    rate_variance: float  # (rad/s)^2, of that yaw rate beyond the bias
    wheel_residual: Four  # m/s, speed of each wheel minus the mean of its side
    mean: ImuReading | None = None  # over the extrapolation; None: as ``imu``
    hidden: tuple[float, float] = 0.0, 0.0  # (m/s)^2, of slip along and across that nothing shows


@cython.cclass
class ContinuousPose:
    """
    Pose that follows the estimated one without steps (REP-105).

    A correction of the distance driven so far moves the estimated pose at once. This pose moves by
    the twist, and towards the estimated one within ``CORRECTION_TIME``, but so slowly that both
    agree: along each axis of the robot at most ``AGREEMENT_SIGMAS`` standard deviations of the
    twist, and not more than ``MAX_CORRECTION_SPEED``. At rest the twist is known to millimeters
    per second. The offset that is left adds to the error of the pose.
    """

    _started: cython.bint
    _stamp_ns: cython.longlong
    _x: cython.double
    _y: cython.double
    _yaw: cython.double
    _v_x: cython.double
    _v_y: cython.double
    _rate: cython.double

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Continue with the next estimated pose, as at the start."""
        self._started = False

    @cython.ccall
    def follow(self, stamp_ns: cython.longlong, wanted: Pose, twist: Pose,
               covariance: cython.double[::1], twist_covariance: cython.double[::1]) -> Pose:
        """
        Return the continuous pose at ``stamp_ns`` for the estimated one, ``wanted``.

        ``twist``: v_x, v_y [m/s], yaw rate [rad/s]. Its offset is added to the ``covariance`` of
        the estimated pose, both covariances in the order of ROS, 36 numbers.
        """
        x: cython.double = wanted[0]
        y: cython.double = wanted[1]
        yaw: cython.double = wanted[2]
        v_x: cython.double = twist[0]
        v_y: cython.double = twist[1]
        rate: cython.double = twist[2]
        if self._started:
            dt: cython.double = (stamp_ns - self._stamp_ns) / SECOND
            self._move(0.5 * (self._v_x + v_x) * dt, 0.5 * (self._v_y + v_y) * dt,
                       0.5 * (self._rate + rate) * dt)
            self._correct(x - self._x, y - self._y, remainder(yaw - self._yaw, TURN), dt,
                          twist_covariance)
            left: cython.double[3] = [
                x - self._x, y - self._y, remainder(yaw - self._yaw, TURN)]
            rows: cython.int[3] = [0, 1, 5]
            for i in range(3):
                for j in range(3):
                    covariance[6 * rows[i] + rows[j]] += left[i] * left[j]
        else:
            self._started, self._x, self._y, self._yaw = True, x, y, yaw
        self._stamp_ns, self._v_x, self._v_y, self._rate = stamp_ns, v_x, v_y, rate
        return self._x, self._y, self._yaw

    @cython.cfunc
    def _move(self, along: cython.double, across: cython.double, turn: cython.double
              ) -> cython.void:
        """Move by a motion in body axes, at its mean heading."""
        yaw = self._yaw + 0.5 * turn
        c, s = cos(yaw), sin(yaw)
        self._x += c * along - s * across
        self._y += s * along + c * across
        self._yaw += turn

    @cython.cfunc
    def _correct(self, dx: cython.double, dy: cython.double, turn: cython.double,
                 dt: cython.double, variances: cython.double[::1]) -> cython.void:
        """Make up for the part of the offset, in the axes of ``odom``, that ``dt`` [s] permits."""
        share = -expm1(-dt / CORRECTION_TIME)
        sigmas = AGREEMENT_SIGMAS * dt
        c, s = cos(self._yaw), sin(self._yaw)
        along = _limited(share * (c * dx + s * dy), sigmas * sqrt(variances[0]))
        across = _limited(share * (c * dy - s * dx), sigmas * sqrt(variances[7]))
        slower = min(1.0, MAX_CORRECTION_SPEED * dt / max(
            sqrt(along * along + across * across), 1e-9))
        self._move(slower * along, slower * across,
                   _limited(share * turn, sigmas * sqrt(variances[35])))


@cython.cfunc
def _limited(value: cython.double, limit: cython.double) -> cython.double:
    return limit if value > limit else -limit if value < -limit else value


@cython.cclass
class ScaleEffect:
    """
    Errors of the pose by an error of the scale of the gyroscope, which nothing shows.

    The error of the heading is the scale's times the angle turned. A state would need no
    correction, and all of its correlations are these.
    """

    variance: cython.double  # of the scale
    _started: cython.bint
    _x: cython.double
    _y: cython.double
    _yaw: cython.double
    _by: cython.double[3]  # derivatives of x, y [m] and yaw [rad]

    def __init__(self, sigma: float) -> None:
        self.variance = sigma * sigma
        self.reset()

    def reset(self) -> None:
        """Begin again at the next pose."""
        self._started, self._by = False, [0.0, 0.0, 0.0]

    @cython.ccall
    def add(self, x: cython.double, y: cython.double, yaw: cython.double,
            covariance: cython.double[::1]) -> None:
        """Follow the pose to x, y [m] and yaw [rad]; add its errors to its ``covariance`` (36)."""
        if self._started:
            turn: cython.double = remainder(yaw - self._yaw, TURN)
            mean: cython.double = self._by[2] + 0.5 * turn  # over the step
            self._by[0] -= mean * (y - self._y)
            self._by[1] += mean * (x - self._x)
            self._by[2] += turn
        self._started, self._x, self._y, self._yaw = True, x, y, yaw
        rows: cython.int[3] = [0, 1, 5]
        for i in range(3):
            for j in range(3):
                covariance[6 * rows[i] + rows[j]] += self.variance * (self._by[i] * self._by[j])


@cython.cclass
class SlipOutputBuilder:
    """Builds the output records of the slip estimator, with a continuous ``pose`` if given."""

    _motion: MotionModel
    _pose = cython.declare(ContinuousPose)
    _scale: ScaleEffect
    _unmeasured = cython.declare(object)
    _covariance = cython.declare(object)
    _rates = cython.declare(object)
    _x_imu: cython.double
    _y_imu: cython.double
    _standstill_speed: cython.double

    def __init__(self, params: SlipEstimatorParams, pose: ContinuousPose | None = None) -> None:
        self._standstill_speed = params.robot.slip.standstill_speed
        self._unmeasured = four([
            0.0 if one else NAN for one in params.robot.joints.measured])
        self._motion, self._pose = MotionModel(params.robot), pose
        self._scale = ScaleEffect(params.robot.imu.gyro_scale_sigma)
        self._x_imu, self._y_imu = params.robot.imu.position[:2]
        # of pose and twist in the order of ROS; the planar part is overwritten
        self._covariance, self._rates = (
            array('d', np.ravel(PLANAR_VARIANCE * np.eye(6))) for _ in range(2))

    def reset_pose(self) -> None:
        """Continue with the next estimated pose, as at the start."""
        self._scale.reset()
        if self._pose is not None:
            self._pose.reset()

    def build(self, context: OutputContext, x: array[float], P: Array) -> list[EstimateRecord]:
        """Return the records for at least the estimated states ``x`` with covariance ``P``."""
        imu, stamp_ns = context.imu, context.instant_ns
        along, across = context.hidden
        if along or across:
            P = P + along * common_slip(len(P))
            P[State.V_Y, State.V_Y] += across
        covariance: cython.double[:, :] = P
        moved = self._motion.extrapolate(x, context.mean or imu, context.extrapolation)
        now: cython.double[::1] = moved
        rate: cython.double = imu[0]
        W = rate - now[GYRO_BIAS_Z]
        x_imu: cython.double = self._x_imu + now[IMU_X]
        y_imu: cython.double = self._y_imu + now[IMU_Y]
        v_x: cython.double = now[V_X] + y_imu * W
        v_y: cython.double = now[V_Y] - x_imu * W
        errors: cython.double[::1] = self._covariance
        rates: cython.double[::1] = self._rates
        fill_covariances(covariance, W, x_imu, y_imu, errors, rates)
        rate_variance: cython.double = context.rate_variance
        rates[35] += rate_variance + self._scale.variance * W * W
        self._scale.add(now[X], now[Y], now[YAW], errors)
        pose = now[X], now[Y], now[YAW]
        if self._pose is not None:
            pose = self._pose.follow(stamp_ns, pose, (v_x, v_y, W), errors, rates)
        records: list[EstimateRecord] = [
            Odometry(stamp_ns, (pose[0], pose[1], 0.0),
                     quaternion(now[ROLL], now[PITCH], pose[2]), (v_x, v_y, 0.0), (0.0, 0.0, W),
                     tuple(self._covariance), tuple(self._rates)),
            WheelSlip(stamp_ns, *self._motion.wheel_slips(
                now, covariance, W, context.wheel_residual, self._unmeasured,
                self._standstill_speed))]
        if abs(W) > MIN_YAW_RATE:
            records.append(Icr(stamp_ns, -v_y / W, v_x / W))
        return records
