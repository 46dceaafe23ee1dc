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
Predicts patch crossings from the wheel angle, and associates the detections with them.

Once the films' mounting position is known, the rolled distance determines when all films have
moved through the patch from one side to the other. A crossing lost by the radio is therefore not
missed, and a film that enters the patch and rolls back out is not counted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
import math

from smart_tire.estimation.contact import constants as c
from smart_tire.estimation.contact.records import FilmCrossing, FilmGroup
from smart_tire.estimation.contact.trajectory import Point


@dataclass(frozen=True, slots=True)
class PredictedCrossing:
    """All films of a wheel moved through the whole patch."""

    position: float  # m, rolled distance with the films' common center at the patch center
    direction: int   # +1 forward, -1 backward
    end_ns: int      # not before the last film left the patch


class MountPosition:
    """
    Position of the films on the wheel, learned from detections, and their crossings.

    ``circumference`` is that of the wheel [m].
    """

    def __init__(self, group: FilmGroup, circumference: float) -> None:
        self._circumference = circumference
        self._gate = c.POSITION_GATE * group.film_length
        # m between the common center and the patch center when the last film has left the patch
        self._reach = group.reach + c.CLEARANCE * group.film_length
        self._position = math.nan  # m, rolled distance of a crossing, modulo the circumference
        self._detections = 0
        self._outliers = 0         # consecutive detections that contradict the position
        self._next: int | None = None  # number of the next crossing forward
        self._previous: tuple[int, int] | None = None  # both numbers at the previous point

    @property
    def trusted(self) -> bool:
        """Whether crossings can be predicted without detections."""
        return self._detections >= c.MIN_DETECTIONS

    def expected(self, near: float) -> float:
        """Return the crossing position [m] nearest to ``near``, NaN before any detection."""
        if not self._detections:
            return math.nan
        return self._position + self._circumference * round(
            (near - self._position) / self._circumference)

    def correct(self, position: float,
                path: Sequence[Point]) -> tuple[bool, list[PredictedCrossing]]:
        """
        Correct with a detection: the films' common center crossed at ``position`` [m].

        ``path`` holds start, reversals and end of the trajectory up to the detection. Return
        whether the mounting position was replaced, which invalidates earlier predictions, and,
        for the first detection, the recent crossings.
        """
        error = position - self.expected(position)
        if abs(error) <= self._gate:
            self._detections += 1
            self._outliers = 0
            self._position += error * max(c.RECURSIVE_GAIN, 1.0 / self._detections)
            return False, []
        first = not self._detections
        self._outliers += 1
        if self._detections > c.MIN_DETECTIONS and self._outliers < c.MIN_DETECTIONS:
            return False, []
        self._position, self._detections, self._outliers = position, 1, 0
        self._next = self._previous = None
        crossings = [crossing for point in path for crossing in self.advance(point)]
        recent = c.LOOKBACK_REVOLUTIONS * self._circumference
        return not first, [crossing for crossing in crossings
                           if first and abs(crossing.position - position) < recent]

    def advance(self, point: Point) -> list[PredictedCrossing]:
        """Follow the trajectory, monotonic since the last point, and return its crossings."""
        if not self._detections:
            return []
        instant, distance = point
        # number of the next crossing forward if the wheel arrived rolling forward, or backward;
        # both are equal unless a film is in the patch
        forward = math.floor((distance - self._position - self._reach) / self._circumference) + 1
        backward = math.ceil((distance - self._position + self._reach) / self._circumference)
        previous, self._previous = self._previous, (forward, backward)
        if self._next is None:
            self._next = _initial_number(previous, forward, backward)
            return []
        first, last = max(self._next, forward - c.REMEMBERED), min(
            self._next, backward + c.REMEMBERED)
        self._next = min(max(self._next, forward), backward)
        return [PredictedCrossing(self._position + self._circumference * n, direction, instant)
                for direction, numbers in ((1, range(first, forward)),
                                           (-1, range(last - 1, backward - 1, -1)))
                for n in numbers]


def _initial_number(previous: tuple[int, int] | None, forward: int, backward: int) -> int | None:
    """Return the number of the next crossing forward, None while it is ambiguous."""
    if forward == backward:
        return forward
    if previous is not None and forward > previous[0]:
        return forward  # all films were outside in between
    return backward if previous is not None and backward < previous[1] else None


class CrossingAssociator:
    """Predicts patch crossings of a group of films, and collects the detections of each."""

    def __init__(self, group: FilmGroup, circumference: float) -> None:
        self._group = group
        self.mount = MountPosition(group, circumference)
        self._detected: deque[FilmCrossing] = deque(maxlen=c.REMEMBERED)
        self.pending: list[PredictedCrossing] = []  # may still be associated with detections

    def add_crossing(self, crossing: FilmCrossing, path: Iterable[Point]) -> None:
        """
        Add a detected film crossing, and learn the films' mounting position from it.

        ``path`` holds start and latest reversals of the trajectory.
        """
        self._detected.append(crossing)
        if crossing.detection.coverage < c.MIN_FREE_COVERAGE:
            return
        begin_ns = crossing.segment.begin_ns
        before = [point for point in path if point[0] < begin_ns]
        replaced, predicted = self.mount.correct(
            crossing.position - self._group.offsets[crossing.segment.film],
            [*before, (begin_ns, crossing.begin)])
        if replaced:
            self.pending = [p for p in self.pending if self.detections(p)]
        self.pending += predicted

    def predict(self, points: Iterable[Point]) -> None:
        """Follow the trajectory through reversals and present position."""
        for point in points:
            self.pending += self.mount.advance(point)

    def detections(self, predicted: PredictedCrossing) -> dict[int, FilmCrossing]:
        """Return the best detection of each film in a predicted crossing."""
        best: dict[int, FilmCrossing] = {}
        for crossing in sorted(self._detected, key=lambda one: one.detection.coverage):
            film = crossing.segment.film
            error = crossing.position - self._group.offsets[film] - predicted.position
            if (crossing.direction == predicted.direction
                    and abs(error) < c.POSITION_GATE * self._group.film_length):
                best[film] = crossing
        return best

    def complete(self, predicted: PredictedCrossing) -> bool:
        """Return whether every film of a predicted crossing was detected."""
        return len(self.detections(predicted)) == len(self._group.films)

    def release(self, ready: Callable[[PredictedCrossing], bool]) -> list[PredictedCrossing]:
        """Remove and return the predicted crossings that are ``ready``."""
        released = [predicted for predicted in self.pending if ready(predicted)]
        self.pending = [predicted for predicted in self.pending if predicted not in released]
        return released

    def take(self, predicted: PredictedCrossing) -> dict[int, FilmCrossing]:
        """Remove and return the detections of a predicted crossing, by film."""
        films = self.detections(predicted)
        for crossing in films.values():
            self._detected.remove(crossing)
        return films

    def drop_before(self, instant: int) -> None:
        """Drop detections in segments that began before ``instant`` [ns], a reversal."""
        self._detected = deque((crossing for crossing in self._detected
                                if crossing.segment.begin_ns >= instant), self._detected.maxlen)
