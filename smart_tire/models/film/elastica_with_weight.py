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
Buckled film with weight (heavy elastica): A(7), A(8) with ``q_e = w s``.

With the Green's function of ``theta'' = h``, ``theta(0) = theta(1) = 0``, the boundary value
problem becomes an integral equation on Chebyshev points, ``theta = G (w s cos(theta) - f
sin(theta))`` and ``int 2 sin^2(theta / 2) = delta``. G is exact for polynomials and well
conditioned, so that a few Newton steps reach rounding, for many films at once. The weight
increases in steps from the weightless solution. Dimensionless as ``elastica``; ``weight`` is w,
positive for a film arched against gravity and negative for a hanging one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models.film import elastica
from smart_tire.models.film.elastica import EULER_LOAD

NODE_COUNT = 40
BLOCK_SIZE = 256            # films that are solved together; limits the size of the matrices
MAX_NEWTON_STEPS = 8
STEP_TOLERANCE = 1e-11    # of the largest theta: last change of theta
MAX_SHAPE_CHANGE = 0.3   # of the largest theta: more may reach another branch of solutions
MIN_WEIGHT_STEP = 1e-3  # share of the weight: below it the branch of solutions has ended
RESOLUTION_TOLERANCE = 1e-9      # of the largest coefficient of the curvature: the last two

# Chebyshev-Lobatto points on [0, 1], and integration from 0 to each of them
NODES: Array = 0.5 * (1.0 - np.cos(np.pi * np.arange(NODE_COUNT) / (NODE_COUNT - 1)))
_TO_SERIES: Array = np.linalg.inv(
    np.asarray(chebyshev.chebvander(2.0 * NODES - 1.0, NODE_COUNT - 1), dtype=np.float64))
_SUM: Array = chebyshev.chebval(
    2.0 * NODES - 1.0, chebyshev.chebint(_TO_SERIES, scl=0.5, lbnd=-1.0)).T
_TWICE: Array = _SUM @ _SUM
GREEN: Array = _TWICE - np.outer(NODES, _TWICE[-1])
INTEGRAL_WEIGHTS: Array = _SUM[-1]  # weights of the integral from 0 to 1


@dataclass(frozen=True)
class HeavyFilm:
    """Solutions; arrays have the shape of stroke and weight, ``theta`` has one more axis."""

    stroke: Array
    weight: Array
    load: Array   # f
    theta: Array  # (..., POINTS) rad at NODES

    @property
    def charge(self) -> Array:
        """Q_en / K of A(9), from the flat film: int(f cos + q sin) / pi^2 - 1."""
        thrust = self.load * (1.0 - self.stroke)
        lift = self.weight * ((NODES * np.sin(self.theta)) @ INTEGRAL_WEIGHTS)
        value: Array = (thrust + lift) / EULER_LOAD - 1.0
        return value


def solve(stroke: ArrayLike, weight: ArrayLike) -> HeavyFilm:
    """
    Return the solutions of A(7), A(8) for strokes and weights that broadcast.

    A film can be arched against its weight only from a stroke of about ``5.04e-4 w^2`` on. Raises
    ParameterError below it, for a stroke outside [0, 1), a weight that is not finite, and where
    the nodes do not resolve the shape.

    >>> film = solve(0.05, [0.0, 0.3])
    >>> print(film.load.round(3), film.charge.round(5))
    [10.123 10.53 ] [-0.02556  0.01784]
    """
    strokes, weights = np.broadcast_arrays(
        elastica.checked_stroke(stroke), np.asarray(weight, dtype=float))
    if not np.isfinite(weights).all():
        raise ParameterError(f'weight is {weights[~np.isfinite(weights)].flat[0]}')
    if np.any((strokes == 0.0) & (weights != 0.0)):
        raise ParameterError('stroke is 0: no finite load holds a film with weight flat')
    flat, goal = strokes.reshape(-1), weights.reshape(-1)
    theta, load = np.empty((flat.size, NODE_COUNT)), np.empty(flat.size)
    for begin in range(0, flat.size, BLOCK_SIZE):
        some = slice(begin, begin + BLOCK_SIZE)
        theta[some], load[some] = _continued(flat[some], goal[some])
    film = HeavyFilm(strokes, weights, load.reshape(strokes.shape),
                     theta.reshape(*strokes.shape, NODE_COUNT))
    _check_resolved(film)
    return film


def _continued(stroke: Array, weight: Array) -> tuple[Array, Array]:
    """Return theta and load, by continuation from the weightless films with adaptive steps."""
    theta = elastica.shape(stroke[:, None], NODES).theta
    load = elastica.load(stroke)
    done, step = np.where(weight == 0.0, 1.0, 0.0), np.ones(weight.size)
    while (todo := np.flatnonzero(done < 1.0)).size:
        share = np.minimum(done[todo] + step[todo], 1.0)
        fine, theta_new, load_new = _newton(stroke[todo], weight[todo] * share, theta[todo],
                                            load[todo])
        good = todo[fine]
        theta[good], load[good], done[good] = theta_new[fine], load_new[fine], share[fine]
        step[todo[~fine]] *= 0.5
        if (lost := np.flatnonzero(step < MIN_WEIGHT_STEP)).size:
            raise ParameterError(
                f'no equilibrium for weight {weight[lost[0]]} and stroke {stroke[lost[0]]}: the '
                'film is too flat to be arched against its weight, or too heavy')
    return theta, load


def _newton(stroke: Array, weight: Array, theta: Array, load: Array
            ) -> tuple[npt.NDArray[np.bool_], Array, Array]:
    """Return which films converged near their start, and their theta and load."""
    start, w = theta, weight[:, None]
    # over the largest theta; otherwise an almost flat film has a row of almost zeros
    size = np.abs(theta).max(axis=1, keepdims=True)
    matrix = np.zeros((stroke.size, NODE_COUNT + 1, NODE_COUNT + 1))
    for _ in range(MAX_NEWTON_STEPS):
        f, sine = load[:, None], np.sin(theta)
        matrix[:, :-1, :-1] = (np.eye(NODE_COUNT) + GREEN
                               * (w * NODES * sine + f * np.cos(theta))[:, None])
        matrix[:, :-1, -1] = sine / size @ GREEN.T
        matrix[:, -1, :-1] = sine / size * INTEGRAL_WEIGHTS
        residual = (theta - _bending(theta, f, w) @ GREEN.T) / size
        closing = (2.0 * np.sin(0.5 * theta)**2 @ INTEGRAL_WEIGHTS - stroke)[:, None] / size**2
        right = np.concatenate([residual, closing], axis=1)
        correction = np.linalg.solve(matrix, right[..., None])[..., 0]
        theta, load = theta - correction[:, :-1] * size, load - correction[:, -1]
        change = np.abs(correction[:, :-1]).max(axis=1)
        if not np.isfinite(change).all() or np.all(change < STEP_TOLERANCE):
            break
    near = np.abs(theta - start).max(axis=1) < MAX_SHAPE_CHANGE * size[:, 0]
    return (change < STEP_TOLERANCE) & near, theta, load


def _bending(theta: Array, load: Array, weight: Array) -> Array:
    """Return theta'' of A(7)."""
    second: Array = weight * NODES * np.cos(theta) - load * np.sin(theta)
    return second


def _check_resolved(film: HeavyFilm) -> None:
    series = np.abs(_bending(film.theta, film.load[..., None], film.weight[..., None])
                    @ _TO_SERIES.T)
    rough = series[..., -2:].max(axis=-1) > RESOLUTION_TOLERANCE * series.max(axis=-1)
    if rough.any():
        raise ParameterError(
            f'the shape for stroke {film.stroke[rough].flat[0]} and weight '
            f'{film.weight[rough].flat[0]} bends too sharply for {NODE_COUNT} nodes')
