# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Core of ``wheel_controller``: velocity commands and wheel speeds to duties, on any clock."""

from __future__ import annotations

from collections.abc import Callable

from smart_tire.control.command_check import VelocityMux
from smart_tire.control.wheel_control import WheelControl
from smart_tire.parameters.control import WheelControllerParams
from smart_tire.samples import MotorCommand, STOPPED, VelocityCommand, WheelCommand, WheelSample

DUTY_REPEAT_NS = 100_000_000  # after which a duty is sent again; time-out of motor_driver: longer


class WheelLoop:
    """
    Controls the wheel speeds for the velocity command in force, and publishes the duties.

    Call ``step`` at ``rate`` and ``check_expiry`` every ``TICK_PERIOD``, at any rate.
    ``steady_ns`` returns the time of time-outs, ``now_ns`` that of timestamps.
    """

    def __init__(self, params: WheelControllerParams,
                 publish_wheels: Callable[[WheelCommand], None],
                 publish_motors: Callable[[MotorCommand], None],
                 steady_ns: Callable[[], int], now_ns: Callable[[], int]) -> None:
        self._publish_wheels, self._publish_motors = publish_wheels, publish_motors
        self._steady_ns, self._now_ns = steady_ns, now_ns
        self.control = WheelControl(params)
        self._mux = VelocityMux(params.inputs())
        self._duty, self._sent_ns = STOPPED, 0

    def set_params(self, params: WheelControllerParams) -> None:
        """Use these parameters from now on; the inputs remain."""
        self.control.set_params(params)

    def selected(self) -> tuple[str, VelocityCommand] | None:
        """Return the input in force and its command; None if the robot must stop."""
        return self._mux.selected(self._steady_ns())

    def set_velocity(self, name: str, command: VelocityCommand, received_ns: int) -> None:
        """Set the command of the input ``name``, whose time-out counts from ``received_ns``."""
        self._mux.set_command(name, command, received_ns)

    def set_velocity_conflict(self, name: str, reason: str) -> None:
        """Block the input ``name`` while ``reason`` is not empty."""
        if reason:
            self._mux.block(name)
            self.check_expiry()
        else:
            self._mux.unblock(name)

    def add_wheels(self, sample: WheelSample, received_ns: int) -> None:
        """Add a reading of the wheels."""
        self.control.add_reading(sample.velocity, received_ns, sample.stamp_ns, sample.position,
                                 sample.effort)

    def set_wheel_conflict(self, reason: str) -> None:
        """Stop the motors if several nodes publish readings."""
        if reason:
            self.control.discard_measurement()
            self.step()

    def set_emergency_stop(self, engaged: bool) -> None:
        """Stop the motors; after the release, a new command is needed."""
        if engaged or self.control.emergency_stop:
            self._mux.discard()
        if engaged != self.control.emergency_stop:
            self.control.emergency_stop = engaged
            self.step()

    def check_expiry(self) -> None:
        """Stop at once if the command or the wheel speeds have expired; else repeat the duty."""
        now_ns = self._steady_ns()
        if self._duty != STOPPED and not (
                self._mux.selected(now_ns) and self.control.has_measurement(now_ns)):
            self.step()
        elif now_ns - self._sent_ns > DUTY_REPEAT_NS:
            self._publish_duty(now_ns)

    def step(self) -> None:
        """Compute and publish set points and duties."""
        now_ns = self._steady_ns()
        selected = self._mux.selected(now_ns)
        stamp_ns = self._now_ns()
        set_points, self._duty = self.control.follow(
            selected[1] if selected else None, now_ns, stamp_ns)
        self._publish_wheels(WheelCommand(stamp_ns, set_points))
        self._publish_duty(now_ns)

    def _publish_duty(self, now_ns: int) -> None:
        self._publish_motors(MotorCommand(self._now_ns(), self._duty))
        self._sent_ns = now_ns
