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

"""Robust linear regression with priors, model errors and consistent standard errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from smart_tire.arrays import Array
from smart_tire.numerics.robust import huber_weights, measurement_noise
from smart_tire.uncertain import Uncertain

HUBER_THRESHOLD = 2.0  # sigmas, beyond which a row has lower weight
REWEIGHTING_ROUNDS = 8
UNINFORMATIVE_PRECISION = 1e-12  # of the prior of an unobserved coefficient, keeps it invertible

# from residuals (n,) in standard deviations to a function that decorrelates rows (n, ...)
Whitener = Callable[[Array], Callable[[Array], Array]]


@dataclass(frozen=True)
class Prior:
    """
    Independent normal prior of p coefficients.

    >>> Prior(np.zeros(2), np.array([0.5, np.inf])).weight  # the second has no prior
    array([2., 0.])
    """

    mean: Array   # (p,)
    sigma: Array  # (p,), inf without a prior

    @property
    def weight(self) -> Array:
        """Return 1 / sigma, shape (p,)."""
        return 1.0 / self.sigma


@dataclass(frozen=True)
class RobustFit:
    """
    Result of ``robust_regression``.

    >>> RobustFit(np.array([3.0]), np.array([[0.04]]), np.ones(5)).estimate(0)
    Uncertain(value=3.0, sigma=0.2)
    """

    coefficients: Array  # (p,)
    covariance: Array    # (p, p)
    row_sigma: Array     # (n,) standard deviation of each row: noise and model error

    def estimate(self, index: int) -> Uncertain:
        """Return a coefficient with its standard error."""
        return Uncertain(float(self.coefficients[index]),
                         float(np.sqrt(self.covariance[index, index])))


def solve_with_prior(matrix: Array, target: Array, prior: Prior) -> tuple[Array, float]:
    """
    Return the coefficients (p,) that minimize the cost, and the cost.

    The cost is |matrix @ c - target|^2 + |(c - prior.mean) / prior.sigma|^2, with ``matrix``
    (n, p) and ``target`` (n,) divided by the standard deviations of their rows.

    >>> solve_with_prior(np.eye(1), np.array([2.0]), Prior(np.zeros(1), np.ones(1)))
    (array([1.]), 2.0)
    """
    extended = np.vstack([matrix, np.diag(prior.weight)])
    wanted = np.concatenate([target, prior.mean * prior.weight])
    coefficients = np.asarray(np.linalg.lstsq(extended, wanted, rcond=None)[0], float)
    return coefficients, float(np.sum((extended @ coefficients - wanted)**2))


def robust_regression(matrix: Array, target: Array, prior: Prior, *, model_sigma: Array,
                      initial_sigma: float, hac_lags: int,
                      whitener: Whitener | None = None) -> RobustFit:
    """
    Fit ``target`` (n,) = ``matrix`` (n, p) @ coefficients by iteratively reweighted least squares.

    The variance of a row is that of the noise, estimated from the residuals by their MAD
    (``initial_sigma`` at first), plus ``model_sigma`` (n,) squared; residuals beyond
    ``HUBER_THRESHOLD`` of these standard deviations have lower weight (Huber). ``whitener``
    removes a correlation of neighboring rows. The covariance is that of ``sandwich_covariance``.

    >>> x = np.arange(10.0)
    >>> y = 3.0 * x
    >>> y[4] = 1000.0  # an outlier
    >>> fit = robust_regression(x[:, None], y, Prior(np.zeros(1), np.full(1, np.inf)),
    ...                         model_sigma=np.zeros(10), initial_sigma=100.0, hac_lags=0)
    >>> round(fit.estimate(0).value, 2)
    3.0
    """
    row_sigma, weight = np.hypot(initial_sigma, model_sigma), np.ones(len(target))
    whitened: Callable[[Array], Array] = np.asarray
    for _ in range(REWEIGHTING_ROUNDS):
        scale = np.sqrt(weight) / row_sigma
        white_matrix, white_target = whitened(matrix * scale[:, None]), whitened(target * scale)
        coefficients, _ = solve_with_prior(white_matrix, white_target, prior)
        residuals = target - matrix @ coefficients
        row_sigma = np.hypot(measurement_noise(residuals, model_sigma), model_sigma)
        weight = huber_weights(residuals / row_sigma, HUBER_THRESHOLD)
        if whitener is not None:
            whitened = whitener(residuals / row_sigma)
    covariance = sandwich_covariance(
        white_matrix, white_target - white_matrix @ coefficients, prior.sigma, hac_lags)
    return RobustFit(coefficients, covariance, row_sigma)


def sandwich_covariance(jacobian: Array, residuals: Array, prior_sigma: Array,
                        lags: int) -> Array:
    """
    Return the covariance (p, p) of a weighted fit from its own ``residuals`` (n,).

    ``jacobian`` (n, p) and residuals are weighted. Heteroscedasticity and autocorrelation
    consistent: residuals up to ``lags`` rows apart may be correlated (Newey and West 1987). A
    prior contributes with its own sigma (p,). The variance of an unobserved coefficient is large.

    >>> sandwich_covariance(np.ones((4, 1)), np.array([1.0, -1.0, 1.0, -1.0]),
    ...                     np.array([np.inf]), 0).round(6)  # 4 / 3 over 4
    array([[0.333333]])
    """
    n, p = jacobian.shape
    prior_precision = np.diag(1.0 / prior_sigma ** 2 + UNINFORMATIVE_PRECISION)
    scores = jacobian * residuals[:, None]
    meat = scores.T @ scores
    for lag in range(1, min(lags, n - 1) + 1):
        product = scores[lag:].T @ scores[:-lag]
        meat += (1.0 - lag / (lags + 1.0)) * (product + product.T)
    meat = meat * n / max(n - p, 1) + prior_precision
    inverse = np.linalg.inv(jacobian.T @ jacobian + prior_precision)
    return np.asarray(inverse @ meat @ inverse)
