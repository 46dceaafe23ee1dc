# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wheel speed controller with command and feedback time-outs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

from smart_tire.control import constants as c
from smart_tire.control.history import time_step
from smart_tire.control.motor_response import error_of, MotorResponse
from smart_tire.control.slip_limits import TireLoad
from smart_tire.control.traction import TractionControl
from smart_tire.control.wheel_feedback import WheelFeedback
from smart_tire.control.wheel_servo import drive_model, DriveModel, Pid, SpeedReference
from smart_tire.parameters.control import WheelControllerParams
from smart_tire.samples import Four, four, NS_PER_S, STOPPED, VelocityCommand

UNMEASURED: Four = (math.nan,) * 4  # N m


def wheel_speeds(command: VelocityCommand, *, radius: float, effective_track: float) -> Four:
    """
    Return the wheel speeds [rad/s] of a body velocity without longitudinal slip, B(1).

    ``effective_track`` [m] is the track of the differential drive with the same yaw rate; a
    skid-steer robot slips while turning, so it is larger than the geometric track.

    >>> command = VelocityCommand(0, v_x=0.5, yaw_rate=1.0)
    >>> wheel_speeds(command, radius=0.1, effective_track=0.4)
    (3.0, 7.0, 3.0, 7.0)
    """
    difference = 0.5 * effective_track * command.yaw_rate
    left, right = (command.v_x - difference) / radius, (command.v_x + difference) / radius
    return left, right, left, right


class WheelServo:
    """Controller of the wheel with index ``wheel``; times are nanoseconds of one steady clock."""

    def __init__(self, wheel: int, params: WheelControllerParams) -> None:
        self._wheel = wheel
        self._params, self._model = params, drive_model(params.pid, params.robot)
        self._pid = Pid(params.pid)
        self.reset()

    def reset(self) -> None:
        """Set integral and output to zero; the next reference begins at the measured speed."""
        self._pid.reset()
        self._reference: SpeedReference | None = None
        self._input, self._direction = 0.0, 0.0
        self._holding = False

    def set_params(self, params: WheelControllerParams, model: DriveModel) -> None:
        """Use these parameters from now on; the duty does not jump."""
        change = (model.duty(self._input, self._direction)
                  - self._model.duty(self._input, self._direction))
        self._params, self._model = params, model
        self._pid.compensate(change)

    def step(self, set_point: float, feedback: WheelFeedback, dt: float, now_ns: int,
             response: MotorResponse, tire: TireLoad | None = None) -> float:
        """
        Return the duty [-1, 1] for a set point [rad/s], ``dt`` [s] after the latest step.

        ``tire`` is given for a set point at the limit of slip. A wheel at rest with a set point
        of zero is held: the integral of its speed is the angle by which it was turned. It begins
        at zero, so that dry friction alone holds a wheel on level ground.
        """
        latest = feedback.latest
        measured = latest.velocity[self._wheel] if latest else 0.0
        if set_point != 0.0:
            self._holding = False
        elif not self._holding and abs(measured) < c.STANDSTILL_WHEEL_SPEED:
            self.reset()
            self._holding = True
        params, reference = self._params, self._reference
        if reference is None:  # a rolling wheel is taken over at its speed
            reference = self._reference = SpeedReference(
                0.0 if self._holding else measured, now_ns)
        self._input = reference.advance(
            set_point, dt, now_ns, self._model,
            (params.max_wheel_acceleration, params.max_wheel_deceleration), tire)
        self._direction = reference.direction
        delay = feedback.delay(1.0 / params.rate) + response.delay
        limit = min(params.pid.limit, c.MAX_HOLD_DUTY if self._holding else 1.0)
        self._pid.set_params(replace(self._model.limited(params.pid, delay), limit=limit))
        feed_forward = self._model.duty(self._input, self._direction)
        error, follows = self._error(reference, feedback, response.delay), True
        if response.motors:
            motor = response.motors[self._wheel]
            follows = motor.missing * error <= 0.0
            if tire is None:  # else the tire slips: the wheel accelerates without the robot
                self._pid.unload(motor.inertial, motor.load, error_of(feed_forward))
        duty = self._pid.duty(feed_forward, error, feedback.slope(self._wheel), dt,
                              current=follows and feedback.is_current(now_ns))
        reference.limit_input(self._input - self._pid.excess / self._model.speed_gain)
        if not math.isfinite(duty):
            self.reset()
            return 0.0
        return duty

    def _error(self, reference: SpeedReference, feedback: WheelFeedback, delay: float) -> float:
        """Return the speed error [rad/s] of the latest readings, 0 without any."""
        mean = feedback.mean(self._wheel)
        if mean is None:
            return 0.0
        speed, begin_ns, end_ns = mean
        late_ns = round(delay * NS_PER_S)
        return reference.mean(begin_ns - late_ns, end_ns - late_ns) - speed


class WheelControl:
    """
    Speed control of the four wheels; all times are nanoseconds of one steady clock.

    The duty is zero without a command, without wheel speeds for ``wheel_states_timeout``, and
    while the emergency stop is engaged.
    """

    def __init__(self, params: WheelControllerParams) -> None:
        self._feedback, self._response = WheelFeedback(params.feedback_window), MotorResponse()
        self._servos = [WheelServo(wheel, params) for wheel in range(len(STOPPED))]
        self._stepped_ns: int | None = None
        self.traction = TractionControl(params.traction, params.robot)
        self.emergency_stop = False  # whether the emergency stop is engaged
        self.motors_enabled = True   # whether the duties reach the motors
        self.set_params(params)

    def set_params(self, params: WheelControllerParams) -> None:
        """Use these parameters from now on; the duties do not jump."""
        self._params = params
        self.traction.params = params.traction
        self._model = drive_model(params.pid, params.robot)
        for servo in self._servos:
            servo.set_params(params, self._model)

    def add_reading(self, velocity: Four, now_ns: int, stamp_ns: int = 0,
                    position: Four | None = None, effort: Four | None = None) -> None:
        """
        Set the wheel speeds [rad/s] received at ``now_ns``; those not finite are ignored.

        ``stamp_ns`` is their timestamp, of any clock, ``position`` the angles [rad], ``effort``
        the motor torques [N m] at that time.
        """
        self._feedback.add_reading(velocity, now_ns, stamp_ns, position)
        self._response.learn(effort or UNMEASURED, self._feedback, self._model)

    def discard_measurement(self) -> None:
        """Discard the measured wheel speeds; no duty until the next ones."""
        self._feedback.discard()

    def has_measurement(self, now_ns: int) -> bool:
        """Return whether the measured wheel speeds have not timed out."""
        latest = self._feedback.latest
        return latest is not None and (
            now_ns - latest.arrived_ns <= math.ceil(self._params.wheel_states_timeout * NS_PER_S))

    @property
    def reading_rate(self) -> float:
        """Return the rate of the measured wheel speeds [Hz], NaN before the second ones."""
        return 1.0 / self._feedback.period if self._feedback.period else math.nan

    @property
    def motor_delay(self) -> tuple[float, bool]:
        """
        Return the delay [s] from a duty to the torque, beyond that of the line, and if it is long.

        With gains for the delay of the readings alone, one as long as the latter would reduce the
        phase margin of the speed control from 61 to 33 degrees, and twice that would end it.
        """
        return self._response.delay, self._response.delay > self._feedback.delay(
            1.0 / self._params.rate)

    def follow(self, command: VelocityCommand | None, now_ns: int,
               stamp_ns: int | None = None) -> tuple[Four, Four]:
        """Return the result of ``step`` for a body velocity; None if there is no command."""
        velocity = None if command is None else wheel_speeds(
            command, radius=self._params.robot.wheel_radius,
            effective_track=self._params.effective_track)
        return self.step(velocity, now_ns, stamp_ns)

    def step(self, velocity: Sequence[float] | None, now_ns: int,
             stamp_ns: int | None = None) -> tuple[Four, Four]:
        """
        Return the set points of the wheel speeds [rad/s] and the duties [-1, 1].

        ``velocity`` [rad/s] are the commanded wheel speeds, None without a valid command; one that
        is not finite is none. If one exceeds ``max_wheel_speed``, all are scaled down by the same
        factor. While the motors are not enabled, the controllers are reset in every step, which
        prevents windup. ``stamp_ns`` is the time of the message clock; without it there is no
        traction control.
        """
        dt = time_step(now_ns, self._stepped_ns, self._params.rate)
        self._stepped_ns = now_ns
        driven = (velocity is not None and all(map(math.isfinite, velocity))
                  and not self.emergency_stop)
        set_points = self._limited(velocity) if velocity is not None and driven else STOPPED
        if driven and stamp_ns is not None and self._params.traction.enabled:
            set_points = self.traction.limit(set_points, stamp_ns, dt)
        else:
            self.traction.reset()
        duty = STOPPED
        if not (driven and self.has_measurement(now_ns) and self.motors_enabled):
            self.traction.reset()
            for servo in self._servos:
                servo.reset()
        if driven and self.has_measurement(now_ns):
            duty = four(
                servo.step(set_point, self._feedback, dt, now_ns, self._response, tire)
                for servo, set_point, tire in zip(self._servos, set_points, self.traction.tires))
        self._response.command(duty if self.motors_enabled else STOPPED, now_ns)
        return set_points, duty

    def _limited(self, velocity: Sequence[float]) -> Four:
        excess = max(max(map(abs, velocity)) / self._params.max_wheel_speed, 1.0)
        return four(speed / excess for speed in velocity)
