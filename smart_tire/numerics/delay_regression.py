"""
Least squares over a delay and linear coefficients, with noise as recordings have it.

The noise may be correlated from row to row, of different size in each row, and have outliers.
Rows are divided by the size of their noise, differenced by its correlation, and weighted after
Huber; standard errors come from the residuals themselves (a sandwich, after Newey and West), so
that they hold where the assumptions do not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math

import numpy as np
from scipy.optimize import minimize_scalar

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.numerics.robust import MAD_TO_SIGMA


HUBER = 2.0        # sigmas; residuals beyond it count less
ROUNDS = 5         # of noise, then delay; more change nothing
MOST_LINKED = 0.999  # correlation of neighbouring rows
LASTING = 1.0      # s over which residuals are correlated beyond what was removed
PRECISION = 1e-5   # s, to which the delay is searched
DISTINCT = 9.0     # of chi-square by which every other minimum must be worse: three sigmas
APART = 5.0        # sigmas, within which another minimum is the same one
UNSEEN = 1e-12      # weight of a prior that says nothing
FEW = 12           # rows, below which residuals tell nothing of their noise


@dataclass(frozen=True)
class Rows:
    """A linear problem ``wanted = matrix @ coefficients`` at one delay."""

    matrix: Array  # (n, p)
    wanted: Array  # (n,)


@dataclass(frozen=True)
class Problem:
    """Rows as a function of the delay [s], and what is known beforehand."""

    rows: Callable[[float], Rows]
    doubt: Callable[[float], Array]  # delay -> (n,) noise by what the model leaves out
    time: Array                      # (n,) s; correlation fades with the time between rows
    prior_mean: Array                # (p,) of the coefficients
    prior_sigma: Array               # (p,), inf where nothing is known
    overlapping: bool = False        # whether neighbouring rows share what they are made of


@dataclass(frozen=True)
class DelayFit:
    """Delay and coefficients; the delay is the last row of the covariance."""

    delay: float            # s
    coefficients: Array     # (p,)
    covariance: Array       # (p + 1, p + 1)
    noise: float            # of a row, one sigma beside the doubts
    correlation: float      # of neighbouring rows
    residuals: Array        # (n,), wanted minus model

    @property
    def sigma(self) -> float:
        """Return the standard error of the delay [s]."""
        return float(np.sqrt(self.covariance[-1, -1]))

    def coefficient_sigma(self, index: int) -> float:
        """Return the standard error of a coefficient."""
        return float(np.sqrt(self.covariance[index, index]))


@dataclass(frozen=True)
class _Noise:
    size: Array         # (n,) one sigma of each row
    correlation: float
    link: Array         # (n - 1,) of each row to the one before
    weight: Array       # (n,) of the rows after they have been whitened
    level: float        # one sigma beside the doubts


def fit_delay(problem: Problem, delays: Array) -> DelayFit:
    """
    Return the best delay near one of ``delays`` [s, evenly spaced] and its coefficients.

    Raises EstimatorError where there are too few rows, where the best delay is at an end of the
    range, or where another one is as good.
    """
    n = len(problem.time)
    if n < FEW:
        raise EstimatorError(f'{n} readings in motion, expected at least {FEW}')
    noise = _Noise(np.ones(n), 0.0, np.zeros(n - 1), np.ones(n), 1.0)
    table = [problem.rows(float(delay)) for delay in delays]
    costs = _scan(problem, table, noise)
    delay = float(delays[int(np.argmin(costs))])
    for count in range(ROUNDS):
        noise = _noise(problem, delay, noise)
        if count < ROUNDS // 2:
            costs = _scan(problem, table, noise)
            delay = float(delays[int(np.argmin(costs))])
        delay = _refined(problem, delay, float(delays[1] - delays[0]), noise)
    result, inflation = _result(problem, delay, noise)
    _check(result, delays, _scan(problem, table, noise) / inflation,
           _cost(problem, problem.rows(delay), noise) / inflation)
    return result


def _scan(problem: Problem, table: Sequence[Rows], noise: _Noise) -> Array:
    return np.array([_cost(problem, rows, noise) for rows in table])


def _refined(problem: Problem, delay: float, step: float, noise: _Noise) -> float:
    found = minimize_scalar(
        lambda x: _cost(problem, problem.rows(x), noise), bounds=(delay - step, delay + step),
        method='bounded', options={'xatol': PRECISION})
    return float(found.x)


def _check(fit: DelayFit, delays: Array, costs: Array, best: float) -> None:
    step, delay = delays[1] - delays[0], fit.delay
    if not delays[0] + step <= delay <= delays[-1] - step:
        raise EstimatorError(f'the best delay lies outside of {delays[0]:g} to {delays[-1]:g} s')
    inner = costs[1:-1]
    away = np.abs(delays[1:-1] - delay) > step + APART * fit.sigma
    minima = (inner <= costs[:-2]) & (inner <= costs[2:]) & away
    rivals = delays[1:-1][minima & (inner < best + DISTINCT)]
    if len(rivals):
        raise EstimatorError(f'delays of {delay:.3f} s and {rivals[0]:.3f} s fit alike')


def _whitened(values: Array, noise: _Noise) -> Array:
    """Return rows (n,) or (n, p) over their noise, without its correlation, weighted."""
    shape = (-1,) + (1,) * (values.ndim - 1)
    scaled = values / noise.size.reshape(shape)
    if noise.correlation > 0.0:
        link = noise.link.reshape(shape)
        scaled[1:] = (scaled[1:] - link * scaled[:-1]) / np.sqrt(1.0 - link ** 2)
    scaled *= np.sqrt(noise.weight).reshape(shape)
    return scaled


def _solve(problem: Problem, rows: Rows, noise: _Noise) -> tuple[Array, float]:
    """Return coefficients and the sum of squares."""
    weight = 1.0 / problem.prior_sigma
    white = _whitened(np.column_stack([rows.matrix, rows.wanted]), noise)
    matrix = np.vstack([white[:, :-1], np.diag(weight)])
    wanted = np.concatenate([white[:, -1], problem.prior_mean * weight])
    coefficients, *_ = np.linalg.lstsq(matrix, wanted, rcond=None)
    return coefficients, float(np.sum((matrix @ coefficients - wanted) ** 2))


def _cost(problem: Problem, rows: Rows, noise: _Noise) -> float:
    return _solve(problem, rows, noise)[1]


def _noise(problem: Problem, delay: float, before: _Noise) -> _Noise:
    """Return what the residuals at ``delay`` tell about their noise."""
    rows = problem.rows(delay)
    coefficients, _ = _solve(problem, rows, before)
    residuals, doubt = rows.wanted - rows.matrix @ coefficients, problem.doubt(delay)
    level = noise_beside(residuals, doubt)
    size = np.hypot(level, doubt)
    linked = np.clip(residuals / size, -HUBER, HUBER)
    steps = np.diff(problem.time)
    near = steps < 1.5 * np.median(steps)
    correlation = float(np.sum((linked[1:] * linked[:-1])[near]) / np.sum(linked ** 2))
    if problem.overlapping:
        correlation = 0.0  # rows that overlap would be undone by it
    correlation = min(max(correlation, 0.0), MOST_LINKED)
    link = correlation ** (steps / np.median(steps))
    plain = _Noise(size, correlation, link, np.ones(len(size)), level)
    white = np.abs(_whitened(residuals, plain))
    # what is left may be smaller than what was: correlation explains a part of it
    scale = max(MAD_TO_SIGMA * float(np.median(white)), 1e-12)
    weight = np.minimum(1.0, HUBER * scale / np.maximum(white, 1e-12))
    return _Noise(size * scale, correlation, link, weight, level * scale)


def noise_beside(residuals: Array, doubt: Array) -> float:
    """Return the noise beside the ``doubt``: that of the half of the rows that have least."""
    calm = np.abs(residuals[doubt <= np.median(doubt)])
    return max(MAD_TO_SIGMA * float(np.median(calm)), 1e-9)


def _result(problem: Problem, delay: float, noise: _Noise) -> tuple[DelayFit, float]:
    """Return the fit, and how much larger the delay's variance is than without correlations."""
    rows = problem.rows(delay)
    coefficients, _ = _solve(problem, rows, noise)
    # as far as half a row: over less, noise of the signal would look like knowledge of the delay
    nudge = 0.5 * float(np.median(np.diff(problem.time)))
    later, sooner = problem.rows(delay + nudge), problem.rows(delay - nudge)
    slope = ((later.matrix - sooner.matrix) @ coefficients - later.wanted + sooner.wanted) / (
        2.0 * nudge)
    jacobian = np.column_stack([rows.matrix, slope])
    residuals = rows.wanted - rows.matrix @ coefficients
    prior = np.append(problem.prior_sigma, np.inf)
    matrix, left = _whitened(jacobian, noise), _whitened(residuals, noise)
    lags = math.ceil(LASTING / float(np.median(np.diff(problem.time))))
    covariance = sandwich(matrix, left, prior, lags)
    plain = sandwich(matrix, left, prior, 0)
    fit = DelayFit(delay, coefficients, covariance, noise.level, noise.correlation, residuals)
    return fit, max(1.0, float(covariance[-1, -1] / plain[-1, -1]))


def sandwich(jacobian: Array, residuals: Array, prior_sigma: Array, lags: int) -> Array:
    """
    Return the covariance (p, p) of a weighted fit from its own residuals (n,).

    ``jacobian`` is (n, p); residuals up to ``lags`` rows apart may be correlated; of a prior,
    its own sigma counts.
    """
    n, p = jacobian.shape
    # a direction that no row sees must come out as unknown, not as exact
    known = np.diag(1.0 / prior_sigma ** 2 + UNSEEN)
    scores = jacobian * residuals[:, None]
    middle = scores.T @ scores
    for lag in range(1, min(lags, n - 1) + 1):
        product = scores[lag:].T @ scores[:-lag]
        middle += (1.0 - lag / (lags + 1.0)) * (product + product.T)
    middle = middle * n / max(n - p, 1) + known
    inverse = np.linalg.inv(jacobian.T @ jacobian + known)
    return np.asarray(inverse @ middle @ inverse)
