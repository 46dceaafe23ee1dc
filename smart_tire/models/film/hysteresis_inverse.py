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
Exact inverse of the Duhem operator of A(17): input u from output y, branch by branch.

On a branch that starts at (y0, z0) with direction s, let ``c = g + s z0``, ``m = alpha c / a`` and
``r = alpha |y - y0| / a``. The input distance ``x = alpha |u - u0|`` then solves
``x - m (1 - exp(-x)) = r``: ``x = r + m + W(-m exp(-(r + m)))`` with the principal branch of the
Lambert W function. Inside the band 0 <= m <= 1 and the solution is unique. Outside it a branch of
the operator is not monotone, two inputs have the same output, and ParameterError is raised.
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
    Branches, dead_band_branches, monotone_branches, series)

BAND_TOLERANCE = 1e-9  # relative to the band: rounding of a state on its border


class InverseDuhem:
    """
    Inverse operator of A(17) with its state (u, y), for outputs y in chunks of any size.

    >>> inverse = InverseDuhem(DuhemParams(alpha=0.15, a=0.54, b=0.28))
    >>> print(inverse.update([1.0, 2.0]).round(3), inverse.update([1.0]).round(3))
    [3.022 5.509] [1.316]
    """

    def __init__(self, params: DuhemParams, u: float = 0.0, y: float = 0.0) -> None:
        self.params = params
        self.reset(u, y)

    def reset(self, u: float = 0.0, y: float = 0.0) -> None:
        """Restart at (u, y); raise ParameterError if it lies outside the band."""
        u, self._y = (float(series(name, value)[0]) for name, value in (('u', u), ('y', y)))
        self._begin, self._sign = self._y, 0.0
        self._begin_z = inside_band(self.params, u, self._y)

    def update(self, y: ArrayLike) -> Array:
        """Advance by the samples ``y`` (n,); return u (n,). ParameterError unless finite."""
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
    Return the input u (n,) of A(17) for a complete output y (n,), from the state ``start`` (u, y).

    ``dead_band`` (in y): reversals of at most this size are noise and stay on their branch.
    Without it noise drives the state through small loops until the large loop has decayed.
    Raises ParameterError for a start outside the band and values that are not finite.

    >>> print(invert([1.0, 2.0, 1.0], DuhemParams(alpha=0.15, a=0.54, b=0.28)).round(3))
    [3.022 5.509 1.316]
    """
    if dead_band == 0.0:
        return InverseDuhem(params, *start).update(y)
    path = np.concatenate([[start[1]], series('y', y)])
    branches = dead_band_branches(path, dead_band)
    z = inside_band(params, *start)
    starts = _at_starts(path, branches, params, z, start[1])
    u: Array = (path[1:] - _deviation(path, branches, params, starts, start[1])) / params.a
    return u


def inside_band(params: DuhemParams, u: float, y: float) -> float:
    """
    Return z = y - a u of A(17); raise ParameterError if it lies outside the band.

    >>> print(f'{inside_band(DuhemParams(alpha=0.15, a=0.54, b=0.28), 2.0, 2.0):.2f}')
    0.92
    """
    z, band = y - params.a * u, params.band
    rounding = BAND_TOLERANCE * max(band, abs(y))
    if abs(z) > band + rounding:
        raise ParameterError(
            f'the state u = {u}, y = {y} has y - a u = {z}, outside the band of +-{band}: '
            'several inputs have this output there, so there is no inverse')
    return min(max(z, -band), band)


def input_distance(r: Array, m: Array) -> Array:
    """
    Return the solution x >= 0 of ``x - m (1 - exp(-x)) = r`` for r >= 0 and 0 <= m <= 1; arrays.

    >>> print(input_distance(np.array([0.1, 1.0]), np.array([0.5, 1.0])).round(4))
    [0.1841 1.8414]
    """
    with np.errstate(divide='ignore', invalid='ignore'):
        # scipy's W is NaN at -1 / e itself, where fmax and max select the lower bound
        x = np.fmax(_lower_bound(r, m, np.sqrt), r + m + lambertw(-m * np.exp(-(r + m))).real)
        # r + m + W cancels; two Newton steps on the equation itself restore the digits
        for _ in range(2):
            decay = np.expm1(-x)
            x = np.maximum(x - (x + m * decay - r) / (1.0 - m - m * decay), r)
    return np.where(r > 0.0, x, 0.0)


def _input_distance(r: float, m: float) -> float:
    """Return ``input_distance`` of numbers."""
    if r <= 0.0:
        return 0.0
    x = max(_lower_bound(r, m, math.sqrt), r + m + float(lambertw(-m * math.exp(-(r + m))).real))
    for _ in range(2):
        decay = math.expm1(-x)
        x = max(x - (x + m * decay - r) / (1.0 - m - m * decay), r)
    return x


def _lower_bound(r: Any, m: Any, root: Callable[[Any], Any]) -> Any:
    """Return a lower bound of x, the root of ``(1 - m) x + m x^2 / 2 = r``, exact for small x."""
    linear = 1.0 - m
    return 2.0 * r / (linear + root(linear * linear + 2.0 * m * r))


def _at_starts(path: Array, branches: Branches, params: DuhemParams, z: float,
               begin: float) -> Array:
    """Return z at the start of each branch; the first one starts at ``begin`` with ``z``."""
    scale, band = params.alpha / params.a, params.band
    rises = scale * np.abs(np.diff(np.concatenate([[begin], path[branches.starts]])))
    values = [z]
    for rise, sign in zip(rises.tolist(), branches.signs[:-1].tolist()):
        reach = band + sign * z
        z += sign * reach * math.expm1(-_input_distance(rise, scale * reach))
        values.append(z)
    return np.array(values)


def _deviation(path: Array, branches: Branches, params: DuhemParams, at_starts: Array,
               begin: float) -> Array:
    """Return z (n,) at each sample."""
    scale, numbers = params.alpha / params.a, branches.numbers
    starts = np.concatenate([[begin], path[branches.starts]])[numbers]
    signs = branches.signs[numbers]
    start = at_starts[numbers]
    reach = params.band + signs * start
    x = input_distance(scale * np.abs(path[1:] - starts), scale * reach)
    z: Array = start + signs * reach * np.expm1(-x)
    return z
