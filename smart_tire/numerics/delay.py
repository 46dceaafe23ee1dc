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
Delay between two signals: a linear model whose rows depend on the delay.

The delay is one more value of the least-squares fit, which whitens the residuals of the rows by
their AR(1) correlation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.numerics.least_squares import (
    Correlation, Errors, Fit, HAC_TIME, HUBER_THRESHOLD, least_costs, nonlinear_fit, Prior,
    regression, Rows, sandwich_covariance, solve_with_prior, Whitener)
from smart_tire.numerics.robust import mad_sigma

GRID_ROUNDS = 3              # of noise, then delay; more do not change the result
MAX_AUTOCORRELATION = 0.999  # of neighboring rows
AMBIGUITY_CHI_SQUARE = 9.0   # by which all other minima must be worse: three sigmas
MINIMUM_WIDTH_SIGMAS = 5.0   # standard errors within which grid points belong to the same minimum
MIN_ROWS = 12                # below this number the residuals do not determine their noise
MAX_NUMBERS = 1 << 20        # in rows of several delays at once: 8 MB; more are not faster


@dataclass(frozen=True)
class DelayFit(Fit):
    """Fitted values, of which the last one is the delay [s]."""

    rows: Rows           # at that delay

    @property
    def delay(self) -> float:
        """Return the delay [s]."""
        return float(self.values[-1])

    @property
    def explained(self) -> Array:
        """Return the target (n,) without all terms but the first."""
        return self.rows.target - self.rows.matrix[:, 1:] @ self.values[1:-1]


def autoregressive(time: Array, limit: float = MAX_AUTOCORRELATION) -> Correlation:
    """
    Return the AR(1) correlation of rows at ``time`` [s] (n,), which decays with their gaps.

    It is at most ``limit``; the whitened residuals have unit noise.

    >>> white = autoregressive(np.arange(4.0))(np.array([1.0, 1.0, -1.0, -1.0]))
    >>> white(np.array([0.0, 1.0, 0.0, 0.0])).round(2)  # the correlation is 0.25
    array([ 0.  ,  0.79, -0.2 ,  0.  ])
    """
    steps = np.diff(time)
    periods = steps / np.median(steps)

    def whitener(residuals: Array) -> Whitener:
        clipped = np.clip(residuals, -HUBER_THRESHOLD, HUBER_THRESHOLD)
        products = (clipped[1:] * clipped[:-1])[periods < 1.5]
        correlation = np.clip(np.sum(products) / np.sum(clipped ** 2), 0.0, limit)
        link = correlation ** periods

        def white(rows: Array) -> Array:
            columns = rows.T
            return np.concatenate([columns[..., :1], (
                columns[..., 1:] - link * columns[..., :-1]) / np.sqrt(1.0 - link ** 2)], -1).T

        # correlation explains a part of the residuals: the whitened ones may be smaller
        unit = max(mad_sigma(white(residuals)), 1e-12)
        return lambda rows: white(rows) / unit
    return whitener


def fit_delay(rows_at: Callable[[float], Rows], prior: Prior, delays: Array, *,
              overlapping: bool = False) -> DelayFit:
    """
    Return the best delay near one of ``delays`` [s, evenly spaced], and the linear values.

    The linear fit, with AR(1) correlation of the rows, is repeated over the grid; from its best
    point on the delay is fitted as well. ``delays`` has shape (m,), m >= 3; neighbors of
    ``overlapping`` rows share measurements. Raises EstimatorError if there are too few rows, if
    the best delay is at an end of the range, or if another delay fits equally well.

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
    time = table[0].time
    if len(time) < MIN_ROWS:
        raise EstimatorError(f'{len(time)} samples in motion, expected at least {MIN_ROWS}')
    # differences of overlapping rows would amplify noise
    errors = Errors(table[0].lags(HAC_TIME), autoregressive(
        time, 0.0 if overlapping else MAX_AUTOCORRELATION))
    # half a row: over a smaller offset noise of the signal would add to the slope
    offset = np.append(np.zeros(len(prior.mean)), 0.5 * float(np.median(np.diff(time))))

    # the targets next to the matrices, of several delays: the rows are whitened at once
    columns = [np.column_stack([rows.matrix, rows.target]) for rows in table]
    count = max(MAX_NUMBERS // columns[0].size, 1)

    def costs(white: Whitener) -> Array:
        found = []
        for first in range(0, len(columns), count):
            several = np.stack(columns[first:first + count], axis=1)
            flat = white(several.reshape(len(time), -1))
            found.append(least_costs(flat.reshape(several.shape).transpose(1, 0, 2), prior))
        return np.concatenate(found)

    latest = lru_cache(maxsize=1)(rows_at)  # residual and Jacobian of the same values

    def residual(values: Array) -> Array:
        rows = latest(float(values[-1]))
        return rows.target - rows.matrix @ values[:-1]

    def jacobian(values: Array) -> Array:
        slope = -latest(float(values[-1])).matrix
        change = residual(values + offset) - residual(values - offset)
        return np.column_stack([slope, 0.5 * change / offset[-1]])

    best = int(np.argmin(costs(np.asarray)))
    for _ in range(GRID_ROUNDS):
        linear = regression(table[best], prior, errors)
        best = int(np.argmin(costs(linear.white)))
    fit = nonlinear_fit(
        residual, np.append(linear.values, delays[best]),
        Prior(np.append(prior.mean, 0.0), np.append(prior.sigma, math.inf)),
        lambda values: table[best].sigma, errors, jacobian=jacobian)
    rows, white = rows_at(float(fit.values[-1])), fit.white(fit.residuals)
    plain = sandwich_covariance(fit.white(jacobian(fit.values)), white,
                                np.append(prior.sigma, math.inf), 0)
    # correlation increases the variance of the delay, and explains a part of the residuals
    unit = max(1.0, float(fit.covariance[-1, -1] / plain[-1, -1])) * mad_sigma(white) ** 2
    smallest = solve_with_prior(fit.white(rows.matrix), fit.white(rows.target), prior)[1]
    _check_unique(fit, delays, (costs(fit.white) - smallest) / unit)
    return DelayFit(**vars(fit), rows=rows)


def _check_unique(fit: Fit, delays: Array, excess: Array) -> None:
    """Raise EstimatorError if the delay is at the end of the range, or another one is as good."""
    step, (delay, sigma) = delays[1] - delays[0], fit.estimate(-1)
    if not delays[0] + step <= delay <= delays[-1] - step:
        raise EstimatorError(f'the best delay is outside of {delays[0]:g} to {delays[-1]:g} s')
    inner = excess[1:-1]
    distant = np.abs(delays[1:-1] - delay) > step + MINIMUM_WIDTH_SIGMAS * sigma
    minima: Sequence[bool] = (inner <= excess[:-2]) & (inner <= excess[2:]) & distant
    competing = delays[1:-1][minima & (inner < AMBIGUITY_CHI_SQUARE)]
    if len(competing):
        raise EstimatorError(
            f'delays of {delay:.3f} s and {competing[0]:.3f} s fit equally well')
