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
Tire forces on a given ground with their derivatives by the state of the slip filter.

The forces of the ground minus the rolling resistance equal mass times specific force at the center
of mass: the slope cancels. Tire forces are those of ``models/tire/brush_tire``.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler (types:
``tire_forces.pxd``).
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.state import N, State
from smart_tire.models.vehicle import skid_steer
from smart_tire.models.vehicle.drive import DRY_FRICTION_SPEED
from smart_tire.models.vehicle.skid_steer import AXLE_SIGNS, linear_loads, SIDE_SIGNS
from smart_tire.parameters import RobotParams
from smart_tire.samples import Four

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.libc.math import copysign, sqrt
    from cython.cimports.smart_tire.models.tire.brush_tire import force_with_derivatives
else:
    from math import copysign, sqrt
    from smart_tire.models.tire.brush_tire import force_with_derivatives

COMPILED: bool = cython.compiled

INFINITY, SLIP_FLOOR, MIN_LOAD = np.inf, skid_steer.SLIP_FLOOR, skid_steer.MIN_LOAD
MIN_RESISTED_SPEED = DRY_FRICTION_SPEED  # below it, rolling resistance is linear, too
V_X, V_Y, GYRO_BIAS_Z, ACCEL_BIAS_X, ACCEL_BIAS_Y, SLIP_VEL_L, IMU_X, IMU_Y = map(int, (
    State.V_X, State.V_Y, State.GYRO_BIAS_Z, State.ACCEL_BIAS_X, State.ACCEL_BIAS_Y,
    State.SLIP_VEL_L, State.IMU_X, State.IMU_Y))
(LN_STIFFNESS, LN_FRICTION, RESISTANCE, LATERAL_SHARE, LN_LATERAL, COM_X, COM_Y) = map(
    int, list(State)[State.LN_STIFFNESS:])


class TireForces:
    """
    Balance of forces at an IMU reading, on a given ground.

    ``H`` (3, N) is the Jacobian of the last forces, without its last row; ``rolling`` [m/s] is r w
    of the wheels.
    """

    def __init__(self, robot: RobotParams, P: Array) -> None:
        self.H, self.rolling = np.zeros((3, N)), [0.0] * 4
        self._P, self._robot, self._mass = P, robot, robot.mass
        self._wheel_x = (0.5 * robot.wheelbase * AXLE_SIGNS).tolist()
        self._wheel_y = (0.5 * robot.track_width * SIDE_SIGNS).tolist()
        self._x_imu, self._y_imu = robot.imu.position[:2]
        self._com_x, self._com_y = robot.center_of_mass[:2]
        self._set_center(self._com_x, self._com_y)

    def roll(self, x: array[float], W: float, residual: Four) -> tuple[float, float]:
        """
        Set r w [m/s] of the wheels from those of the sides; ``residual`` is the rest.

        Return the least and the mean magnitude.
        """
        least, total = INFINITY, 0.0
        for i in range(4):
            rest: cython.double = residual[i]
            rolling = (x[V_X] + (self._y_imu + x[IMU_Y] - self._wheel_y[i]) * W
                       + x[SLIP_VEL_L + i % 2] + rest)
            self.rolling[i] = rolling
            least, total = min(least, abs(rolling)), total + abs(rolling)
        return least, 0.25 * total

    def set_ground(self, ground: Sequence[float]) -> None:
        """
        Set the ground.

        It is C_x [N], mu, rolling resistance, its lateral share, C_y / C_x, center of mass [m].
        """
        (self._stiffness, self._friction, self._resistance, self._share, self._lateral_ratio,
         com_x, com_y) = ground
        if (com_x, com_y) != (self._com_x, self._com_y):
            self._com_x, self._com_y = com_x, com_y
            self._set_center(com_x, com_y)

    def _set_center(self, com_x: float, com_y: float) -> None:
        """Set the wheel loads at rest and their derivatives by acceleration [kg]."""
        rest, by_x, by_y = linear_loads(
            self._robot, (com_x, com_y, self._robot.center_of_mass[2]))
        self._level, self._by_x, self._by_y = rest.tolist(), by_x.tolist(), by_y.tolist()

    def _arms(self, i: cython.int, x: array[float]) -> tuple[float, float]:
        """Return the derivatives [m] of v_x and v_y of a wheel by the yaw rate."""
        return (self._y_imu + x[IMU_Y] - self._wheel_y[i],
                self._wheel_x[i] - self._x_imu - x[IMU_X])

    def _load(self, i: cython.int, a_x: float, a_y: float) -> float:
        """Return the load [N] of a wheel at a specific force [m/s2]."""
        return max(MIN_LOAD, self._level[i] + self._by_x[i] * a_x + self._by_y[i] * a_y)

    def loads(self, x: array[float], force_x: float, force_y: float) -> list[float]:
        """Return the loads [N] of the wheels at a specific force [m/s2] as measured."""
        return [self._load(i, force_x - x[ACCEL_BIAS_X], force_y - x[ACCEL_BIAS_Y])
                for i in range(4)]

    def tractions(self, x: array[float], W: float, loads: Sequence[float]) -> list[float]:
        """Return the forces [N] along x on the wheels of both sides; set their Jacobian."""
        H = self.H
        H[:, :] = 0.0
        forces = [0.0, 0.0]
        self._scale, self._y_row = 1.0, 2
        for i in range(4):
            self._x_row = i % 2
            load: cython.double = loads[i]
            f_x, _ = self._add_tread(i, x, W, load)
            forces[i % 2] += f_x
        return forces

    def center_arm(self, x: array[float]) -> tuple[float, float]:
        """Return the position [m] of the center of mass from the IMU."""
        return (self._com_x - self._x_imu - x[IMU_X], self._com_y - self._y_imu - x[IMU_Y])

    def balance(self, x: array[float], W: float, yaw_accel: float, force_x: float,
                force_y: float) -> tuple[float, float]:
        """Return model minus measurement [m/s2] along x and y, and set its Jacobian."""
        a_x, a_y = force_x - x[ACCEL_BIAS_X], force_y - x[ACCEL_BIAS_Y]
        arm_x, arm_y = self.center_arm(x)
        sum_x = -self._mass * (a_x - yaw_accel * arm_y - W * W * arm_x)
        sum_y = -self._mass * (a_y + yaw_accel * arm_x - W * W * arm_y)
        H = self.H
        H[:, :] = 0.0
        H[0, ACCEL_BIAS_X] = H[1, ACCEL_BIAS_Y] = 1.0
        H[0, COM_X] = H[1, COM_Y] = W * W
        H[0, COM_Y], H[1, COM_X] = yaw_accel, -yaw_accel
        H[0, IMU_X] = H[1, IMU_Y] = -W * W
        H[0, IMU_Y], H[1, IMU_X] = -yaw_accel, yaw_accel
        self._scale, self._x_row, self._y_row = 1.0 / self._mass, 0, 1
        for i in range(4):
            load = self._load(i, a_x, a_y)
            f_x, f_y = self._add_tread(i, x, W, load)
            d_x, d_y = self._add_drag(i, x, W, load)
            sum_x += f_x - d_x
            sum_y += f_y - d_y
        return sum_x / self._mass, sum_y / self._mass

    def _add_tread(self, i: cython.int, x: array[float], W: float, load: float
                   ) -> tuple[float, float]:
        """Return the force [N] of the tread of a wheel and add its derivatives."""
        P, rolling = self._P, self.rolling[i]
        slip = SLIP_VEL_L + i % 2
        arm_x, arm_y = self._arms(i, x)
        v_x, v_y = x[V_X] + arm_x * W, x[V_Y] + arm_y * W
        inverse = 1.0 / max(abs(rolling), SLIP_FLOOR)
        lateral = self._lateral_ratio * inverse
        s_x, s_y = (rolling - v_x) * inverse, -v_y * lateral
        # standard deviation of the slip along itself
        side = self._lateral_ratio * s_y
        spread = inverse * sqrt((s_x * s_x * P[slip, slip] + side * side * P[V_Y, V_Y]) / (
            s_x * s_x + s_y * s_y + 1e-18))
        f_x, f_y, xx, xy, yy, x_by_friction, y_by_friction = force_with_derivatives(
            s_x, s_y, self._stiffness, self._friction * load, spread)
        # of the slip by r w at constant velocity; of the forces by r w, v_x and v_y
        sign = copysign(1.0, rolling)
        d_x, d_y = inverse * (1.0 - sign * s_x), -inverse * sign * s_y
        x_by_rolling, y_by_rolling = xx * d_x + xy * d_y, xy * d_x + yy * d_y
        self._add(slip, x_by_rolling, y_by_rolling)
        self._add_velocity(x_by_rolling - xx * inverse, y_by_rolling - xy * inverse,
                           -xy * lateral, -yy * lateral, arm_x, arm_y, W)
        self._add(LN_STIFFNESS, f_x - x_by_friction, f_y - y_by_friction)
        self._add(LN_FRICTION, x_by_friction, y_by_friction)
        self._add(LN_LATERAL, xy * s_y, yy * s_y)
        return f_x, f_y

    def _add_drag(self, i: cython.int, x: array[float], W: float, load: float
                  ) -> tuple[float, float]:
        """Return the rolling resistance [N] of a wheel and subtract its derivatives."""
        resistance, share = self._resistance, self._share
        arm_x, arm_y = self._arms(i, x)
        v_x, v_y = x[V_X] + arm_x * W, x[V_Y] + arm_y * W
        speed = max(sqrt(v_x * v_x + v_y * v_y), MIN_RESISTED_SPEED)
        heading = max(-1.0, min(1.0, v_x / MIN_RESISTED_SPEED))
        along_x, along_y = load * v_x / speed, load * v_y / speed
        drag_x, drag_y = (1.0 - share) * load * heading + share * along_x, share * along_y
        self._add_velocity(0.0, 0.0, 0.0, -resistance * share * load / speed, arm_x, arm_y, W)
        self._add(RESISTANCE, -drag_x, -drag_y)
        self._add(LATERAL_SHARE, resistance * (load * heading - along_x), -resistance * along_y)
        return resistance * drag_x, resistance * drag_y

    def _add_velocity(self, x_by_u: float, y_by_u: float, x_by_v: float, y_by_v: float,
                      arm_x: float, arm_y: float, W: float) -> None:
        """Add derivatives by the velocity of a wheel: that of the IMU plus yaw rate times arms."""
        self._add(V_X, x_by_u, y_by_u)
        self._add(V_Y, x_by_v, y_by_v)
        self._add(GYRO_BIAS_Z, -x_by_u * arm_x - x_by_v * arm_y, -y_by_u * arm_x - y_by_v * arm_y)
        self._add(IMU_X, -x_by_v * W, -y_by_v * W)
        self._add(IMU_Y, x_by_u * W, y_by_u * W)

    def _add(self, row: cython.int, x: float, y: float) -> None:
        """Add derivatives of the forces [N] along x and y by a state to the Jacobian."""
        self.H[self._x_row, row] += x * self._scale
        self.H[self._y_row, row] += y * self._scale
