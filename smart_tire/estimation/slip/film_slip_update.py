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
Slip measured by the films, as a delayed measurement of the robot's speed.

A patch crossing is reported some tenths of a second after it happened, with a delay that varies
with the computer's load. It is used at a grid instant that depends only on its timestamp and the
wheel's speed, so that live, replayed and recorded data give identical results. The IMU gives the
change of speed since then, so the measurement corrects the present state even if the slip has
changed in the meantime.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
import heapq
import math
from typing import NamedTuple

from smart_tire.estimation.slip.state import DelayedSpeed
from smart_tire.estimation.slip.wheel_model import WHEEL_SPEED_SIGMA
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, WHEELS
from smart_tire.uncertain import Uncertain, UNKNOWN

# From a crossing to its use. It is reported after 0.4 s at 60 rpm, 0.8 s at 20 rpm, and 0.1 s
# later with wheel samples at 4 Hz: once the wheel has rolled on and its angle can be smoothed.
REPORT_DELAY = 0.55      # s, plus ...
REPORT_DISTANCE = 0.08   # m, over the wheel's speed
HISTORY_LENGTH = 3.0     # s


class MotionPoint(NamedTuple):
    """Integrated motion and wheel speeds of the filter at one time."""

    time: float          # s
    speed_change: float  # m/s, integrated acceleration since the start
    variance: float      # m2/s2, of that
    yaw_change: float    # rad, since the start
    gyro_z: float        # rad/s, bias included
    left: float          # m/s, r w of the left side ...
    right: float         # ... and of the right one
    change_sigma_left: float   # m/s, of their slip velocity change since the last wheel sample
    change_sigma_right: float
    lateral_change: float = 0.0  # m/s, integrated lateral acceleration since the start

    @property
    def wheel_speeds(self) -> tuple[float, float]:
        """Return r w [m/s] of both sides."""
        return self.left, self.right

    @property
    def slip_change_sigma(self) -> tuple[float, float]:
        """Return the standard deviation [m/s] of both sides' slip velocity change."""
        return self.change_sigma_left, self.change_sigma_right


@dataclass(frozen=True, slots=True, order=True)
class FilmSlip:
    """A measured slip that waits for its instant."""

    due_ns: int
    wheel: int        # index in ``WHEELS``
    stamp_ns: int     # of the crossing
    slip: float       # -, B(3)'s lambda
    sigma: float
    ratio: Uncertain = UNKNOWN  # -, adhesion ratio


class FilmSlipBuffer:
    """Holds film slips until they are due, and the motion since they were measured."""

    def __init__(self, robot: RobotParams) -> None:
        positions = [robot.film.centers[film] for film in robot.film_groups[0]]
        self._lead = 0.5 * (positions[-1] - positions[0])  # m, from the first film to the center
        self._min_speed = robot.slip.standstill_speed
        self._waiting: list[FilmSlip] = []
        self._newest: dict[int, int] = {}  # wheel -> stamp
        self._points: list[MotionPoint] = []

    def add(self, sample: Friction, time: float, now_ns: int) -> bool:
        """
        Add a crossing of ``time`` [s] at the grid instant ``now_ns``; return False if too late.

        Samples without information are ignored: NaN, a stationary wheel, a time before the
        history.
        """
        slip, sigma = sample.film_slip
        wheel, then = WHEELS.index(sample.wheel), self._at(time)
        if sample.stamp_ns <= self._newest.get(wheel, 0):
            return False
        if then is None or not (abs(slip) <= 1.0 and 0.0 < sigma < 1.0):
            return True
        speed = abs(then.wheel_speeds[wheel % 2])
        if speed < self._min_speed:
            return True
        due_ns = sample.stamp_ns + round((REPORT_DELAY + REPORT_DISTANCE / speed) * NS_PER_S)
        if due_ns <= now_ns:
            return False
        self._newest[wheel] = sample.stamp_ns
        heapq.heappush(self._waiting, FilmSlip(due_ns, wheel, sample.stamp_ns, slip, sigma,
                                               sample.adhesion_ratio))
        return True

    def pop_due(self, instant_ns: int) -> list[FilmSlip]:
        """Remove and return the slips due at a grid instant, in the order of due times."""
        due = []
        while self._waiting and self._waiting[0].due_ns <= instant_ns:
            due.append(heapq.heappop(self._waiting))
        return due

    def record_step(self, time: float, speed_change: float, variance: float, yaw_change: float,
                    gyro_z: float, wheel_speeds: Sequence[float],
                    slip_change_sigma: Sequence[float], lateral_change: float = 0.0) -> None:
        """Append a prediction step that ended at ``time`` [s]: its changes and final values."""
        points = self._points
        if points:
            last = points[-1]
            speed_change, variance, yaw_change, lateral_change = (
                last.speed_change + speed_change, last.variance + variance,
                last.yaw_change + yaw_change, last.lateral_change + lateral_change)
        points.append(MotionPoint(time, speed_change, variance, yaw_change, gyro_z,
                                  wheel_speeds[0], wheel_speeds[1],
                                  slip_change_sigma[0], slip_change_sigma[1], lateral_change))
        if points[0].time < time - 2.0 * HISTORY_LENGTH:
            del points[:bisect_right(points, (time - HISTORY_LENGTH,))]

    def delayed_speed(self, film: FilmSlip, time: float) -> DelayedSpeed | None:
        """
        Return the speed over ground that ``film`` measured at ``time`` [s].

        None if that is before the history.
        """
        side, then = film.wheel % 2, self._at(time)
        if then is None:
            return None
        # the slip is that of film 1, which crosses before the center of all films
        then = self._at(time - self._lead / then.wheel_speeds[side]) or then
        now, rolling = self._points[-1], then.wheel_speeds[side]
        wheel_sigma = math.hypot(WHEEL_SPEED_SIGMA, then.slip_change_sigma[side])
        variance = (rolling * film.sigma)**2 + ((1.0 - film.slip) * wheel_sigma)**2
        return DelayedSpeed(
            side, rolling * (1.0 - film.slip), variance + now.variance - then.variance,
            now.time - then.time, now.speed_change - then.speed_change,
            now.yaw_change - then.yaw_change, then.gyro_z,
            now.lateral_change - then.lateral_change)

    def _at(self, time: float) -> MotionPoint | None:
        """Interpolate the history; None outside of it."""
        points = self._points
        index = bisect_right(points, (time,))
        if not 0 < index < len(points):
            return None
        before, after = points[index - 1], points[index]
        share = (time - before.time) / (after.time - before.time)
        return MotionPoint(*(a + share * (b - a) for a, b in zip(before, after)))
