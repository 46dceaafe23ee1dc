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

"""
Duhem hysteresis of the film, A(17): ``dy = alpha |du| (a u - y) + b du``.

With ``z = y - a u`` it reads ``dz = -alpha |du| z - (a - b) du``: linear, and on a branch of one
direction s = +-1 that starts at (u0, z0), with g = (a - b) / alpha,
``z = -s g + (z0 + s g) exp(-alpha |u - u0|)``. The operator is rate-independent, and the effect of
the initial z decays, since the band ``|z| <= g`` attracts all states. ``u`` is the paper's Q_en
and ``y`` its Q_e in coulomb, but any units can be used: ``alpha`` is in 1/u, ``a`` and ``b`` in
y/u.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models.film.monotone_branches import (
    dead_band_branches, monotone_branches, relaxation, relaxation_at_starts, series)


@dataclass(frozen=True, kw_only=True)
class DuhemParams:
    """
    Constants of A(17), ``a > b >= a / 2 > 0``; ParameterError otherwise.

    Inside the band, ``b >= a / 2`` makes the output monotone in the input on every branch.
    """

    alpha: float  # 1/u
    a: float      # y/u, mean slope of large loops
    b: float      # y/u, slope of small loops

    def __post_init__(self) -> None:
        for name in ('alpha', 'a', 'b'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ParameterError(f'{name} is {value}, expected a positive number')
        if not self.a > self.b >= 0.5 * self.a:
            raise ParameterError(f'b is {self.b}, expected a > b >= a / 2 with a = {self.a}')

    @property
    def band(self) -> float:
        """Largest |y - a u| of the band that attracts all states."""
        return (self.a - self.b) / self.alpha


TABLE_I = DuhemParams(alpha=0.15e9, a=0.54, b=0.28)  # 1/C, -, -: paper A, Table I
TABLE_I_GAIN = 34.47e-9                              # C, K there


class Duhem:
    """
    Duhem operator of A(17) with its state (u, y), for inputs in chunks.

    The output of a sample is computed from the turning point at which its branch started, so the
    division of the input into chunks does not change the output, not even by rounding.

    >>> operator = Duhem(TABLE_I)
    >>> print(operator.update([4e-9, 8e-9]), operator.update([4e-9]))
    [1.37794017e-09 3.10873663e-09] [2.2773044e-09]
    """

    def __init__(self, params: DuhemParams, u: float = 0.0, y: float = 0.0) -> None:
        self.params = params
        self.reset(u, y)

    def reset(self, u: float = 0.0, y: float = 0.0) -> None:
        """Restart at (u, y), which may lie outside the band."""
        self._u, y = (float(series(name, value)[0]) for name, value in (('u', u), ('y', y)))
        self._begin, self._begin_z, self._sign = self._u, y - self.params.a * self._u, 0.0

    def update(self, u: ArrayLike) -> Array:
        """Advance by the samples ``u`` (n,); return y (n,). ParameterError unless finite."""
        u = series('u', u)
        path = np.concatenate([[self._u], u])
        p, branches = self.params, monotone_branches(path, self._sign)
        starts = relaxation_at_starts(path, branches, p.alpha, p.band, self._begin_z, self._begin)
        z = relaxation(path, branches, p.alpha, p.band, starts, self._begin)
        if branches.starts.size:
            self._begin = float(path[branches.starts[-1]])
            self._begin_z = float(starts[-1])
        self._u, self._sign = float(path[-1]), float(branches.signs[-1])
        return p.a * u + z


def respond(u: ArrayLike, params: DuhemParams, *, start: tuple[float, float] = (0.0, 0.0),
            dead_band: float = 0.0) -> Array:
    """
    Return the output y (n,) of A(17) for a complete input u (n,), from the state ``start`` (u, y).

    ``dead_band`` (in u) is for a measured input, whose noise would reverse the direction at every
    sample and change the state; reversals of at most the dead band do not end a branch. Raises
    ParameterError for values that are not finite.

    >>> print(respond([4e-9, 8e-9, 4e-9], TABLE_I))
    [1.37794017e-09 3.10873663e-09 2.27730440e-09]
    """
    if dead_band == 0.0:
        return Duhem(params, *start).update(u)
    path = np.concatenate([[start[0]], series('u', u)])
    branches = dead_band_branches(path, dead_band)
    z = start[1] - params.a * start[0]
    starts = relaxation_at_starts(path, branches, params.alpha, params.band, z, start[0])
    return params.a * path[1:] + relaxation(path, branches, params.alpha, params.band, starts,
                                            start[0])
