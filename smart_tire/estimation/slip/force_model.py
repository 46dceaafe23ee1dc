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
Forces on the robot as measurements of the slip EKF: force balance, motor torques, adhesion ratio.

The wheels' forces by the brush model minus their rolling resistance equal mass times specific
force at the center of mass: the slope of the ground cancels. C_x, mu / C_x and the rolling
resistance of the ground are states, so no friction coefficient is assumed. The balance of moments
is not used: it does not depend on C_x, and the noise of the yaw acceleration would bias C_x.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.robust_ekf import Measurement
from smart_tire.estimation.slip.state import (
    DelayedSpeed, N, SLIP_VELS, State, TORQUE_OFFSETS)
from smart_tire.models.vehicle.drive import required_torque
from smart_tire.models.vehicle.skid_steer import AXLE_SIGNS, normal_loads, SIDE_SIGNS
from smart_tire.models.vehicle.tire_forces import wheel_forces, WheelForces
from smart_tire.parameters import RobotParams
from smart_tire.samples import Four
from smart_tire.uncertain import Uncertain

PRIOR_FRICTION = 0.45       # -, median of mu on unknown ground, as in estimation/friction
SLIP_FLOOR = 0.05           # m/s, smallest denominator of a slip
MIN_ROLLING_SPEED = 0.1     # m/s, of the slower side: the forces are not used below
MIN_DRAG_SPEED = 0.02       # m/s, below which rolling resistance is proportional to the speed
BALANCE_SIGMA = 0.05        # m/s2, of the specific force by the model, of a level contact patch
MODEL_ERROR_SHARE = 0.02    # of the sum of all tire forces, error of the brush model; assumed
TORQUE_SIGMA = 0.05         # N m, noise and ripple of one torque measurement; small robots
TORQUE_ERROR_SHARE = 0.02   # of a torque, error of the model
INERTIA_ERROR_SHARE = 0.3   # of the torque that accelerates a wheel, between wheel samples
SIGNIFICANT_SIGMAS = 2.0    # of a force that determines C_x
MAX_RATIO_SIGMA = 0.3       # of an adhesion ratio; above, it carries no information
MAX_NORMALIZED_SLIP = 0.95  # near full sliding the adhesion ratio is bounded, not measured
RATIO_ERROR_SHARE = 0.1     # of the normalized slip: slip that changes within a crossing


class Wheels(NamedTuple):
    """State of the four wheels; arrays (4,)."""

    rolling: Array  # m/s, r w
    v_x: Array      # m/s, of the wheel centers over ground
    v_y: Array      # m/s
    load: Array     # N
    forces: WheelForces


class ForceModel:
    """Predicted forces for a state ``x`` (N numbers), and the measurements that they allow."""

    def __init__(self, robot: RobotParams) -> None:
        self._robot = robot
        self._x = 0.5 * robot.wheelbase * AXLE_SIGNS
        self._y = 0.5 * robot.track_width * SIDE_SIGNS
        self._x_imu, self._y_imu = robot.imu.position[:2]
        self._com_x, self._com_y = (robot.center_of_mass[0] - self._x_imu,
                                    robot.center_of_mass[1] - self._y_imu)
        level, by_x, by_y = normal_loads(
            robot.mass, robot.center_of_mass, robot.wheelbase, robot.track_width,
            [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], radius=robot.wheel_radius)
        self._load, self._load_by_x, self._load_by_y = level, by_x - level, by_y - level
        self._prior_ratio = PRIOR_FRICTION / robot.tire.longitudinal_stiffness

    def wheels(self, x: Sequence[float], residual: Four) -> Wheels:
        """Return the wheels; ``residual`` [m/s] is the speed of each minus that of its side."""
        W = x[State.YAW_RATE]
        v_x = x[State.V_X] + (self._y_imu - self._y) * W
        v_y = x[State.V_Y] + (self._x - self._x_imu) * W
        rolling = v_x + np.array([x[State.SLIP_VEL_L], x[State.SLIP_VEL_R]] * 2) + residual
        load = self.loads(x)
        stiffness = self._robot.tire.longitudinal_stiffness * math.exp(x[State.LN_STIFFNESS])
        return Wheels(rolling, v_x, v_y, load, wheel_forces(
            rolling, v_x, v_y, load, stiffness, self._ratio(x), floor=SLIP_FLOOR))

    def loads(self, x: Sequence[float]) -> Array:
        """Return the wheel loads [N], (4,)."""
        load: Array = np.maximum(self._load + self._load_by_x * x[State.FORCE_X]
                                 + self._load_by_y * x[State.FORCE_Y], 0.0)
        return load

    def longitudinal_balance(self, x: Sequence[float], residual: Four) -> Measurement:
        """Return the balance of forces along x [N] as a measurement of zero."""
        z, expected, H, R = self._balance(x, residual)
        H = H[:1]
        H[:, State.LN_STIFFNESS] *= _significance(
            H[:, State.LN_STIFFNESS], BALANCE_SIGMA * self._robot.mass)
        return Measurement(z[:1], expected[:1], H, R[:1, :1])

    def lateral_balance(self, x: Sequence[float], residual: Four, speed: float) -> Measurement:
        """
        Return the balance of forces along y [N] as a measurement of zero.

        ``speed`` [m/s] is the lateral speed of base_link. A given lateral force determines only
        the product of C_x and that speed; the Jacobian by ln C_x is the one for which this holds.
        """
        z, expected, H, R = self._balance(x, residual)
        H = H[1:]
        H[0, State.LN_STIFFNESS] = speed * H[0, State.V_Y]
        return Measurement(z[1:], expected[1:], H, R[1:, 1:])

    def _balance(self, x: Sequence[float], residual: Four) -> Measurement:
        mass, W, W_dot = self._robot.mass, x[State.YAW_RATE], x[State.YAW_ACCEL]
        wheels = self.wheels(x, residual)
        f = wheels.forces
        per_speed = wheels.load / np.maximum(np.hypot(wheels.v_x, wheels.v_y), MIN_DRAG_SPEED)
        drag_x, drag_y = per_speed @ wheels.v_x, per_speed @ wheels.v_y
        a_x = x[State.FORCE_X] - W_dot * self._com_y - W * W * self._com_x
        a_y = x[State.FORCE_Y] + W_dot * self._com_x - W * W * self._com_y
        expected = np.array([f.x.sum() - x[State.DRAG] * drag_x - mass * a_x,
                             f.y.sum() - x[State.DRAG] * drag_y - mass * a_y])
        H = np.zeros((2, N))
        for row, first in zip(SLIP_VELS, (0, 1)):  # wheels 0 and 2 are on the left
            H[0, row] = f.x_by_rolling[first::2].sum()
            H[1, row] = f.y_by_rolling[first::2].sum()
        by_v_x = f.x_by_rolling + f.x_by_v_x, f.y_by_rolling + f.y_by_v_x
        arm_y, arm_x = self._y_imu - self._y, self._x - self._x_imu
        for i, (by_x, by_y, force, by_ratio) in enumerate((
                (by_v_x[0], f.x_by_v_y, f.x, f.x_by_log_ratio),
                (by_v_x[1], f.y_by_v_y, f.y, f.y_by_log_ratio))):
            H[i, State.V_X], H[i, State.V_Y] = by_x.sum(), by_y.sum()
            H[i, State.YAW_RATE] = by_x @ arm_y + by_y @ arm_x
            H[i, State.LN_STIFFNESS], H[i, State.LN_RATIO] = force.sum(), by_ratio.sum()
        H[:, State.DRAG] = -drag_x, -drag_y
        H[0, State.FORCE_X] = H[1, State.FORCE_Y] = -mass
        H[:, State.YAW_RATE] += 2.0 * mass * W * self._com_x, 2.0 * mass * W * self._com_y
        H[:, State.YAW_ACCEL] = mass * self._com_y, -mass * self._com_x
        variance = (BALANCE_SIGMA * mass) ** 2 + (
            MODEL_ERROR_SHARE * float(np.hypot(f.x, f.y).sum())) ** 2
        return Measurement(np.zeros(2), expected, H, variance * np.eye(2))

    def wheel_accelerations(self, x: Sequence[float]) -> Array:
        """Return the acceleration [m/s2] of the wheel centers over ground, (4,)."""
        acceleration: Array = (x[State.FORCE_X] + x[State.YAW_RATE] * x[State.V_Y]
                               + (self._y_imu - self._y) * x[State.YAW_ACCEL])
        return acceleration

    def torques(self, x: Sequence[float], torques: Four, residual: Four,
                acceleration_variance: Array) -> Measurement:
        """
        Return the measured motor ``torques`` [N m].

        ``acceleration_variance`` (4,) [(m/s2)^2] is that of the wheels' own acceleration: a torque
        is a momentary value, and the wheels follow each new command within milliseconds.
        """
        motor, r = self._robot.motor, self._robot.wheel_radius
        wheels = self.wheels(x, residual)
        f, gain = wheels.forces, math.exp(-x[State.TORQUE_SCALE])
        acceleration = self.wheel_accelerations(x) / r
        torque = required_torque(f.x, wheels.rolling / r, acceleration, wheels.load, motor, r)
        H = np.zeros((4, N))
        for i in range(4):
            H[i, SLIP_VELS[i % 2]] = r * f.x_by_rolling[i]
            H[i, State.TORQUE_OFFSET_FL + i] = 1.0 / gain
        H[:, State.V_X] = r * (f.x_by_rolling + f.x_by_v_x)
        H[:, State.V_Y] = r * f.x_by_v_y
        H[:, State.LN_STIFFNESS] = r * f.x * _significance(r * f.x, TORQUE_SIGMA)
        H[:, State.LN_RATIO] = r * f.x_by_log_ratio
        H[:, State.TORQUE_SCALE] = -torque
        H[:, State.FORCE_X] = motor.inertia / r
        H *= gain
        expected = gain * torque + np.array(x[TORQUE_OFFSETS])
        variance = (TORQUE_SIGMA ** 2 + (TORQUE_ERROR_SHARE * torque) ** 2
                    + (motor.inertia / r) ** 2 * acceleration_variance
                    + (INERTIA_ERROR_SHARE * motor.inertia * acceleration) ** 2)
        return Measurement(np.array(torques), expected, H, np.diag(variance))

    def adhesion(self, x: Sequence[float], wheel: int, ratio: Uncertain, slip: Uncertain,
                 then: DelayedSpeed) -> Measurement | None:
        """
        Return the normalized slip t = 1 - L_a / L of a wheel; None if it is not informative.

        ``ratio`` L_a / L and ``slip`` lambda are those of the films; t = |s| / (3 kappa F_z).
        They were measured at the time of ``then``.
        """
        t, sigma = 1.0 - ratio.value, ratio.sigma
        load, v_x = float(self.loads(x)[wheel]), then.speed
        v_y = x[State.V_Y] - then.lateral_change + float(self._x[wheel] - self._x_imu) * (
            then.gyro_z - x[State.GYRO_BIAS_Z])
        if not (0.0 < sigma < MAX_RATIO_SIGMA and t < MAX_NORMALIZED_SLIP and abs(slip.value) < 1.0
                and abs(v_x) > MIN_ROLLING_SPEED and load > 0.0):
            return None
        rolling = v_x / (1.0 - slip.value)
        total = max(math.hypot(slip.value, v_y / rolling), slip.sigma)
        scale = 1.0 / (3.0 * self._ratio(x) * load)
        expected, by_slip = scale * total, scale * slip.value / total
        H = np.zeros((1, N))
        H[0, State.LN_RATIO] = -expected
        H[0, State.V_Y] = scale * v_y / (rolling ** 2 * total)
        H[0, State.GYRO_BIAS_Z] = -float(self._x[wheel] - self._x_imu) * H[0, State.V_Y]
        variance = (sigma ** 2 + (by_slip * slip.sigma) ** 2
                    + (RATIO_ERROR_SHARE * expected) ** 2)
        return Measurement(np.array([t]), np.array([expected]), H, np.array([[variance]]))

    def _ratio(self, x: Sequence[float]) -> float:
        """Return mu / C_x [1/N]."""
        return self._prior_ratio * math.exp(x[State.LN_RATIO])


def _significance(force: Array, sigma: float) -> Array:
    """
    Return the share (0 to 1) of the Jacobian by ln C_x that is signal: it is the force itself.

    A force that is not larger than its noise does not determine C_x, but would bias it.
    """
    square = force * force
    share: Array = square / (square + (SIGNIFICANT_SIGMAS * sigma) ** 2)
    return share
