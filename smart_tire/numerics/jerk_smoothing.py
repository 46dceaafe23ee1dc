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
Smoothing of a signal against white jerk: least squares, whose equations are banded.

The jerk over four consecutive samples is six times their third divided difference.
"""

from __future__ import annotations

import numpy as np

from smart_tire.arrays import Array


def jerk_rows(times: Array, density: float) -> Array:
    """
    Return the coefficients (4, n - 3) of the normalized jerk, for n > 3 ``times`` [s] (n,).

    ``density`` is that of the white jerk, per s^5 in units of the signal squared.

    >>> jerk_rows(np.arange(4.0), 1.0).ravel()  # the third difference
    array([-1.,  3., -3.,  1.])
    """
    n = len(times)
    first, second, third, fourth = (times[j:n - 3 + j] for j in range(4))
    early, middle, late = second - first, third - second, fourth - third
    begin, end, whole = third - first, fourth - second, fourth - first
    rows: Array = np.sqrt(12.0 / density * whole) / np.array([
        -early * begin * whole, early * middle * end, -begin * middle * late, whole * end * late])
    return rows


def jerks(rows: Array, signal: Array) -> Array:
    """
    Return the normalized jerks of a ``signal`` (n, k), of shape (n - 3, k).

    >>> jerks(jerk_rows(np.arange(5.0), 3.0), np.arange(5.0)[:, np.newaxis]**3).ravel().round(9)
    array([3.46410162, 3.46410162])
    """
    n = rows.shape[1]
    return np.sum([rows[j, :, np.newaxis] * signal[j:n + j] for j in range(4)], axis=0)


def jerk_information(rows: Array) -> Array:
    """
    Return the information matrix (n, n) of jerks of zero, as its upper bands (4, n).

    >>> jerk_information(jerk_rows(np.arange(4.0), 1.0))[3]  # the diagonal
    array([1., 9., 9., 1.])
    """
    n = rows.shape[1]
    banded = np.zeros((4, n + 3))  # row 3 - k holds the k-th superdiagonal
    for k in range(4):
        for j, product in enumerate(rows[:4 - k] * rows[k:], k):
            banded[3 - k, j:n + j] += product
    return banded


def solve_smoothed(information: Array, precision: Array, right: Array) -> Array:
    """
    Return the solution (n, k) for right-hand sides (n, k), or one (n,).

    The matrix is that of ``jerk_information`` plus ``precision`` (n,) on its diagonal. Raises
    LinAlgError if it is singular.

    >>> information = jerk_information(jerk_rows(np.arange(4.0), 1.0))
    >>> solve_smoothed(information, np.ones(4), np.arange(4.0)).round(9)  # without jerk
    array([0., 1., 2., 3.])
    """
    from scipy.linalg.lapack import dpbsv  # see docs/architecture.md, "Libraries"
    matrix = information.copy()
    matrix[3] += precision
    _, solution, failed = dpbsv(matrix, right)
    if failed:
        raise np.linalg.LinAlgError('the equations of the smoothing are singular')
    return np.asarray(solution)
