"""
Slip that the films tell, as a measurement of the robot's speed at an earlier time.

A passage is told some tenths of a second after it happened, sooner or later as other programs
let it. It is applied at an instant that only its stamp and the wheel's speed then decide, so that
live, replayed and recorded data give the same numbers. From then to now the inertial unit has
seen how the speed changed, so what the films say of the past corrects the present, whatever the
slip has done since.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
import heapq
import math
from typing import NamedTuple

from smart_tire.estimation.slip.ekf import WHEEL_NOISE
from smart_tire.estimation.slip.state import DelayedSpeed
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, WHEELS

# From a passage to its use. It is told after 0.4 s at 60 rpm, 0.8 s at 20 rpm, 0.1 s later with
# wheels at 4 Hz: once the wheel has rolled on and its angle is smooth.
DELAY, ROLL = 0.55, 0.08  # s, and m
MEMORY = 3.0             # s


class Point(NamedTuple):
    """What the filter knew at one time on the way."""

    time: float      # s
    gained: float    # m/s, forward speed by the inertial unit since the start
    variance: float  # m2/s2, of that
    angle: float     # rad, turned since the start
    gyro_z: float    # rad/s, bias not removed
    left: float      # m/s, r w of the left side ...
    right: float     # ... and of the right one
    unseen_left: float   # m/s, one sigma by which they may have changed since the last reading
    unseen_right: float

    @property
    def wheels(self) -> tuple[float, float]:
        """Return r w of both sides."""
        return self.left, self.right

    @property
    def unseen(self) -> tuple[float, float]:
        """Return one sigma of what is not seen of both sides."""
        return self.unseen_left, self.unseen_right


@dataclass(frozen=True, slots=True, order=True)
class FilmSlip:
    """A slip that waits for its instant."""

    due_ns: int
    wheel: int        # index in ``WHEELS``
    stamp_ns: int     # of the passage
    slip: float       # -, B(3)'s lambda
    sigma: float


class FilmAid:
    """Keeps the slips of the films until they are due, and the way since they were measured."""

    def __init__(self, robot: RobotParams) -> None:
        places = [robot.film.places[film] for film in robot.film_groups[0]]
        self._lead = 0.5 * (places[-1] - places[0])  # m, from the first film to the middle
        self._slowest = robot.slip.standstill_speed
        self._waiting: list[FilmSlip] = []
        self._newest: dict[int, int] = {}  # wheel -> stamp
        self._points: list[Point] = []

    def push(self, sample: Friction, time: float, now_ns: int) -> bool:
        """
        Take a passage of ``time`` [s] at the grid instant ``now_ns``; return False if too late.

        What tells nothing is passed over: NaN, a wheel that stood, a time before the memory.
        """
        slip, sigma = sample.value['film_slip'], sample.sigma['film_slip']
        wheel, then = WHEELS.index(sample.wheel), self._at(time)
        if sample.stamp_ns <= self._newest.get(wheel, 0):
            return False
        if then is None or not (abs(slip) <= 1.0 and 0.0 < sigma < 1.0):
            return True
        speed = abs(then.wheels[wheel % 2])
        if speed < self._slowest:
            return True
        due_ns = sample.stamp_ns + round((DELAY + ROLL / speed) * NS_PER_S)
        if due_ns <= now_ns:
            return False
        self._newest[wheel] = sample.stamp_ns
        heapq.heappush(self._waiting, FilmSlip(due_ns, wheel, sample.stamp_ns, slip, sigma))
        return True

    def due(self, instant_ns: int) -> list[FilmSlip]:
        """Return what is to be used at a grid instant, in the order of stamps and wheels."""
        found = []
        while self._waiting and self._waiting[0].due_ns <= instant_ns:
            found.append(heapq.heappop(self._waiting))
        return found

    def note(self, time: float, gained: float, variance: float, angle: float, gyro_z: float,
             wheels: Sequence[float], unseen: Sequence[float]) -> None:
        """Append a step that ended at ``time`` [s]: what it added, and what was known then."""
        points = self._points
        if points:
            last = points[-1]
            gained, variance, angle = (
                last.gained + gained, last.variance + variance, last.angle + angle)
        points.append(Point(time, gained, variance, angle, gyro_z, wheels[0], wheels[1],
                            unseen[0], unseen[1]))
        if points[0].time < time - 2.0 * MEMORY:
            del points[:bisect_right(points, (time - MEMORY,))]

    def speed(self, film: FilmSlip, time: float) -> DelayedSpeed | None:
        """
        Return what ``film`` that passed at ``time`` [s] says of the speed over ground.

        None where that is no longer remembered.
        """
        side, then = film.wheel % 2, self._at(time)
        if then is None:
            return None
        # the slip is that of film 1, which passes before the middle of all films
        then = self._at(time - self._lead / then.wheels[side]) or then
        now, rolling = self._points[-1], then.wheels[side]
        wheel = math.hypot(WHEEL_NOISE, then.unseen[side])
        variance = (rolling * film.sigma)**2 + ((1.0 - film.slip) * wheel)**2
        return DelayedSpeed(side, rolling * (1.0 - film.slip),
                         variance + now.variance - then.variance, now.time - then.time,
                         now.gained - then.gained, now.angle - then.angle, then.gyro_z)

    def _at(self, time: float) -> Point | None:
        """Interpolate; None before the memory or after its end."""
        points = self._points
        index = bisect_right(points, (time,))
        if not 0 < index < len(points):
            return None
        before, after = points[index - 1], points[index]
        share = (time - before.time) / (after.time - before.time)
        return Point(*(a + share * (b - a) for a, b in zip(before, after)))
