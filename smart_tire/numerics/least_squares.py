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
Robust least squares with priors: the core of everything that is fitted to a recording.

Rows are divided by their standard deviation, which comes from the residuals, and weighted by
Huber's function. The standard errors come from the residuals as well (heteroscedasticity and
autocorrelation consistent sandwich, Newey and West 1987), so that they hold if neighboring rows
have common errors. ``regression`` fits a linear model, ``nonlinear_fit`` any residual function.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.numerics.robust import huber_weights, measurement_noise
from smart_tire.uncertain import Uncertain

HUBER_THRESHOLD = 2.0  # sigmas, beyond which a row has lower weight
REWEIGHTING_ROUNDS = 8       # of a regression; more do not change the result
MAX_EVALUATIONS = 50         # of a nonlinear model, between two new weights
MIN_INFORMATION = 1e-12      # relative, of a direction that the rows do not determine
MAX_ANTICORRELATION = 0.49   # of neighboring rows
HAC_TIME = 1.0               # s over which whitened residuals may still be correlated

Indices = NDArray[np.intp]
Whitener = Callable[[Array], Array]        # rows (n,) or (n, p) -> rows with independent errors
Correlation = Callable[[Array], Whitener]  # normalized residuals (n,) -> whitener


@dataclass(frozen=True)
class Prior:
    """
    Independent normal prior of p values.

    >>> Prior(np.zeros(2), np.array([0.5, np.inf])).weight  # the second has no prior
    array([2., 0.])
    """

    mean: Array   # (p,)
    sigma: Array  # (p,), inf without a prior

    @classmethod
    def of(cls, *values: tuple[float, float] | None) -> Prior:
        """Return the prior from mean and sigma of each value, None without a prior."""
        mean, sigma = np.array([value or (0.0, math.inf) for value in values]).T
        return cls(mean, sigma)

    @property
    def weight(self) -> Array:
        """Return 1 / sigma, shape (p,)."""
        return 1.0 / self.sigma


@dataclass(frozen=True)
class Rows:
    """Linear system ``target = matrix @ values``, one row per time interval."""

    time: Array    # (n,) s; correlation decays with the time between rows
    matrix: Array  # (n, p)
    target: Array  # (n,)
    sigma: Array   # (n,) standard deviation of effects that the model omits

    def where(self, selected: NDArray[np.bool_]) -> Rows:
        """Return the ``selected`` rows."""
        return Rows(self.time[selected], self.matrix[selected], self.target[selected],
                    self.sigma[selected])

    def lags(self, time: float) -> int:
        """Return the number of rows in ``time`` [s]."""
        return math.ceil(time / float(np.median(np.diff(self.time))))


def independent(residuals: Array) -> Whitener:
    """
    Return the whitener of rows with independent errors.

    >>> independent(np.zeros(2))(np.array([1.0, 2.0]))
    array([1., 2.])
    """
    return np.asarray


def anticorrelated(contiguous: NDArray[np.bool_]) -> Correlation:
    """
    Return the correlation of rows of which some begin with the measurement that ends the previous.

    ``contiguous`` (n,) are those: the displacements between noisy poses are an example.

    >>> white = anticorrelated(np.array([False, True]))(np.array([1.0, -0.4]))
    >>> white(np.array([1.0, 0.0])).round(3)  # their correlation is -0.4 / 1.16
    array([1.   , 0.367])
    """
    from scipy.linalg import solve_triangular  # at first use: takes a part of a second

    def whitener(residuals: Array) -> Whitener:
        clipped = np.clip(residuals, -HUBER_THRESHOLD, HUBER_THRESHOLD)
        products = clipped[1:] * clipped[:-1] * contiguous[1:]
        # one half if all noise comes from the measurements at the ends
        correlation = np.clip(np.sum(products) / np.sum(clipped ** 2), -MAX_ANTICORRELATION, 0.0)
        links = np.diag(correlation * contiguous[1:], -1)
        factor = np.linalg.cholesky(np.eye(len(clipped)) + links + links.T)
        return lambda rows: np.asarray(
            solve_triangular(factor, rows, lower=True, check_finite=False))
    return whitener


@dataclass(frozen=True)
class Errors:
    """How the errors of n rows are related."""

    lags: int = 0                           # instants over which they may be correlated
    correlation: Correlation = independent  # of neighboring rows, removed before the fit
    group: Indices | None = None            # (n,) 0 to g - 1: rows with the same noise
    instant: Indices | None = None          # (n,) from 0 on: rows that may have common errors
    repeats: float = 1.0                    # rows with common errors, that count as one

    def noise(self, residuals: Array, model_sigma: Array) -> Array:
        """Return the standard deviation (n,) of the noise in ``residuals`` (n,)."""
        if self.group is None:
            return np.full(len(residuals), measurement_noise(residuals, model_sigma))
        same = [self.group == number for number in range(int(self.group.max()) + 1)]
        return np.array([measurement_noise(residuals[rows], model_sigma[rows]) if rows.any()
                         else 1.0 for rows in same])[self.group]


INDEPENDENT = Errors()


@dataclass(frozen=True)
class Fit:
    """
    Fitted values with their covariance.

    >>> Fit(np.array([3.0]), np.array([[0.04]]), np.ones(5), np.zeros(5), np.abs).estimate(0)
    Uncertain(value=3.0, sigma=0.2)
    """

    values: Array      # (p,)
    covariance: Array  # (p, p)
    row_sigma: Array   # (n,) standard deviation of each row: noise and model error
    residuals: Array   # (n,) target minus model
    white: Whitener    # of rows: divided by their standard deviation, without correlation

    def estimate(self, index: int) -> Uncertain:
        """Return a value with its standard error."""
        return Uncertain(float(self.values[index]), math.sqrt(self.covariance[index, index]))

    def combined(self, factors: Array) -> Uncertain:
        """Return the sum of the values times ``factors`` (p,), with its standard error."""
        return Uncertain(float(factors @ self.values),
                         math.sqrt(float(factors @ self.covariance @ factors)))


def solve_with_prior(matrix: Array, target: Array, prior: Prior) -> tuple[Array, float]:
    """
    Return the values (p,) that minimize the cost, and the cost.

    The cost is |matrix @ c - target|^2 + |(c - prior.mean) / prior.sigma|^2, with ``matrix``
    (n, p) and ``target`` (n,) divided by the standard deviations of their rows.

    >>> solve_with_prior(np.eye(1), np.array([2.0]), Prior(np.zeros(1), np.ones(1)))
    (array([1.]), 2.0)
    """
    from scipy.linalg import lstsq  # at first use: takes a part of a second
    extended = np.vstack([matrix, np.diag(prior.weight)])
    wanted = np.concatenate([target, prior.mean * prior.weight])
    # by orthogonal factorization: several times as fast as by singular values
    values = np.asarray(lstsq(extended, wanted, lapack_driver='gelsy', check_finite=False)[0])
    return values, float(np.sum((extended @ values - wanted)**2))


def least_costs(systems: Array, prior: Prior) -> Array:
    """
    Return the smallest costs (m,) of ``systems`` (m, n, p + 1).

    Each is a matrix and, as its last column, a target, as in ``solve_with_prior``.

    >>> least_costs(np.array([[[1.0, 2.0]]]), Prior(np.zeros(1), np.ones(1))).round(12)
    array([2.])
    """
    p = len(prior.mean)
    known = np.column_stack([np.diag(prior.weight), prior.mean * prior.weight])
    extended = np.concatenate(
        [systems, np.broadcast_to(known, (len(systems), *known.shape))], axis=1)
    factors: Array = np.asarray(np.linalg.qr(extended, mode='r'))
    costs: Array = factors[:, p, p] ** 2  # the part of the target that no column explains
    sizes = np.abs(np.diagonal(factors, axis1=1, axis2=2))[:, :p]
    # with columns that depend on each other, the factors do not separate that part
    for index in np.flatnonzero(np.min(sizes, 1) <= MIN_INFORMATION * np.max(sizes, 1)):
        costs[index] = solve_with_prior(systems[index, :, :p], systems[index, :, p], prior)[1]
    return costs


def regression(rows: Rows, prior: Prior, errors: Errors = INDEPENDENT) -> Fit:
    """
    Fit a linear model.

    >>> x = np.arange(10.0)
    >>> y = 3.0 * x
    >>> y[4] = 1000.0  # an outlier
    >>> fit = regression(Rows(x, x[:, None], y, np.zeros(10)), Prior.of(None))
    >>> round(fit.estimate(0).value, 2)
    3.0
    """
    def solve(white: Whitener, _: Array) -> tuple[Array, Array]:
        matrix = white(rows.matrix)
        return solve_with_prior(matrix, white(rows.target), prior)[0], matrix
    return _reweighted(lambda values: rows.target - rows.matrix @ values, solve,
                       np.zeros(len(prior.mean)), prior, lambda values: rows.sigma, errors)


def nonlinear_fit(residual: Callable[[Array], Array], start: Array, prior: Prior,
                  sigma: Callable[[Array], Array], errors: Errors = INDEPENDENT, *,
                  jacobian: Callable[[Array], Array] | None = None) -> Fit:
    """
    Fit ``residual`` (p,) -> (n,), measured minus model, from ``start`` (p,).

    ``sigma`` (p,) -> (n,) is the standard deviation of effects that the model omits; ``jacobian``
    (p,) -> (n, p), by finite differences if None, is that of the residual.

    >>> t = np.linspace(0.0, 3.0, 30)
    >>> fit = nonlinear_fit(lambda x: np.exp(-0.7 * t) - np.exp(-x[0] * t), np.ones(1),
    ...                     Prior.of(None), lambda x: np.zeros(30))
    >>> round(fit.estimate(0).value, 3)
    0.7
    """
    from scipy.optimize import least_squares  # at first use: takes a part of a second

    def solve(white: Whitener, latest: Array) -> tuple[Array, Array]:
        slope: Any = '2-point' if jacobian is None else lambda x: np.vstack(
            [white(jacobian(x)), np.diag(prior.weight)])
        found = least_squares(
            lambda x: np.concatenate([white(residual(x)), (x - prior.mean) * prior.weight]),
            latest, slope, x_scale='jac', max_nfev=MAX_EVALUATIONS)
        return found.x, found.jac[:-len(latest)]
    return _reweighted(residual, solve, np.asarray(start, float), prior, sigma, errors)


def _reweighted(residual: Callable[[Array], Array],
                solve: Callable[[Whitener, Array], tuple[Array, Array]], values: Array,
                prior: Prior, sigma: Callable[[Array], Array], errors: Errors) -> Fit:
    """
    Return the fit by iteratively reweighted least squares, from ``values`` (p,) on.

    ``solve`` returns new values and the whitened Jacobian. The variance of a row is that of the
    noise, estimated from the residuals by their MAD, plus ``sigma`` (n,) squared; residuals beyond
    ``HUBER_THRESHOLD`` of these standard deviations have lower weight (Huber).
    """
    residuals, model_sigma = residual(values), sigma(values)
    row_sigma = np.hypot(errors.noise(residuals, np.zeros(len(residuals))), model_sigma)
    weight, correlation = np.full(len(residuals), 1.0 / errors.repeats), independent(residuals)
    for _ in range(REWEIGHTING_ROUNDS):
        white = _weighted(row_sigma, correlation, weight)
        values, jacobian = solve(white, values)
        residuals, model_sigma = residual(values), sigma(values)
        row_sigma = np.hypot(errors.noise(residuals, model_sigma), model_sigma)
        correlation = errors.correlation(residuals / row_sigma)
        normalized = correlation(residuals / row_sigma)
        weight = huber_weights(normalized, HUBER_THRESHOLD) / errors.repeats
    covariance = sandwich_covariance(jacobian, white(residuals), prior.sigma, errors.lags,
                                     errors.instant)
    return Fit(values, covariance, row_sigma, residuals, white)


def _weighted(sigma: Array, correlation: Whitener, weight: Array) -> Whitener:
    return lambda rows: (np.sqrt(weight) * correlation((rows.T / sigma).T).T).T


def sandwich_covariance(jacobian: Array, residuals: Array, prior_sigma: Array,
                        lags: int, instant: Indices | None = None) -> Array:
    """
    Return the covariance (p, p) of a weighted fit from its own ``residuals`` (n,).

    ``jacobian`` (n, p) and residuals are weighted. Heteroscedasticity and autocorrelation
    consistent: residuals up to ``lags`` rows apart may be correlated (Newey and West 1987), or up
    to ``lags`` instants if some rows are of the same ``instant`` (n,). A prior contributes with
    its own sigma (p,). The variance of an unobserved value is large.

    >>> sandwich_covariance(np.ones((4, 1)), np.array([1.0, -1.0, 1.0, -1.0]),
    ...                     np.array([np.inf]), 0).round(6)  # 4 / 3 over 4
    array([[0.333333]])
    """
    n, p = jacobian.shape
    prior_precision = np.diag(1.0 / prior_sigma ** 2)
    scores = jacobian * residuals[:, None]
    if instant is not None:
        scores = np.stack([np.bincount(instant, column) for column in scores.T], axis=1)
    meat = scores.T @ scores
    for lag in range(1, min(lags, len(scores) - 1) + 1):
        product = scores[lag:].T @ scores[:-lag]
        meat += (1.0 - lag / (lags + 1.0)) * (product + product.T)
    meat = meat * n / max(n - p, 1) + prior_precision
    information = jacobian.T @ jacobian + prior_precision
    size = np.sqrt(np.maximum(np.diag(information), MIN_INFORMATION))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    values = np.maximum(values, MIN_INFORMATION)
    inverse = vectors / values @ vectors.T / np.outer(size, size)
    unobserved = vectors * (values <= MIN_INFORMATION) / MIN_INFORMATION @ vectors.T
    return np.asarray(inverse @ meat @ inverse + unobserved / np.outer(size, size))
