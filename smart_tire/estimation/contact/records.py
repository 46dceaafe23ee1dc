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

"""Records of patch crossings, exchanged between detection, association and waveform fit."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.estimation.contact.segmentation import ActiveSegment
from smart_tire.estimation.contact.trajectory_error import TrajectoryErrors


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
