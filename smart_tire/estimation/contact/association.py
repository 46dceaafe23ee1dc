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

"""Association of detected film crossings with predicted patch crossings."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence

from smart_tire.estimation.contact.film_crossing import MIN_FREE_COVERAGE
from smart_tire.estimation.contact.film_group import FilmGroup
from smart_tire.estimation.contact.prediction import MountPosition, PredictedCrossing
from smart_tire.estimation.contact.records import FilmCrossing
from smart_tire.estimation.contact.wheel_trajectory import Point

POSITION_GATE = 0.012  # m, between a film's detection and the predicted crossing of its group
MAX_CROSSINGS = 16     # film crossings remembered, per film


class CrossingAssociator:
    """Predicts patch crossings of a group of films, and collects the detections of each."""

    def __init__(self, group: FilmGroup, circumference: float) -> None:
        self._group = group
        self.mount = MountPosition(circumference, group.reach)
        self._detected: deque[FilmCrossing] = deque(maxlen=MAX_CROSSINGS * len(group.films))
        self._pending: list[PredictedCrossing] = []

    @property
    def pending(self) -> Sequence[PredictedCrossing]:
        """Predicted crossings that may still be associated with detections."""
        return self._pending

    def add(self, crossing: FilmCrossing, path: Iterable[Point]) -> None:
        """
        Add a detected film crossing, and learn the films' mounting position from it.

        ``path`` holds start and latest reversals of the trajectory.
        """
        self._detected.append(crossing)
        if crossing.detection.coverage < MIN_FREE_COVERAGE:
            return
        begin_ns = crossing.segment.begin_ns
        before = [point for point in path if point[0] < begin_ns]
        replaced, predicted = self.mount.update(
            crossing.position - self._group.offsets[crossing.segment.film],
            [*before, (begin_ns, crossing.begin)])
        if replaced:
            self._pending = [p for p in self._pending if self.detections(p)]
        self._pending += predicted

    def predict(self, points: Iterable[Point]) -> None:
        """Follow the trajectory through reversals and present position."""
        for point in points:
            self._pending += self.mount.advance(point)

    def detections(self, predicted: PredictedCrossing) -> dict[int, FilmCrossing]:
        """Return the best detection of each film in a predicted crossing."""
        best: dict[int, FilmCrossing] = {}
        for crossing in self._detected:
            film = crossing.segment.film
            error = crossing.position - self._group.offsets[film] - predicted.position
            other = best.get(film)
            if crossing.direction == predicted.direction and abs(error) < POSITION_GATE and (
                    other is None or crossing.detection.coverage >= other.detection.coverage):
                best[film] = crossing
        return best

    def complete(self, predicted: PredictedCrossing) -> bool:
        """Return whether every film of a predicted crossing was detected."""
        return len(self.detections(predicted)) == len(self._group.films)

    def release(self, ready: Callable[[PredictedCrossing], bool]) -> list[PredictedCrossing]:
        """Remove and return the predicted crossings that are ``ready``."""
        released: list[PredictedCrossing] = []
        pending: list[PredictedCrossing] = []
        for predicted in self._pending:
            (released if ready(predicted) else pending).append(predicted)
        self._pending = pending
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
