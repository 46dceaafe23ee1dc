# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Records of patch crossings, exchanged between segmentation, detection and waveform fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array, Instants
from smart_tire.estimation.contact.constants import ACTIVITY_SHARE, CLEARANCE
from smart_tire.parameters.robot import RobotParams


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
    film_length: float    # m
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
            tuple(ACTIVITY_SHARE * bending[i] for i in films),
            tuple(position - positions[0] - 0.5 * extent for position in positions), film.length,
            max(0.5 * abs(patch - film.length), CLEARANCE * film.length), half_crossing,
            half_crossing + 0.5 * extent,
            (0.5 * film.code_voltage, film.voltage_range - 0.5 * film.code_voltage))


@dataclass(frozen=True, slots=True, eq=False)
class ActiveSegment:
    """Samples of one film while it was active and the wheel rolled in one direction."""

    film: int           # index, 0 for film 1
    begin_ns: int       # first active sample
    end_ns: int         # last active sample
    instants: Instants  # ns, of the samples, including some before and after
    volts: Array        # V, as sampled
    baseline: float     # V


@dataclass(frozen=True, slots=True)
class Detection:
    """Coarse estimate of a film's crossing by the matched filter."""

    center: float    # m, rolled distance with the film center at the patch center
    bending: float   # V, bending peak
    slip: float      # -, B(3)'s lambda
    normalized_slip: float  # -, total slip / critical slip, one of ``NORMALIZED_SLIPS``
    coverage: float  # share of the distance from entry to release that was sampled, 0 to 1


@dataclass(frozen=True, slots=True)
class FilmCrossing:
    """Detected crossing of one film."""

    position: float  # m, rolled distance with the film center at the patch center ...
    instant_ns: int  # ... and the instant
    direction: int   # +1 forward, -1 backward
    begin: float     # m, rolled distance at the first active sample
    detection: Detection
    segment: ActiveSegment


@dataclass(frozen=True, slots=True)
class TrajectoryErrors:
    """
    Standard deviations of the errors of the distances in a crossing.

    ``shape_sigmas`` [m] belong to Legendre polynomials of order 2, 3, ... over the sampled
    distance.
    """

    scale_sigma: float = 0.0  # -, relative, of the scale
    shape_sigmas: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class FilmSamples:
    """Samples of one film around a crossing."""

    film: int        # index of the film on the wheel, 0 for film 1
    distance: Array  # m, (n,), rolled in the direction of motion
    volts: Array     # V, (n,), above baseline
    rail: NDArray[np.int8]  # (n,), 1 where clipped at the upper rail, -1 at the lower, else 0


@dataclass(frozen=True, slots=True, eq=False)
class CrossingSamples:
    """
    Samples of a wheel's films in one patch crossing, with the detection of each film.

    ``reference`` [m] is the distance at which slip and normalized slip are estimated.
    """

    films: tuple[FilmSamples, ...]
    detections: tuple[Detection, ...]
    reference: float
    errors: TrajectoryErrors = field(default_factory=TrajectoryErrors)


@dataclass(frozen=True, slots=True)
class PatchCrossing:
    """
    All films of a wheel moved through the patch; ``samples`` are those of the detected films.

    Slip and load refer to the interval from ``begin_ns`` to ``end_ns``, while the first film was
    fully inside; ``samples.reference`` is its center.
    """

    stamp_ns: int        # films' common center at the patch center, by the detections
    direction: int       # +1 forward, -1 backward
    speed: float         # m/s, r |omega|
    speed_sigma: float   # m/s
    speed_change: float  # relative, while any film was in the patch ...
    distance: float      # m, rolled meanwhile
    begin_ns: int
    end_ns: int
    samples: CrossingSamples | None  # None without a detected film, or if speed_change is large
