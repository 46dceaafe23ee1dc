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

"""Progress of a calibration step, from the samples of IMU and wheels while it is recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import math

from smart_tire.calibration.procedure.sequence import LIFTED, REST, STRAIGHT, TURNS
from smart_tire.samples import ImuSample, NS_PER_S, Sample, WheelSample

REST_DURATION = 10.0     # s of uninterrupted rest
STARTS = 6               # from rest, in each direction
YAW = 2.0 * math.pi      # rad, in each direction
LIFTED_DURATION = 8.0    # s of wheel rotation, in each direction
WHEEL_AT_REST = 0.05     # rad/s
WHEEL_IN_MOTION = 2.0    # rad/s, of a start: slower ones hardly slip
BODY_AT_REST = 0.1       # rad/s, about any axis
MAX_STRAIGHT_YAW_RATE = 0.15  # rad/s, means over a sample of the wheels
TURN_RATE = 0.15         # rad/s, of a turn


@dataclass(frozen=True)
class Progress:
    """How far a step is."""

    done: bool
    text: str          # what has been seen, of what is needed
    warning: str = ''  # what is wrong at present


class Watch:
    """Progress of a step; ``update`` takes the samples in order of their reception."""

    def __init__(self) -> None:
        self.yaw_rate = 0.0    # rad/s, latest
        self.wheels = 0.0      # rad/s, mean of the latest
        self.fastest = 0.0     # rad/s, of the latest wheels
        self.tilting = 0.0     # rad/s, largest rate about any axis
        self._last_ns: dict[type, int] = {}

    def update(self, sample: Sample) -> None:
        """Take a sample; others than those of IMU and wheels are ignored."""
        if not isinstance(sample, (ImuSample, WheelSample)):
            return
        last = self._last_ns.get(type(sample), sample.stamp_ns)
        self._last_ns[type(sample)] = sample.stamp_ns
        elapsed = max((sample.stamp_ns - last) / NS_PER_S, 0.0)
        if isinstance(sample, ImuSample):
            self.yaw_rate, self.tilting = sample.rate[2], max(map(abs, sample.rate))
            self.imu_moved(elapsed)
        else:
            self.wheels = sum(sample.velocity) / len(sample.velocity)
            self.fastest = max(map(abs, sample.velocity))
            self.wheels_moved(elapsed)

    def imu_moved(self, elapsed: float) -> None:
        """Take the latest rates, ``elapsed`` [s] after the previous ones."""

    def wheels_moved(self, elapsed: float) -> None:
        """Take the latest wheel speeds, ``elapsed`` [s] after the previous ones."""

    @property
    def progress(self) -> Progress:
        """Return how far the step is."""
        raise NotImplementedError


class RestWatch(Watch):
    """Rest without interruption."""

    def __init__(self) -> None:
        super().__init__()
        self._rest = 0.0  # s

    def wheels_moved(self, elapsed: float) -> None:
        """Count the rest; motion starts it again."""
        moving = self.fastest > WHEEL_AT_REST or self.tilting > BODY_AT_REST
        self._rest = 0.0 if moving else self._rest + elapsed

    @property
    def progress(self) -> Progress:
        """Return the seconds of rest."""
        moving = self.fastest > WHEEL_AT_REST or self.tilting > BODY_AT_REST
        return Progress(self._rest >= REST_DURATION,
                        f'at rest for {self._rest:.0f} of {REST_DURATION:.0f} s',
                        'the robot moves: the time starts again' if moving else '')


class StraightWatch(Watch):
    """Straight starts from rest, and stops, in both directions."""

    def __init__(self) -> None:
        super().__init__()
        self.starts = {1: 0, -1: 0}  # direction -> complete starts and stops
        self._direction, self._straight = 0, True

    def wheels_moved(self, elapsed: float) -> None:
        """Count starts that end in a stop without a turn."""
        turning = abs(self.yaw_rate) > MAX_STRAIGHT_YAW_RATE
        if self._direction == 0:
            if self.fastest > WHEEL_IN_MOTION:
                self._direction, self._straight = (1 if self.wheels > 0.0 else -1), not turning
        elif self.fastest < WHEEL_AT_REST:
            self.starts[self._direction] += self._straight
            self._direction = 0
        else:
            self._straight &= not turning

    @property
    def progress(self) -> Progress:
        """Return the starts and stops in both directions."""
        forward, back = self.starts[1], self.starts[-1]
        warning = '' if self._straight or not self._direction else (
            'the robot turns: this start does not count')
        return Progress(min(forward, back) >= STARTS,
                        f'starts and stops: {forward} forward, {back} back, of {STARTS} each',
                        warning)


class TurnWatch(Watch):
    """Turns in both directions."""

    def __init__(self) -> None:
        super().__init__()
        self.yaw = {1: 0.0, -1: 0.0}  # direction -> rad

    def imu_moved(self, elapsed: float) -> None:
        """Add the yaw of turns."""
        if abs(self.yaw_rate) > TURN_RATE and self.fastest > WHEEL_AT_REST:
            self.yaw[1 if self.yaw_rate > 0.0 else -1] += abs(self.yaw_rate) * elapsed

    @property
    def progress(self) -> Progress:
        """Return the yaw in both directions."""
        left, right = (math.degrees(self.yaw[sign]) for sign in (1, -1))
        return Progress(min(self.yaw.values()) >= YAW, f'turned {left:.0f} degrees to the left, '
                        f'{right:.0f} to the right, of {math.degrees(YAW):.0f} each')


class LiftedWatch(Watch):
    """Wheels rotate in both directions while the body is at rest."""

    def __init__(self) -> None:
        super().__init__()
        self.rotated = {1: 0.0, -1: 0.0}  # direction -> s

    def wheels_moved(self, elapsed: float) -> None:
        """Count the time of rotation with the body at rest."""
        if self.fastest > WHEEL_IN_MOTION and abs(self.yaw_rate) < BODY_AT_REST:
            self.rotated[1 if self.wheels > 0.0 else -1] += elapsed

    @property
    def progress(self) -> Progress:
        """Return the time of rotation in both directions."""
        forward, back = self.rotated[1], self.rotated[-1]
        warning = 'the robot turns: are the wheels off the ground?' if (
            abs(self.yaw_rate) > BODY_AT_REST) else ''
        return Progress(min(forward, back) >= LIFTED_DURATION,
                        f'wheels rotated {forward:.0f} s forward, {back:.0f} s back, of '
                        f'{LIFTED_DURATION:.0f} s each', warning)


WATCHES: Mapping[str, Callable[[], Watch]] = {
    REST: RestWatch, STRAIGHT: StraightWatch, TURNS: TurnWatch, LIFTED: LiftedWatch}
