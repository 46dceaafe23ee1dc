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
Velocity commands from keys that are held down: dead-man's switch and ramps.

A terminal reports no release of a key, only its repetition while it is held: after half a second
(at most ``FIRST_HOLD``), then about 30 times a second. So a key is in force for ``FIRST_HOLD``
after it was pressed, and for ``REPEAT_HOLD`` after a repetition.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.cli._keyboard import Key

FIRST_HOLD = 0.75    # s; the delay of the first repetition is 0.25 to 0.66 s by default
REPEAT_HOLD = 0.3    # s; also the longest time between two repetitions
ACCELERATION, BRAKING = 0.8, 1.6         # m/s2 of the commanded speed
YAW_ACCELERATION, YAW_BRAKING = 3.0, 6.0  # rad/s2 of the commanded yaw rate
YAW_RATE = 1.2       # rad/s, at first
STEP_FACTOR = 1.1    # of speed and yaw rate, per key press
MIN_SCALE, MAX_SCALE = 0.2, 3.0  # of speed and yaw rate, relative to those at first
MAX_PERIOD = 0.1     # s; a longer pause between two steps is no time to accelerate
DIRECTIONS = {Key.FORWARD: 1.0, Key.BACKWARD: -1.0, Key.LEFT: 1.0, Key.RIGHT: -1.0}
SPEED_KEYS = Key.FORWARD, Key.BACKWARD


@dataclass
class _Axis:
    """Speed or yaw rate: what is asked for, until when, and what is commanded now."""

    acceleration: float
    braking: float
    direction: float = 0.0  # -1, 0 or 1
    until: float = -math.inf  # s
    command: float = 0.0

    def step(self, size: float, time: float, period: float) -> None:
        """Move the command towards ``size`` in the direction asked for, or towards zero."""
        target = self.direction * size if time < self.until else 0.0
        slower = self.command * target < 0.0 or abs(target) < abs(self.command)
        reach = period * (self.braking if slower else self.acceleration)
        if self.command * target < 0.0:
            target = 0.0  # brakes before it reverses
        self.command += min(max(target - self.command, -reach), reach)


class Teleoperation:
    """
    Velocity command from the keys pressed; times are seconds of one steady clock.

    A key of the direction of travel acts as long as it is repeated. A key for turning also
    prolongs the speed, so that curves can be driven: a terminal repeats the latest key only. The
    space bar sets the command to zero at once, all other changes are ramps.
    """

    def __init__(self, speed: float) -> None:
        """Drive at ``speed`` [m/s] until another one is selected."""
        self._speed, self._scale = speed, 1.0
        self._travel = _Axis(ACCELERATION, BRAKING)
        self._turn = _Axis(YAW_ACCELERATION, YAW_BRAKING)
        self._latest: Key | None = None
        self._latest_time = -math.inf  # s
        self._time = math.inf          # s, of the latest step; no acceleration before the first

    @property
    def limits(self) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] that the keys ask for."""
        return self._scale * self._speed, self._scale * YAW_RATE

    def press(self, key: Key, time: float) -> None:
        """Take a key at ``time`` [s]."""
        repeated = key == self._latest and time - self._latest_time <= REPEAT_HOLD
        self._latest, self._latest_time = key, time
        if key is Key.STOP:
            self.stop()
        elif key in (Key.FASTER, Key.SLOWER):
            factor = STEP_FACTOR if key is Key.FASTER else 1.0 / STEP_FACTOR
            self._scale = min(max(self._scale * factor, MIN_SCALE), MAX_SCALE)
        elif key in DIRECTIONS:
            until = time + (REPEAT_HOLD if repeated else FIRST_HOLD)
            axis = self._travel if key in SPEED_KEYS else self._turn
            if axis is self._turn and time < self._travel.until:
                self._travel.until = max(self._travel.until, until)
            axis.direction, axis.until = DIRECTIONS[key], until

    def stop(self) -> None:
        """Command standstill at once, until the next key."""
        for axis in (self._travel, self._turn):
            axis.until, axis.command = -math.inf, 0.0

    def step(self, time: float) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] to command at ``time`` [s]."""
        period = min(max(time - self._time, 0.0), MAX_PERIOD)
        self._time = time
        for axis, size in zip((self._travel, self._turn), self.limits):
            axis.step(size, time, period)
        return self._travel.command, self._turn.command
