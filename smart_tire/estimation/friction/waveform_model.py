# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Output of all films of a wheel in one patch crossing, and its Jacobian, for a waveform fit.

The output is that of ``tread_film``: bending B(15), strain B(23), release of Fig. 8, and bumps.

Samples are given over rolled distance in the direction of motion, from any origin. The parameters
are those that the films share, then a block for each film, then the coefficients [m] of Legendre
polynomials of order 2, 3, ... that describe the distance errors over all samples. The shape of
release and bumps, which no theory gives, is part of the shared parameters (``SHAPE``).
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import legvander

from smart_tire.arrays import Array
from smart_tire.estimation.contact.records import FilmSamples
from smart_tire.estimation.friction.constants import (
    MAX_CENTER_STEP, MIN_NORMALIZED_SLIP, NORMALIZED_SLIP_RANGE)
from smart_tire.models.tire import strain_charge, tread_film
from smart_tire.models.tire.tread_film import PADDING
from smart_tire.parameters.robot import RobotParams


class Shared(IntEnum):
    """Parameters that all films of a wheel share."""

    SLIP = 0     # -, slip ratio of B(3) at the reference distance
    NORM_SLIP = 1  # -, normalized slip there: total slip / critical slip
    CHANGE = 2   # -, relative change of both over a contact length
    SCALE = 3    # -, relative error of the distance scale
    ALPHA = 4    # -, ln of alpha in B(15) over its nominal value
    LENGTH = 5   # -, ln of the contact length over its nominal value


class Release(IntEnum):
    """Parameters of the release, shared by all films; within ``SHAPE``."""

    SHARE = 0  # -, share of the release in ``RELEASES`` that ``film.release`` does not name
    SIZE = 1   # -, additional opposite charge over the bending peak


class PerFilm(IntEnum):
    """Parameters of one film."""

    CENTER = 0    # m, distance at which the centers of film and patch coincide
    OFFSET = 1    # V
    BENDING = 2   # V, q_bm
    BEFORE = 3    # V, height of the bump before the contact
    AFTER = 4     # V, height of the bump after it
    GAIN = 5      # -, relative error of the stretch gain
    RECOVERY = 6  # -, ln of the recovery length over its nominal value


KNOTS = len(tread_film.KNOTS)
# of the parameter vector: release, then deviations of the bumps before and after the contact from
# their nominal shape over their height
SHAPE = slice(len(Shared), len(Shared) + len(Release) + 2 * KNOTS)
BUMPS = slice(SHAPE.start + len(Release), SHAPE.stop)


class StrainPart(NamedTuple):
    """Strain part of the output [V] and its partial derivatives; (n,) each."""

    volts: Array
    by_gain: Array            # by the relative error of the gain
    by_position: Array        # per m of x
    by_contact_length: Array  # per m of L


def film_index(film: int, which: PerFilm) -> int:
    """Return the index of a parameter of the ``film``-th film of a crossing."""
    return SHAPE.stop + len(PerFilm) * film + which


class WaveformModel:
    """
    Output of the films of a wheel in one patch crossing, for a vector of parameters.

    ``gains`` [V/m] are the nominal stretch gains of all films of the wheel, ``reference`` [m] is
    the distance at which ``Shared.SLIP`` and ``Shared.NORM_SLIP`` apply, ``warps`` is the number
    of polynomials for the distance errors.
    """

    def __init__(self, robot: RobotParams, gains: Sequence[float], films: Sequence[FilmSamples],
                 reference: float, warps: int = 0) -> None:
        self._film, self._patch = robot.film, robot.tire.contact_length
        self._ends = np.cumsum([0, *(len(one.distance) for one in films)]).tolist()
        self._index = np.repeat(np.arange(len(films)), np.diff(self._ends))
        self._gain = np.array([gains[one.film] for one in films])[self._index]
        self._distance = np.concatenate([one.distance for one in films])
        self._columns = np.arange(len(self._distance))
        self._recovery = tread_film.RECOVERY * robot.film.length
        # from the reference, in contact lengths
        self._relative = (self._distance - reference) / self._patch
        self._own = slice(SHAPE.stop, film_index(len(films), PerFilm.CENTER))
        self._release, other = (np.array(tread_film.RELEASE_WEIGHTS[name]) for name in sorted(
            tread_film.RELEASES, key=lambda name: name != robot.film.release))
        self._by_release = np.array([other - self._release, [1.0, 0.0]])
        low, high = float(self._distance.min()), float(self._distance.max())
        # -1 to 1, the domain of the polynomials
        centered = (2.0 * self._distance - low - high) / max(high - low, self._patch)
        self._polynomials = legvander(centered, warps + 1).T[2:]

    def linearized(self, p: Array) -> tuple[Array, Array]:
        """
        Return the output above rest [V] and its Jacobian for the parameters ``p`` (m,).

        Shapes are (n,) and (m, n) for n samples of all films.
        """
        films = p[self._own].reshape(-1, len(PerFilm)).copy()
        films[:, PerFilm.RECOVERY] = self._recovery * np.exp(films[:, PerFilm.RECOVERY])
        center, offset, peak, before, after, gain, recovery = films.T.take(self._index, axis=1)
        scale, alpha, length = p[Shared.SCALE:len(Shared)].tolist()
        alpha, patch = self._film.bending_alpha * math.exp(alpha), self._patch * math.exp(length)
        distance = self._distance - center
        x = (distance * (1.0 + scale) + p[self._own.stop:] @ self._polynomials
             + 0.5 * (patch - self._film.length))

        opposite, lost = (self._release + p[SHAPE.start:BUMPS.start] @ self._by_release).tolist()
        bend = tread_film.bending(x, self._film.length, patch, alpha, (opposite, lost), recovery)
        jacobian = np.zeros((len(p), len(x)))
        strain = self._strain(x, patch, p, gain, jacobian)
        bump = self._bumps(x, patch, p, before, after, jacobian)
        height = np.where(bump.after, after, before)
        by_position = (peak * bend.by_position + strain.by_position
                       - height * bump.by_position)
        np.multiply(by_position, distance, out=jacobian[Shared.SCALE])
        np.multiply(alpha * peak, bend.by_alpha, out=jacobian[Shared.ALPHA])
        np.multiply(patch, peak * bend.by_contact_length + strain.by_contact_length
                    - height * bump.by_contact_length + 0.5 * by_position,
                    out=jacobian[Shared.LENGTH])
        np.matmul(self._by_release, peak * np.array(bend.by_release),
                  out=jacobian[SHAPE.start:BUMPS.start])
        np.multiply(by_position, self._polynomials, out=jacobian[self._own.stop:])
        block = np.empty((len(PerFilm), len(x)))
        np.multiply(by_position, -1.0 - scale, out=block[PerFilm.CENTER])
        block[PerFilm.OFFSET] = 1.0
        block[PerFilm.BENDING], block[PerFilm.GAIN] = bend.value, strain.by_gain
        np.multiply(bump.value, bump.after - 1.0, out=block[PerFilm.BEFORE])
        np.multiply(bump.value, -1.0 * bump.after, out=block[PerFilm.AFTER])
        np.multiply(peak * bend.by_recovery, recovery, out=block[PerFilm.RECOVERY])
        for i, (low, high) in enumerate(zip(self._ends, self._ends[1:])):
            rows = slice(film_index(i, PerFilm.CENTER), film_index(i + 1, PerFilm.CENTER))
            jacobian[rows, low:high] = block[:, low:high]
        return offset + peak * bend.value + strain.volts - height * bump.value, jacobian

    def moved(self, p: Array, step: Array) -> Array:
        """
        Return ``p`` after ``step``, shortened if a film center would move too far.

        The normalized slip is limited to ``NORMALIZED_SLIP_RANGE``.
        """
        largest = float(np.abs(step[self._own][PerFilm.CENTER::len(PerFilm)]).max())
        limit = MAX_CENTER_STEP * self._film.length
        moved: Array = p + step * min(1.0, limit / max(largest, limit))
        low, high = NORMALIZED_SLIP_RANGE
        moved[Shared.NORM_SLIP] = min(max(float(moved[Shared.NORM_SLIP]), low), high)
        return moved

    def _bumps(self, x: Array, patch: float, p: Array, before: Array, after: Array,
               jacobian: Array) -> tread_film.Bumps:
        """Return the bumps of height 1; write the rows of their shape into ``jacobian``."""
        nominal = tread_film.bumps(x, self._film.length, patch)
        second = nominal.after
        outside = np.where(second, x - patch, -self._film.length - x)
        basis = tread_film.splines(outside, self._film.length)
        padded = np.zeros((2, KNOTS + 2 * PADDING))
        padded[:, PADDING:-PADDING] = p[BUMPS].reshape(2, KNOTS)
        index = basis.knot + second * padded.shape[1]
        coefficients = padded.reshape(-1)[index]
        rows = np.zeros((padded.size, len(x)))
        rows[index, self._columns] = basis.value * -np.where(second, after, before)
        jacobian[BUMPS] = rows.reshape(*padded.shape, -1)[:, PADDING:-PADDING].reshape(
            2 * KNOTS, -1)
        value, slope = ((coefficients * part).sum(axis=0)
                        for part in (basis.value, basis.by_outside))
        return tread_film.Bumps(
            nominal.value + value, nominal.by_position + np.where(second, slope, -slope),
            nominal.by_contact_length - second * slope, second)

    def _strain(self, x: Array, patch: float, p: Array, gain: Array, jacobian: Array
                ) -> StrainPart:
        """Return the strain part; write its rows SLIP to CHANGE into ``jacobian``."""
        slip, normalized_slip, change = p[:Shared.SCALE].tolist()
        growth = 1.0 + change * self._relative
        normalized = normalized_slip * growth
        limited = np.maximum(normalized, MIN_NORMALIZED_SLIP)
        overlap = strain_charge.overlap(x, limited, self._film.length, patch)
        length = overlap.value + (normalized - limited) * overlap.by_normalized_slip
        gains = self._gain * growth  # V/m per unit of SLIP
        by_gain = slip * gains * length
        gains *= 1.0 + gain
        by_slip = np.multiply(gains, length, out=jacobian[Shared.SLIP])
        volts, factor = slip * by_slip, slip * gains
        by_normalized = factor * overlap.by_normalized_slip
        np.multiply(by_normalized, growth, out=jacobian[Shared.NORM_SLIP])
        np.multiply(self._relative, volts / growth + normalized_slip * by_normalized,
                    out=jacobian[Shared.CHANGE])
        return StrainPart(volts, by_gain, factor * overlap.by_position,
                          factor * overlap.by_contact_length)
