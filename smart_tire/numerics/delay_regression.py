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

"""
Least squares over a delay and linear coefficients, with realistic measurement noise.

The noise may be correlated between rows, heteroscedastic, and contain outliers. Rows are divided
by their standard deviation, whitened by an AR(1) model and weighted by Huber's function. Standard
errors come from the residuals (heteroscedasticity and autocorrelation consistent sandwich, Newey
and West 1987), so they hold if these assumptions do not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math

import numpy as np
from scipy.optimize import minimize_scalar

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.numerics.regression import (
    HUBER_THRESHOLD, Prior, sandwich_covariance, solve_with_prior)
from smart_tire.numerics.robust import huber_weights, mad_sigma, measurement_noise

REWEIGHTING_ROUNDS = 5       # of noise, then delay; more do not change the result
MAX_AUTOCORRELATION = 0.999  # of neighboring rows
HAC_TIME = 1.0               # s over which whitened residuals may still be correlated
DELAY_TOLERANCE = 1e-5       # s, of the search
AMBIGUITY_CHI_SQUARE = 9.0   # by which all other minima must be worse: three sigmas
MINIMUM_WIDTH_SIGMAS = 5.0   # standard errors within which grid points belong to the same minimum
MIN_ROWS = 12                # below this number the residuals do not determine their noise


@dataclass(frozen=True)
class Rows:
    """Linear system ``target = matrix @ coefficients`` at one delay."""

    matrix: Array  # (n, p)
    target: Array  # (n,)


@dataclass(frozen=True)
class DelayProblem:
    """A linear system as a function of the delay [s], with priors."""

    rows: Callable[[float], Rows]
    model_sigma: Callable[[float], Array]  # delay -> (n,) sigma of effects the model omits
    time: Array                            # (n,) s; correlation decays with the time between rows
    prior: Prior                           # of the coefficients
    overlapping: bool = False              # whether neighboring rows share measurements


@dataclass(frozen=True)
class DelayFit:
    """Delay and coefficients; the delay is the last row of the covariance."""

    delay: float         # s
    coefficients: Array  # (p,)
    covariance: Array    # (p + 1, p + 1)
    noise: float         # standard deviation of a row without model errors
    correlation: float   # of neighboring rows
    residuals: Array     # (n,), target minus model

    @property
    def sigma(self) -> float:
        """Return the standard error of the delay [s]."""
        return float(np.sqrt(self.covariance[-1, -1]))

    def coefficient_sigma(self, index: int) -> float:
        """Return the standard error of a coefficient."""
        return float(np.sqrt(self.covariance[index, index]))


@dataclass(frozen=True)
class _Noise:
    sigma: Array  # (n,) standard deviation of each row
    correlation: float
    step_correlation: Array  # (n - 1,) of each row with the previous one
    weight: Array            # (n,) of the whitened rows
    white_sigma: float       # standard deviation without model errors


def fit_delay(problem: DelayProblem, delays: Array) -> DelayFit:
    """
    Return the best delay near one of ``delays`` [s, evenly spaced] and its coefficients.

    The cost is minimized over the grid, then near its best point; noise, correlation and weights
    of the rows are estimated in between. ``delays`` has shape (m,), m >= 3. Raises EstimatorError
    if there are too few rows, if the best delay is at an end of the range, or if another delay
    fits equally well.

    >>> time = np.arange(0.0, 20.0, 0.1)
    >>> noise = 0.01 * np.random.default_rng(0).standard_normal(time.size)
    >>> def rows(delay):  # an echo, 0.2 s later and three times as large
    ...     return Rows(np.sin(time - delay)[:, None], 3.0 * np.sin(time - 0.2) + noise)
    >>> problem = DelayProblem(rows, lambda delay: np.zeros(time.size), time,
    ...                        Prior(np.zeros(1), np.full(1, np.inf)))
    >>> fit = fit_delay(problem, np.arange(-1.0, 1.1, 0.1))
    >>> round(fit.delay, 2), round(float(fit.coefficients[0]), 2)
    (0.2, 3.0)
    """
    n = len(problem.time)
    if n < MIN_ROWS:
        raise EstimatorError(f'{n} samples in motion, expected at least {MIN_ROWS}')
    noise = _Noise(np.ones(n), 0.0, np.zeros(n - 1), np.ones(n), 1.0)
    table = [problem.rows(float(delay)) for delay in delays]
    costs = _scan(problem, table, noise)
    delay = float(delays[int(np.argmin(costs))])
    for count in range(REWEIGHTING_ROUNDS):
        noise = _noise(problem, delay, noise)
        if count < REWEIGHTING_ROUNDS // 2:
            costs = _scan(problem, table, noise)
            delay = float(delays[int(np.argmin(costs))])
        delay = _refined(problem, delay, float(delays[1] - delays[0]), noise)
    result, inflation = _result(problem, delay, noise)
    _check(result, delays, _scan(problem, table, noise) / inflation,
           _cost(problem, problem.rows(delay), noise) / inflation)
    return result


def _scan(problem: DelayProblem, table: Sequence[Rows], noise: _Noise) -> Array:
    return np.array([_cost(problem, rows, noise) for rows in table])


def _refined(problem: DelayProblem, delay: float, step: float, noise: _Noise) -> float:
    found = minimize_scalar(
        lambda x: _cost(problem, problem.rows(x), noise), bounds=(delay - step, delay + step),
        method='bounded', options={'xatol': DELAY_TOLERANCE})
    return float(found.x)


def _check(fit: DelayFit, delays: Array, costs: Array, best: float) -> None:
    step, delay = delays[1] - delays[0], fit.delay
    if not delays[0] + step <= delay <= delays[-1] - step:
        raise EstimatorError(f'the best delay is outside of {delays[0]:g} to {delays[-1]:g} s')
    candidates = costs[1:-1]
    distant = np.abs(delays[1:-1] - delay) > step + MINIMUM_WIDTH_SIGMAS * fit.sigma
    minima = (candidates <= costs[:-2]) & (candidates <= costs[2:]) & distant
    competing = delays[1:-1][minima & (candidates < best + AMBIGUITY_CHI_SQUARE)]
    if len(competing):
        raise EstimatorError(
            f'delays of {delay:.3f} s and {competing[0]:.3f} s fit equally well')


def _whitened(values: Array, noise: _Noise) -> Array:
    """Return whitened and weighted rows, (n,) or (n, p)."""
    shape = (-1,) + (1,) * (values.ndim - 1)
    scaled = values / noise.sigma.reshape(shape)
    if noise.correlation > 0.0:
        link = noise.step_correlation.reshape(shape)
        scaled[1:] = (scaled[1:] - link * scaled[:-1]) / np.sqrt(1.0 - link ** 2)
    scaled *= np.sqrt(noise.weight).reshape(shape)
    return scaled


def _solve(problem: DelayProblem, rows: Rows, noise: _Noise) -> tuple[Array, float]:
    """Return coefficients and the weighted sum of squares."""
    white = _whitened(np.column_stack([rows.matrix, rows.target]), noise)
    return solve_with_prior(white[:, :-1], white[:, -1], problem.prior)


def _cost(problem: DelayProblem, rows: Rows, noise: _Noise) -> float:
    return _solve(problem, rows, noise)[1]


def _noise(problem: DelayProblem, delay: float, previous: _Noise) -> _Noise:
    """Return the noise model of the residuals at ``delay``."""
    rows = problem.rows(delay)
    coefficients, _ = _solve(problem, rows, previous)
    residuals, model_sigma = rows.target - rows.matrix @ coefficients, problem.model_sigma(delay)
    white_sigma = measurement_noise(residuals, model_sigma)
    sigma = np.hypot(white_sigma, model_sigma)
    clipped = np.clip(residuals / sigma, -HUBER_THRESHOLD, HUBER_THRESHOLD)
    steps = np.diff(problem.time)
    regular = steps < 1.5 * np.median(steps)
    correlation = float(np.sum((clipped[1:] * clipped[:-1])[regular]) / np.sum(clipped ** 2))
    if problem.overlapping:
        correlation = 0.0  # differences of overlapping rows would amplify noise
    correlation = min(max(correlation, 0.0), MAX_AUTOCORRELATION)
    step_correlation = correlation ** (steps / np.median(steps))
    plain = _Noise(sigma, correlation, step_correlation, np.ones(len(sigma)), white_sigma)
    white = _whitened(residuals, plain)
    # correlation explains a part of the residuals: the whitened ones may be smaller
    scale = max(mad_sigma(white), 1e-12)
    weight = huber_weights(white / scale, HUBER_THRESHOLD)
    return _Noise(sigma * scale, correlation, step_correlation, weight, white_sigma * scale)


def _result(problem: DelayProblem, delay: float, noise: _Noise) -> tuple[DelayFit, float]:
    """Return the fit, and the factor by which correlation increases the delay's variance."""
    rows = problem.rows(delay)
    coefficients, _ = _solve(problem, rows, noise)
    # half a row: over a smaller offset noise of the signal would add to the slope
    offset = 0.5 * float(np.median(np.diff(problem.time)))
    later, earlier = problem.rows(delay + offset), problem.rows(delay - offset)
    slope = ((later.matrix - earlier.matrix) @ coefficients - later.target + earlier.target) / (
        2.0 * offset)
    jacobian = np.column_stack([rows.matrix, slope])
    residuals = rows.target - rows.matrix @ coefficients
    prior = np.append(problem.prior.sigma, np.inf)
    matrix, white_residuals = _whitened(jacobian, noise), _whitened(residuals, noise)
    lags = math.ceil(HAC_TIME / float(np.median(np.diff(problem.time))))
    covariance = sandwich_covariance(matrix, white_residuals, prior, lags)
    plain = sandwich_covariance(matrix, white_residuals, prior, 0)
    fit = DelayFit(
        delay, coefficients, covariance, noise.white_sigma, noise.correlation, residuals)
    return fit, max(1.0, float(covariance[-1, -1] / plain[-1, -1]))
