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

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.contact.records import FilmSamples
from smart_tire.estimation.friction.constants import MAX_CENTER_STEP, MIN_NORMALIZED_SLIP
from smart_tire.models.tire import film_equations as equations, tread_film
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


PER_FILM = len(PerFilm)  # asking the enumeration takes longer
KNOTS = len(equations.KNOTS)
# of the parameter vector: release, then deviations of the bumps before and after the contact from
# their nominal shape over their height
SHAPE = slice(len(Shared), len(Shared) + len(Release) + 2 * KNOTS)
BUMPS = slice(SHAPE.start + len(Release), SHAPE.stop)


def film_index(film: int, which: PerFilm) -> int:
    """Return the index of a parameter of the ``film``-th film of a crossing."""
    return SHAPE.stop + PER_FILM * film + which


class WaveformModel:
    """
    Output of the films of a wheel in one patch crossing, for a vector of parameters.

    ``gains`` [V/m] are the nominal stretch gains of all films of the wheel, ``reference`` [m] is
    the distance at which ``Shared.SLIP`` and ``Shared.NORM_SLIP`` apply, ``warps`` is the number
    of polynomials for the distance errors.
    """

    def __init__(self, robot: RobotParams, gains: Sequence[float], films: Sequence[FilmSamples],
                 reference: float, warps: int = 0) -> None:
        from numpy.polynomial.legendre import legvander  # nodes start without
        self._film, self._patch = robot.film, robot.tire.contact_length
        self._ends = np.cumsum([0, *(len(one.distance) for one in films)]).tolist()
        self._index = np.repeat(np.arange(len(films)), np.diff(self._ends))
        self._gain = np.array([gains[one.film] for one in films])[self._index]
        self._distance = np.concatenate([one.distance for one in films])
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
        films = p[self._own].reshape(-1, PER_FILM).copy()
        films[:, PerFilm.RECOVERY] = self._recovery * np.exp(films[:, PerFilm.RECOVERY])
        scale, alpha, length = p[Shared.SCALE:len(Shared)].tolist()
        patch = self._patch * math.exp(length)
        distance = self._distance - films[self._index, PerFilm.CENTER]
        x = (distance * (1.0 + scale) + p[self._own.stop:] @ self._polynomials
             + 0.5 * (patch - self._film.length))
        shared = np.array([
            *p[:Shared.ALPHA], self._film.bending_alpha * math.exp(alpha), patch,
            self._film.length, *(self._release + p[SHAPE.start:BUMPS.start] @ self._by_release),
            MIN_NORMALIZED_SLIP])
        rows, jacobian = np.empty((equations.ROWS, len(x))), np.zeros((len(p), len(x)))
        equations.linearize(x, distance, self._relative, self._gain, self._index, films, shared,
                            p[BUMPS], rows, jacobian[BUMPS])
        jacobian[:len(Shared)] = rows[:len(Shared)]
        np.matmul(self._by_release, rows[equations.BY_OPPOSITE:equations.BY_CENTER],
                  out=jacobian[SHAPE.start:BUMPS.start])
        np.multiply(rows[equations.BY_POSITION], self._polynomials,
                    out=jacobian[self._own.stop:])
        for i, (low, high) in enumerate(zip(self._ends, self._ends[1:])):
            own = slice(film_index(i, PerFilm.CENTER), film_index(i + 1, PerFilm.CENTER))
            jacobian[own, low:high] = rows[equations.BY_CENTER:equations.VOLTS, low:high]
        return rows[equations.VOLTS], jacobian

    def moved(self, p: Array, step: Array) -> Array:
        """Return ``p`` after ``step``, shortened if a film center would move too far."""
        largest = float(np.abs(step[self._own][PerFilm.CENTER::PER_FILM]).max())
        limit = MAX_CENTER_STEP * self._film.length
        return p + step * min(1.0, limit / max(largest, limit))
