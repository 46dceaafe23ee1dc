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
Combination of the tracks of many drives in the cells of a grid.

All errors are those of ln mu: they are relative. A drive counts once in a cell, unless it comes
back after the correlation length of its errors or on another ground; what the estimates of one
robot share does not average out. Drives that contradict those after them are of a ground that has
changed since.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array, Instants
from smart_tire.errors import ParameterError
from smart_tire.estimates import Tabular
from smart_tire.estimation.ground.unknowns import MAX_SIGMA
from smart_tire.mapping.raster import Raster
from smart_tire.mapping.track import FrictionTrack

RESOLUTION = 0.1         # m, edge of a cell
MAX_CELLS = 4_000_000    # of a map: 200 m x 200 m; its images and messages are smaller than 4 MB
MAX_POSITION_SIGMA = 1.0  # m, of a position; what is known less is not assigned to cells; assumed
SPREAD_SIGMAS = 2.0      # of a position, to which its evidence is spread; derived: 95 %
CONTRADICTION = 3.0      # sigmas between drives, above: the ground has changed; 1 in 370 cells


@dataclass(frozen=True, eq=False, repr=False)
class FrictionCells(Tabular):
    """
    Friction of cells; one whose ground has changed has a row for each of its grounds.

    * ``stamp_ns``: (n,) ns, of the latest drive
    * ``first_ns``: (n,) ns, of the first drive
    * ``x``, ``y``: (n,) m, center of the cell
    * ``friction``, ``sigma``: (n,) -, mu and its standard deviation
    * ``drives``: (n,) number of drives, as likely as they have crossed it
    * ``current``: (n,) 1 for the latest ground of the cell, else 0
    """

    stamp_ns: Instants
    first_ns: Instants
    x: Array
    y: Array
    friction: Array
    sigma: Array
    drives: Instants
    current: Instants

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return {name: values for name, values in vars(self).items() if name != 'stamp_ns'}


@dataclass(frozen=True, eq=False)
class FrictionMap:
    """Friction of a place: all cells with evidence, and the latest ground as a raster."""

    cells: FrictionCells
    raster: Raster


class _Visits(NamedTuple):
    """Evidence of one drive, a row for each cell; logarithms."""

    cell: NDArray[np.int64]  # (n, 2) column and row
    stamp_ns: Instants
    mean: Array              # ln mu
    own: Array               # variance of errors that the drive has for itself
    common: Array            # ... that all drives of the robot share
    crossed: Array           # probability that the drive has crossed the cell
    robot: NDArray[np.int64]


class Combined(NamedTuple):
    """Drives that agree on a cell."""

    mean: float      # ln mu
    variance: float
    rows: list[int]  # of the drives


def friction_map(tracks: Sequence[FrictionTrack], resolution: float = RESOLUTION) -> FrictionMap:
    """
    Return the map of all ``tracks``, with cells of ``resolution`` [m].

    Raises ParameterError if they are in different frames, without any friction, or if the map
    would have too many cells.
    """
    frames = sorted({track.frame for track in tracks if len(track)})
    if len(frames) > 1:
        raise ParameterError(f'the drives are in the frames {" and ".join(frames)}, expected one')
    robots = sorted({track.robot for track in tracks})
    parts = [_visits(track, robots.index(track.robot), resolution)
             for track in tracks if _precise(track).any()]
    if not parts:
        raise ParameterError('no friction was estimated on any drive')
    visits = _Visits._make(map(np.concatenate, zip(*parts)))
    cells = _cells(visits, resolution)
    return FrictionMap(cells, raster_of(cells, frames[0], resolution))


def _precise(track: FrictionTrack) -> NDArray[np.bool_]:
    """Return the rows (n,) of which the place is known."""
    found: NDArray[np.bool_] = np.max(
        track.covariance[:, [0, 2]], axis=1) <= MAX_POSITION_SIGMA ** 2
    return found


def _visits(track: FrictionTrack, robot: int, resolution: float) -> _Visits:
    """Return the evidence of one drive in the cells around its tracks."""
    precise = _precise(track)
    own = np.maximum(track.sigma ** 2 - track.common ** 2, 1e-3 * track.sigma ** 2)
    table = np.column_stack([np.log(track.friction), own / track.friction ** 2,
                             (track.common / track.friction) ** 2])[precise]
    places, weights = _spread(track.position[precise], track.covariance[precise], resolution)
    low, height = places.min(axis=0), int(np.ptp(places[:, 1])) + 1
    found, cell = np.unique((places - low) @ [height, 1], return_inverse=True)
    cells = np.column_stack(divmod(found, height)) + low
    # the error of a position is nearly constant while a cell is crossed: of each point of the
    # grid around the positions, the drive has crossed a cell, or not
    count, points = len(weights), len(table)
    block, blocks = track.block[precise], int(track.block.max()) + 1
    visit = cell * blocks + np.repeat(block, count)
    crossings = np.unique(visit * count + np.tile(np.arange(count), points))
    visits, index = np.unique(visit, return_inverse=True)
    parts = _Sums(index, len(visits))
    crossed: Array = np.bincount(
        np.searchsorted(visits, crossings // count), weights[crossings % count]).astype(float)
    weight = np.tile(weights, points)
    mean, spread, common, times = (parts.mean(np.repeat(column, count), weight) for column in (
        *table.T, (track.stamp_ns[precise] - track.stamp_ns[0]).astype(float)))
    information, index = crossed / spread, visits // blocks
    own_parts = _Sums(index, len(cells))
    total = own_parts.total(information)
    average = own_parts.mean(mean, information)
    # parts that contradict each other: a border runs through the cell
    square = own_parts.total(information * (mean - average[index]) ** 2)
    others = np.maximum(own_parts.total(np.ones(len(mean))) - 1.0, 1.0)
    scatter = np.maximum(square / others, 1.0)
    stamp = track.stamp_ns[0] + own_parts.mean(times, information).astype(np.int64)
    return _Visits(cells, stamp, average, scatter / total, own_parts.mean(common, information),
                   np.minimum(own_parts.total(crossed), 1.0), np.full(len(cells), robot))


class _Sums:
    """Sums over the rows with the same ``index``."""

    def __init__(self, index: NDArray[np.intp], size: int) -> None:
        self._index, self._size = index, size

    def total(self, values: Array) -> Array:
        """Return the sums (size,) of ``values`` (n,)."""
        found: Array = np.bincount(self._index, values, self._size).astype(float)
        return found

    def mean(self, values: Array, weight: Array) -> Array:
        """Return the weighted means (size,) of ``values`` (n,)."""
        return self.total(values * weight) / self.total(weight)


def _spread(positions: Array, covariance: Array, resolution: float
            ) -> tuple[NDArray[np.int64], Array]:
    """
    Return the cells (n * k, 2) of points around each position (n, 2), and the weights (k,) of k.

    The points are a grid over its normal distribution, as wide as half a cell at most.
    """
    deviation = np.sqrt(np.max(covariance[:, [0, 2]], initial=0.0))
    count = 2 * math.ceil(2.0 * SPREAD_SIGMAS * deviation / resolution) + 1
    steps = np.linspace(-SPREAD_SIGMAS, SPREAD_SIGMAS, count) if count > 1 else np.zeros(1)
    weights = np.exp(-0.5 * (steps[:, None] ** 2 + steps ** 2)).ravel()
    grid = np.stack(np.meshgrid(steps, steps, indexing='ij'), axis=-1).reshape(-1, 2)
    first = np.sqrt(np.maximum(covariance[:, 0], 1e-12))  # lower triangle of Cholesky
    second = covariance[:, 1] / first
    third = np.sqrt(np.maximum(covariance[:, 2] - second ** 2, 0.0))
    offsets = np.stack([first[:, None] * grid[:, 0],
                        second[:, None] * grid[:, 0] + third[:, None] * grid[:, 1]], axis=-1)
    cells = np.floor((positions[:, None] + offsets) / resolution).astype(np.int64)
    return cells.reshape(-1, 2), weights / weights.sum()


def _cells(visits: _Visits, resolution: float) -> FrictionCells:
    """Return the combination of the drives in each cell."""
    order = np.lexsort((visits.stamp_ns, visits.cell[:, 0], visits.cell[:, 1]))
    visits = _Visits._make(column[order] for column in visits)
    starts = np.flatnonzero(np.any(np.diff(visits.cell, axis=0, prepend=np.iinfo(int).min), 1))
    rows: list[tuple[float, ...]] = []
    for start, end in zip(starts.tolist(), [*starts.tolist()[1:], len(order)]):
        x, y = (visits.cell[start] + 0.5) * resolution
        for age, group in enumerate(grounds_of(visits, range(start, end))):
            sigma = math.sqrt(group.variance)
            if sigma > MAX_SIGMA:
                continue
            mu, stamps = math.exp(group.mean), visits.stamp_ns[group.rows]
            rows.append((int(stamps.max()), int(stamps.min()), x, y, mu, mu * sigma,
                         max(1, round(visits.crossed[group.rows].sum())), int(age == 0)))
    columns = list(zip(*rows)) or [()] * 8
    kinds = (np.int64, np.int64, float, float, float, float, np.int64, np.int64)
    return FrictionCells(*(np.array(one, kind) for one, kind in zip(columns, kinds)))


def grounds_of(visits: _Visits, rows: range) -> Iterator[Combined]:
    """Yield the grounds of a cell whose drives are ``rows`` in order of time, latest first."""
    group = [rows[-1]]
    for row in reversed(rows[:-1]):
        before = combination(visits, group)
        variance = before.variance + visits.own[row] + visits.common[row]
        if abs(visits.mean[row] - before.mean) <= CONTRADICTION * math.sqrt(variance):
            group.append(row)
        else:
            yield before
            group = [row]
    yield combination(visits, group)


def combination(visits: _Visits, rows: list[int]) -> Combined:
    """Return the mean of drives that agree; what those of a robot share remains its floor."""
    mean, information = 0.0, 0.0
    robots = visits.robot[rows]
    for robot in np.unique(robots):
        chosen = np.array(rows)[robots == robot]
        weight = 1.0 / visits.own[chosen]
        own = float(weight @ visits.mean[chosen] / weight.sum())
        common = float(weight @ visits.common[chosen] / weight.sum())
        precision = 1.0 / (1.0 / float(weight.sum()) + common)
        mean, information = mean + precision * own, information + precision
    return Combined(mean / information, 1.0 / information, rows)


def raster_of(cells: FrictionCells, frame: str, resolution: float) -> Raster:
    """Return the latest ground of the ``cells`` as a raster; raise ParameterError if too large."""
    now = cells.current == 1
    if not now.any():
        raise ParameterError('no friction is known well enough in any cell')
    column, row = (np.floor(values[now] / resolution).astype(np.int64)
                   for values in (cells.x, cells.y))
    shape = int(np.ptp(row)) + 1, int(np.ptp(column)) + 1
    if math.prod(shape) > MAX_CELLS:
        raise ParameterError(f'the map would have {shape[1]} x {shape[0]} cells of {resolution:g} '
                             f'm, expected at most {MAX_CELLS}')
    found = []
    for values in (cells.friction, cells.sigma):
        image = np.full(shape, math.nan)
        image[row - row.min(), column - column.min()] = values[now]
        found.append(image)
    return Raster(frame, resolution, (float(column.min() * resolution),
                                      float(row.min() * resolution)), *found)
