"""
One instrumented wheel: from its samples and its angle to passages of its films.

Work is done in blocks, when the wheel's angle is known up to some instant with samples beyond
it: a single sample costs no more than its place in a list.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.contact.detection import CrossingDetector
from smart_tire.estimation.contact.prediction import MountPosition, Point, PredictedCrossing
from smart_tire.estimation.contact.records import (
    CrossingSamples, Detection, FilmCrossing, FilmSamples, PatchCrossing)
from smart_tire.estimation.contact.segmentation import ActiveSegment, SegmentExtractor
from smart_tire.estimation.contact.stamp_regularizer import StampRegularizer
from smart_tire.estimation.contact.wheel_trajectory import (
    ReversalDetector, SmoothedTrajectory, TravelSegment, WheelTrajectory)
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import NS_PER_S, TireSample, WHEELS, WheelSample


BLOCK_NS = 100_000_000    # of the wheel's course that is worked off at once, at least
SETTLE_NS = 100_000_000   # the wheel's angle is smooth that long before its newest sample
SILENCE_NS = 500_000_000  # after which a silent wheel is predicted instead of waited for
TURN = 0.003              # m, rolled back before it counts as a turn: more than jitter feigns
PATH_STEP_NS = 8_000_000  # of the course in which passes are looked for
LONGEST_PATH = 1000       # such steps at once
ACTIVE = 0.25             # of the bending peak; bumps stay below half of that
ACTIVE_NOISE = 6.0        # sigmas, likewise
SCATTER = 0.008           # m, around the place where a film that is expected is looked for
BEFORE_ACTIVE = 0.018     # m from a film's entry to its first active sample, at most
WHOLE = 0.7               # coverage of a passage that is believed without being expected
SCRAP = 0.3               # coverage below which not even an expected one is
NEAR = 0.012              # m, between a film's passage and the pass that it belongs to
WAIT = 0.030              # m of travel beyond a pass, after which no film is waited for
LONGEST_WAIT = 0.100      # m, likewise, if a film seems active for want of samples
REST_NS = 200_000_000     # of standing, after which nothing is waited for either
REST_TRAVEL = 5e-4        # m in that time: two counts of the encoder
STEADY = 0.7              # largest relative change of speed in a pass that can be measured
PARTLY_GONE = 0.15        # lost share of a film's passage, of which a part was seen ...
GONE = 0.5                # ... and of one that explains that nothing was seen
SHORTEST = 1e-3           # s, of a film's way while inside: no division by zero
SHORTEST_WAY = 1e-3       # m, likewise, with a film as long as the patch
MARGIN = 0.030            # m of travel before and after a contact: bumps, recovery, some rest
SIGHTINGS = 16            # contacts and film passages remembered, per film


class ContactTracker:
    """
    Finds the passages of a group of one wheel's films, and what was sampled in them.

    ``films`` are indices, those of the first group by default; the films of other groups have
    passages of their own.
    """

    def __init__(self, wheel: str, robot: RobotParams,
                 films: Sequence[int] | None = None) -> None:
        film, encoder, patch = robot.film, robot.encoder, robot.tire.contact_length
        circumference = 2.0 * math.pi * robot.wheel_radius
        self._index, self._patch = WHEELS.index(wheel), patch
        # of the wheel's films, those in the group; from here on films are numbered within it
        self._group = tuple(robot.film_groups[0] if films is None else films)
        self._gains, self._bending = ([values[i] for i in self._group]
                                      for values in (film.gains(wheel), film.bending(wheel)))
        places = [film.places[i] for i in self._group]
        extent = places[-1] - places[0]
        # m, from the films' common middle
        self._offsets = [place - places[0] - 0.5 * extent for place in places]
        self._inside = max(0.5 * abs(patch - film.length), SHORTEST_WAY)
        self._half = 0.5 * (patch + film.length)
        self._reach = self._half + 0.5 * extent
        self._rate = film.sample_rate
        self._rails = 0.5 * film.code, film.voltage_range - 0.5 * film.code
        self._course = WheelTrajectory(robot.wheel_radius, encoder.counts_per_revolution,
                                   encoder.stamp_jitter, encoder.latency)
        self._path = ReversalDetector(
            max(TURN, 2.0 * circumference / encoder.counts_per_revolution))
        self._record = SegmentExtractor(
            [max(ACTIVE * peak, ACTIVE_NOISE * film.noise) for peak in self._bending],
            film.rest_voltage, round(NS_PER_S / film.sample_rate), 2.0 * self._half)
        self._place = MountPosition(circumference, self._reach)
        self._sighter = CrossingDetector(robot)
        self._clock = StampRegularizer(round(NS_PER_S / film.sample_rate))
        self._stamps: list[int] = []
        self._volts: list[tuple[float, ...]] = []
        sightings = SIGHTINGS * len(self._group)
        self._contacts: deque[ActiveSegment] = deque(maxlen=sightings)
        self._seen: deque[FilmCrossing] = deque(maxlen=sightings)
        self._passes: list[PredictedCrossing] = []
        self._horizon_ns: int | None = None
        self.unmeasured = 0  # contacts in which no passage could be recognised

    def add_wheels(self, sample: WheelSample) -> None:
        """Take in the wheels' angles."""
        position = None if sample.position is None else sample.position[self._index]
        self._course.add(sample.stamp_ns, sample.velocity[self._index], position)

    def add_films(self, sample: TireSample) -> None:
        """Take in one conversion of this wheel's films; the last ones may be absent."""
        self._stamps.append(sample.stamp_ns)
        self._volts.append(sample.volts)

    def advance(self, now_ns: int) -> list[PatchCrossing]:
        """Work up to where the wheel's angle is known; return the passages that were completed."""
        newest = self._course.newest_ns
        if newest is None:
            del self._stamps[:], self._volts[:]
            return []
        horizon = max(newest - SETTLE_NS, now_ns - SILENCE_NS)
        if self._horizon_ns is not None and horizon < self._horizon_ns + BLOCK_NS:
            return []
        course, turns = self._follow(horizon)
        self._recognise(self._take(horizon, turns))
        for point in [*turns, course]:
            self._passes += self._place.advance(point)
        resting = bool(self._passes) and self._resting(course)
        if resting or any(self._beyond(p, course) > LONGEST_WAIT for p in self._passes):
            self._recognise(self._record.finish())
        ready: list[PredictedCrossing] = []
        waiting: list[PredictedCrossing] = []
        for p in self._passes:
            (ready if resting or self._complete(p, course) else waiting).append(p)
        self._passes = waiting
        passages = [passage for p in ready if (passage := self._passage(p)) is not None]
        for turn_ns, _ in turns[-1:]:
            self._seen = deque((s for s in self._seen if s.contact.begin_ns >= turn_ns),
                               self._seen.maxlen)
        return passages

    def _follow(self, horizon: int) -> tuple[Point, list[Point]]:
        """Follow the wheel to ``horizon``; return where it is and where it turned round."""
        begin = horizon if self._horizon_ns is None else max(
            self._horizon_ns + PATH_STEP_NS, horizon - LONGEST_PATH * PATH_STEP_NS)
        self._horizon_ns = horizon
        instants = np.array([*range(begin, horizon, PATH_STEP_NS), horizon])
        places = self._course.coarse(instants)
        return (horizon, float(places[-1])), self._path.advance(instants, places)

    def _take(self, horizon: int, turns: list[Point]) -> list[ActiveSegment]:
        """Move the samples up to ``horizon`` to the record; return the contacts that ended."""
        count = bisect_right(self._stamps, horizon)
        instants = self._clock.regular(self._stamps[:count])
        volts = self._columns(self._volts[:count])
        del self._stamps[:count], self._volts[:count]
        places = self._course.coarse(instants)
        return self._record.add(instants, places, volts, [instant for instant, _ in turns])

    def _columns(self, volts: list[tuple[float, ...]]) -> Array:
        """Return ``volts`` as an array (n, films of the group), NaN where a film is absent."""
        films, lengths = max(self._group) + 1, set(map(len, volts))
        if len(lengths) != 1 or min(lengths) < films:
            volts = [(row + (math.nan,) * films)[:films] for row in volts]
        columns = len(volts[0]) if volts else films
        found: Array = np.array(volts).reshape(len(volts), columns)[:, self._group]
        return found

    def _recognise(self, contacts: list[ActiveSegment]) -> None:
        for contact in contacts:
            if len(contact.instants):
                self._contacts.append(contact)
                self._see(contact)

    def _see(self, contact: ActiveSegment) -> None:
        """Look for the passage in a contact, and learn from it where the films sit."""
        course = self._course.smooth(int(contact.instants[0]), int(contact.instants[-1]))
        rolled = course.at(contact.instants)
        begin, end = np.interp((contact.begin_ns, contact.end_ns), contact.instants, rolled)
        direction = 1 if end >= begin else -1
        offset = self._offsets[contact.film]
        expected = self._place.expected(0.5 * (begin + end) - offset) + offset
        distance = direction * rolled
        found = None
        if math.isfinite(expected):
            found = self._look(contact, distance, SCRAP, (
                direction * expected - SCATTER, direction * expected + SCATTER))
        if found is None:
            lead = direction * begin + self._inside
            found = self._look(contact, distance, WHOLE, (
                lead - 2.0 * self._half, lead + BEFORE_ACTIVE))
        if found is None:
            self.unmeasured += 1
            return
        place, way = direction * found.middle, np.maximum.accumulate(distance)
        instant = int(np.interp(found.middle, way, contact.instants))
        self._seen.append(FilmCrossing(place, instant, direction, found, contact))
        if found.coverage >= WHOLE:
            before = [point for point in self._path.turns if point[0] < contact.begin_ns]
            moved, passes = self._place.sight(
                place - offset, [*before, (contact.begin_ns, float(begin))])
            if moved:
                self._passes = [p for p in self._passes if self._films_of(p)]
            self._passes += passes

    def _look(self, contact: ActiveSegment, distance: Array, coverage: float,
              between: tuple[float, float]) -> Detection | None:
        usable = (contact.volts > self._rails[0]) & (contact.volts < self._rails[1])
        seen = self._sighter.look(
            distance[usable], contact.volts[usable] - contact.rest,
            bending=self._bending[contact.film], gain=self._gains[contact.film], between=between)
        return seen if seen is not None and seen.coverage >= coverage else None

    def _films_of(self, p: PredictedCrossing) -> dict[int, FilmCrossing]:
        """Return the best sighting of each film in a pass."""
        films: dict[int, FilmCrossing] = {}
        for seen in self._seen:
            film = seen.contact.film
            off = seen.place - self._offsets[film] - p.place
            best = films.get(film)
            if seen.direction == p.direction and abs(off) < NEAR and (
                    best is None or seen.sighting.coverage >= best.sighting.coverage):
                films[film] = seen
        return films

    def _complete(self, p: PredictedCrossing, here: Point) -> bool:
        """Return whether nothing more can become known about a pass while the wheel rolls."""
        return (len(self._films_of(p)) == len(self._offsets)
                or self._path.direction != p.direction
                or not self._record.active and self._beyond(p, here) > WAIT)

    def _beyond(self, p: PredictedCrossing, here: Point) -> float:
        """Return how far the films are beyond the end of a pass [m]."""
        return p.direction * (here[1] - p.place) - self._reach

    def _resting(self, here: Point) -> bool:
        """Return whether the wheel has been standing for some time."""
        before = self._course.coarse(np.array([here[0] - REST_NS]))
        return abs(here[1] - float(before[0])) < REST_TRAVEL

    def _passage(self, p: PredictedCrossing) -> PatchCrossing | None:
        """Return the passage of all films, None if nothing but the wheel's angle speaks for it."""
        films = self._films_of(p)
        for film in films.values():
            self._seen.remove(film)
        ahead = p.direction * self._reach
        sampled = [int(film.contact.instants[i]) for film in films.values() for i in (0, -1)]
        roll = self._course.roll(p.place - ahead, p.place + ahead, p.end_ns, sampled)
        # where the films' common, and the first one's own middle is at the patch's middle
        common = self._middle(p, films, roll)
        first = common + p.direction * self._offsets[0]
        if not films and not self._explained(p, roll):
            return None
        begin, end = roll.when(first - self._inside), roll.when(first + self._inside)
        speed = 2.0 * self._inside / max((end - begin) / NS_PER_S, SHORTEST)
        turned = any(roll.instants[0] < instant < roll.instants[-1]
                     for instant, _ in self._path.turns)
        change = math.inf if turned else roll.speed_change()
        samples = (self._samples(p.direction, list(films.values()), roll.course, roll.when(first))
                   if films and change < STEADY else None)
        return PatchCrossing(
            roll.when(common), p.direction, speed, roll.course.speed_sigma, change,
            2.0 * self._reach, begin, end, samples)

    def _samples(self, direction: int, films: list[FilmCrossing], course: SmoothedTrajectory,
                 reference_ns: int) -> CrossingSamples:
        """Return the samples of ``films`` over one course of the wheel."""
        begin = min(int(film.contact.instants[0]) for film in films)
        end = max(int(film.contact.instants[-1]) for film in films)
        samples, sightings = [], []
        *middles, reference = (direction * course.at(np.array(
            [*(film.instant_ns for film in films), reference_ns]))).tolist()
        for film, middle in sorted(zip(films, middles), key=lambda both: both[0].contact.film):
            contact = film.contact
            distance = direction * course.at(contact.instants)
            near = np.abs(distance - middle) < self._half + MARGIN
            volts = contact.volts[near]
            rail = (volts > self._rails[1]).astype(np.int8) - (volts < self._rails[0])
            samples.append(FilmSamples(
                self._group[contact.film], distance[near], volts - contact.rest, rail))
            sightings.append(replace(film.sighting, middle=middle))
        return CrossingSamples(
            tuple(samples), tuple(sightings), reference, course.errors(begin, end))

    def _middle(self, p: PredictedCrossing, films: dict[int, FilmCrossing],
                roll: TravelSegment) -> float:
        """Return the way at which the films' common middle is at the patch's middle."""
        if not films:
            return self._reach
        ways = [roll.at(film.instant_ns) - p.direction * self._offsets[film.contact.film]
                for film in films.values()]
        return float(np.average(ways, weights=[f.sighting.coverage for f in films.values()]))

    def _explained(self, p: PredictedCrossing, roll: TravelSegment) -> bool:
        """Return whether a pass that was not seen has contacts or lost samples behind it."""
        gone = 0
        for film, offset in enumerate(self._offsets):
            place = self._reach + p.direction * offset
            begin, middle, end = (roll.when(place + off) for off in (-self._half, 0.0, self._half))
            lost = self._record.lost(begin, end)
            gone += lost > GONE
            for contact in self._contacts:
                if contact.film == film and (
                        contact.begin_ns < middle < contact.end_ns or lost > PARTLY_GONE
                        and contact.begin_ns < end and contact.end_ns > begin):
                    return True
        return self._place.trusted and gone == len(self._offsets)
