"""
Duhem hysteresis of the film, A(17): ``dy = alpha |du| (a u - y) + b du``.

With ``z = y - a u`` it reads ``dz = -alpha |du| z - (a - b) du``: linear, and on a branch of one
direction s = +-1 that starts at (u0, z0), with g = (a - b) / alpha,
``z = -s g + (z0 + s g) exp(-alpha |u - u0|)``. Only the way matters, not its speed; every
initial z is forgotten, for z is drawn into the band ``|z| <= g``. ``u`` is the paper's Q_en and
``y`` its Q_e in coulomb, but any units will do: ``alpha`` is in 1/u, ``a`` and ``b`` in y/u.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models.film.monotone_branches import (
    lasting_branches, monotone_branches, relaxation, relaxation_at_starts, series)


@dataclass(frozen=True, kw_only=True)
class DuhemParams:
    """Constants of A(17); inside the band no branch ever falls, because of ``b >= a / 2``."""

    alpha: float  # 1/u
    a: float      # y/u, slope of the middle of large loops
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
        """Return the largest |y - a u| of the band that attracts all states."""
        return (self.a - self.b) / self.alpha


TABLE_I = DuhemParams(alpha=0.15e9, a=0.54, b=0.28)  # 1/C, -, -: paper A, Table I
TABLE_I_GAIN = 34.47e-9                              # C, K there


class Duhem:
    """
    The operator as a state: (u, y), the way in so far.

    A sample's output follows from the turning point that its branch started at, so any division
    of the input into chunks gives the same output to the last bit.
    """

    def __init__(self, params: DuhemParams, u: float = 0.0, y: float = 0.0) -> None:
        self.params = params
        self.reset(u, y)

    def reset(self, u: float = 0.0, y: float = 0.0) -> None:
        """Forget the way; stand at (u, y), which may lie outside the band."""
        self._u, y = (float(series(name, value)[0]) for name, value in (('u', u), ('y', y)))
        self._begin, self._begin_z, self._sign = self._u, y - self.params.a * self._u, 0.0

    def update(self, u: ArrayLike) -> Array:
        """Go on to the samples ``u`` one after the other; return y (n,)."""
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
    Return the output y (n,) of a whole input u (n,) that comes from the state ``start`` (u, y).

    ``dead_band`` [u] is for a measured input: its noise would turn the direction with every
    sample, and with it the state; ways back that are not longer do not count as branches.
    """
    if dead_band == 0.0:
        return Duhem(params, *start).update(u)
    path = np.concatenate([[start[0]], series('u', u)])
    branches = lasting_branches(path, dead_band)
    z = start[1] - params.a * start[0]
    starts = relaxation_at_starts(path, branches, params.alpha, params.band, z, start[0])
    return params.a * path[1:] + relaxation(path, branches, params.alpha, params.band, starts,
                                            start[0])
