# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The guided sequence: which step is next, recorded, repeated or skipped, and its progress."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
import math

import numpy as np

from smart_tire.calibration.recording import MIN_RATE
from smart_tire.calibration.sequence import LIFTED, REST, STRAIGHT, TURNS
from smart_tire.samples import ImuSample, NS_PER_S, Sample, WheelSample

Leg = tuple[float, float, float]  # duration [s], rpm of the left and of the right wheels

PAUSE = 1.0              # s of standstill between two legs
STARTS = (110.0, 1.4), (60.0, 1.8), (140.0, 1.1)  # rpm and duration [s] of legs straight ahead
TURN_SPEEDS = (90.0, 30.0), (60.0, 15.0), (-45.0, 45.0)  # rpm, left and right; the last in place
TURN_TIME = 6.0          # s
MAX_SPEED = 1.3          # m/s, of the surface of a wheel
FREE_SPACE_MARGIN = 0.5  # m, free space around the path
PATH_STEP = 0.02         # s
TRACK_FACTORS = (1.0, 2.0)  # effective track over the geometric one: tight and wide turns
WHEEL_SPEED = 2.0        # rad/s, of a start: slower ones hardly slip

INSTRUCTIONS: Mapping[str, str] = {
    REST: 'Leave the robot at rest on level ground, motors on, nobody touches it.',
    STRAIGHT: 'On firm, level ground: start and stop straight ahead and straight back, some '
              'firmly and some gently, with a stop of one second after each.',
    TURNS: 'On the same ground: turn left and right at two speeds, and in place; a full circle '
           'in each direction or more, each turn at constant speed for five seconds.',
    LIFTED: 'Put the robot on blocks, all wheels off the ground, and turn the wheels at several '
            'speeds in both directions.'}


def shuttle(rpm: float, duration: float) -> tuple[Leg, ...]:
    """Return legs forward and back, with a stop after each."""
    stop = (PAUSE, 0.0, 0.0)
    return (duration, rpm, rpm), stop, (duration, -rpm, -rpm), stop


def turn(left: float, right: float, duration: float) -> tuple[Leg, ...]:
    """Return a turn and its mirror image, with a stop after each."""
    stop = (1.5 * PAUSE, 0.0, 0.0)
    return (duration, left, right), stop, (duration, right, left), stop


def limited(legs: Sequence[Leg], wheel_radius: float) -> list[Leg]:
    """Return legs no faster than ``MAX_SPEED``, for wheels of ``wheel_radius`` [m]."""
    fastest = max(max(abs(left), abs(right)) for _, left, right in legs) * math.tau / 60.0
    scale = min(1.0, MAX_SPEED / max(fastest * wheel_radius, 1e-9))
    return [(duration, scale * left, scale * right) for duration, left, right in legs]


def reach(legs: Sequence[Leg], wheel_radius: float, track: float) -> float:
    """
    Return the distance [m] from the start that a robot on these legs may reach, with a margin.

    Turns may be as tight as those of the geometric ``track`` [m] or twice as wide.
    """
    duration, left, right = np.array(legs).T
    steps = np.round(duration / PATH_STEP).astype(int)
    rolled = np.repeat([left, right], steps, axis=1) * math.tau / 60.0 * wheel_radius * PATH_STEP
    yaw = np.cumsum(rolled[1] - rolled[0]) / np.array(TRACK_FACTORS)[:, None] / track
    path = np.cumsum(rolled.mean(axis=0) * np.exp(1j * yaw), axis=1)
    return FREE_SPACE_MARGIN + float(np.abs(path).max())


@dataclass(frozen=True)
class Progress:
    """How far a step is."""

    done: bool
    text: str          # what has been seen, of what is needed
    warning: str = ''  # what is wrong at present


class Watch:
    """Progress of a step, from the samples of IMU and wheels while it is recorded."""

    needed = 0.0  # in each direction
    text = ''     # of the progress: {0} and {1} are what was seen in both directions
    warning = ''
    wrong = False  # whether the motion contradicts the step at present

    def __init__(self) -> None:
        self.yaw_rate = self.tilting = 0.0  # rad/s, latest; the largest about any axis
        self.wheels = self.fastest = 0.0    # rad/s, latest: mean, largest magnitude
        self.seen = {1: 0.0, -1: 0.0}       # direction -> what counts
        self._last_ns: int | None = None

    def take(self, sample: Sample) -> None:
        """Take a sample; others than those of IMU and wheels are ignored."""
        if isinstance(sample, ImuSample):
            self.yaw_rate, self.tilting = sample.rate[2], max(map(abs, sample.rate))
        elif isinstance(sample, WheelSample):
            self.wheels = sum(sample.velocity) / len(sample.velocity)
            self.fastest = max(map(abs, sample.velocity))
            last = sample.stamp_ns if self._last_ns is None else self._last_ns
            self._last_ns = sample.stamp_ns
            self.count(max((sample.stamp_ns - last) / NS_PER_S, 0.0))

    def count(self, elapsed: float) -> None:
        """Count what is seen in the ``elapsed`` [s] until the latest wheel sample."""
        raise NotImplementedError

    @property
    def progress(self) -> Progress:
        """Return how far the step is."""
        return Progress(min(self.seen.values()) >= self.needed, self.text.format(
            *self.seen.values()), self.warning if self.wrong else '')


class RestWatch(Watch):
    """Rest without interruption [s]."""

    needed, text = 10.0, 'at rest for {0:.0f} of 10 s'
    warning = 'the robot moves: the time starts again'

    def count(self, elapsed: float) -> None:
        """Count the rest; motion starts it again."""
        self.wrong = self.fastest > MIN_RATE or self.tilting > MIN_RATE
        self.seen = dict.fromkeys((1, -1), 0.0 if self.wrong else self.seen[1] + elapsed)


class StraightWatch(Watch):
    """Straight starts from rest, and stops."""

    needed, text = 6, 'starts and stops: {0:.0f} forward, {1:.0f} back, of 6 each'
    warning = 'the robot turns: this start does not count'
    _direction = 0

    def count(self, elapsed: float) -> None:
        """Count starts that end in a stop without a turn."""
        turning = abs(self.yaw_rate) > MIN_RATE
        if self._direction == 0:
            if self.fastest > WHEEL_SPEED:
                self._direction, self.wrong = (1 if self.wheels > 0.0 else -1), turning
        elif self.fastest < MIN_RATE:
            self.seen[self._direction] += not self.wrong
            self._direction, self.wrong = 0, False
        else:
            self.wrong |= turning


class TurnWatch(Watch):
    """Turns [degrees]."""

    needed, text = 360.0, 'turned {0:.0f} degrees to the left, {1:.0f} to the right, of 360 each'

    def count(self, elapsed: float) -> None:
        """Count the yaw of turns."""
        if abs(self.yaw_rate) > MIN_RATE and self.fastest > MIN_RATE:
            self.seen[1 if self.yaw_rate > 0.0 else -1] += math.degrees(
                abs(self.yaw_rate) * elapsed)


class LiftedWatch(Watch):
    """Rotation of the wheels while the body is at rest [s]."""

    needed, text = 8.0, 'wheels rotated {0:.0f} s forward, {1:.0f} s back, of 8 s each'
    warning = 'the robot turns: are the wheels off the ground?'

    def count(self, elapsed: float) -> None:
        """Count the time of rotation with the body at rest."""
        self.wrong = abs(self.yaw_rate) > MIN_RATE
        if self.fastest > WHEEL_SPEED and not self.wrong:
            self.seen[1 if self.wheels > 0.0 else -1] += elapsed


WATCHES: Mapping[str, Callable[[], Watch]] = {
    REST: RestWatch, STRAIGHT: StraightWatch, TURNS: TurnWatch, LIFTED: LiftedWatch}


def _legs() -> dict[str, tuple[Leg, ...]]:
    """Return the legs of each step, which its watch needs and a little more."""
    *turns, pivot = TURN_SPEEDS
    return {
        REST: ((RestWatch.needed + 2.0 * PAUSE, 0.0, 0.0),),
        STRAIGHT: (int(StraightWatch.needed) // len(STARTS) + 1) * tuple(
            leg for rpm, duration in STARTS for leg in shuttle(rpm, duration)),
        TURNS: (*(leg for speeds in turns for leg in turn(*speeds, TURN_TIME)),
                *turn(*pivot, TURN_TIME - PAUSE)),
        LIFTED: tuple(leg for rpm, _ in STARTS for leg in shuttle(rpm, LiftedWatch.needed / 2.0))}


LEGS: Mapping[str, tuple[Leg, ...]] = _legs()


class Key(Enum):
    """What the user may ask for; the value is the line to type."""

    GO = ''        # start the step, or end it before it is complete
    REPEAT = 'r'   # discard what is recorded of the step, and start again
    SKIP = 's'     # continue without this step
    QUIT = 'q'     # identify from the steps recorded so far


class Action(Enum):
    """What the program has to do."""

    RECORD = 'start a recording of the step'
    KEEP = 'end the recording'
    DISCARD = 'end the recording and delete it'


class Guide:
    """State of the sequence: waiting for the user, or recording a step."""

    def __init__(self, steps: Sequence[str]) -> None:
        self._steps, self._index = tuple(steps), 0
        self.watch: Watch | None = None  # of the step while it is recorded
        self.recorded: list[str] = []

    @property
    def step(self) -> str | None:
        """Return the present step, None after the last one."""
        return self._steps[self._index] if self._index < len(self._steps) else None

    @property
    def number(self) -> str:
        """Return the number of the step and of all steps."""
        return f'{min(self._index + 1, len(self._steps))}/{len(self._steps)}'

    @property
    def progress(self) -> Progress | None:
        """Return the progress of the step while it is recorded."""
        return None if self.watch is None else self.watch.progress

    def take(self, sample: Sample) -> list[Action]:
        """Take a sample; a complete step ends."""
        if self.watch is None:
            return []
        self.watch.take(sample)
        return self.finish() if self.watch.progress.done else []

    def key(self, key: Key) -> list[Action]:
        """Take a request of the user; return what has to be done, in order."""
        if self.step is None:
            return []
        if key is Key.GO:
            return self._start() if self.watch is None else self.finish()
        recording = [Action.DISCARD] if self.watch is not None else []
        if key is Key.REPEAT:
            return [*recording, *self._start()]
        self.watch = None
        self._index = self._index + 1 if key is Key.SKIP else len(self._steps)
        return recording

    def restart_watch(self) -> None:
        """Forget what has been seen of the step: its recording begins now."""
        if self.step is not None and self.watch is not None:
            self.watch = WATCHES[self.step]()

    def finish(self) -> list[Action]:
        """End the recording of the step and continue with the next one."""
        if self.watch is None or self.step is None:
            return []
        self.recorded.append(self.step)
        self.watch, self._index = None, self._index + 1
        return [Action.KEEP]

    def _start(self) -> list[Action]:
        assert self.step is not None
        self.watch = WATCHES[self.step]()
        return [Action.RECORD]
