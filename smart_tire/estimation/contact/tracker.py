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
From film samples and wheel angle of one wheel to patch crossings.

Each advance of a ``ContactTracker`` follows the order of this package: regularize timestamps,
segment, detect, predict, associate, assemble. It works in blocks, once the wheel angle is known
for an interval of samples; adding a single sample only appends it to a list.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.estimation.contact.assembly import CrossingAssembler
from smart_tire.estimation.contact.association import CrossingAssociator
from smart_tire.estimation.contact.detection import CrossingDetector
from smart_tire.estimation.contact.film_crossing import FilmCrossingDetector
from smart_tire.estimation.contact.film_group import FilmGroup
from smart_tire.estimation.contact.prediction import PredictedCrossing
from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.contact.reversal_detection import ReversalDetector
from smart_tire.estimation.contact.sample_buffer import FilmSampleBuffer
from smart_tire.estimation.contact.segmentation import ActiveSegment, SegmentExtractor
from smart_tire.estimation.contact.wheel_trajectory import Point, WheelTrajectory
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import NS_PER_S, TireSample, WHEELS, WheelSample

MIN_BLOCK_NS = 100_000_000  # of the trajectory that is processed at once
SETTLING_NS = 100_000_000   # before its newest sample, the wheel angle can be smoothed
MAX_SILENCE_NS = 500_000_000  # after which a silent wheel angle is extrapolated
MIN_REVERSAL = 0.003        # m rolled back that count as a reversal: more than timestamp jitter
GRID_STEP_NS = 8_000_000    # of the trajectory in which reversals are searched
MAX_GRID_STEPS = 1000       # at once
MAX_WAIT = 0.030            # m beyond a crossing, after which no detection is awaited
MAX_WAIT_ACTIVE = 0.100     # m beyond a crossing while a film seems active, for lack of samples
STANDSTILL_NS = 200_000_000  # after which no detection is awaited either
STANDSTILL_DISTANCE = 5e-4  # m rolled in that time: two encoder counts


class ContactTracker:
    """
    Finds the patch crossings of a group of one wheel's films, with their samples.

    ``films`` are indices, those of the first group by default; other groups have crossings of
    their own.
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
            max(MIN_REVERSAL, 2.0 * circumference / encoder.counts_per_revolution))
        self._buffer = FilmSampleBuffer(self._group.films, period_ns)
        self._extractor = SegmentExtractor(self._group.thresholds, film.rest_voltage, period_ns,
                                           2.0 * self._group.half_crossing)
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
            self._trajectory.add(sample.stamp_ns, speed, position)

    def add_films(self, sample: TireSample) -> None:
        """Add one conversion of this wheel's films; the last films may be absent."""
        self._buffer.add(sample)

    def advance(self, now_ns: int) -> list[PatchCrossing]:
        """Process samples up to the latest wheel angle; return completed crossings."""
        newest = self._trajectory.newest_ns
        if newest is None:
            self._buffer.clear()
            return []
        horizon = max(newest - SETTLING_NS, now_ns - MAX_SILENCE_NS)
        if self._horizon_ns is not None and horizon < self._horizon_ns + MIN_BLOCK_NS:
            return []
        position, reversals = self._follow(horizon)
        self._detect(self._segment(horizon, reversals))
        self._associator.predict([*reversals, position])
        crossings = self._assemble(self._completed(position))
        if reversals:
            self._associator.drop_before(reversals[-1][0])
        return crossings

    def finish(self, now_ns: int) -> list[PatchCrossing]:
        """Process all samples, the latest at ``now_ns``; return the completed crossings."""
        newest = self._trajectory.newest_ns
        if newest is None:
            return []
        # the last speed applies until the next wheel sample would have arrived
        horizon = max(newest, min(now_ns, newest + MAX_SILENCE_NS), self._horizon_ns or newest)
        position, reversals = self._follow(horizon)
        self._detect(self._segment(horizon, reversals))
        self._detect(self._extractor.finish())
        self._associator.predict([*reversals, position])
        return self._assemble(self._associator.release(lambda predicted: True))

    def _follow(self, horizon: int) -> tuple[Point, list[Point]]:
        """Follow the wheel up to ``horizon``; return its position there, and reversals."""
        begin = horizon if self._horizon_ns is None else max(
            self._horizon_ns + GRID_STEP_NS, horizon - MAX_GRID_STEPS * GRID_STEP_NS)
        self._horizon_ns = horizon
        instants = np.array([*range(begin, horizon, GRID_STEP_NS), horizon])
        distance = self._trajectory.interpolate(instants)
        return (horizon, float(distance[-1])), self._reversals.advance(instants, distance)

    def _segment(self, horizon: int, reversals: list[Point]) -> list[ActiveSegment]:
        """Return the segments that close with the samples up to ``horizon``."""
        instants, volts = self._buffer.take(horizon)
        return self._extractor.add(instants, self._trajectory.interpolate(instants), volts,
                                   [instant for instant, _ in reversals])

    def _detect(self, segments: list[ActiveSegment]) -> None:
        for segment in segments:
            if not len(segment.instants):
                continue
            self._assembler.add(segment)
            crossing = self._detector.detect(segment, self._associator.mount)
            if crossing is None:
                self.undetected += 1
            else:
                self._associator.add(crossing, self._reversals.points)

    def _completed(self, position: Point) -> list[PredictedCrossing]:
        """Return the predicted crossings for which no further detection is awaited."""
        pending = self._associator.pending
        standstill = bool(pending) and self._stands_still(position)
        if standstill or any(self._beyond(p, position) > MAX_WAIT_ACTIVE for p in pending):
            self._detect(self._extractor.finish())
        return self._associator.release(
            lambda predicted: standstill or self._settled(predicted, position))

    def _settled(self, predicted: PredictedCrossing, position: Point) -> bool:
        """Return whether no further detection can be expected while the wheel rolls."""
        return (self._associator.complete(predicted)
                or self._reversals.direction != predicted.direction
                or not self._extractor.active and self._beyond(predicted, position) > MAX_WAIT)

    def _beyond(self, predicted: PredictedCrossing, position: Point) -> float:
        """Return the distance [m] rolled since the end of a predicted crossing."""
        return predicted.direction * (position[1] - predicted.position) - self._group.reach

    def _stands_still(self, position: Point) -> bool:
        before = self._trajectory.interpolate(np.array([position[0] - STANDSTILL_NS]))
        return abs(position[1] - float(before[0])) < STANDSTILL_DISTANCE

    def _assemble(self, completed: list[PredictedCrossing]) -> list[PatchCrossing]:
        found = (self._assembler.assemble(
            predicted, self._associator.take(predicted), self._reversals.points,
            self._associator.mount.trusted) for predicted in completed)
        return [crossing for crossing in found if crossing is not None]
