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

"""Speed control of one wheel: reference, feed-forward and feedback."""

from __future__ import annotations

from dataclasses import replace
import math

from smart_tire.control.drive_model import drive_model, DriveModel
from smart_tire.control.pid import Pid
from smart_tire.control.speed_reference import SpeedReference
from smart_tire.control.tire_load import TireLoad
from smart_tire.control.wheel_feedback import WheelFeedback
from smart_tire.parameters.control import WheelControllerParams

STANDSTILL_SPEED = 0.1  # rad/s; a slower wheel with a set point of zero is held
# -, holds on slopes of 35 degrees, and is below ``stall_duty`` of motor_driver: a wheel that
# stands at this duty is not taken for a blocked one.
MAX_HOLD_DUTY = 0.25


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

    def update(self, set_point: float, feedback: WheelFeedback, dt: float, now_ns: int,
               tire: TireLoad | None = None) -> float:
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
        elif not self._holding and abs(measured) < STANDSTILL_SPEED:
            self.reset()
            self._holding = True
        params, reference = self._params, self._reference
        pid = params.pid if not self._holding else replace(
            params.pid, limit=min(params.pid.limit, MAX_HOLD_DUTY))
        if reference is None:  # a rolling wheel is taken over at its speed
            reference = self._reference = SpeedReference(
                0.0 if self._holding else measured, now_ns)
        self._input = reference.advance(
            set_point, dt, now_ns, self._model,
            (params.max_wheel_acceleration, params.max_wheel_deceleration), tire)
        self._direction = reference.direction
        delay = feedback.delay(1.0 / params.rate)
        self._pid.set_gains(pid, self._model.limited(params.pid, delay))
        duty = self._pid.update(
            self._model.duty(self._input, self._direction), self._error(reference, feedback),
            feedback.slope(self._wheel), dt, current=feedback.is_current(now_ns))
        reference.limit_input(self._input - self._pid.excess / self._model.speed_gain)
        return duty if math.isfinite(duty) else self._failed()

    def _failed(self) -> float:
        self.reset()
        return 0.0

    def _error(self, reference: SpeedReference, feedback: WheelFeedback) -> float:
        """Return the speed error [rad/s] of the latest readings, 0 without any."""
        mean = feedback.mean(self._wheel)
        if mean is None:
            return 0.0
        speed, begin_ns, end_ns = mean
        return reference.mean(begin_ns, end_ns) - speed
