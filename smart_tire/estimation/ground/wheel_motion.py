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
from smart_tire.estimation.ground.unknowns import BLOCK, REWEIGHTINGS
from smart_tire.estimation.plausibility import JERK_DENSITY
from smart_tire.models.vehicle.skid_steer import AXLE_SIGNS, SIDE_SIGNS
from smart_tire.numerics.jerk_smoothing import (
    jerk_information, jerk_rows, jerks, solve_smoothed)

# mean of the wheels, side difference, axle difference, and the remaining one: orthogonal
MODES = np.array([np.ones_like(SIDE_SIGNS), -SIDE_SIGNS, AXLE_SIGNS, SIDE_SIGNS * AXLE_SIGNS]
                 ) / len(SIDE_SIGNS)

CUBIC_POINTS = 4  # of a cubic, by which angles become rates
OTHERS = np.array([[j for j in range(CUBIC_POINTS) if j != i] for i in range(CUBIC_POINTS)])


class WheelMotion(NamedTuple):
    """Smoothed angles, and what their errors depend on."""

    times: Array        # s, (n,)
    angles: Array       # rad, (n, 4)
    information: Array  # rad^-2, (4, n), as of ``jerk_information``
    precision: Array    # rad^-2, (4, n), of the angles as measured, by mode

    def errors(self, weights: Array) -> list[Array]:
        """
        Return the covariances (m, m) of ``weights`` (m, n) times the errors of the angles.

        That of the mean of the wheels, and that of half the difference of the sides.
        """
        return [weights @ solve_smoothed(self.information, one, weights).T
                for one in self.precision[:2]]


def smoothed(times: Array, angles: Array, jitter: float, step: float) -> WheelMotion:
    """
    Return the ``angles`` (n, 4) [rad] at ``times`` (n,) [s], n > 3, smoothed.

    ``jitter`` [s] is the standard deviation of the stamps, ``step`` [rad] that of the angles.
    """
    rows = jerk_rows(times, JERK_DENSITY)
    y = MODES @ (angles - angles[0]).T
    gap = np.diff(times)
    slope = np.diff(y) / gap
    rate = np.hstack([
        slope[:, :1], (gap[1:] * slope[:, :-1] + gap[:-1] * slope[:, 1:]) / (gap[1:] + gap[:-1]),
        slope[:, -1:]])
    precision = 1.0 / ((jitter * rate) ** 2 + step ** 2 / 4.0)
    information = jerk_information(rows)
    for _ in range(REWEIGHTINGS):
        found = solve_smoothed(information, precision, precision * y)
        weight = 2.0 / (1.0 + np.sum(jerks(rows, found) ** 2, axis=0))
        # a step of the speed may lie in any of the intervals around
        padded = np.concatenate([weight[:1], weight, weight[-1:]])
        weight = np.minimum(weight, np.minimum(padded[2:], padded[:-2]))
        information = jerk_information(rows * np.sqrt(weight))
    return WheelMotion(times, angles[0] + len(MODES) * found.T @ MODES, information, precision)


def rate_weights(times: Array, at: Array) -> Array:
    """Return the matrix (m, n) that gives rates at ``at`` (m,) from values at ``times`` (n,)."""
    at = np.minimum(at, times[-1])
    index = np.minimum(np.maximum(np.searchsorted(times, at) - 2, 0), len(times) - CUBIC_POINTS)[
        :, np.newaxis] + np.arange(CUBIC_POINTS)
    knots, weights = times[index], np.zeros((len(at), len(times)))
    # derivative of the cubic through four neighbors (Lagrange)
    others = knots[:, OTHERS]
    a, b, c = (at[:, np.newaxis, np.newaxis] - others).transpose(2, 0, 1)
    d, e, f = (knots[:, :, np.newaxis] - others).transpose(2, 0, 1)
    weights[np.arange(len(at))[:, np.newaxis], index] = (a * b + b * c + a * c) / (d * e * f)
    return weights


def central_differences(values: Array, step: float) -> Array:
    """Return the derivatives of values (n, k) at a constant ``step``, one-sided at the ends."""
    padded = np.concatenate([2.0 * values[:1] - values[1:2], values,
                             2.0 * values[-1:] - values[-2:-1]])
    return (padded[2:] - padded[:-2]) / (2.0 * step)


def block_means(values: Array) -> Array:
    """Return the block means of values (..., n, k) at the ends of steps, by trapezoids."""
    blocks = values.reshape(*values.shape[:-2], -1, BLOCK, values.shape[-1])
    found = blocks.sum(axis=-2)
    found[..., 1:, :] += 0.5 * (blocks[..., :-1, -1, :] - blocks[..., 1:, -1, :])
    return found / BLOCK


def sample_means(samples: Array, edges: Array) -> tuple[Array, Instants]:
    """Return means (blocks, columns - 1) of samples with time in column 0, and their counts."""
    ends = np.searchsorted(samples[:, 0], edges, side='right')
    sums = np.zeros((len(samples) + 1, samples.shape[1] - 1))
    np.cumsum(samples[:, 1:], axis=0, out=sums[1:])
    count = np.diff(ends)
    return np.diff(sums[ends], axis=0) / np.maximum(count, 1)[:, np.newaxis], count


def block_spread(values: Array, edges: Array, times: Array, period: float) -> Array:
    """Return the range (blocks, 4) of ``values`` (n, 4) within a ``period`` [s] of each block."""
    low = np.searchsorted(times, edges[:-1] - period)
    high = np.searchsorted(times, edges[1:] + period, side='right')
    ends = np.column_stack([low, high]).ravel()
    padded = np.concatenate([values, values[-1:]])  # an end may be that of all values
    spread: Array = np.maximum.reduceat(padded, ends)[::2] - np.minimum.reduceat(padded, ends)[::2]
    return spread
