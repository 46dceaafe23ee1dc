# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True, infer_types=True, show_performance_hints=False

"""
Smoothing of a signal against white jerk: least squares, whose equations are banded.

The jerk over four consecutive samples is six times their third divided difference.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler.
"""

from __future__ import annotations

import numpy as np

from smart_tire.arrays import Array

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

COMPILED: bool = cython.compiled


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
    Return the normalized jerks of a ``signal`` (..., n), of shape (..., n - 3).

    >>> jerks(jerk_rows(np.arange(5.0), 3.0), np.arange(5.0)**3).round(9)
    array([3.46410162, 3.46410162])
    """
    n = rows.shape[1]
    found: Array = rows[0] * signal[..., :n]
    for j in range(1, 4):
        found += rows[j] * signal[..., j:n + j]
    return found


def jerk_information(rows: Array) -> Array:
    """
    Return the information matrix (n, n) of jerks of zero, as its upper bands (4, n).

    >>> jerk_information(jerk_rows(np.arange(4.0), 1.0))[3]  # the diagonal
    array([1., 9., 9., 1.])
    """
    bands = np.zeros((4, rows.shape[1] + 3))  # row 3 - k holds the k-th superdiagonal
    _add_products(rows, bands)
    return bands


def _add_products(rows: cython.double[:, ::1], bands: cython.double[:, ::1]) -> None:
    """Add the products of each column of ``rows`` to the matrix with these ``bands``."""
    for i in range(rows.shape[1]):
        for j in range(4):
            for k in range(j + 1):
                bands[3 - k, i + j] += rows[j - k, i] * rows[j, i]


def solve_smoothed(information: Array, precision: Array, right: Array) -> Array:
    """
    Return the solutions (k, n) for right-hand sides (k, n), or that of one (n,).

    The matrix is that of ``jerk_information`` plus ``precision`` (n,), or one of each right-hand
    side (k, n), on its diagonal. Raises LinAlgError if it is not positive definite.

    >>> information = jerk_information(jerk_rows(np.arange(4.0), 1.0))
    >>> solve_smoothed(information, np.ones(4), np.arange(4.0)).round(9)  # without jerk
    array([0., 1., 2., 3.])
    """
    n = information.shape[1]
    found = right.copy()
    if not _solve(information, precision.reshape(-1, n), found.reshape(-1, n),
                  np.zeros((n + 6, 4))):
        raise np.linalg.LinAlgError('the equations of the smoothing are singular')
    return found


def _solve(bands: cython.double[:, ::1], precision: cython.double[:, ::1],
           found: cython.double[:, ::1], factor: cython.double[:, ::1]) -> bool:
    """
    Replace right-hand sides (k, n) by solutions; return False if there are none.

    ``factor`` (n + 6, 4) has zeros; it becomes L and the inverse of D of L D L^T. LAPACK would
    call a function for each column of a band. Terms that are known late are subtracted last.
    """
    a: cython.double
    b: cython.double
    c: cython.double
    d: cython.double
    n = bands.shape[1]
    for k in range(found.shape[0]):
        for i in range(3, n + 3 if k < precision.shape[0] else 0):
            c = bands[0, i - 3]
            b = bands[1, i - 3] - c * factor[i - 2, 0]
            a = bands[2, i - 3] - c * factor[i - 1, 1] - b * factor[i - 1, 0]
            factor[i, 0] = a * factor[i - 1, 3]
            factor[i, 1] = b * factor[i - 2, 3]
            factor[i, 2] = c * factor[i - 3, 3]
            d = (bands[3, i - 3] + precision[k, i - 3]
                 - c * factor[i, 2] - b * factor[i, 1] - a * factor[i, 0])
            if not d > 0.0:
                return False
            factor[i, 3] = 1.0 / d
        a = b = c = 0.0  # the latest three
        for i in range(n):
            d = found[k, i] - c * factor[i + 3, 2] - b * factor[i + 3, 1] - a * factor[i + 3, 0]
            a, b, c = d, a, b
            found[k, i] = d * factor[i + 3, 3]
        a = b = c = 0.0
        for i in range(n - 1, -1, -1):
            d = found[k, i] - c * factor[i + 6, 2] - b * factor[i + 5, 1] - a * factor[i + 4, 0]
            a, b, c = d, a, b
            found[k, i] = d
    return True
