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
Wheel speeds in a window, from angles with quantization and stamp jitter, and means of its blocks.

The angles are smoothed against white jerk. A wheel that follows a new command has a jerk that is
larger by orders of magnitude, so the weight of each jerk follows its size, as for a Student
distribution: heavy smoothing while the speed is steady, none at a step. An error of a stamp moves
the angles of all wheels in proportion to their speeds, so the mean of the wheels and their
differences are smoothed apart.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.estimation.ground.unknowns import BLOCK, JERK_DENSITY, SMOOTHINGS

# mean of the wheels, side difference, axle difference, and the remaining one: orthogonal
MODES = 0.25 * np.array([[1, 1, 1, 1], [-1, 1, -1, 1], [1, 1, -1, -1], [1, -1, -1, 1]])


class WheelMotion(NamedTuple):
    """Smoothed angles, and the covariances of their errors."""

    times: Array            # s, (n,)
    angles: Array           # rad, (n, 4)
    mean_error: Array       # rad^2, (n, n), of the mean of the wheels
    difference_error: Array  # rad^2, (n, n), of half the difference of the sides


def smoothed(times: Array, angles: Array, jitter: float, step: float) -> WheelMotion:
    """
    Return the ``angles`` (n, 4) [rad] at ``times`` (n,) [s], n > 3, smoothed.

    ``jitter`` [s] is the standard deviation of the stamps, ``step`` [rad] that of the angles.
    """
    n = len(times)
    first, second, third, fourth = (times[j:n - 3 + j] for j in range(4))
    early, middle, late = second - first, third - second, fourth - third
    begin, end, whole = third - first, fourth - second, fourth - first
    # jerk over four samples: six times their third divided difference
    rows = np.sqrt(12.0 / JERK_DENSITY * whole) / np.stack([
        -early * begin * whole, early * middle * end, -begin * middle * late, whole * end * late])
    jerk, k = np.zeros((n - 3, n)), np.arange(n - 3)
    for j in range(4):
        jerk[k, k + j] = rows[j]
    y = (angles - angles[0]) @ MODES.T
    rate = np.gradient(y, times, axis=0)
    variance = (jitter * rate) ** 2 + step ** 2 / 4.0
    measured = np.apply_along_axis(np.diag, 0, 1.0 / variance).transpose(2, 0, 1)  # (4, n, n)
    weight, found = np.ones(n - 3), y
    for _ in range(SMOOTHINGS):
        prior = (jerk.T * weight) @ jerk
        found = np.linalg.solve(prior + measured, (y / variance).T[:, :, np.newaxis])[:, :, 0].T
        weight = 2.0 / (1.0 + np.sum((jerk @ found) ** 2, axis=1))
        # a step of the speed may lie in any of the intervals around
        padded = np.pad(weight, 1, mode='edge')
        weight = np.minimum(weight, np.minimum(padded[2:], padded[:-2]))
    prior = (jerk.T * weight) @ jerk
    mean, difference = np.linalg.inv(prior + measured[:2])
    return WheelMotion(times, angles[0] + found @ np.linalg.inv(MODES).T, mean, difference)


def rate_weights(times: Array, at: Array) -> Array:
    """Return the matrix (m, n) that gives rates at ``at`` (m,) from values at ``times`` (n,)."""
    at = np.minimum(at, times[-1])
    index = np.clip(np.searchsorted(times, at) - 2, 0, len(times) - 4)[:, np.newaxis] + range(4)
    knots, weights = times[index], np.zeros((len(at), len(times)))
    for j in range(4):  # derivative of the cubic through four neighbors (Lagrange)
        others = [k for k in range(4) if k != j]
        scale = np.prod([knots[:, j] - knots[:, k] for k in others], axis=0)
        a, b, c = (at - knots[:, k] for k in others)
        weights[np.arange(len(at)), index[:, j]] = (a * b + b * c + a * c) / scale
    return weights


def block_means(values: Array) -> Array:
    """Return the block means of values (..., n) at the ends of steps, by trapezoids."""
    blocks = values.reshape(*values.shape[:-1], -1, BLOCK)
    found = blocks.mean(axis=-1)
    found[..., 1:] += 0.5 / BLOCK * (blocks[..., :-1, -1] - blocks[..., 1:, -1])
    return found


def sample_means(samples: Array, edges: Array) -> tuple[Array, Instants]:
    """Return means (blocks, columns - 1) of samples with time in column 0, and their counts."""
    block = np.searchsorted(edges, samples[:, 0]) - 1
    inside = (block >= 0) & (samples[:, 0] <= edges[-1])
    block, values = block[inside], samples[inside, 1:]
    count = np.bincount(block, minlength=len(edges) - 1)
    sums = np.zeros((len(edges) - 1, values.shape[1]))
    np.add.at(sums, block, values)
    return sums / np.maximum(count, 1)[:, np.newaxis], count


def block_spread(values: Array, edges: Array, times: Array, period: float) -> Array:
    """Return the range (blocks, 4) of ``values`` (n, 4) within a ``period`` [s] of each block."""
    low = np.searchsorted(times, edges[:-1] - period)
    high = np.searchsorted(times, edges[1:] + period, side='right')
    return np.array([np.ptp(values[a:b], axis=0) for a, b in zip(low, high)])
