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
Predicts patch crossings from the wheel angle once the films' mounting position is known.

The rolled distance then determines when all films have moved through the patch from one side to
the other. A crossing lost by the radio is therefore not missed, and a film that enters the patch
and rolls back out is not counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from smart_tire.estimation.contact.wheel_trajectory import Point

MIN_UPDATE_GAIN = 0.2        # smallest share of a new detection in the mounting position
POSITION_TOLERANCE = 0.010   # m, between detection and position: fits of sparse samples are worse
MIN_DETECTIONS = 2           # consistent detections after which the position is trusted
LOOKBACK_REVOLUTIONS = 2.5   # before a first detection, in which earlier crossings are reported
MAX_CROSSINGS_PER_STEP = 100  # per call to advance: bounds the work after an implausible angle
CLEARANCE_MARGIN = 0.001     # m between film and patch: jitter of the interpolated trajectory


@dataclass(frozen=True, slots=True)
class PredictedCrossing:
    """All films of a wheel moved through the whole patch."""

    position: float  # m, rolled distance with the films' common center at the patch center
    direction: int   # +1 forward, -1 backward
    end_ns: int      # not before the last film left the patch


class MountPosition:
    """
    Position of the films on the wheel, learned from detections, and their crossings.

    ``circumference`` is that of the wheel [m]; ``reach`` [m] is the distance between film center
    and patch center at which the last film leaves the patch.
    """

    def __init__(self, circumference: float, reach: float) -> None:
        self._circumference = circumference
        self._reach = reach + CLEARANCE_MARGIN
        self._position = math.nan  # m, rolled distance of a crossing, modulo the circumference
        self._detections = 0
        self._outliers = 0         # consecutive detections that contradict the position
        self._next: int | None = None  # number of the next crossing forward
        self._previous: tuple[int, int] | None = None  # both numbers at the previous point

    @property
    def trusted(self) -> bool:
        """Whether crossings can be predicted without detections."""
        return self._detections >= MIN_DETECTIONS

    def expected(self, near: float) -> float:
        """Return the crossing position [m] nearest to ``near``, NaN before any detection."""
        if not self._detections:
            return math.nan
        return self._position + self._circumference * round(
            (near - self._position) / self._circumference)

    def update(self, position: float,
               path: Sequence[Point]) -> tuple[bool, list[PredictedCrossing]]:
        """
        Update with a detection: the films' common center crossed at ``position`` [m].

        ``path`` holds start, reversals and end of the trajectory up to the detection. Return
        whether the mounting position was replaced, which invalidates earlier predictions, and,
        for the first detection, the recent crossings.
        """
        error = position - self.expected(position)
        if abs(error) <= POSITION_TOLERANCE:
            self._detections += 1
            self._outliers = 0
            self._position += error * max(MIN_UPDATE_GAIN, 1.0 / self._detections)
            return False, []
        first = not self._detections
        self._outliers += 1
        if self._detections > MIN_DETECTIONS and self._outliers < MIN_DETECTIONS:
            return False, []
        self._position, self._detections, self._outliers = position, 1, 0
        self._next = self._previous = None
        crossings = [crossing for point in path for crossing in self.advance(point)]
        recent = LOOKBACK_REVOLUTIONS * self._circumference
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
        first, last = max(self._next, forward - MAX_CROSSINGS_PER_STEP), min(
            self._next, backward + MAX_CROSSINGS_PER_STEP)
        crossings = ([self._crossing(n, 1, instant) for n in range(first, forward)]
                     + [self._crossing(n, -1, instant)
                        for n in range(last - 1, backward - 1, -1)])
        self._next = min(max(self._next, forward), backward)
        return crossings

    def _crossing(self, number: int, direction: int, instant: int) -> PredictedCrossing:
        return PredictedCrossing(self._position + self._circumference * number, direction, instant)


def _initial_number(previous: tuple[int, int] | None, forward: int, backward: int) -> int | None:
    """Return the number of the next crossing forward, None while it is ambiguous."""
    if forward == backward:
        return forward
    if previous is not None and forward > previous[0]:
        return forward  # all films were outside in between
    return backward if previous is not None and backward < previous[1] else None
