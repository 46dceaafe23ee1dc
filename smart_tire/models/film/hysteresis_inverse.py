"""
The exact inverse of Duhem's operator: from the output y back to the input u, branch by branch.

On a branch that starts at (y0, z0) with direction s, let ``c = g + s z0``, ``m = alpha c / a``
and ``r = alpha |y - y0| / a``. The way ``x = alpha |u - u0|`` then solves
``x - m (1 - exp(-x)) = r``: ``x = r + m + W(-m exp(-(r + m)))`` with the principal branch of
Lambert's W. Inside the band 0 <= m <= 1 and there is one solution; outside it a branch of the
operator falls before it rises, two inputs give one output, and the inverse is refused.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

import numpy as np
from scipy.special import lambertw

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models.film.hysteresis import DuhemParams
from smart_tire.models.film.monotone_branches import (
    Branches, lasting_branches, monotone_branches, series)

ROUNDING = 1e-9  # of the band: how far outside a state may lie that was computed to be inside


class InverseDuhem:
    """The inverse operator as a state (u, y), for inputs y in chunks of any size."""

    def __init__(self, params: DuhemParams, u: float = 0.0, y: float = 0.0) -> None:
        self.params = params
        self.reset(u, y)

    def reset(self, u: float = 0.0, y: float = 0.0) -> None:
        """Forget the way; stand at (u, y), which must lie inside the band."""
        u, self._y = (float(series(name, value)[0]) for name, value in (('u', u), ('y', y)))
        self._begin, self._sign = self._y, 0.0
        self._begin_z = inside_band(self.params, u, self._y)

    def update(self, y: ArrayLike) -> Array:
        """Go on to the samples ``y`` one after the other; return u (n,)."""
        y = series('y', y)
        path = np.concatenate([[self._y], y])
        branches = monotone_branches(path, self._sign)
        starts = _at_starts(path, branches, self.params, self._begin_z, self._begin)
        z = _deviation(path, branches, self.params, starts, self._begin)
        if branches.starts.size:
            self._begin = float(path[branches.starts[-1]])
            self._begin_z = float(starts[-1])
        self._y, self._sign = float(path[-1]), float(branches.signs[-1])
        u: Array = (y - z) / self.params.a
        return u


def invert(y: ArrayLike, params: DuhemParams, *, start: tuple[float, float] = (0.0, 0.0),
           dead_band: float = 0.0) -> Array:
    """
    Return the input u (n,) of a whole output y (n,) that comes from the state ``start`` (u, y).

    ``dead_band`` [y]: ways back that are not longer are noise and stay on their branch. Without
    it noise wanders through small loops until the state has forgotten the large one.
    """
    if dead_band == 0.0:
        return InverseDuhem(params, *start).update(y)
    path = np.concatenate([[start[1]], series('y', y)])
    branches = lasting_branches(path, dead_band)
    z = inside_band(params, *start)
    starts = _at_starts(path, branches, params, z, start[1])
    u: Array = (path[1:] - _deviation(path, branches, params, starts, start[1])) / params.a
    return u


def inside_band(params: DuhemParams, u: float, y: float) -> float:
    """Return z = y - a u; raise ParameterError if it lies outside the band."""
    z, band = y - params.a * u, params.band
    rounding = ROUNDING * max(band, abs(y))
    if abs(z) > band + rounding:
        raise ParameterError(
            f'the state u = {u}, y = {y} has y - a u = {z}, outside the band of +-{band}: there '
            'an output belongs to more than one input, so there is no inverse')
    return min(max(z, -band), band)


def way(r: Array, m: Array) -> Array:
    """Return x >= 0 of ``x - m (1 - exp(-x)) = r`` for r >= 0 and 0 <= m <= 1."""
    with np.errstate(divide='ignore', invalid='ignore'):
        # scipy's W is not a number at -1 / e itself, where fmax and max take the other one
        x = np.fmax(_shortest(r, m, np.sqrt), r + m + lambertw(-m * np.exp(-(r + m))).real)
        # r + m + W cancels; two steps of Newton on the equation itself bring the digits back
        for _ in range(2):
            decay = np.expm1(-x)
            x = np.maximum(x - (x + m * decay - r) / (1.0 - m - m * decay), r)
    return np.where(r > 0.0, x, 0.0)


def _way(r: float, m: float) -> float:
    """Return what ``way`` returns, for numbers."""
    if r <= 0.0:
        return 0.0
    x = max(_shortest(r, m, math.sqrt), r + m + float(lambertw(-m * math.exp(-(r + m))).real))
    for _ in range(2):
        decay = math.expm1(-x)
        x = max(x - (x + m * decay - r) / (1.0 - m - m * decay), r)
    return x


def _shortest(r: Any, m: Any, root: Callable[[Any], Any]) -> Any:
    """Return less than the way: of ``(1 - m) x + m x^2 / 2 = r``, where W itself is lost."""
    rest = 1.0 - m
    return 2.0 * r / (rest + root(rest * rest + 2.0 * m * r))


def _at_starts(path: Array, branches: Branches, params: DuhemParams, z: float,
               begin: float) -> Array:
    """Return z where each branch starts; the first has started at ``begin`` with ``z``."""
    scale, band = params.alpha / params.a, params.band
    rises = scale * np.abs(np.diff(np.concatenate([[begin], path[branches.starts]])))
    values = [z]
    for rise, sign in zip(rises.tolist(), branches.signs[:-1].tolist()):
        reach = band + sign * z
        z += sign * reach * math.expm1(-_way(rise, scale * reach))
        values.append(z)
    return np.array(values)


def _deviation(path: Array, branches: Branches, params: DuhemParams, at_starts: Array,
               begin: float) -> Array:
    """Return z (n,) at every sample."""
    scale, numbers = params.alpha / params.a, branches.numbers
    starts = np.concatenate([[begin], path[branches.starts]])[numbers]
    signs = branches.signs[numbers]
    start = at_starts[numbers]
    reach = params.band + signs * start
    x = way(scale * np.abs(path[1:] - starts), scale * reach)
    z: Array = start + signs * reach * np.expm1(-x)
    return z
