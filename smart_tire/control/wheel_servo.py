# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Speed control of one wheel: model of the drive, reference, feed-forward and PID feedback."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

from smart_tire.control import constants as c
from smart_tire.control.history import History
from smart_tire.control.slip_limits import TireLoad
from smart_tire.parameters.control import PidParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GRAVITY, NS_PER_S, WHEELS


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
    free_gain: float      # s/rad, duty per wheel speed without load, 1 / w_0

    @property
    def inertia(self) -> float:
        """Return J_eff [kg m2]."""
        return self.time_constant * self.stall_torque * self.speed_gain

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

    def limited(self, pid: PidParams, delay: float) -> PidParams:
        """
        Return ``pid`` with its gains reduced by one factor to those that ``delay`` [s] permits.

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
        return replace(pid, proportional=factor * pid.proportional, integral=factor * pid.integral,
                       derivative=min(factor * pid.derivative,
                                      c.MAX_DERIVATIVE_SHARE * wheel_inertia))


def drive_model(pid: PidParams, robot: RobotParams) -> DriveModel:
    """Return the model of a wheel that carries a quarter of the robot."""
    motor, radius, stall = robot.motor, robot.wheel_radius, pid.stall_torque
    mass = robot.mass / len(WHEELS)
    friction = motor.coulomb_friction + motor.axle_friction * radius * mass * GRAVITY
    speed_gain = pid.feed_forward + motor.viscous_friction / stall
    inertia = motor.inertia + mass * radius ** 2
    return DriveModel(speed_gain, friction / stall, inertia / (stall * speed_gain),
                      pid.acceleration, motor.inertia / (stall * speed_gain), stall,
                      pid.feed_forward)


class SpeedReference:
    """
    Ramps to the set point, and the speed which the wheel is expected to have on the way.

    The expected speed is that of the drive model for the feed-forward. Encoder readings are means
    over a period in the past: they are compared with the mean of the expected speed over the same
    period, so that the delay of the readings is no control error. Times are nanoseconds of one
    steady clock.
    """

    def __init__(self, velocity: float, now_ns: int) -> None:
        """Begin at rest or at a measured ``velocity`` [rad/s]."""
        self.velocity = velocity    # rad/s, now
        self._input = velocity      # rad/s, of the drive model until the next step, without load
        self._load, self._lag = 0.0, 1.0  # rad/s and s, of the latest step
        self._expected = velocity   # rad/s
        self._turned = History()    # rad, integral of the expected speed, also before
        for time_ns in (now_ns - NS_PER_S, now_ns):
            self._turned.add(time_ns, velocity * (time_ns - now_ns) / NS_PER_S)

    @property
    def direction(self) -> float:
        """Return the direction of the reference: -1, 0 or 1."""
        return math.copysign(1.0, self.velocity) if self.velocity else 0.0

    def advance(self, set_point: float, dt: float, now_ns: int, model: DriveModel,
                limits: tuple[float, float], tire: TireLoad | None = None) -> float:
        """
        Move towards the set point [rad/s]; return the input of ``model`` [rad/s] from now on.

        ``dt`` [s] is the length of a control period, ``limits`` are those of acceleration and
        deceleration [rad/s2]. With ``tire``, the set point is at the limit of slip: as soon as the
        wheel slips, it accelerates on its own, not with the robot. The input is then between
        zero, the commanded speed and the input without ``tire``: even a wheel that finds no
        friction at all does not leave the command.
        """
        self._expect(now_ns)
        before, self._load = self.velocity, 0.0
        self.velocity = _limited(before, set_point, dt, limits)
        if tire is not None:
            acceleration, deceleration = limits
            faster = _limited(before, set_point, dt, (
                acceleration, model.slipping_deceleration(deceleration, tire.torque)))
            if tire.slips(faster, set_point):
                bounds = 0.0, tire.command, model.input_speed(before, self.velocity, dt)
                self.velocity, model = faster, model.slipping()
                self._input, self._lag = model.input_speed(before, faster, dt), model.time_constant
                wanted = self._input + model.load_speed(tire.torque_at(faster))
                applied = min(max(wanted, min(bounds)), max(bounds))
                self._load = applied - self._input
                return applied
        self._input, self._lag = model.input_speed(before, self.velocity, dt), model.time_constant
        return self._input

    def limit_input(self, input_speed: float) -> None:
        """
        Set the input of the drive model [rad/s] that the limits of the duty leave.

        The expected speed then remains below the reference as that of the wheel does, and nothing
        is left to be made up for when the limit ends.
        """
        self._input = input_speed - self._load

    def mean(self, begin_ns: int, end_ns: int) -> float:
        """Return the mean of the expected speed [rad/s] in an interval of the past."""
        (begin,), (end,) = map(self._turned.at, (begin_ns, end_ns))
        return (end - begin) * NS_PER_S / (end_ns - begin_ns)

    def _expect(self, now_ns: int) -> None:
        """Advance the expected speed from the latest step to ``now_ns``."""
        last_ns, (angle,) = self._turned.times[-1], self._turned.latest
        if now_ns <= last_ns:
            return
        elapsed, lag = (now_ns - last_ns) / NS_PER_S, self._lag
        rest = (self._expected - self._input) * math.exp(-elapsed / lag)
        angle += self._input * elapsed + lag * (self._expected - self._input - rest)
        self._expected = self._input + rest
        self._turned.add(now_ns, angle)


def _limited(velocity: float, set_point: float, dt: float, limits: tuple[float, float]) -> float:
    """Return the speed [rad/s] after ``dt`` [s] from ``velocity`` towards ``set_point``."""
    acceleration, deceleration = limits
    if velocity * set_point < 0.0 or abs(set_point) < abs(velocity):
        target = set_point if velocity * set_point > 0.0 else 0.0
        braking = abs(target - velocity) / deceleration  # s
        if braking >= dt:
            return velocity + math.copysign(deceleration * dt, target - velocity)
        velocity, dt = target, dt - braking
    return velocity + max(min(set_point - velocity, acceleration * dt), -acceleration * dt)


class Pid:
    """
    Feedback of one wheel: duty [-1, 1] of the feed-forward, corrected by the speed error.

    The integral is a duty. Changes of the gains or of the feed-forward at run time change it such
    that the output remains; limits act at once.
    """

    def __init__(self, params: PidParams) -> None:
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Set integral and output to zero."""
        self._integral = 0.0
        self._output = 0.0
        self.excess = 0.0  # duty that the limits cut off
        self._error = self._slope = 0.0

    def set_params(self, params: PidParams) -> None:
        """Use these limits and gains from now on; the gains change nothing at once."""
        before = self._proportional_derivative(self._error, self._slope)
        self._params = params
        self._integral += before - self._proportional_derivative(self._error, self._slope)

    def compensate(self, change: float) -> None:
        """Make up for a ``change`` of the feed-forward duty by its parameters."""
        self._integral -= change

    def unload(self, inertial: float, load: float, error: float) -> None:
        """
        Take away what is left of a load that has ended.

        All are duties. While a torque beyond the ``error`` of the model accelerates the wheel in
        the direction of the integral, the latter is at most the ``load`` and the error. A load
        below zero is no load, but a wheel that slides, and accelerates without the robot.
        """
        sign = math.copysign(1.0, self._integral)
        if sign * inertial > error and sign * load > -error:
            self._integral = sign * min(abs(self._integral), sign * load + error)

    def duty(self, feed_forward: float, error: float, slope: float, dt: float, *,
             current: bool = True) -> float:
        """
        Return the duty after ``dt`` [s], within its limits of magnitude and rate.

        ``error`` [rad/s] is the speed error, ``slope`` [rad/s2] the measured acceleration: a step
        of the set point causes no spike of the derivative. Unless the error is ``current``, the
        integral is held. So it is while a limit is active and the error would increase the excess
        (conditional integration); it is at most what the other terms leave of the magnitude.
        """
        self._error, self._slope = error, slope
        partial = feed_forward + self._proportional_derivative(error, slope)
        integral = self._integral + (self._params.integral * error * dt if current else 0.0)
        output = self._limited(partial + integral, dt)
        if (partial + integral - output) * error > 0.0:
            integral = self._integral
        limit = self._params.limit
        self._integral = min(max(integral, min(-limit - partial, 0.0)), max(limit - partial, 0.0))
        self._output, self.excess = output, partial + self._integral - output
        return output

    def _proportional_derivative(self, error: float, slope: float) -> float:
        return self._params.proportional * error - self._params.derivative * slope

    def _limited(self, output: float, dt: float) -> float:
        step = self._params.rate_limit * dt
        output = min(max(output, self._output - step), self._output + step)
        return min(max(output, -self._params.limit), self._params.limit)
