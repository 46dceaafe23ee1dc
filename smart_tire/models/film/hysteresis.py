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
Duhem hysteresis of the film, A(17): ``dy = alpha |du| (a u - y) + b du``.

With ``z = y - a u`` it reads ``dz = -alpha |du| z - (a - b) du``: linear, and on a branch of one
direction s = +-1 that starts at (u0, z0), with g = (a - b) / alpha,
``z = -s g + (z0 + s g) exp(-alpha |u - u0|)``. The operator is rate-independent, and the effect of
the initial z decays, since the band ``|z| <= g`` attracts all states. ``u`` is the paper's Q_en
and ``y`` its Q_e in coulomb, but any units can be used: ``alpha`` is in 1/u, ``a`` and ``b`` in
y/u.

A branch starts at a turning point and contains every sample up to the next turning point, which is
the last sample of its branch. ``path`` (n + 1,) is the signal (n,) preceded by its start point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models import validation

Indices = npt.NDArray[np.intp]


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
            validation.positive(name, getattr(self, name))
        if not self.a > self.b >= 0.5 * self.a:
            raise ParameterError(f'b is {self.b}, expected a > b >= a / 2 with a = {self.a}')

    @property
    def band(self) -> float:
        """Largest |y - a u| of the band that attracts all states."""
        return (self.a - self.b) / self.alpha


TABLE_I = DuhemParams(alpha=0.15e9, a=0.54, b=0.28)  # 1/C, -, -: paper A, Table I
TABLE_I_GAIN = 34.47e-9                              # C, K there


@dataclass(frozen=True)
class Branches:
    """Branches of a path; the first one starts at ``path[0]``."""

    starts: Indices  # of each branch after the first: index of its turning point in the path
    signs: Array     # of each branch: +1 rising, -1 falling, 0 constant since the beginning
    numbers: Indices  # of each sample: number of its branch


def series(name: str, values: ArrayLike) -> Array:
    """
    Return a signal as an array (n,); raise ParameterError unless it is finite with one axis.

    >>> series('u', [0.0, 1.0, float('nan')])
    Traceback (most recent call last):
    ...
    smart_tire.errors.ParameterError: u[2] is nan, expected finite numbers
    """
    array = validation.finite(name, values)
    if array.ndim > 1:
        raise ParameterError(f'{name} has shape {array.shape}, expected one axis')
    return array.reshape(-1)


def monotone_branches(path: Array, dead_band: float = 0.0) -> Branches:
    """
    Return the branches of ``path`` between reversals larger than ``dead_band``.

    With noise a branch is not monotone; reversals of at most the dead band stay on it. A turning
    point is confirmed by later samples only, so this is for complete recordings. Raises
    ParameterError unless the dead band is finite and not negative.

    >>> path = np.array([0.0, 1.0, 0.9, 2.0, 1.0, 1.1, 0.0])
    >>> print(monotone_branches(path, 0.2).starts, monotone_branches(path).starts)
    [0 3] [0 1 2 3 4 5]
    """
    if not 0.0 <= dead_band < np.inf:
        raise ParameterError(f'dead_band is {dead_band}, expected zero or a positive number')
    # candidates: ends of the path, and samples before a step of the opposite direction
    steps = np.sign(np.diff(path))
    moving = np.flatnonzero(steps)
    reverses = np.diff(steps[moving], prepend=0.0) != 0.0
    corners = np.unique(np.concatenate([[0], moving[reverses], [path.size - 1]]))
    starts, signs = _reversals(path[corners].tolist(), dead_band)
    indices = corners[starts].astype(np.intp)
    numbers = np.zeros(path.size - 1, dtype=np.intp)
    np.add.at(numbers, indices[indices < numbers.size], 1)
    return Branches(indices, np.array([0.0, *signs]), np.cumsum(numbers))


def _reversals(values: list[float], dead_band: float) -> tuple[list[int], list[float]]:
    """Return indices of reversals above the dead band, and the directions after them."""
    starts: list[int] = []
    signs: list[float] = []
    low = high = 0
    for index, value in enumerate(values):
        if value > values[high]:
            high = index
        if value < values[low]:
            low = index
        sign = signs[-1] if signs else 0.0
        if sign <= 0.0 and value - values[low] > dead_band:
            starts.append(low)
            signs.append(1.0)
            high = low = index
        elif sign >= 0.0 and values[high] - value > dead_band:
            starts.append(high)
            signs.append(-1.0)
            high = low = index
    return starts, signs


def relaxed(path: Array, branches: Branches, alpha: float, limit: float, z: float) -> Array:
    """
    Return z (n,) at each sample, for ``dz = -alpha |du| z - alpha limit du``, A(17).

    ``z`` is that at ``path[0]``. The only loop is over turning points: the z at the start of each
    branch follows from that of the branch before.

    >>> path = np.array([0.0, 5.0, 10.0, 0.0])
    >>> print(relaxed(path, monotone_branches(path), 0.15, 1.733, 0.0).round(3))
    [-0.914 -1.346  1.046]
    """
    corners = path[np.concatenate([[0], branches.starts])]
    shares, starts = np.expm1(-alpha * np.abs(np.diff(corners))), [z]
    for share, pull in zip(shares.tolist(), (branches.signs[:-1] * limit).tolist()):
        z += (z + pull) * share
        starts.append(z)
    start, pull = np.array(starts)[branches.numbers], (branches.signs * limit)[branches.numbers]
    found: Array = start + (start + pull) * np.expm1(
        -alpha * np.abs(path[1:] - corners[branches.numbers]))
    return found


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
    path = np.concatenate([[start[0]], series('u', u)])
    return params.a * path[1:] + relaxed(
        path, monotone_branches(path, dead_band), params.alpha, params.band,
        start[1] - params.a * start[0])
