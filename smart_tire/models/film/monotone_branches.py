"""
Monotone branches of a sampled signal, on which a rate-independent operator has a closed form.

A branch starts at a turning point and belongs to every sample up to the next one; the turning
point itself is the last sample of the branch before. ``path`` is the signal with the point that
it comes from in front: n + 1 values for n samples.
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
    """The branches of a path; the first goes on from before and starts at ``path[0]``."""

    starts: Indices  # of every branch after the first: index of its turning point in the path
    signs: Array     # of every branch: +1 rising, -1 falling, 0 at rest since the beginning
    numbers: Indices  # of every sample: the number of its branch


def series(name: str, values: ArrayLike) -> Array:
    """Return a signal as an array (n,); raise ParameterError if it is no finite series."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ParameterError(f'{name} holds what is no number: {error}') from error
    if array.ndim > 1:
        raise ParameterError(f'{name} has shape {array.shape}, expected one axis')
    array = array.reshape(-1)
    finite = np.isfinite(array)
    if not finite.all():
        where = int(np.argmin(finite))
        raise ParameterError(f'{name}[{where}] is {array[where]}, expected finite numbers')
    return array


def monotone_branches(path: Array, sign: float = 0.0) -> Branches:
    """Return the branches of ``path`` that goes on in direction ``sign``; rest turns nothing."""
    steps = np.sign(np.diff(path))
    moved = np.maximum.accumulate(np.where(steps != 0.0, np.arange(steps.size), -1))
    signs = np.where(moved >= 0, steps[moved], sign) if steps.size else steps
    turned = signs != np.concatenate([[sign], signs[:-1]])[:signs.size]
    starts = np.flatnonzero(turned)
    return Branches(starts, np.concatenate([[sign], signs[starts]]), np.cumsum(turned))


def lasting_branches(path: Array, dead_band: float) -> Branches:
    """
    Return the branches of ``path`` that are left when it turns back by ``dead_band`` or less.

    What noise makes of a branch is not monotone: the small ways back and forth stay on it. A
    turning point is known once the path has come back from it, so this is for whole recordings.
    """
    if not 0.0 <= dead_band < np.inf:
        raise ParameterError(f'dead_band is {dead_band}, expected zero or a positive number')
    strict = monotone_branches(path)
    corners = np.concatenate([[0], strict.starts, [path.size - 1]])
    starts, signs = _turns(path[corners].tolist(), dead_band)
    indices = corners[starts]
    numbers = np.zeros(path.size - 1, dtype=np.intp)
    np.add.at(numbers, indices[indices < numbers.size], 1)
    return Branches(indices, np.array([0.0, *signs]), np.cumsum(numbers))


def _turns(values: list[float], dead_band: float) -> tuple[list[int], list[float]]:
    """Return where ``values`` turn by more than the dead band, and the directions from there."""
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
    Return z where each branch starts, for ``dz = -alpha |du| z - alpha limit du``.

    The first branch has started at ``begin`` with ``z``. This is the only loop that Duhem's
    operator needs, over turning points: each start follows from the one before.
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
    """Return z (n,) at every sample of the path from its values where the branches start."""
    starts = np.concatenate([[begin], path[branches.starts]])[branches.numbers]
    pull = (branches.signs * limit)[branches.numbers]
    start = at_starts[branches.numbers]
    z: Array = start + (start + pull) * np.expm1(-alpha * np.abs(path[1:] - starts))
    return z
