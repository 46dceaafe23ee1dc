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

"""Fewer points per curve without the loss of extremes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.analysis.curves import Curve
from smart_tire.analysis.series import Floats

MAX_POINTS = 5000  # of a curve
KEPT = 'largest value', 'smallest value', 'largest sigma', 'first NaN'  # of each interval
Rows = NDArray[np.intp]


def decimated(curve: Curve, limit: int = MAX_POINTS) -> Curve:
    """
    Return at most ``limit`` rows of ``curve``.

    The curve is divided into intervals with equal numbers of values. Of each the smallest and the
    largest value, the largest standard deviation and the first NaN, which interrupts the line, are
    kept. Runs of NaN are shortened to one.
    """
    undefined = ~np.isfinite(curve.value)
    repeated = undefined & np.append(True, undefined[:-1])
    rows = np.flatnonzero(~repeated)
    if len(rows) <= limit:
        return curve.at_rows(rows)
    sigma = np.zeros(len(rows)) if curve.sigma is None else curve.sigma[rows]
    value = curve.value[rows]
    buckets = bucket_count(limit)
    criteria = (_filled(value, buckets), _filled(-value, buckets), _filled(sigma, buckets),
                _filled(np.where(np.isfinite(value), math.nan, 1.0), buckets))
    width = criteria[0].shape[1]
    offsets = np.arange(buckets) * width
    kept = [np.argmax(table, axis=1) + offsets for table in criteria]
    kept = [best[np.isfinite(table.max(axis=1))] for best, table in zip(kept, criteria)]
    kept.append(np.array([0, len(rows) - 1]))
    return curve.at_rows(rows[np.unique(np.concatenate(kept))])


def bucket_count(limit: int) -> int:
    """Return the number of intervals of a curve with at most ``limit`` points."""
    return (limit - 2) // len(KEPT)


def _filled(values: Floats, buckets: int) -> Floats:
    """Return ``values`` in rows of equal length, with -inf for NaN and at the end."""
    width = -(-len(values) // buckets)
    padded = np.full(buckets * width, -math.inf)
    padded[:len(values)] = np.where(np.isfinite(values), values, -math.inf)
    return padded.reshape(buckets, width)


def equidistant(position: Floats, limit: int = MAX_POINTS) -> Rows:
    """Return at most ``limit`` rows of a path (n, 2), about equally spaced along it."""
    if len(position) <= limit:
        return np.arange(len(position))
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    travel = np.append(0.0, np.cumsum(steps))
    cells = np.floor(travel * ((limit - 2) / max(travel[-1], 1e-9)))
    return np.unique(np.append(np.unique(cells, return_index=True)[1], len(position) - 1))
