# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Rolled distance of one wheel, from samples of its angle or of its mean speed.

Linear interpolation between the samples is sufficient to segment and detect crossings; the
waveform fit uses the smoothed trajectory.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.estimation.contact import constants as c
from smart_tire.estimation.contact.smoothing import smooth_angles, SmoothedTrajectory
from smart_tire.estimation.plausibility import is_position_jump
from smart_tire.samples import NS_PER_S

Point = tuple[int, float]  # of a trajectory: instant [ns] and rolled distance [m]


class WheelTrajectory:
    """
    Trajectory of one wheel: distance [m] rolled by its tread over instants [ns].

    The distance is positive forward and starts at zero. ``counts`` are encoder counts per
    revolution, ``jitter`` [s] is the timestamp noise and ``latency`` [s] the timestamp delay.
    """

    def __init__(self, radius: float, counts: float, jitter: float, latency: float = 0.0) -> None:
        self._radius = radius
        self._quantization_sigma = 2.0 * math.pi / counts / math.sqrt(12.0)
        self._jitter = jitter
        self._latency_ns = round(latency * NS_PER_S)
        self._stamps = array('q')
        self._angles = array('d')
        self._speeds = array('d')
        self._position: float | None = None

    @property
    def newest_ns(self) -> int | None:
        """Instant of the newest sample, None before the first."""
        return self._stamps[-1] if self._stamps else None

    def add_wheel(self, stamp_ns: int, speed: float, position: float | None) -> None:
        """Add the mean speed [rad/s] up to ``stamp_ns`` and, if available, the angle [rad]."""
        stamp_ns -= self._latency_ns
        if not self._stamps:
            self._append(stamp_ns - c.SETTLING_NS, -speed * c.SETTLING_NS / NS_PER_S, speed)
        if stamp_ns - self._stamps[-1] < c.MIN_STEP_NS:
            return
        dt = (stamp_ns - self._stamps[-1]) / NS_PER_S
        angle = self._angles[-1] + self._angle_step(speed, position, dt)
        self._position = position
        if len(self._angles) > 1 and self._angles[-2] == self._angles[-1] == angle:
            self._stamps[-1] = stamp_ns  # at standstill the first and last sample are sufficient
        else:
            self._append(stamp_ns, angle, speed)

    def _append(self, stamp_ns: int, angle: float, speed: float) -> None:
        self._stamps.append(stamp_ns)
        self._angles.append(angle)
        self._speeds.append(speed)
        if len(self._stamps) > 2 * c.HISTORY_LENGTH:
            for history in (self._stamps, self._angles, self._speeds):
                del history[:c.HISTORY_LENGTH]

    def _angle_step(self, speed: float, position: float | None, dt: float) -> float:
        integrated = speed * dt
        if position is None or self._position is None:
            return integrated
        step = position - self._position
        return integrated if is_position_jump(step, integrated) else step

    def interpolate(self, instants: Instants) -> Array:
        """Return the distance [m] at ``instants`` by linear interpolation of the samples."""
        if not len(instants):
            return np.empty(0)
        low = max(bisect_right(self._stamps, int(instants.min())) - 1, 0)
        angle = np.interp(instants, np.array(self._stamps[low:]), np.array(self._angles[low:]))
        if instants.max() > self._stamps[-1]:
            beyond = np.clip(instants - self._stamps[-1], 0, c.MAX_SILENCE_NS)
            angle += self._speeds[-1] * beyond / NS_PER_S
        distance: Array = self._radius * angle
        return distance

    def segment(self, begin: float, end: float, until_ns: int,
                also: Sequence[int] = ()) -> TravelSegment:
        """
        Return the last segment before ``until_ns`` from distance ``begin`` to ``end`` [m].

        Its smoothed trajectory also covers the instants ``also`` [ns].
        """
        direction = 1 if end > begin else -1
        start = last = bisect_right(self._stamps, until_ns)
        while start > 0 and direction * (self._radius * self._angles[start - 1] - begin) >= 0.0:
            start -= 1
        stamps = np.array([*self._stamps[max(start - 1, 0):last], until_ns])
        rolled = np.maximum.accumulate(direction * (self.interpolate(stamps) - begin))
        # an even grid over distance, so that a stop takes no points
        grid = np.linspace(0.0, abs(end - begin), c.SEGMENT_POINTS)
        instants = np.interp(grid, rolled, stamps).astype(np.int64)
        trajectory = self.smooth(min([int(instants[0]), *also]), max([int(instants[-1]), *also]))
        distance = np.maximum.accumulate(direction * (trajectory.distance_at(instants) - begin))
        return TravelSegment(instants, distance, trajectory)

    def smooth(self, begin_ns: int, end_ns: int) -> SmoothedTrajectory:
        """Return the smoothed trajectory between two instants."""
        high = max(bisect_left(self._stamps, end_ns + c.SMOOTHING_NS), 4)
        low = max(min(bisect_left(self._stamps, begin_ns - c.SMOOTHING_NS), high - 4), 0)
        times = (np.array(self._stamps[low:high]) - begin_ns) / NS_PER_S
        angles = np.array(self._angles[low:high])
        speeds = np.abs(np.array(self._speeds[low:high]))
        sigma = np.hypot(self._quantization_sigma, self._jitter * speeds)
        # the smoothing is a low-pass filter of white noise with this density [rad^2 s]
        period = (times[-1] - times[0]) / max(len(times) - 1, 1)
        density = float(sigma @ sigma) / len(sigma) * period
        return SmoothedTrajectory(begin_ns, times, smooth_angles(times, angles, sigma),
                                  self._radius, density)


@dataclass(frozen=True, slots=True, eq=False)
class TravelSegment:
    """Part of a trajectory in one direction; ``distance`` [m] is rolled from its beginning."""

    instants: Instants
    distance: Array
    trajectory: SmoothedTrajectory

    def instant_at(self, distance: float) -> int:
        """Return the instant [ns] at which ``distance`` had been rolled."""
        return int(np.interp(distance, self.distance, self.instants))

    def distance_at(self, instant: int) -> float:
        """Return the distance [m] rolled up to ``instant`` [ns]."""
        return float(np.interp(instant, self.instants, self.distance))

    def speed_change(self, length: float) -> float:
        """Return the range of mean speeds over parts of about a ``length`` [m] over their mean."""
        begin, end = self.distance[[0, -1]].tolist()  # smoothing has moved the ends, too
        edges = np.linspace(begin, end, max(round((end - begin) / length), 2) + 1)
        reached = np.interp(edges, self.distance, self.instants)
        speeds = 1.0 / np.maximum(reached[1:] - reached[:-1], 1.0)
        return float((speeds.max() - speeds.min()) / speeds.mean())


class ReversalDetector:
    """
    Detects reversals of a rolled distance; rolling back by less than ``hysteresis`` [m] is none.

    ``points`` are the start and the latest reversals, ``direction`` is the present one: +1
    forward, -1 backward, 0 before the first motion.
    """

    def __init__(self, hysteresis: float) -> None:
        self._hysteresis = hysteresis
        self.direction = 0
        self.points: list[Point] = []
        self._extreme: Point | None = None

    def follow(self, instants: Instants, distance: Array) -> list[Point]:
        """Follow the trajectory; return the reversals in it."""
        found = []
        for point in zip(instants.tolist(), distance.tolist()):
            if self._extreme is None:
                self._extreme, self.points = point, [point]
            moved = point[1] - self._extreme[1]
            if self.direction * moved < -self._hysteresis or (
                    not self.direction and abs(moved) > self._hysteresis):
                if self.direction:
                    found.append(self._extreme)
                self.direction = 1 if moved > 0.0 else -1
                self._extreme = point
            elif self.direction * moved > 0.0:
                self._extreme = point
        self.points = (self.points + found)[-c.REMEMBERED:]
        return found
