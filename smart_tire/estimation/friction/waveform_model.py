"""
The output of all films of a wheel in one passage, and its Jacobian.

Samples lie over the rolled distance, in the direction of motion and up to a constant. What the
films share comes first in the parameters, then a block of each film, and at last the errors of the
distances [m] that Legendre polynomials of order 2, 3, ... over all samples describe.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.contact.records import FilmSamples
from smart_tire.models.tire import strain_charge, tread_film
from smart_tire.parameters.robot import RobotParams


LEAST_SLIDING = 0.01  # -, below, the model goes on linearly: noise may make a sliding negative


class Shared(IntEnum):
    """Parameters that all films of a wheel share."""

    SLIP = 0     # -, B(3)'s lambda where the distance is the reference
    SLIDING = 1  # -, total slip / critical slip there
    GROWTH = 2   # -, relative change of the slip over a contact length ...
    SPREAD = 3   # -, ... and of the sliding share: the lateral slip changes as it likes
    SCALE = 4    # -, relative error of the distances' scale
    ALPHA = 5    # -, ln of B(15)'s alpha over the nominal one
    LENGTH = 6   # -, ln of the contact length over the nominal one


class Own(IntEnum):
    """Parameters of one film."""

    PLACE = 0     # m, distance at which film's and patch's middle coincide
    OFFSET = 1    # V
    BENDING = 2   # V, q_bm
    BEFORE = 3    # V, height of the bump before the contact ...
    AFTER = 4     # V, ... and behind it
    GAIN = 5      # -, relative error of the stretch gain
    RECOVERY = 6  # -, ln of the recovery over the nominal one


def own(film: int, which: Own) -> int:
    """Return the index of a parameter of the ``film``-th film of a passage."""
    return len(Shared) + len(Own) * film + which


class WaveformModel:
    """
    ``tread_film.crossing_voltage`` with bumps for films of a wheel in one passage.

    ``gains`` [V/m] are the nominal ones of all films of the wheel; ``reference`` [m] is the
    distance for which slip and sliding of ``Shared`` are told, ``warps`` how many polynomials
    describe the errors of the distances.
    """

    def __init__(self, robot: RobotParams, gains: Sequence[float], films: Sequence[FilmSamples],
                 reference: float, warps: int = 0) -> None:
        self._film, self._patch = robot.film, robot.tire.contact_length
        self._ends = np.cumsum([0, *(len(one.distance) for one in films)]).tolist()
        self._index = np.repeat(np.arange(len(films)), np.diff(self._ends))
        self._gain = np.array([gains[one.film] for one in films])[self._index]
        self._distance = np.concatenate([one.distance for one in films])
        self._far = (self._distance - reference) / self._patch
        self._own = slice(len(Shared), own(len(films), Own.PLACE))
        low, high = float(self._distance.min()), float(self._distance.max())
        even = (2.0 * self._distance - low - high) / max(high - low, self._patch)
        self._warps = _legendre(even, warps)

    def linearised(self, p: Array) -> tuple[Array, Array]:
        """
        Return the output above rest [V] and its slopes.

        Shapes are (n,) and (m, n) for n samples of all films and m parameters.
        """
        films = p[self._own].reshape(-1, len(Own)).copy()
        films[:, Own.RECOVERY] = tread_film.RECOVERY * np.exp(films[:, Own.RECOVERY])
        place, offset, bending, before, after, gain, tail = films.take(self._index, axis=0).T
        slip, sliding, growth, spread, scale, alpha, length = p[:len(Shared)].tolist()
        alpha, patch = self._film.bending_alpha * math.exp(alpha), self._patch * math.exp(length)
        way = self._distance - place
        x = (way * (1.0 + scale) + p[self._own.stop:] @ self._warps
             + 0.5 * (patch - self._film.length))

        bend = tread_film.bending(x, self._film.length, patch, alpha, self._film.release, tail)
        bump = tread_film.bumps(x, self._film.length, patch)
        height = np.where(bump.after, after, before)
        grown, spreads = 1.0 + growth * self._far, 1.0 + spread * self._far
        local = sliding * spreads
        inside = np.maximum(local, LEAST_SLIDING)
        strain = strain_charge.overlap(x, inside, self._film.length, patch)
        unit = strain.value + (local - inside) * strain.by_normalized_slip

        slopes = np.zeros((len(p), len(x)))
        volts_per = self._gain * grown  # per metre of strain and unit of SLIP, but for GAIN
        per_gain = slip * volts_per * unit
        volts_per *= 1.0 + gain
        by_slip = np.multiply(volts_per, unit, out=slopes[Shared.SLIP])
        pull = slip * volts_per  # V/m
        stretched = slip * by_slip
        by_sliding = pull * strain.by_normalized_slip
        by_place = (bending * bend.by_position + pull * strain.by_position
                    - height * bump.by_position)
        np.multiply(by_sliding, spreads, out=slopes[Shared.SLIDING])
        np.multiply(self._far, stretched / grown, out=slopes[Shared.GROWTH])
        np.multiply(self._far, sliding * by_sliding, out=slopes[Shared.SPREAD])
        np.multiply(by_place, way, out=slopes[Shared.SCALE])
        np.multiply(alpha * bending, bend.by_alpha, out=slopes[Shared.ALPHA])
        np.multiply(patch, bending * bend.by_contact_length + pull * strain.by_contact_length
                    - height * bump.by_contact_length + 0.5 * by_place, out=slopes[Shared.LENGTH])
        np.multiply(by_place, self._warps, out=slopes[self._own.stop:])
        each = np.empty((len(Own), len(x)))
        np.multiply(by_place, -1.0 - scale, out=each[Own.PLACE])
        each[Own.OFFSET], each[Own.BENDING], each[Own.GAIN] = 1.0, bend.value, per_gain
        np.multiply(bump.value, bump.after - 1.0, out=each[Own.BEFORE])
        np.multiply(bump.value, -1.0 * bump.after, out=each[Own.AFTER])
        np.multiply(bending * bend.by_recovery, tail, out=each[Own.RECOVERY])
        for i, (low, high) in enumerate(zip(self._ends, self._ends[1:])):
            slopes[own(i, Own.PLACE):own(i + 1, Own.PLACE), low:high] = each[:, low:high]
        output = offset + bending * bend.value + stretched - height * bump.value
        return output, slopes


def _legendre(x: Array, count: int) -> Array:
    """Return the Legendre polynomials of order 2 to ``count`` + 1 at ``x``, (count, n)."""
    found = np.empty((count + 2, len(x)))
    found[0], found[1] = 1.0, x
    for k in range(2, count + 2):
        found[k] = ((2 * k - 1) / k) * x * found[k - 1] - ((k - 1) / k) * found[k - 2]
    return found[2:]
