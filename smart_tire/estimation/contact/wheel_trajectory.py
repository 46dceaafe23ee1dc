"""
Rolled distance of one wheel, from samples of its angle or of its mean speed.

A coarse course between the samples is enough to find contacts. To measure one, the course is
smoothed: 1 ms of stamp jitter is 1 mm at 1 m/s, as large as what the friction shows.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpbsv

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.estimation.contact.trajectory_error import TrajectoryErrors, warps
from smart_tire.samples import NS_PER_S

Instants = NDArray[np.int64]

LEAST_DENSITY = 1e-12  # rad^2 s, of angles without noise
JERK_DENSITY = 3.0     # (rad/s3)^2 s, how a controlled wheel's acceleration wanders
MEMORY = 1024             # samples kept, standstill aside
BEFORE_NS = 400_000_000   # samples that support the smoothing, before ...
AFTER_NS = 300_000_000    # ... and after the stretch that is asked for
LONGEST_EXTRAPOLATION = 1.0  # s, beyond the newest sample
IMPLAUSIBLE_STEP = 1.0       # rad, more than the speed explains: the counter was reset
KEPT_TURNS = 16
SHORTEST = 1e-3          # s, of a stretch of course ...
SHORTEST_WAY = 1e-3      # m, ... and of its way: no division by zero
EVEN = np.linspace(0.0, 1.0, 200)  # share of a roll, where its course is told
PARTS = np.linspace(0.0, 1.0, 9)  # share of a roll, between whose speeds the change is looked for


class WheelTrajectory:
    """
    Course of one wheel: distance [m] that its tread has rolled over instants [ns].

    The distance grows forward and starts at zero. ``latency`` [s] is how late stamps are,
    ``counts`` the encoder's counts per turn and ``jitter`` [s] the noise of the stamps.
    """

    def __init__(self, radius: float, counts: float, jitter: float, latency: float = 0.0) -> None:
        self._radius = radius
        self._quantum = 2.0 * math.pi / counts / math.sqrt(12.0)
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

    def add(self, stamp_ns: int, speed: float, position: float | None) -> None:
        """Take in the mean speed [rad/s] up to ``stamp_ns`` and, where known, the angle [rad]."""
        stamp_ns -= self._latency_ns
        angle = 0.0
        if self._stamps:
            dt = (stamp_ns - self._stamps[-1]) / NS_PER_S
            if dt <= 0.0:
                return
            angle = self._angles[-1] + self._step(speed, position, dt)
        self._position = position
        if len(self._angles) > 1 and self._angles[-2] == self._angles[-1] == angle:
            self._stamps[-1] = stamp_ns  # of a wheel that stands, begin and end are enough
            return
        self._stamps.append(stamp_ns)
        self._angles.append(angle)
        self._speeds.append(speed)
        if len(self._stamps) > 2 * MEMORY:
            for history in (self._stamps, self._angles, self._speeds):
                del history[:MEMORY]

    def _step(self, speed: float, position: float | None, dt: float) -> float:
        rolled = speed * dt
        if position is None or self._position is None:
            return rolled
        step = position - self._position
        return step if abs(step - rolled) < IMPLAUSIBLE_STEP + abs(rolled) else rolled

    def coarse(self, instants: Instants) -> Array:
        """Return the distance [m] at ``instants`` by straight lines between the samples."""
        if not len(instants):
            return np.empty(0)
        low = max(bisect_right(self._stamps, int(instants.min())) - 1, 0)
        distance = np.interp(instants, np.array(self._stamps[low:]), np.array(self._angles[low:]))
        if instants.max() > self._stamps[-1]:
            beyond = (instants - self._stamps[-1]) / NS_PER_S
            distance += self._speeds[-1] * np.minimum(
                np.maximum(beyond, 0.0), LONGEST_EXTRAPOLATION)
        rolled: Array = self._radius * distance
        return rolled

    def roll(self, begin: float, end: float, until_ns: int,
             also: Sequence[int] = ()) -> TravelSegment:
        """
        Return the course of the last roll from one distance [m] to another.

        Its smoothed course also holds the instants ``also`` [ns].
        """
        direction = 1 if end > begin else -1
        start = last = bisect_right(self._stamps, until_ns)
        while start > 0 and direction * (self._radius * self._angles[start - 1] - begin) >= 0.0:
            start -= 1
        stamps = np.array([*self._stamps[max(start - 1, 0):last], until_ns])
        rolled = np.maximum.accumulate(direction * (self.coarse(stamps) - begin))
        # evenly spread over the way, so that a stop on it takes no points
        even = EVEN * abs(end - begin)
        instants = np.interp(even, rolled, stamps).astype(np.int64)
        course = self.smooth(min([int(instants[0]), *also]), max([int(instants[-1]), *also]))
        smooth = np.maximum.accumulate(direction * (course.at(instants) - begin))
        return TravelSegment(instants, smooth, course)

    def smooth(self, begin_ns: int, end_ns: int) -> SmoothedTrajectory:
        """Return the smoothed course between two instants."""
        high = bisect_left(self._stamps, end_ns + AFTER_NS)
        low = max(min(bisect_left(self._stamps, begin_ns - BEFORE_NS), high - 4), 0)
        times = (np.array(self._stamps[low:high]) - begin_ns) / NS_PER_S
        angles = np.array(self._angles[low:high])
        speeds = np.abs(np.array(self._speeds[low:high]))
        sigma = np.hypot(self._quantum, self._jitter * speeds)
        smoothed = _least_jerk(times, angles, sigma)
        # the smoothing is a low-pass filter against white noise of this density [rad^2 s]
        interval = (times[-1] - times[0]) / max(len(times) - 1, 1)
        density = float(sigma @ sigma) / len(sigma) * interval
        return SmoothedTrajectory(begin_ns, times, self._radius * smoothed, self._radius,
                            max(density, LEAST_DENSITY))


class SmoothedTrajectory:
    """
    Smoothed distance [m] over instants [ns], and what is uncertain in it.

    ``density`` [rad^2 s] is that of the white noise of the angles that were smoothed.
    """

    def __init__(self, origin_ns: int, times: Array, distance: Array, radius: float,
                 density: float) -> None:
        self._origin_ns = origin_ns
        self._times, self._distance = times, distance
        self._slopes, self._cubics = _cubics(times, distance)
        self._radius, self._density = radius, density
        self._cutoff = (JERK_DENSITY / density)**(1.0 / 6.0)  # rad/s, of the low-pass filter

    @property
    def speed_sigma(self) -> float:
        """One sigma of the speed [m/s]."""
        return self._radius * (self._density * JERK_DENSITY)**0.25

    def errors(self, begin_ns: int, end_ns: int) -> TrajectoryErrors:
        """Return what is uncertain in the distances between two instants."""
        seconds = max((end_ns - begin_ns) / NS_PER_S, SHORTEST)
        begin, end = self.at(np.array([begin_ns, end_ns]))
        speed = max(abs(float(end - begin)), SHORTEST_WAY) / seconds
        return TrajectoryErrors(self.speed_sigma / speed, warps(
            self._radius**2 * self._density, self._cutoff, seconds))

    def at(self, instants: Instants) -> Array:
        """Return the distance [m] at ``instants`` [ns]; past the ends the speed stays."""
        knots, slopes = self._times, self._slopes
        times = (instants - self._origin_ns) / NS_PER_S
        if len(knots) < 2:
            return np.full(len(times), self._distance[0])
        inner = np.minimum(np.maximum(times, knots[0]), knots[-1])
        knot, value, per_second, rise, begin, end = self._cubics[
            :, knots[1:-1].searchsorted(inner, side='right')]
        t = (inner - knot) * per_second
        left = 1.0 - t
        distance: Array = value + t * (rise + left * (left * begin - t * end))
        beyond = times - inner
        if beyond.any():
            beyond = np.clip(beyond, -LONGEST_EXTRAPOLATION, LONGEST_EXTRAPOLATION)
            distance += np.where(beyond > 0.0, slopes[-1], slopes[0]) * beyond
        return distance


@dataclass(frozen=True, slots=True, eq=False)
class TravelSegment:
    """Course over a stretch of way [m], which begins at 0, by the way instead of the time."""

    instants: Instants
    way: Array
    course: SmoothedTrajectory

    def when(self, way: float) -> int:
        """Return the instant [ns] at which ``way`` had been rolled."""
        return int(np.interp(way, self.way, self.instants))

    def at(self, instant: int) -> float:
        """Return the way that had been rolled at ``instant`` [ns]."""
        return float(np.interp(instant, self.instants, self.way))

    def speed_change(self) -> float:
        """Return the relative change of the speed on the way."""
        # smoothing moved the ends as well
        edges = self.way[0] + PARTS * (self.way[-1] - self.way[0])
        passed = np.interp(edges, self.way, self.instants)
        speeds = 1.0 / np.maximum(passed[1:] - passed[:-1], 1.0)
        return float((speeds.max() - speeds.min()) / speeds.mean())


def _cubics(times: Array, distance: Array) -> tuple[Array, Array]:
    """
    Return slopes at the knots with which a cubic does not overshoot, and the cubics.

    Of each cubic: time and distance where it begins, 1 / duration, its rise, and by how much more
    it would rise with the slope of its begin and of its end.
    """
    if len(times) < 2:
        return np.zeros(len(times)), np.empty((6, 0))
    step, rise = times[1:] - times[:-1], distance[1:] - distance[:-1]
    secant = rise / step
    before, after = secant[:-1], secant[1:]
    near, far = 2.0 * step[1:] + step[:-1], step[1:] + 2.0 * step[:-1]
    product = before * after
    # harmonic means
    inner = (near + far) * product / np.where(product > 0.0, near * after + far * before, np.inf)
    slopes = np.concatenate([secant[:1], inner, secant[-1:]])
    cubics = np.empty((6, len(step)))
    cubics[0], cubics[1], cubics[3] = times[:-1], distance[:-1], rise
    np.divide(1.0, step, out=cubics[2])
    np.subtract(step * slopes[:-1], rise, out=cubics[4])
    np.subtract(step * slopes[1:], rise, out=cubics[5])
    return slopes, cubics


def _least_jerk(times: Array, angles: Array, sigma: Array) -> Array:
    """Return ``angles`` smoothed: least squares against white jerk of ``JERK_DENSITY``."""
    n = len(times)
    if n < 4:
        return angles
    # jerk over each run of four samples: six times its third divided difference
    first, second, third, fourth = (times[j:n - 3 + j] for j in range(4))
    early, middle, late = second - first, third - second, fourth - third
    begin, end, whole = third - first, fourth - second, fourth - first
    rows = np.sqrt(12.0 / JERK_DENSITY * whole) / np.stack([
        -early * begin * whole, early * middle * end, -begin * middle * late, whole * end * late])
    products = rows[:, np.newaxis] * rows
    banded = np.zeros((4, n))  # upper form: row 3 - k holds the k-th superdiagonal
    for j in range(4):
        for k in range(j, 4):
            banded[3 - (k - j), k:n - 3 + k] += products[j, k]
    weight = 1.0 / sigma**2
    banded[3] += weight
    _, smoothed, failed = dpbsv(banded, (angles - angles[0]) * weight)
    if failed:
        raise EstimatorError(f'the angles of a wheel at {times} s cannot be smoothed')
    found: Array = angles[0] + smoothed
    return found


class ReversalDetector:
    """
    Turning points of a rolled distance: the last of them tells where the present run began.

    Rolling back by less than ``least`` [m] is no turn.
    """

    def __init__(self, least: float) -> None:
        self._least = least
        self.direction = 0  # of the present run: +1 forward, -1 backward, 0 before the first
        self.turns: list[tuple[int, float]] = []  # instant [ns] and distance [m], begin first
        self._extreme: tuple[int, float] | None = None

    def advance(self, instants: Instants, distance: Array) -> list[tuple[int, float]]:
        """Follow the course; return the turning points (instant, distance) that it shows."""
        if not len(instants):
            return []
        if self._extreme is None:
            self._extreme = (int(instants[0]), float(distance[0]))
            self.turns = [self._extreme]
        found = []
        for instant, place in zip(instants.tolist(), distance.tolist()):
            moved = place - self._extreme[1]
            if self.direction * moved < -self._least or (
                    not self.direction and abs(moved) > self._least):
                if self.direction:
                    found.append(self._extreme)
                self.direction = 1 if moved > 0.0 else -1
                self._extreme = (instant, place)
            elif self.direction * moved > 0.0:
                self._extreme = (instant, place)
        self.turns = (self.turns + found)[-KEPT_TURNS:]
        return found
