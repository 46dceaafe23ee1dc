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

"""Reversals of a wheel's direction of rolling."""

from __future__ import annotations

from smart_tire.arrays import Array, Instants
from smart_tire.estimation.contact.wheel_trajectory import Point

MAX_REVERSALS = 16  # remembered


class ReversalDetector:
    """
    Detects reversals of a rolled distance; rolling back by less than ``hysteresis`` [m] is none.

    ``points`` are the start and the latest reversals, ``direction`` is the present one: +1
    forward, -1 backward, 0 before the first motion.
    """

    def __init__(self, hysteresis: float) -> None:
        self._hysteresis = hysteresis
        self.direction = 0
        self.points: list[Point] = []
        self._extreme: Point | None = None

    def advance(self, instants: Instants, distance: Array) -> list[Point]:
        """Follow the trajectory; return the reversals in it."""
        if not len(instants):
            return []
        if self._extreme is None:
            self._extreme = (int(instants[0]), float(distance[0]))
            self.points = [self._extreme]
        found = []
        for instant, position in zip(instants.tolist(), distance.tolist()):
            moved = position - self._extreme[1]
            if self.direction * moved < -self._hysteresis or (
                    not self.direction and abs(moved) > self._hysteresis):
                if self.direction:
                    found.append(self._extreme)
                self.direction = 1 if moved > 0.0 else -1
                self._extreme = (instant, position)
            elif self.direction * moved > 0.0:
                self._extreme = (instant, position)
        self.points = (self.points + found)[-MAX_REVERSALS:]
        return found
