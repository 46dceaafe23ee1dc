"""Records of patch crossings: what detection, tracker and waveform fit hand to each other."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.estimation.contact.segmentation import ActiveSegment
from smart_tire.estimation.contact.trajectory_error import TrajectoryErrors


@dataclass(frozen=True, slots=True)
class Detection:
    """A film's passage, as far as a first look tells."""

    middle: float    # m, rolled distance at which film's and patch's middle coincide
    bending: float   # V
    slip: float      # -, B(3)'s lambda
    sliding: float   # -, total slip / critical slip, one of ``SLIDINGS``
    coverage: float  # share of the way from entry to release that was sampled, 0 to 1


@dataclass(frozen=True, slots=True)
class FilmCrossing:
    """One film, seen to pass."""

    place: float     # m, rolled distance when its middle is at the patch's middle ...
    instant_ns: int  # ... and the instant
    direction: int   # +1 forward, -1 backward
    sighting: Detection
    contact: ActiveSegment


@dataclass(frozen=True, slots=True, eq=False)
class FilmSamples:
    """Samples of one film around a passage."""

    film: int        # index of the film on the wheel, 0 for film 1
    distance: Array  # m, (n,), rolled in the direction of motion
    volts: Array     # V, (n,), above rest
    rail: NDArray[np.int8]  # (n,), 1 where clipped at the upper rail, -1 at the lower, else 0


@dataclass(frozen=True, slots=True, eq=False)
class CrossingSamples:
    """
    Samples of the films of a wheel in one passage, film by film, and where each was sighted.

    ``reference`` [m] is the distance for which slip and sliding are told.
    """

    films: tuple[FilmSamples, ...]
    sightings: tuple[Detection, ...]
    reference: float
    errors: TrajectoryErrors = field(default_factory=TrajectoryErrors)


@dataclass(frozen=True, slots=True)
class PatchCrossing:
    """
    All films of a wheel went through the patch; ``samples`` are those of the films that were seen.

    Slip and load are meant from ``begin_ns`` to ``end_ns``, while the first film was fully inside,
    and ``samples.reference`` is the middle of that.
    """

    stamp_ns: int        # films' common middle at the patch's middle, as it was sighted
    direction: int       # +1 forward, -1 backward
    speed: float         # m/s, r |omega|
    speed_sigma: float   # m/s
    speed_change: float  # relative, while any film was in the patch ...
    way: float           # m, rolled meanwhile
    begin_ns: int
    end_ns: int
    samples: CrossingSamples | None  # None where no film was seen, or the speed changed too much
