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

"""Film crossings in active segments: samples over rolled distance, through the detector."""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.contact.detection import CrossingDetector
from smart_tire.estimation.contact.film_group import FilmGroup
from smart_tire.estimation.contact.prediction import MountPosition
from smart_tire.estimation.contact.records import Detection, FilmCrossing
from smart_tire.estimation.contact.segmentation import ActiveSegment
from smart_tire.estimation.contact.wheel_trajectory import WheelTrajectory

SEARCH_MARGIN = 0.008        # m, around the expected position of a film
MAX_ENTRY_DISTANCE = 0.018   # m from a film's entry to its first active sample
MIN_FREE_COVERAGE = 0.7      # of a crossing that is accepted without being expected
MIN_EXPECTED_COVERAGE = 0.3  # of an expected crossing


class FilmCrossingDetector:
    """Detects the crossing of one film of ``group`` in an active segment."""

    def __init__(self, group: FilmGroup, detector: CrossingDetector,
                 trajectory: WheelTrajectory) -> None:
        self._group, self._detector, self._trajectory = group, detector, trajectory

    def detect(self, segment: ActiveSegment, mount: MountPosition) -> FilmCrossing | None:
        """
        Return the crossing in ``segment``, None if there is none.

        The position expected from ``mount`` is searched first, then the whole segment.
        """
        group = self._group
        trajectory = self._trajectory.smooth(int(segment.instants[0]), int(segment.instants[-1]))
        rolled = trajectory.distance_at(segment.instants)
        begin, end = np.interp((segment.begin_ns, segment.end_ns), segment.instants, rolled)
        direction = 1 if end >= begin else -1
        offset = group.offsets[segment.film]
        expected = direction * (mount.expected(0.5 * (begin + end) - offset) + offset)
        distance = direction * rolled
        found = None
        if math.isfinite(expected):
            found = self._search(segment, distance, MIN_EXPECTED_COVERAGE, (
                expected - SEARCH_MARGIN, expected + SEARCH_MARGIN))
        if found is None:
            latest = direction * begin + group.half_inside
            found = self._search(segment, distance, MIN_FREE_COVERAGE, (
                latest - 2.0 * group.half_crossing, latest + MAX_ENTRY_DISTANCE))
        if found is None:
            return None
        instant = int(np.interp(found.center, np.maximum.accumulate(distance), segment.instants))
        return FilmCrossing(direction * found.center, instant, direction, float(begin), found,
                            segment)

    def _search(self, segment: ActiveSegment, distance: Array, coverage: float,
                between: tuple[float, float]) -> Detection | None:
        low, high = self._group.rails
        unclipped = (segment.volts > low) & (segment.volts < high)
        found = self._detector.detect(
            distance[unclipped], segment.volts[unclipped] - segment.baseline,
            bending=self._group.bending[segment.film], gain=self._group.gains[segment.film],
            between=between)
        return found if found is not None and found.coverage >= coverage else None
