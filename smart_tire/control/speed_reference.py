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

"""Reference of a wheel speed: a set point within the limits of acceleration."""

from __future__ import annotations

from collections import deque
import math

from smart_tire.control.drive_model import DriveModel, TireLoad
from smart_tire.samples import NS_PER_S

MAX_HISTORY_NS = 3 * NS_PER_S  # of the expected angle; more than two readings at 1 Hz


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
        self._initial = velocity    # rad/s, before the first step
        self._history = deque([(now_ns, 0.0)])  # time and integral of the expected speed [rad]

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
        angle = self._angle(end_ns) - self._angle(begin_ns)
        return angle * NS_PER_S / (end_ns - begin_ns)

    def _expect(self, now_ns: int) -> None:
        """Advance the expected speed from the latest step to ``now_ns``."""
        last_ns, angle = self._history[-1]
        if now_ns <= last_ns:
            return
        elapsed, lag = (now_ns - last_ns) / NS_PER_S, self._lag
        rest = (self._expected - self._input) * math.exp(-elapsed / lag)
        angle += self._input * elapsed + lag * (self._expected - self._input - rest)
        self._expected = self._input + rest
        self._history.append((now_ns, angle))
        while len(self._history) > 2 and self._history[1][0] < now_ns - MAX_HISTORY_NS:
            self._history.popleft()

    def _angle(self, time_ns: int) -> float:
        """Return the integral of the expected speed [rad] until ``time_ns``."""
        after_ns, after = self._history[-1]
        if time_ns >= after_ns:
            return after + self._expected * (time_ns - after_ns) / NS_PER_S
        for before_ns, before in reversed(self._history):
            if before_ns <= time_ns:
                share = (time_ns - before_ns) / (after_ns - before_ns)
                return before + share * (after - before)
            after_ns, after = before_ns, before
        return after - self._initial * (after_ns - time_ns) / NS_PER_S


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
