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
import math

from smart_tire.control.drive_model import drive_model
from smart_tire.control.duty_gate import STOPPED
from smart_tire.control.traction import TractionControl
from smart_tire.control.wheel_feedback import WheelFeedback
from smart_tire.control.wheel_servo import WheelServo
from smart_tire.parameters.control import WheelControllerParams
from smart_tire.samples import Four, NS_PER_S, VelocityCommand

MAX_STEP_PERIODS = 4    # upper limit of the time step of the controllers, in periods


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


class WheelControl:
    """
    Speed control of the four wheels; all times are nanoseconds of one steady clock.

    The duty is zero without a command, without wheel speeds for ``wheel_states_timeout``, and
    while the emergency stop is engaged.
    """

    def __init__(self, params: WheelControllerParams) -> None:
        self._feedback = WheelFeedback(params.feedback_window)
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
        model = drive_model(params.pid, params.robot)
        for servo in self._servos:
            servo.set_params(params, model)

    def add_reading(self, velocity: Four, now_ns: int, stamp_ns: int = 0,
                           position: Four | None = None) -> None:
        """
        Set the wheel speeds [rad/s] received at ``now_ns``; those not finite are ignored.

        ``stamp_ns`` is their timestamp, of any clock, ``position`` the angles [rad].
        """
        self._feedback.add_reading(velocity, now_ns, stamp_ns, position)

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

    def follow(self, command: VelocityCommand | None, now_ns: int,
               stamp_ns: int | None = None) -> tuple[Four, Four]:
        """Return the result of ``step`` for a body velocity; None if there is no command."""
        if command is None:
            return self.step(None, now_ns, stamp_ns)
        return self.step(
            wheel_speeds(command, radius=self._params.robot.wheel_radius,
                         effective_track=self._params.effective_track), now_ns, stamp_ns)

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
        dt = self._elapsed(now_ns)
        driven = (velocity is not None and all(map(math.isfinite, velocity))
                  and not self.emergency_stop)
        set_points = self._limited(velocity) if velocity is not None and driven else STOPPED
        if driven and stamp_ns is not None:
            set_points = self.traction.limit(set_points, stamp_ns, dt)
        else:
            self.traction.reset()
        if not driven or not self.has_measurement(now_ns):
            self._reset()
            return set_points, STOPPED
        if not self.motors_enabled:
            self._reset()
        a, b, c, d = (
            servo.step(set_point, self._feedback, dt, now_ns, tire)
            for servo, set_point, tire in zip(self._servos, set_points, self.traction.tires))
        return set_points, (a, b, c, d)

    def _reset(self) -> None:
        for servo in self._servos:
            servo.reset()
        self.traction.reset()

    def _limited(self, velocity: Sequence[float]) -> Four:
        excess = max(max(map(abs, velocity)) / self._params.max_wheel_speed, 1.0)
        a, b, c, d = (speed / excess for speed in velocity)
        return a, b, c, d

    def _elapsed(self, now_ns: int) -> float:
        period = 1.0 / self._params.rate
        before, self._stepped_ns = self._stepped_ns, now_ns
        if before is None or now_ns <= before:
            return period
        return min((now_ns - before) / NS_PER_S, MAX_STEP_PERIODS * period)
