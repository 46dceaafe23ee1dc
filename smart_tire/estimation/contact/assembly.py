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

"""Assembly of a patch crossing from a prediction, film detections and the wheel's trajectory."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import replace
import math

import numpy as np

from smart_tire.estimation.contact.film_group import FilmGroup
from smart_tire.estimation.contact.prediction import PredictedCrossing
from smart_tire.estimation.contact.records import (
    CrossingSamples, FilmCrossing, FilmSamples, PatchCrossing)
from smart_tire.estimation.contact.segmentation import ActiveSegment, SegmentExtractor
from smart_tire.estimation.contact.trajectory_smoothing import SmoothedTrajectory
from smart_tire.estimation.contact.wheel_trajectory import (
    Point, TravelSegment, WheelTrajectory)
from smart_tire.samples import NS_PER_S

SAMPLE_MARGIN = 0.030     # m of samples before and after a film's crossing: bumps, recovery
MAX_SPEED_CHANGE = 0.7    # relative, in a crossing whose waveform can be fitted
LOST_SHARE_PARTIAL = 0.15  # of a film crossing's time without samples, of which a part was active
LOST_SHARE_WHOLE = 0.5    # of a film crossing's time without samples, that explains no detection
MIN_INSIDE_TIME = 1e-3    # s, of a film fully inside the patch: no division by zero
MAX_SEGMENTS = 16         # remembered, per film


class CrossingAssembler:
    """Assembles the patch crossings of a group of films."""

    def __init__(self, group: FilmGroup, trajectory: WheelTrajectory,
                 extractor: SegmentExtractor) -> None:
        self._group, self._trajectory, self._extractor = group, trajectory, extractor
        self._segments: deque[ActiveSegment] = deque(maxlen=MAX_SEGMENTS * len(group.films))

    def add(self, segment: ActiveSegment) -> None:
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
        speed = 2.0 * group.half_inside / max((end - begin) / NS_PER_S, MIN_INSIDE_TIME)
        reversed_inside = any(travel.instants[0] < instant < travel.instants[-1]
                              for instant, _ in reversals)
        change = math.inf if reversed_inside else travel.speed_change()
        samples = (self._samples(direction, list(films.values()), travel.trajectory,
                                 travel.instant_at(first))
                   if films and change < MAX_SPEED_CHANGE else None)
        return PatchCrossing(
            travel.instant_at(common), direction, speed, travel.trajectory.speed_sigma, change,
            2.0 * group.reach, begin, end, samples)

    def _samples(self, direction: int, films: list[FilmCrossing], trajectory: SmoothedTrajectory,
                 reference_ns: int) -> CrossingSamples:
        """Return the samples of ``films`` over distance, from one trajectory for all."""
        begin = min(int(film.segment.instants[0]) for film in films)
        end = max(int(film.segment.instants[-1]) for film in films)
        samples, detections = [], []
        low, high = self._group.rails
        *centers, reference = (direction * trajectory.distance_at(np.array(
            [*(film.instant_ns for film in films), reference_ns]))).tolist()
        for film, center in sorted(zip(films, centers), key=lambda both: both[0].segment.film):
            segment = film.segment
            distance = direction * trajectory.distance_at(segment.instants)
            near = np.abs(distance - center) < self._group.half_crossing + SAMPLE_MARGIN
            volts = segment.volts[near]
            rail = (volts > high).astype(np.int8) - (volts < low)
            samples.append(FilmSamples(self._group.films[segment.film], distance[near],
                                       volts - segment.baseline, rail))
            detections.append(replace(film.detection, center=center))
        return CrossingSamples(tuple(samples), tuple(detections), reference,
                               trajectory.errors(begin, end))

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
            lost = self._extractor.lost_share(begin, end)
            lost_films += lost > LOST_SHARE_WHOLE
            for segment in self._segments:
                if segment.film == film and (
                        segment.begin_ns < center < segment.end_ns or lost > LOST_SHARE_PARTIAL
                        and segment.begin_ns < end and segment.end_ns > begin):
                    return True
        return trusted and lost_films == len(self._group.offsets)
