# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Models of a wheel for the feed-forward: with its motor, and of its tire."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

from smart_tire.parameters.control import PidParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GRAVITY, WHEELS

# Of the wheel's own inertia, added by the derivative. With a delay the loop is stable below 1 for
# the true acceleration; readings give its mean of the past, with the noise of their timestamps.
MAX_DERIVATIVE_SHARE = 0.25
MIN_SPEED = 0.2  # rad/s, lower limit in the denominator of the slip


@dataclass(frozen=True)
class Gains:
    """Gains of the feedback: duty per speed error, its integral, and acceleration."""

    proportional: float  # s/rad
    integral: float      # 1/rad
    derivative: float    # s2/rad


@dataclass(frozen=True)
class DriveModel:
    """
    A wheel on the ground: a first-order lag with dry friction.

    ``J_eff dw/dt = T (d - w / w_0) - friction sign(w)`` for duty d, stall torque T and free speed
    w_0; J_eff is the inertia of the wheel and its share of the mass of the robot. A wheel that
    slips near the limit of friction has its own inertia and the torque r F_x of the tire instead.
    """

    speed_gain: float     # s/rad, duty per wheel speed
    friction: float       # duty that overcomes the dry friction
    time_constant: float  # s, of the wheel speed on the ground
    acceleration: float   # share of the duty for accelerations, 0 to 1
    wheel_time_constant: float  # s, of a wheel with its own inertia only
    stall_torque: float   # N m, T

    def slipping(self) -> DriveModel:
        """Return the model of a wheel at the limit of friction."""
        return replace(self, time_constant=self.wheel_time_constant, acceleration=1.0)

    def slipping_deceleration(self, limit: float, torque: float) -> float:
        """
        Return the ``limit`` of deceleration [rad/s2] for a slipping wheel.

        A limit above the deceleration that the ``torque`` [N m] of the sliding tire gives to the
        robot is one of the torque of the motor: with its own inertia only, the wheel slows down
        faster. A lower limit is one of the robot. (Starts keep their limit: near standstill the
        slip depends on small errors of the speed.)
        """
        of_robot = self.load_speed(torque) / (self.time_constant - self.wheel_time_constant)
        return limit * (self.time_constant / self.wheel_time_constant) if limit > of_robot else (
            limit)

    def input_speed(self, before: float, after: float, dt: float) -> float:
        """
        Return the input [rad/s], as steady speed, for a change of the speed in ``dt`` [s].

        With a share of 1 the wheel reaches ``after`` at the end of the period; with 0 the input
        is ``after``, which the wheel follows with its time constant.
        """
        return before + (after - before) * (
            1.0 + self.acceleration * (1.0 / -math.expm1(-dt / self.time_constant) - 1.0))

    def load_speed(self, torque: float) -> float:
        """Return the input [rad/s] that makes up for a ``torque`` [N m] against the wheel."""
        return torque / (self.stall_torque * self.speed_gain)

    def duty(self, input_speed: float, direction: float) -> float:
        """Return the duty for an input, and for the friction in the ``direction`` -1, 0 or 1."""
        return self.speed_gain * input_speed + self.friction * direction

    def limited(self, pid: PidParams, delay: float) -> Gains:
        """
        Return the gains of ``pid``, reduced by one factor to those that ``delay`` [s] permits.

        Internal model control of a first-order lag with a delay, for a closed loop as fast as the
        delay: the proportional gain is at most ``time constant / (2 delay)``, the integral gain
        at most ``1 / (2 delay)``, both in units of ``speed_gain``. With a proportional gain below
        ``speed_gain`` the loop is stable for a wheel of any smaller inertia as well, such as a
        lifted one. The derivative gain acts as an inertia of the wheel, but later than its own.
        """
        fastest = self.speed_gain / (2.0 * delay)
        factor = min([1.0] + [most / gain for gain, most in (
            (pid.proportional, min(self.time_constant * fastest, self.speed_gain)),
            (pid.integral, fastest)) if gain > 0.0])
        wheel_inertia = self.wheel_time_constant * self.speed_gain  # s2/rad: over stall torque
        return Gains(factor * pid.proportional, factor * pid.integral,
                     min(factor * pid.derivative, MAX_DERIVATIVE_SHARE * wheel_inertia))


def drive_model(pid: PidParams, robot: RobotParams) -> DriveModel:
    """Return the model of a wheel that carries a quarter of the robot."""
    motor, radius, stall = robot.motor, robot.wheel_radius, pid.stall_torque
    mass = robot.mass / len(WHEELS)
    friction = motor.coulomb_friction + motor.axle_friction * radius * mass * GRAVITY
    speed_gain = pid.feed_forward + motor.viscous_friction / stall
    inertia = motor.inertia + mass * radius ** 2
    return DriveModel(speed_gain, friction / stall, inertia / (stall * speed_gain),
                      pid.acceleration, motor.inertia / (stall * speed_gain), stall)


@dataclass(frozen=True)
class TireLoad:
    """Ground under a wheel, as expected for the end of the control period."""

    speed: float          # rad/s, of the wheel if it rolled without slip
    torque: float         # N m, of the force on a sliding wheel: mu F_z r
    critical_slip: float  # -
    speed_sigma: float    # rad/s, standard deviation of ``speed``
    command: float        # rad/s, commanded wheel speed; the feed-forward does not leave it

    def slips(self, speed: float, set_point: float) -> bool:
        """Return whether a wheel at ``speed`` [rad/s] slips, in the direction of a set point."""
        return (speed - self.speed) * (set_point - self.speed) > 0.0

    def torque_at(self, speed: float) -> float:
        """
        Return the torque [N m] of the tire force against a wheel at ``speed`` [rad/s], B(22).

        >>> tire = TireLoad(9.0, torque=0.5, critical_slip=0.2, speed_sigma=0.0, command=20.0)
        >>> tire.torque_at(10.0)
        0.4375
        """
        return math.copysign(self.torque * self._force_share(speed), speed - self.speed)

    def with_share(self, speed: float, share: float) -> float:
        """
        Return the speed [rad/s] at which a wheel has a ``share`` of its force at ``speed``.

        >>> tire = TireLoad(9.0, torque=0.5, critical_slip=0.2, speed_sigma=0.1, command=20.0)
        >>> round(tire.torque_at(tire.with_share(10.0, 0.5)) / tire.torque_at(10.0), 9)
        0.5
        """
        if share == 1.0:
            return speed
        slip = self.critical_slip * (1.0 - (1.0 - share * self._force_share(speed)) ** (1.0 / 3.0))
        return self.speed / (1.0 - math.copysign(slip, (speed - self.speed) * self.speed))

    def slip_share(self, speed: float) -> float:
        """Return the slip of a wheel at ``speed`` [rad/s] over the critical slip, 0 or more."""
        return abs(speed - self.speed) / (
            max(abs(speed), MIN_SPEED) * self.critical_slip + self.speed_sigma)

    def _force_share(self, speed: float) -> float:
        """Return the force over that of a sliding wheel, 0 to 1."""
        return 1.0 - max(1.0 - self.slip_share(speed), 0.0) ** 3
