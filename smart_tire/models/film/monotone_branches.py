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
Monotone branches of a sampled signal, on which the Duhem operator of A(17) has a closed form.

A branch starts at a turning point and contains every sample up to the next turning point, which is
the last sample of its branch. ``path`` (n + 1,) is the signal (n,) preceded by its start point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Branches:
    """Branches of a path; the first one continues an earlier branch and starts at ``path[0]``."""

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
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ParameterError(f'{name} is not numeric: {error}') from error
    if array.ndim > 1:
        raise ParameterError(f'{name} has shape {array.shape}, expected one axis')
    array = array.reshape(-1)
    finite = np.isfinite(array)
    if not finite.all():
        index = int(np.argmin(finite))
        raise ParameterError(f'{name}[{index}] is {array[index]}, expected finite numbers')
    return array


def monotone_branches(path: Array, sign: float = 0.0) -> Branches:
    """
    Return the branches of ``path``, whose first one has the direction ``sign``.

    Equal successive samples do not end a branch.

    >>> branches = monotone_branches(np.array([0.0, 1.0, 2.0, 2.0, 1.0, 3.0]))
    >>> print(branches.starts, branches.signs, branches.numbers)
    [0 3 4] [ 0.  1. -1.  1.] [1 1 1 2 3]
    """
    steps = np.sign(np.diff(path))
    latest = np.maximum.accumulate(np.where(steps != 0.0, np.arange(steps.size), -1))
    signs = np.where(latest >= 0, steps[latest], sign) if steps.size else steps
    reverses = signs != np.concatenate([[sign], signs[:-1]])[:signs.size]
    starts = np.flatnonzero(reverses)
    return Branches(starts, np.concatenate([[sign], signs[starts]]), np.cumsum(reverses))


def dead_band_branches(path: Array, dead_band: float) -> Branches:
    """
    Return the branches of ``path`` between reversals larger than ``dead_band``.

    With noise a branch is not monotone; reversals of at most the dead band stay on it. A turning
    point is confirmed by later samples only, so this is for complete recordings. Raises
    ParameterError unless the dead band is finite and not negative.

    >>> path = np.array([0.0, 1.0, 0.9, 2.0, 1.0, 1.1, 0.0])
    >>> print(dead_band_branches(path, 0.2).starts, monotone_branches(path).starts)
    [0 3] [0 1 2 3 4 5]
    """
    if not 0.0 <= dead_band < np.inf:
        raise ParameterError(f'dead_band is {dead_band}, expected zero or a positive number')
    strict = monotone_branches(path)
    corners = np.concatenate([[0], strict.starts, [path.size - 1]])
    starts, signs = _reversals(path[corners].tolist(), dead_band)
    indices = corners[starts]
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


def relaxation_at_starts(path: Array, branches: Branches, alpha: float, limit: float,
                         z: float, begin: float) -> Array:
    """
    Return z at the start of each branch, for ``dz = -alpha |du| z - alpha limit du``, A(17).

    The first branch starts at ``begin`` with ``z``. This is the only loop of the Duhem operator,
    over turning points: each start follows from the previous one.

    >>> path = np.array([0.0, 10.0, 0.0])
    >>> print(relaxation_at_starts(path, monotone_branches(path), 0.15, 1.733, 0.0, 0.0).round(3))
    [ 0.     0.    -1.346]
    """
    starts = np.concatenate([[begin], path[branches.starts]])
    shares = np.expm1(-alpha * np.abs(np.diff(starts)))
    values = [z]
    for share, pull in zip(shares.tolist(), (branches.signs[:-1] * limit).tolist()):
        z += (z + pull) * share
        values.append(z)
    return np.array(values)


def relaxation(path: Array, branches: Branches, alpha: float, limit: float,
               at_starts: Array, begin: float) -> Array:
    """
    Return z (n,) of A(17) at each sample, from its values at the starts of the branches.

    Arguments as for ``relaxation_at_starts``, whose result is ``at_starts``.

    >>> path = np.array([0.0, 5.0, 10.0, 0.0])
    >>> branches = monotone_branches(path)
    >>> starts = relaxation_at_starts(path, branches, 0.15, 1.733, 0.0, 0.0)
    >>> print(relaxation(path, branches, 0.15, 1.733, starts, 0.0).round(3))
    [-0.914 -1.346  1.046]
    """
    starts = np.concatenate([[begin], path[branches.starts]])[branches.numbers]
    pull = (branches.signs * limit)[branches.numbers]
    start = at_starts[branches.numbers]
    z: Array = start + (start + pull) * np.expm1(-alpha * np.abs(path[1:] - starts))
    return z
