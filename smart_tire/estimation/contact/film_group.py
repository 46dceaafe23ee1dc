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

"""Geometry and calibration of films on one wheel that cross the patch together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from smart_tire.parameters.robot import RobotParams

ACTIVITY_SHARE = 0.25   # of the bending peak, activity threshold; bumps stay below half of that
ACTIVITY_SIGMAS = 6.0   # standard deviations of a sample, lower limit of the threshold
MIN_INSIDE = 1e-3       # m, with a film as long as the patch: no division by zero


@dataclass(frozen=True, slots=True)
class FilmGroup:
    """
    Films of one wheel that cross the patch together; within the group they count from 0.

    Distances are in the direction of rolling forward.
    """

    films: tuple[int, ...]       # indices of the films on the wheel
    gains: tuple[float, ...]     # V/m
    bending: tuple[float, ...]   # V, bending peaks
    thresholds: tuple[float, ...]  # V, of activity
    offsets: tuple[float, ...]   # m, of film centers from their common center
    half_inside: float    # m, half the distance that a film rolls while fully inside the patch
    half_crossing: float  # m, half the distance from entry to release of a film
    reach: float          # m, half the distance from the first film's entry to the last's release
    rails: tuple[float, float]  # V, samples beyond are clipped

    @classmethod
    def of(cls, robot: RobotParams, wheel: str, films: Sequence[int]) -> FilmGroup:
        """Return the group of ``films``, by index, on ``wheel``."""
        film, patch = robot.film, robot.tire.contact_length
        gains, bending = film.gains(wheel), film.bending(wheel)
        positions = [film.centers[i] for i in films]
        extent = positions[-1] - positions[0]
        half_crossing = 0.5 * (patch + film.length)
        return cls(
            tuple(films), tuple(gains[i] for i in films), tuple(bending[i] for i in films),
            tuple(max(ACTIVITY_SHARE * bending[i], ACTIVITY_SIGMAS * film.noise) for i in films),
            tuple(position - positions[0] - 0.5 * extent for position in positions),
            max(0.5 * abs(patch - film.length), MIN_INSIDE), half_crossing,
            half_crossing + 0.5 * extent,
            (0.5 * film.code_voltage, film.voltage_range - 0.5 * film.code_voltage))
