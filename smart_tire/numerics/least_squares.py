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
have common errors. ``regression`` fits a linear model, ``nonlinear_fit`` any residual function,
``fit_delay`` a linear model whose signals have an unknown delay.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq, solve_triangular
from scipy.optimize import least_squares, minimize_scalar

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.numerics.robust import huber_weights, mad_sigma, measurement_noise
from smart_tire.uncertain import Uncertain

HUBER_THRESHOLD = 2.0  # sigmas, beyond which a row has lower weight
REWEIGHTING_ROUNDS = 8       # of a regression; more do not change the result
MAX_EVALUATIONS = 50         # of a nonlinear model, between two new weights
MIN_INFORMATION = 1e-12      # relative, of a direction that the rows do not determine
DELAY_ROUNDS = 5             # of noise, then delay; more do not change the result
MAX_AUTOCORRELATION, MAX_ANTICORRELATION = 0.999, 0.49  # of neighboring rows
HAC_TIME = 1.0               # s over which whitened residuals may still be correlated
DELAY_TOLERANCE = 1e-5       # s, of the search
AMBIGUITY_CHI_SQUARE = 9.0   # by which all other minima must be worse: three sigmas
MINIMUM_WIDTH_SIGMAS = 5.0   # standard errors within which grid points belong to the same minimum
MIN_ROWS = 12                # below this number the residuals do not determine their noise


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
        """Return the prior of (mean, sigma) of each value, None without a prior."""
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


@dataclass(frozen=True)
class Fit:
    """
    Fitted values with their covariance.

    >>> Fit(np.array([3.0]), np.array([[0.04]]), np.ones(5), np.zeros(5)).estimate(0)
    Uncertain(value=3.0, sigma=0.2)
    """

    values: Array      # (p,)
    covariance: Array  # (p, p)
    row_sigma: Array   # (n,) standard deviation of each row: noise and model error
    residuals: Array   # (n,) target minus model

    def estimate(self, index: int) -> Uncertain:
        """Return a value with its standard error."""
        return Uncertain(float(self.values[index]), math.sqrt(self.covariance[index, index]))


@dataclass(frozen=True)
class DelayFit(Fit):
    """Fitted values, of which the last one is the delay [s]."""

    rows: Rows           # at that delay
    noise: float         # standard deviation of a row without model errors
    correlation: float   # of neighboring rows

    @property
    def delay(self) -> float:
        """Return the delay [s]."""
        return float(self.values[-1])

    @property
    def explained(self) -> Array:
        """Return the target (n,) without all terms but the first."""
        return self.rows.target - self.rows.matrix[:, 1:] @ self.values[1:-1]


Whitener = Callable[[Array], Array]   # rows (n,) or (n, p) -> weighted rows
Solved = tuple[Array, Array, Array]  # values (p,), residuals (n,), weighted Jacobian (n, p)


def solve_with_prior(matrix: Array, target: Array, prior: Prior) -> tuple[Array, float]:
    """
    Return the values (p,) that minimize the cost, and the cost.

    The cost is |matrix @ c - target|^2 + |(c - prior.mean) / prior.sigma|^2, with ``matrix``
    (n, p) and ``target`` (n,) divided by the standard deviations of their rows.

    >>> solve_with_prior(np.eye(1), np.array([2.0]), Prior(np.zeros(1), np.ones(1)))
    (array([1.]), 2.0)
    """
    extended = np.vstack([matrix, np.diag(prior.weight)])
    wanted = np.concatenate([target, prior.mean * prior.weight])
    # by orthogonal factorization: several times as fast as by singular values
    values = np.asarray(lstsq(extended, wanted, lapack_driver='gelsy', check_finite=False)[0])
    return values, float(np.sum((extended @ values - wanted)**2))


def posterior(matrix: Array, target: Array, prior: Prior) -> tuple[Array, Array]:
    """
    Return the values (p,) of ``solve_with_prior``, of rows with unit noise, and their covariance.

    >>> posterior(np.eye(1), np.array([2.0]), Prior(np.zeros(1), np.ones(1)))[1]
    array([[0.5]])
    """
    values, _ = solve_with_prior(matrix, target, prior)
    return values, np.linalg.inv(matrix.T @ matrix + np.diag(prior.weight ** 2))


def regression(rows: Rows, prior: Prior, *, lags: int = 0,
               contiguous: NDArray[np.bool_] | None = None) -> Fit:
    """
    Fit a linear model; residuals up to ``lags`` rows apart may be correlated.

    ``contiguous`` (n,) are rows that begin with the measurement that ended the previous one, like
    the displacements between noisy poses: their errors are anticorrelated.

    >>> x = np.arange(10.0)
    >>> y = 3.0 * x
    >>> y[4] = 1000.0  # an outlier
    >>> fit = regression(Rows(x, x[:, None], y, np.zeros(10)), Prior.of(None))
    >>> round(fit.estimate(0).value, 2)
    3.0
    """
    def solve(white: Whitener) -> Solved:
        matrix, target = white(rows.matrix), white(rows.target)
        values, _ = solve_with_prior(matrix, target, prior)
        return values, rows.target - rows.matrix @ values, matrix
    return _reweighted(solve, prior, lambda values: rows.sigma, mad_sigma(rows.target) or 1.0,
                       lags, contiguous)


def nonlinear_fit(residual: Callable[[Array], Array], start: Array, prior: Prior,
                  sigma: Callable[[Array], Array], *, lags: int = 0,
                  contiguous: NDArray[np.bool_] | None = None,
                  jacobian: Callable[[Array], Array] | None = None) -> Fit:
    """
    Fit ``residual`` (p,) -> (n,), measured minus model, from ``start`` (p,).

    ``sigma`` (p,) -> (n,) is the standard deviation of effects that the model omits; ``jacobian``
    (p,) -> (n, p), by finite differences if None, is that of the residual. The other arguments
    are those of ``regression``.

    >>> t = np.linspace(0.0, 3.0, 30)
    >>> fit = nonlinear_fit(lambda x: np.exp(-0.7 * t) - np.exp(-x[0] * t), np.ones(1),
    ...                     Prior.of(None), lambda x: np.zeros(30))
    >>> round(fit.estimate(0).value, 3)
    0.7
    """
    latest = np.asarray(start, float)

    def solve(white: Whitener) -> Solved:
        nonlocal latest
        slope: Any = '2-point' if jacobian is None else lambda x: np.vstack(
            [white(jacobian(x)), np.diag(prior.weight)])
        found = least_squares(
            lambda x: np.concatenate([white(residual(x)), (x - prior.mean) * prior.weight]),
            latest, slope, x_scale='jac', max_nfev=MAX_EVALUATIONS)
        latest, residuals = found.x, residual(found.x)
        return latest, residuals, -found.jac[:len(residuals)]
    return _reweighted(solve, prior, sigma, mad_sigma(residual(latest)) or 1.0, lags, contiguous,
                       sigma(latest))


def _anticorrelation_factor(residuals: Array, contiguous: NDArray[np.bool_]) -> Array:
    """Return the Cholesky factor of the correlation that normalized ``residuals`` (n,) show."""
    clipped = np.clip(residuals, -HUBER_THRESHOLD, HUBER_THRESHOLD)
    products = clipped[1:] * clipped[:-1] * contiguous[1:]
    # one half if all noise comes from the measurements at the ends
    correlation = np.clip(np.sum(products) / np.sum(clipped ** 2), -MAX_ANTICORRELATION, 0.0)
    links = np.diag(correlation * contiguous[1:], -1)
    return np.asarray(np.linalg.cholesky(np.eye(len(clipped)) + links + links.T))


def _reweighted(solve: Callable[[Whitener], Solved], prior: Prior,
                sigma: Callable[[Array], Array], first_sigma: float, lags: int,
                contiguous: NDArray[np.bool_] | None, first: Array | None = None) -> Fit:
    """
    Return the fit by iteratively reweighted least squares; ``solve`` takes the rows' weights.

    The variance of a row is that of the noise, estimated from the residuals by their MAD
    (``first_sigma`` at first), plus ``sigma`` (n,) squared; residuals beyond ``HUBER_THRESHOLD``
    of these standard deviations have lower weight (Huber).
    """
    model_sigma = sigma(prior.mean) if first is None else first
    row_sigma, weight = np.hypot(first_sigma, model_sigma), np.ones(len(model_sigma))
    factor: Array | None = None
    for _ in range(REWEIGHTING_ROUNDS):
        scale = np.sqrt(weight) / row_sigma
        white = partial(_white, scale, factor)
        values, residuals, jacobian = solve(white)
        model_sigma = sigma(values)
        row_sigma = np.hypot(measurement_noise(residuals, model_sigma), model_sigma)
        weight = huber_weights(residuals / row_sigma, HUBER_THRESHOLD)
        if contiguous is not None:
            factor = _anticorrelation_factor(residuals / row_sigma, contiguous)
    return Fit(values, sandwich_covariance(jacobian, white(residuals), prior.sigma, lags),
               row_sigma, residuals)


def _white(scale: Array, factor: Array | None, rows: Array) -> Array:
    """Return weighted rows, (n,) or (n, p), without the correlation with the factor ``factor``."""
    weighted = (rows.T * scale).T
    return weighted if factor is None else np.asarray(
        solve_triangular(factor, weighted, lower=True, check_finite=False))


def sandwich_covariance(jacobian: Array, residuals: Array, prior_sigma: Array,
                        lags: int) -> Array:
    """
    Return the covariance (p, p) of a weighted fit from its own ``residuals`` (n,).

    ``jacobian`` (n, p) and residuals are weighted. Heteroscedasticity and autocorrelation
    consistent: residuals up to ``lags`` rows apart may be correlated (Newey and West 1987). A
    prior contributes with its own sigma (p,). The variance of an unobserved value is large.

    >>> sandwich_covariance(np.ones((4, 1)), np.array([1.0, -1.0, 1.0, -1.0]),
    ...                     np.array([np.inf]), 0).round(6)  # 4 / 3 over 4
    array([[0.333333]])
    """
    n, p = jacobian.shape
    prior_precision = np.diag(1.0 / prior_sigma ** 2)
    scores = jacobian * residuals[:, None]
    meat = scores.T @ scores
    for lag in range(1, min(lags, n - 1) + 1):
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


@dataclass(frozen=True)
class _Noise:
    """AR(1) noise of the rows."""

    sigma: Array             # (n,) standard deviation of each row
    correlation: float
    step_correlation: Array  # (n - 1,) of each row with the previous one
    weight: Array            # (n,) of the whitened rows
    white_sigma: float       # standard deviation without model errors

    def whitened(self, values: Array) -> Array:
        """Return whitened and weighted rows, (n,) or (n, p)."""
        shape = (-1,) + (1,) * (values.ndim - 1)
        scaled = values / self.sigma.reshape(shape)
        if self.correlation > 0.0:
            link = self.step_correlation.reshape(shape)
            scaled[1:] = (scaled[1:] - link * scaled[:-1]) / np.sqrt(1.0 - link ** 2)
        return np.asarray(scaled * np.sqrt(self.weight).reshape(shape))

    def solve(self, rows: Rows, prior: Prior) -> tuple[Array, float]:
        """Return the values, and the weighted sum of squares."""
        white = self.whitened(np.column_stack([rows.matrix, rows.target]))
        return solve_with_prior(white[:, :-1], white[:, -1], prior)

    def renewed(self, rows: Rows, prior: Prior, *, overlapping: bool) -> _Noise:
        """Return the noise of the residuals."""
        values, _ = self.solve(rows, prior)
        residuals = rows.target - rows.matrix @ values
        white_sigma = measurement_noise(residuals, rows.sigma)
        sigma = np.hypot(white_sigma, rows.sigma)
        clipped = np.clip(residuals / sigma, -HUBER_THRESHOLD, HUBER_THRESHOLD)
        steps = np.diff(rows.time)
        regular = steps < 1.5 * np.median(steps)
        correlation = float(np.sum((clipped[1:] * clipped[:-1])[regular]) / np.sum(clipped ** 2))
        if overlapping:
            correlation = 0.0  # differences of overlapping rows would amplify noise
        correlation = min(max(correlation, 0.0), MAX_AUTOCORRELATION)
        step_correlation = correlation ** (steps / np.median(steps))
        plain = _Noise(sigma, correlation, step_correlation, np.ones(len(sigma)), white_sigma)
        white = plain.whitened(residuals)
        # correlation explains a part of the residuals: the whitened ones may be smaller
        scale = max(mad_sigma(white), 1e-12)
        weight = huber_weights(white / scale, HUBER_THRESHOLD)
        return _Noise(sigma * scale, correlation, step_correlation, weight, white_sigma * scale)


def fit_delay(rows_at: Callable[[float], Rows], prior: Prior, delays: Array, *,
              overlapping: bool = False) -> DelayFit:
    """
    Return the best delay near one of ``delays`` [s, evenly spaced], and the linear values.

    The cost is minimized over the grid, then near its best point; noise, its AR(1) correlation
    and weights of the rows are estimated in between. ``delays`` has shape (m,), m >= 3; neighbors
    of ``overlapping`` rows share measurements. Raises EstimatorError if there are too few rows,
    if the best delay is at an end of the range, or if another delay fits equally well.

    >>> time = np.arange(0.0, 20.0, 0.1)
    >>> noise = 0.01 * np.random.default_rng(0).standard_normal(time.size)
    >>> def rows(delay):  # an echo, 0.2 s later and three times as large
    ...     return Rows(time, np.sin(time - delay)[:, None], 3.0 * np.sin(time - 0.2) + noise,
    ...                 np.zeros(time.size))
    >>> fit = fit_delay(rows, Prior.of(None), np.arange(-1.0, 1.1, 0.1))
    >>> round(fit.delay, 2), round(float(fit.values[0]), 2)
    (0.2, 3.0)
    """
    table = [rows_at(float(delay)) for delay in delays]
    n, step = len(table[0].time), float(delays[1] - delays[0])
    if n < MIN_ROWS:
        raise EstimatorError(f'{n} samples in motion, expected at least {MIN_ROWS}')
    noise = _Noise(np.ones(n), 0.0, np.zeros(n - 1), np.ones(n), 1.0)

    def costs() -> Array:
        return np.array([noise.solve(rows, prior)[1] for rows in table])

    delay = float(delays[int(np.argmin(costs()))])
    for count in range(DELAY_ROUNDS):
        noise = noise.renewed(rows_at(delay), prior, overlapping=overlapping)
        if count < DELAY_ROUNDS // 2:
            delay = float(delays[int(np.argmin(costs()))])
        delay = float(minimize_scalar(
            lambda x, noise: noise.solve(rows_at(x), prior)[1], args=(noise,),
            bounds=(delay - step, delay + step), method='bounded',
            options={'xatol': DELAY_TOLERANCE}).x)
    fit, inflation = _delay_fit(rows_at, prior, delay, noise)
    _check_unique(fit, delays, costs() / inflation,
                  noise.solve(rows_at(delay), prior)[1] / inflation)
    return fit


def _delay_fit(rows_at: Callable[[float], Rows], prior: Prior, delay: float,
               noise: _Noise) -> tuple[DelayFit, float]:
    """Return the fit, and the factor by which correlation increases the delay's variance."""
    rows = rows_at(delay)
    values, _ = noise.solve(rows, prior)
    # half a row: over a smaller offset noise of the signal would add to the slope
    offset = 0.5 * float(np.median(np.diff(rows.time)))
    later, earlier = rows_at(delay + offset), rows_at(delay - offset)
    slope = ((later.matrix - earlier.matrix) @ values - later.target + earlier.target) / (
        2.0 * offset)
    residuals = rows.target - rows.matrix @ values
    jacobian = noise.whitened(np.column_stack([rows.matrix, slope]))
    white, sigma = noise.whitened(residuals), np.append(prior.sigma, np.inf)
    covariance = sandwich_covariance(jacobian, white, sigma, rows.lags(HAC_TIME))
    plain = sandwich_covariance(jacobian, white, sigma, 0)
    fit = DelayFit(np.append(values, delay), covariance, noise.sigma, residuals, rows,
                   noise.white_sigma, noise.correlation)
    return fit, max(1.0, float(covariance[-1, -1] / plain[-1, -1]))


def _check_unique(fit: DelayFit, delays: Array, costs: Array, best: float) -> None:
    step, delay = delays[1] - delays[0], fit.delay
    if not delays[0] + step <= delay <= delays[-1] - step:
        raise EstimatorError(f'the best delay is outside of {delays[0]:g} to {delays[-1]:g} s')
    inner = costs[1:-1]
    distant = np.abs(delays[1:-1] - delay) > step + MINIMUM_WIDTH_SIGMAS * fit.estimate(-1).sigma
    minima: Sequence[bool] = (inner <= costs[:-2]) & (inner <= costs[2:]) & distant
    competing = delays[1:-1][minima & (inner < best + AMBIGUITY_CHI_SQUARE)]
    if len(competing):
        raise EstimatorError(
            f'delays of {delay:.3f} s and {competing[0]:.3f} s fit equally well')
