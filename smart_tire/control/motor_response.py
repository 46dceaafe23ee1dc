# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the motors make of their duties, by the measured torques: delay, limits and loads."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
import math

from smart_tire.control import constants as c
from smart_tire.control.history import History
from smart_tire.control.wheel_feedback import WheelFeedback
from smart_tire.control.wheel_servo import DriveModel
from smart_tire.samples import Four, MAX_WHEEL_TORQUE, NS_PER_S, STOPPED


@dataclass(frozen=True)
class MotorState:
    """What the torque of a motor shows at the latest reading; duties are torques over T."""

    missing: float = 0.0   # -, duty beyond the errors of the model that the motor does not follow
    inertial: float = 0.0  # -, duty that accelerates the wheel and its share of the robot
    load: float = 0.0      # -, the rest of the torque, with the dry friction


class MotorResponse:
    """
    Compares measured torques with the duties before them.

    A motor with the duty d at the speed w has the torque ``T (d - w / w_0)``. The ``delay`` [s] is
    the one with which the duties explain the torques best, if its difference to the present one is
    above ``MOTOR_MARGIN``; only changes of the duty show it. Times are nanoseconds of one steady
    clock.
    """

    def __init__(self) -> None:
        self.delay = 0.0                            # s, beyond that of the line
        self.motors: tuple[MotorState, ...] = ()    # empty without torques
        self._duties = History()
        self._errors = [0.0] * len(c.DELAYS)        # s, squared duties times time
        self._readings: deque[tuple[int, list[float], Four]] = deque()  # time, speed, torque

    def command(self, duty: Four, now_ns: int) -> None:
        """Add the duties from now on."""
        self._duties.add(now_ns, *duty)

    def learn(self, torque: Four, feedback: WheelFeedback, model: DriveModel) -> None:
        """
        Use the motor torques [N m] of the latest reading of ``feedback``.

        They count if all are plausible. The acceleration is that between the mean speeds of two
        windows of ``feedback``, its torque the mean between their middles.
        """
        means = [mean for wheel in range(len(torque)) if (mean := feedback.mean(wheel))]
        if not means or not all(  # false for NaN, too
                abs(one) <= MAX_WHEEL_TORQUE for one in torque):
            self.motors = ()
            self._readings.clear()
            return
        _, begin_ns, end_ns = means[0]
        speed, stall = [mean[0] for mean in means], model.stall_torque
        realized = [one / stall + model.free_gain * w for one, w in zip(torque, speed)]
        self._learn_delay(realized, [one / stall for one in torque], end_ns)
        readings, middle_ns = self._readings, (begin_ns + end_ns) // 2
        readings.append((middle_ns, speed, torque))
        while len(readings) > 2 and middle_ns - readings[1][0] >= end_ns - begin_ns:
            readings.popleft()
        first_ns, before, _ = readings[0]
        gain = model.inertia / stall * NS_PER_S / max(middle_ns - first_ns, end_ns - begin_ns)
        inertial = [gain * (w - old) for w, old in zip(speed, before)]
        given = self._duties.held(end_ns - round(self.delay * NS_PER_S)) or realized
        mean_torque = [math.fsum(torques) / len(readings)
                       for torques in zip(*(torque for _, _, torque in readings))]
        self.motors = tuple(
            MotorState(_missing(*duties), change, mean_torque[wheel] / stall
                       - change - (model.speed_gain - model.free_gain) * speed[wheel])
            for wheel, (duties, change) in enumerate(zip(zip(given, realized), inertial)))

    def _learn_delay(self, realized: Sequence[float], shares: Sequence[float], end_ns: int
                     ) -> None:
        """Compare the ``realized`` duties and ``shares`` of T with duties before ``end_ns``."""
        last_ns = self._readings[-1][0] if self._readings else end_ns
        if not self._duties.times or end_ns - self._duties.times[0] < c.DELAYS[-1] * NS_PER_S:
            return
        given = [self._duties.held(end_ns - delay_ns) or STOPPED
                 for delay_ns in c.DELAYS_NS.tolist()]
        squares = {duty: _unexplained(duty, realized, shares) for duty in {*given}}
        least, elapsed = min(squares.values()), (
            min(max(end_ns - last_ns, 0), c.MAX_GAP_NS) / NS_PER_S)
        errors = [error + elapsed * (squares[duty] - least)
                  for error, duty in zip(self._errors, given)]
        kept = min(1.0, c.MOTOR_EVIDENCE / max(max(errors) - min(errors), c.TINY))
        self._errors = [kept * error for error in errors]
        best = min(self._errors)
        if self._errors[round(self.delay / c.DELAY_STEP)] > best + c.MOTOR_MARGIN:
            self.delay = float(c.DELAYS[self._errors.index(best)])


def _unexplained(given: Sequence[float], realized: Sequence[float], shares: Sequence[float]
                 ) -> float:
    """
    Return the mean square of what the errors of the model leave of the differences of duties.

    Nothing is left for a motor whose current is limited: it has less torque than given, but a
    share of the stall torque in the right direction.
    """
    squares = 0.0
    for duty, found, share in zip(given, realized, shares):
        rest = duty - found
        if rest * duty <= 0.0 or share * math.copysign(1.0, duty) <= c.DUTY_ERROR:
            squares += max(abs(rest) - error_of(duty), 0.0) ** 2
    return squares / len(given)


def _missing(given: float, realized: float) -> float:
    """Return the part of a duty beyond the errors of the model that is not realized."""
    rest = given - realized
    return rest if rest * given > 0.0 and abs(rest) > error_of(given) else 0.0


def error_of(duty: float) -> float:
    """Return the error of a duty [-] that supply, temperature and friction of a motor explain."""
    return c.MODEL_ERROR * abs(duty) + c.DUTY_ERROR
