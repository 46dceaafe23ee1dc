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
Levenberg-Marquardt least squares with priors, Huber weights and clipped samples.

For few parameters and some hundred samples, many times a second: LAPACK is called directly, and
products stay below the size from which BLAS uses threads, which is many times slower. A clipped
sample is used only while the model is below the rail.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.numerics.robust import huber_weights, MAD_TO_SIGMA

MAX_ITERATIONS = 15
INITIAL_DAMPING, MAX_DAMPING = 1e-4, 1e6  # of the diagonal of the Hessian
DAMPING_FACTOR = 10.0       # after a failed step, its inverse after a successful one
MIN_COST_REDUCTION = 0.03   # chi-squared; a step with a smaller expected reduction is the last
HUBER_THRESHOLD = 3.0       # sigmas, beyond which a sample has lower weight
MAX_PRODUCT_SIZE = 200_000  # multiplications; OpenBLAS uses threads from 4 * 65536 on

Indices = NDArray[np.intp]


class Model(Protocol):
    """Model of the samples."""

    def linearized(self, p: Array) -> tuple[Array, Array]:
        """Return output (n,) and Jacobian (m, n) for the parameters ``p`` (m,)."""

    def moved(self, p: Array, step: Array) -> Array:
        """Return ``p`` after ``step``, which may be shortened to a valid range."""


@dataclass(frozen=True, slots=True, eq=False)
class JointPrior:
    """Gaussian prior of the parameters; those that are not ``free`` are fixed."""

    value: Array
    precision: Array     # inverse covariance (free, free) of the fitted parameters
    free: Indices        # of the fitted parameters

    def without(self, fixed: slice) -> JointPrior:
        """Return the prior with the parameters ``fixed`` at their values."""
        kept = (self.free < fixed.start) | (self.free >= fixed.stop)
        return replace(self, precision=self.precision[kept][:, kept], free=self.free[kept])

    def rows(self, parameters: Indices) -> Indices:
        """Return the rows of free ``parameters`` in the precision."""
        return np.searchsorted(self.free, parameters)


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """Parameters with residuals and derivatives of the model."""

    p: Array
    residual: Array  # (n,)
    jacobian: Array  # (m, n), by all m parameters


@dataclass(frozen=True, slots=True, eq=False)
class FitResult:
    """Result of a fit: ``p`` is at most a small step from the last evaluated ``point``."""

    p: Array
    point: Point
    prior: JointPrior
    weight: Array   # (n,), of the samples, over their variance
    hessian: Array  # by the free parameters


class LevenbergMarquardt:
    """
    Minimizes the weighted residuals of ``observed`` (n,) with noise of ``variance``.

    ``rail`` (n,) is 1 where a sample is clipped at the upper rail, -1 at the lower, else 0.
    """

    def __init__(self, model: Model, observed: Array, rail: NDArray[np.int8],
                 variance: float) -> None:
        self._model, self._observed, self._variance = model, observed, variance
        self._rail, self._clips = rail, bool(rail.any())

    def run(self, start: Array | Point, prior: JointPrior,
            min_reduction: float = MIN_COST_REDUCTION) -> FitResult:
        """
        Return the fit; fixed parameters take the value of ``prior``, as they must have in a point.

        A step whose expected reduction of the cost is below ``min_reduction`` is the last.
        """
        if isinstance(start, Point):
            point = start
        else:
            p = prior.value.copy()
            p[prior.free] = start[prior.free]
            point = self._at(p)
        damping = INITIAL_DAMPING
        for _ in range(MAX_ITERATIONS):
            weight = self._weights(point)
            jacobian = point.jacobian.take(prior.free, axis=0)
            hessian = gram(jacobian, weight)
            hessian += prior.precision
            gradient = jacobian @ (weight * point.residual) + prior.precision @ (
                prior.value - point.p)[prior.free]
            parameters, moved, damping = self._step(
                point, prior, weight, hessian, gradient, damping, min_reduction)
            if moved is None:
                break
            point = moved
        return FitResult(parameters, point, prior, weight, hessian)

    def _at(self, p: Array) -> Point:
        output, jacobian = self._model.linearized(p)
        return Point(p, self._observed - output, jacobian)

    def _step(self, point: Point, prior: JointPrior, weight: Array, hessian: Array,
              gradient: Array, damping: float, min_reduction: float
              ) -> tuple[Array, Point | None, float]:
        """
        Return the parameters after a step, the point there, and the next damping.

        The point is None if the expected reduction of the cost is small, or no step reduces it:
        then the step is the last.
        """
        current_cost = self._cost(point, prior, weight)
        while damping < MAX_DAMPING:
            damped = hessian.copy()
            damped.reshape(-1)[::len(damped) + 1] *= 1.0 + damping
            step, whole = solve_spd(damped, gradient), np.zeros_like(point.p)
            whole[prior.free] = step
            p = self._model.moved(point.p, whole)
            if float(gradient @ step) < min_reduction:
                return p, None, damping
            trial = self._at(p)
            if self._cost(trial, prior, weight) <= current_cost:
                return p, trial, damping / DAMPING_FACTOR
            damping *= DAMPING_FACTOR
        return point.p, None, damping

    def _cost(self, point: Point, prior: JointPrior, weight: Array) -> float:
        deviation = (point.p - prior.value)[prior.free]
        return float(self._unclipped(point, weight) @ (point.residual * point.residual)
                     + deviation @ prior.precision @ deviation)

    def _weights(self, point: Point) -> Array:
        """Return 1 / variance with Huber's factor, 0 for samples beyond their rail."""
        size = np.abs(point.residual)
        sigma = max(math.sqrt(self._variance), MAD_TO_SIGMA * upper_median(size))
        return self._unclipped(point, huber_weights(size, HUBER_THRESHOLD * sigma)
                               / self._variance)

    def _unclipped(self, point: Point, weight: Array) -> Array:
        return (np.where(self._rail * point.residual < 0.0, 0.0, weight) if self._clips
                else weight)


def solve_spd(matrix: Array, right: Array) -> NDArray[np.floating]:
    """
    Return matrix^-1 @ right of a positive definite matrix, with little overhead.

    >>> solve_spd(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([3.0, 3.0]))
    array([1., 1.])
    """
    from scipy.linalg.lapack import dposv  # see docs/architecture.md
    _, solution, failed = dposv(matrix, right)
    return np.linalg.solve(matrix, right) if failed else solution


def inverse_factor(matrix: Array) -> Array:
    """
    Return the inverse of the lower Cholesky factor of a covariance (n, n): it whitens errors.

    Raises LinAlgError if the matrix is not positive definite.

    >>> inverse_factor(np.array([[4.0, 2.0], [2.0, 5.0]])).tolist()
    [[0.5, 0.0], [-0.25, 0.5]]
    """
    from scipy.linalg.lapack import dpotrf, dtrtri  # see docs/architecture.md
    factor, failed = dpotrf(matrix, lower=1)
    if failed:
        raise np.linalg.LinAlgError('the matrix is not positive definite')
    return np.asarray(dtrtri(factor, lower=1)[0] if matrix.size else factor)


def inverse_spd(matrix: Array) -> Array:
    """
    Return the inverse of a positive definite matrix.

    For the size of these matrices LAPACK's own inverses use threads, which is many times slower.

    >>> inverse_spd(np.diag([4.0, 16.0])).tolist()
    [[0.25, 0.0], [0.0, 0.0625]]
    """
    try:
        return gram(inverse_factor(matrix).T)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.inv(matrix), dtype=float)


def gram(jacobian: Array, weight: Array | None = None) -> Array:
    """
    Return jacobian @ diag(weight) @ jacobian.T, for a jacobian (m, n) and weights (n,) >= 0.

    BLAS computes half of the symmetric product. Computed in blocks below the size from which it
    uses threads, which is ten times slower.

    >>> gram(np.array([[1.0, 2.0], [0.0, 1.0]]), np.array([1.0, 4.0])).tolist()
    [[17.0, 8.0], [8.0, 4.0]]
    """
    root = jacobian if weight is None else jacobian * np.sqrt(weight)
    part = max(MAX_PRODUCT_SIZE // len(jacobian)**2, 1)
    total: Array = root[:, :part] @ root[:, :part].T
    for i in range(part, jacobian.shape[1], part):
        total += root[:, i:i + part] @ root[:, i:i + part].T
    return total


def upper_median(values: Array) -> float:
    """
    Return the upper median; for short arrays ten times as fast as numpy.median.

    >>> upper_median(np.array([4.0, 1.0, 3.0, 2.0]))
    3.0
    """
    return float(np.sort(values)[len(values) // 2])
