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
From film samples and wheel angle of one wheel to patch crossings.

Each advance of a ``ContactTracker`` follows the order of this package: regularize timestamps,
segment, detect, predict, associate, assemble. It works in blocks, once the wheel angle is known
for an interval of samples; adding a single sample only appends it to a list.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.estimation.contact import constants as c
from smart_tire.estimation.contact.detection import CrossingDetector, FilmCrossingDetector
from smart_tire.estimation.contact.prediction import CrossingAssociator, PredictedCrossing
from smart_tire.estimation.contact.records import (
    ActiveSegment, CrossingSamples, FilmCrossing, FilmGroup, FilmSamples, PatchCrossing)
from smart_tire.estimation.contact.segmentation import FilmSampleBuffer, SegmentExtractor
from smart_tire.estimation.contact.smoothing import SmoothedTrajectory
from smart_tire.estimation.contact.trajectory import (
    Point, ReversalDetector, TravelSegment, WheelTrajectory)
from smart_tire.estimation.reorder_buffer import GRID_NS
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import NS_PER_S, WHEELS, WheelSample


class ContactTracker:
    """
    Finds the patch crossings of a group of one wheel's films, with their samples.

    ``films`` are indices, those of the first group by default; other groups have crossings of
    their own. Conversions are added to the buffer ``films``.
    """

    def __init__(self, wheel: str, robot: RobotParams,
                 films: Sequence[int] | None = None) -> None:
        film, encoder = robot.film, robot.encoder
        circumference = 2.0 * math.pi * robot.wheel_radius
        period_ns = round(NS_PER_S / film.sample_rate)
        self._wheel_index = WHEELS.index(wheel)
        self._group = FilmGroup.of(robot, wheel, robot.film_groups[0] if films is None else films)
        self._trajectory = WheelTrajectory(
            robot.wheel_radius, encoder.counts_per_revolution, encoder.stamp_jitter,
            encoder.latency)
        self._reversals = ReversalDetector(
            max(c.MIN_REVERSAL * film.length,
                2.0 * circumference / encoder.counts_per_revolution))
        self.films = FilmSampleBuffer(self._group.films, period_ns)
        self._extractor = SegmentExtractor(self._group, film.rest_voltage, period_ns)
        self._detector = FilmCrossingDetector(
            self._group, CrossingDetector(robot), self._trajectory)
        self._associator = CrossingAssociator(self._group, circumference)
        self._assembler = CrossingAssembler(self._group, self._trajectory, self._extractor)
        self._horizon_ns: int | None = None
        self.undetected = 0  # active segments without a detected crossing

    def add_wheels(self, sample: WheelSample) -> None:
        """Add angles and speeds of the wheels."""
        position = None if sample.position is None else sample.position[self._wheel_index]
        speed = sample.velocity[self._wheel_index]
        if not math.isnan(speed):
            self._trajectory.add_wheel(sample.stamp_ns, speed, position)

    def advance(self, now_ns: int) -> list[PatchCrossing]:
        """Process samples up to the latest wheel angle; return completed crossings."""
        newest = self._trajectory.newest_ns
        if newest is None:
            self.films.clear()
            return []
        horizon = max(newest - c.SETTLING_NS, now_ns - c.MAX_SILENCE_NS)
        if self._horizon_ns is not None and horizon < self._horizon_ns + c.SETTLING_NS:
            return []
        return self._advance(horizon, last=False)

    def finish(self, now_ns: int) -> list[PatchCrossing]:
        """Process all samples, the latest at ``now_ns``; return the completed crossings."""
        newest = self._trajectory.newest_ns
        if newest is None:
            return []
        # the last speed applies until the next wheel sample would have arrived
        horizon = max(newest, min(now_ns, newest + c.MAX_SILENCE_NS), self._horizon_ns or newest)
        return self._advance(horizon, last=True)

    def _advance(self, horizon: int, last: bool) -> list[PatchCrossing]:
        """Process samples up to ``horizon``; if it is the ``last`` one, await nothing further."""
        position, reversals = self._follow(horizon)
        instants, volts = self.films.take(horizon)
        self._detect(self._extractor.extend(
            instants, self._trajectory.interpolate(instants), volts,
            [instant for instant, _ in reversals]))
        self._associator.predict([*reversals, position])
        last = last or bool(self._associator.pending) and self._stands_still(position)
        if last:
            self._detect(self._extractor.finish())
            self._associator.predict([position])
        found = [self._assembler.assemble(
            predicted, self._associator.take(predicted), self._reversals.points,
            self._associator.mount.trusted) for predicted in self._associator.release(
                lambda predicted: last or self._settled(predicted, position))]
        if reversals:
            self._associator.drop_before(reversals[-1][0])
        return [crossing for crossing in found if crossing is not None]

    def _follow(self, horizon: int) -> tuple[Point, list[Point]]:
        """Follow the wheel up to ``horizon``; return its position there, and reversals."""
        begin = horizon if self._horizon_ns is None else max(
            self._horizon_ns + GRID_NS, horizon - c.HISTORY_LENGTH * GRID_NS)
        self._horizon_ns = horizon
        instants = np.array([*range(begin, horizon, GRID_NS), horizon])
        distance = self._trajectory.interpolate(instants)
        return (horizon, float(distance[-1])), self._reversals.follow(instants, distance)

    def _detect(self, segments: list[ActiveSegment]) -> None:
        for segment in segments:
            if not len(segment.instants):
                continue
            self._assembler.add_segment(segment)
            crossing = self._detector.detect(segment, self._associator.mount)
            if crossing is None:
                self.undetected += 1
            else:
                self._associator.add_crossing(crossing, self._reversals.points)

    def _settled(self, predicted: PredictedCrossing, position: Point) -> bool:
        """Return whether no further detection can be expected while the wheel rolls."""
        since = predicted.direction * (position[1] - predicted.position) - self._group.reach  # m
        return (self._associator.complete(predicted)
                or self._reversals.direction != predicted.direction
                or not self._extractor.active
                and since > c.OUTER_LENGTH * self._group.film_length)

    def _stands_still(self, position: Point) -> bool:
        before = self._trajectory.interpolate(np.array([position[0] - c.STANDSTILL_NS]))
        limit = c.MIN_FILM_SPEED * self._group.film_length * c.STANDSTILL_NS / NS_PER_S
        return abs(position[1] - float(before[0])) < limit


class CrossingAssembler:
    """Assembles the patch crossings of a group of films."""

    def __init__(self, group: FilmGroup, trajectory: WheelTrajectory,
                 extractor: SegmentExtractor) -> None:
        self._group, self._trajectory, self._extractor = group, trajectory, extractor
        self._segments: deque[ActiveSegment] = deque(maxlen=c.REMEMBERED)

    def add_segment(self, segment: ActiveSegment) -> None:
        """Remember an active segment, as evidence of a crossing without detections."""
        self._segments.append(segment)

    def assemble(self, predicted: PredictedCrossing, films: dict[int, FilmCrossing],
                 reversals: Iterable[Point], trusted: bool) -> PatchCrossing | None:
        """
        Return the crossing of all films, None if only the wheel angle supports it.

        ``films`` are the detections by film, ``reversals`` the latest ones, and ``trusted`` is
        whether the prediction is sufficient where samples were lost.
        """
        group, direction = self._group, predicted.direction
        ahead = direction * group.reach
        sampled = [int(film.segment.instants[i]) for film in films.values() for i in (0, -1)]
        travel = self._trajectory.segment(predicted.position - ahead, predicted.position + ahead,
                                          predicted.end_ns, sampled)
        # distances with the common center, and that of film 1, at the patch center
        common = self._common_center(direction, films, travel)
        first = common + direction * group.offsets[0]
        if not films and not self._explained(direction, travel, trusted):
            return None
        begin, end = (travel.instant_at(first + sign * group.half_inside) for sign in (-1.0, 1.0))
        speed = 2.0 * group.half_inside * NS_PER_S / max(end - begin, 1)
        reversed_inside = any(travel.instants[0] < instant < travel.instants[-1]
                              for instant, _ in reversals)
        change = math.inf if reversed_inside else travel.speed_change(group.film_length)
        samples = (self._samples(direction, list(films.values()), travel.trajectory,
                                 travel.instant_at(first), sampled)
                   if films and change < c.MAX_SPEED_CHANGE else None)
        return PatchCrossing(
            travel.instant_at(common), direction, speed, travel.trajectory.speed_sigma, change,
            2.0 * group.reach, begin, end, samples)

    def _samples(self, direction: int, films: list[FilmCrossing], trajectory: SmoothedTrajectory,
                 reference_ns: int, sampled: Sequence[int]) -> CrossingSamples:
        """Return the samples of ``films`` over distance, from one trajectory for all."""
        samples, detections = [], []
        low, high = self._group.rails
        *centers, reference = (direction * trajectory.distance_at(np.array(
            [*(film.instant_ns for film in films), reference_ns]))).tolist()
        for film, center in sorted(zip(films, centers), key=lambda both: both[0].segment.film):
            segment = film.segment
            distance = direction * trajectory.distance_at(segment.instants)
            near = np.isfinite(segment.volts) & (np.abs(distance - center) < (  # NaN: no film
                self._group.half_crossing + c.OUTER_LENGTH * self._group.film_length))
            volts = segment.volts[near]
            rail = (volts > high).astype(np.int8) - (volts < low)
            samples.append(FilmSamples(self._group.films[segment.film], distance[near],
                                       volts - segment.baseline, rail))
            detections.append(replace(film.detection, center=center))
        return CrossingSamples(tuple(samples), tuple(detections), reference,
                               trajectory.errors(min(sampled), max(sampled)))

    def _common_center(self, direction: int, films: dict[int, FilmCrossing],
                       travel: TravelSegment) -> float:
        """Return the distance in ``travel`` with the common center at the patch center."""
        if not films:
            return self._group.reach
        centers = [travel.distance_at(film.instant_ns)
                   - direction * self._group.offsets[film.segment.film]
                   for film in films.values()]
        return float(np.average(centers, weights=[film.detection.coverage
                                                  for film in films.values()]))

    def _explained(self, direction: int, travel: TravelSegment, trusted: bool) -> bool:
        """Return whether activity or lost samples support a crossing without detections."""
        lost_films, half = 0, self._group.half_crossing
        for film, offset in enumerate(self._group.offsets):
            position = self._group.reach + direction * offset
            begin, center, end = (travel.instant_at(position + by) for by in (-half, 0.0, half))
            lost = self._extractor.lost_share(begin, end) > 1.0 - c.MIN_FREE_COVERAGE
            lost_films += lost
            if not lost:
                begin = end = center
            if any(segment.film == film and segment.begin_ns < end and segment.end_ns > begin
                   for segment in self._segments):
                return True
        return trusted and lost_films == len(self._group.offsets)
