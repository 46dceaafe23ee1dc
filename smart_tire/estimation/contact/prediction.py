"""
Passages of a wheel's films through the patch, from the wheel's angle alone.

Once it is known where on the wheel the films sit, the rolled distance says when all of them went
through the patch from one side to the other: so a passage that the radio lost is not missed, and
one that stops inside and rolls back out does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

LEARNING = 0.2        # least share of a new sighting in the films' place
TOLERANCE = 0.010     # m, between a sighting and the place: more than a fit from scraps is wrong
TRUSTED = 2           # sightings that agree, after which the place is trusted
RECENT = 2.5          # turns of the wheel, in which a first sighting finds earlier passes
MOST_PASSES = 100     # the latest ones between two points: no wheel is followed for longer
MARGIN = 0.001        # m, that the films must be out of the patch: the jitter of the coarse course

Point = tuple[int, float]  # instant [ns] and rolled distance [m]


@dataclass(frozen=True, slots=True)
class PredictedCrossing:
    """All films of a wheel went through the whole patch."""

    place: float    # m, rolled distance when the films' common middle is at the patch's middle
    direction: int  # +1 forward, -1 backward
    end_ns: int     # not before the last film left


class MountPosition:
    """
    Where on the wheel the films sit, learned from sightings, and their passes.

    The wheel's circumference and the distance ``reach`` from the middle of the patch, at which
    the films' middle is when the last film leaves, are in m.
    """

    def __init__(self, circumference: float, reach: float) -> None:
        self._round = circumference
        self._reach = reach + MARGIN
        self._place = math.nan   # m, rolled distance of some pass, modulo the circumference
        self._sightings = 0
        self._strangers = 0      # sightings in a row that disagree
        self._turn: int | None = None  # number of the pass that would come next forward
        self._before: tuple[int, int] | None = None  # the two numbers at the point before

    @property
    def trusted(self) -> bool:
        """Whether passes can be told without seeing the films."""
        return self._sightings >= TRUSTED

    def expected(self, near: float) -> float:
        """Return the place [m] of the pass nearest to ``near``, NaN before the first sighting."""
        if not self._sightings:
            return math.nan
        return self._place + self._round * round((near - self._place) / self._round)

    def sight(self, place: float, path: Sequence[Point]) -> tuple[bool, list[PredictedCrossing]]:
        """
        Learn from a film that was seen to pass: the films' middle passed ``place`` [m].

        ``path`` holds begin, turning points and end of the course up to when the film was seen.
        Return whether the place moved, so that passes at the old one mean nothing, and, with the
        first sighting, the recent passes that are known only now.
        """
        off = place - self.expected(place)
        if abs(off) <= TOLERANCE:
            self._sightings += 1
            self._strangers = 0
            self._place += off * max(LEARNING, 1.0 / self._sightings)
            return False, []
        first = not self._sightings
        self._strangers += 1
        if self._sightings > TRUSTED and self._strangers < TRUSTED:
            return False, []
        self._place, self._sightings, self._strangers = place, 1, 0
        self._turn = self._before = None
        passes = [p for point in path for p in self.advance(point)]
        recent = RECENT * self._round
        return not first, [p for p in passes if first and abs(p.place - place) < recent]

    def advance(self, point: Point) -> list[PredictedCrossing]:
        """Follow the course to ``point``, monotonic since the last one; return the passes."""
        if not self._sightings:
            return []
        instant, distance = point
        # numbers of the next pass forward, had the wheel come here rolling forward or backward;
        # they are the same unless a film is in the patch
        forward = math.floor((distance - self._place - self._reach) / self._round) + 1
        backward = math.ceil((distance - self._place + self._reach) / self._round)
        before, self._before = self._before, (forward, backward)
        if self._turn is None:
            self._turn = _begin(before, forward, backward)
            return []
        first, last = max(self._turn, forward - MOST_PASSES), min(
            self._turn, backward + MOST_PASSES)
        passes = ([self._pass(n, 1, instant) for n in range(first, forward)]
                  + [self._pass(n, -1, instant) for n in range(last - 1, backward - 1, -1)])
        self._turn = min(max(self._turn, forward), backward)
        return passes

    def _pass(self, number: int, direction: int, instant: int) -> PredictedCrossing:
        return PredictedCrossing(self._place + self._round * number, direction, instant)


def _begin(before: tuple[int, int] | None, forward: int, backward: int) -> int | None:
    """Return the number of the next pass forward, None while it is not known from which side."""
    if forward == backward:
        return forward
    if before is not None and forward > before[0]:
        return forward  # all films were outside on the way
    return backward if before is not None and backward < before[1] else None
