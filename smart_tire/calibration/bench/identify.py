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
Identification of a film from a recording: the products alpha K, a K and b K of paper A.

The input is v = Q_en / K, which follows from the deflection, or any input of a Duhem operator.
Gain K, alpha, a and b are not observable separately from v and Q_e, but their products are:
``Q_e = b K h + a K (v - h) + ...`` with ``dh = dv - alpha K |dv| h``. For a given alpha K the
model is linear in the other parameters: a K, b K, the initial state, an offset, a drift, and the
integral of the output, whose factor is exactly the lower corner of a charge amplifier.

A periodic loop discharges the amplifier at a constant rate, like a drift. The two are then
correlated, which the covariance shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np
import numpy.typing as npt
from scipy.integrate import cumulative_trapezoid

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError, ParameterError
from smart_tire.estimation.film.denoise import DEAD_BAND_NOISE_FACTOR
from smart_tire.models.film.monotone_branches import (
    Branches, dead_band_branches, relaxation, relaxation_at_starts)
from smart_tire.numerics.robust import huber_weights, mad_sigma, noise_level, tukey_weights
from smart_tire.uncertain import Uncertain

ALPHA_GAIN_GRID = np.geomspace(0.03, 100.0, 24)  # of alpha K times the range of the input
COARSE_SAMPLES = 2000                            # of the coarse search
LOG_STEP = 1e-4                                  # of log(alpha K), for the derivative
MAX_LOG_STEP = 0.7                               # of log(alpha K), in one iteration
HUBER_THRESHOLD, TUKEY_THRESHOLD = 1.345, 4.685  # sigmas, both with 95 % efficiency
REWEIGHTING_ROUNDS = 40
HUBER_ROUNDS = 4         # the first ones: Huber's function has no local minima
LOG_TOLERANCE = 1e-5     # of log(alpha K): a smaller step ends the iteration
MIN_BRANCH_SHARE = 0.05  # of the range of the input: shorter branches do not make a loop
RANK_TOLERANCE = 1e-9    # of the largest singular value, for unobservable directions
NEGATIVE_SIGMAS = 3.0    # standard errors below zero: not a corner with noise

# columns of the linear part
A_COLUMN, B_COLUMN, OFFSET_COLUMN, DRIFT_COLUMN, LOW_CORNER_COLUMN = 0, 1, 3, 4, 5


@dataclass(frozen=True)
class FilmFit:
    """Parameters of a Duhem operator with a known input v, with residuals."""

    alpha_gain: Uncertain           # alpha K, 1 / unit of v
    a_gain: Uncertain               # a K, unit of the output / unit of v
    b_gain: Uncertain               # b K, as a K
    low_corner: Uncertain           # Hz, of the amplifier; infinite sigma without an amplifier
    drift: Uncertain  # unit of the output / s, in addition to the amplifier's discharge
    offset: float                   # output at v = 0
    covariance: Array               # (5, 5) of alpha K, a K, b K, lower corner, drift
    fitted: Array                   # output (n,)
    residual: Array                 # measured minus fitted (n,)
    counted: npt.NDArray[np.bool_]  # samples that are not outliers (n,)
    correlation: float              # correlation length of the residual, samples
    span: float                     # range of v
    noise: float                    # of an output sample

    @property
    def values(self) -> Array:
        """Return alpha K, a K, b K, lower corner and drift."""
        return np.array([estimate.value for estimate in (
            self.alpha_gain, self.a_gain, self.b_gain, self.low_corner, self.drift)])

    @property
    def determined(self) -> bool:
        """Return whether all three products are observable."""
        return all(product.determined for product in (self.alpha_gain, self.a_gain, self.b_gain))

    @property
    def rms(self) -> float:
        """Return the rms residual without outliers."""
        return float(np.sqrt(np.mean(self.residual[self.counted]**2)))

    @property
    def share(self) -> float:
        """Return the rms residual over half the range of the fitted output."""
        return self.rms / (0.5 * float(np.ptp(self.fitted)))

    @property
    def valid(self) -> bool:
        """Return whether a > b >= a / 2, so that the operator has an inverse."""
        return self.a_gain.value > self.b_gain.value >= 0.5 * self.a_gain.value > 0.0


class _Model:
    """The linear part of the output for a given alpha K."""

    def __init__(self, time: Array, v: Array, output: Array, dead_band: float,
                 amplifier: bool) -> None:
        self._v, self._path = v, np.concatenate([v[:1], v])
        self._branches = dead_band_branches(self._path, dead_band)
        _check_loop(self._path, self._branches)
        elapsed = time - time[0]
        self.center = float(np.median(output))  # decorrelates the integral from the drift
        integral = cumulative_trapezoid(output - self.center, elapsed, initial=0.0)
        drain = -2.0 * math.pi * integral if amplifier else np.zeros(v.size)
        self._slow = np.column_stack([np.ones(v.size), elapsed, drain])

    def columns(self, alpha_gain: float) -> Array:
        """Return columns of a K, b K, initial state, offset, drift and low corner."""
        h = -self._relaxed(alpha_gain, 1.0 / alpha_gain, 0.0)
        before = self._relaxed(alpha_gain, 0.0, 1.0)
        return np.column_stack([self._v - h, h, before, self._slow])

    def slope(self, alpha_gain: float, factors: Array) -> Array:
        """Return the derivative of the output with respect to log(alpha K)."""
        upper, lower = (self.columns(alpha_gain * math.exp(step))[:, :3]
                        for step in (LOG_STEP, -LOG_STEP))
        slope: Array = (upper - lower) @ factors[:3] / (2.0 * LOG_STEP)
        return slope

    def _relaxed(self, alpha: float, limit: float, z: float) -> Array:
        begin = float(self._path[0])
        starts = relaxation_at_starts(self._path, self._branches, alpha, limit, z, begin)
        return relaxation(self._path, self._branches, alpha, limit, starts, begin)


def identify(time: Array, v: Array, output: Array, *, dead_band: float | None = None,
             trusted: npt.NDArray[np.bool_] | None = None, amplifier: bool = True) -> FilmFit:
    """
    Return the operator from the input ``v`` to ``output``, all (n,).

    Reversals of ``v`` up to ``dead_band`` are noise (default: ten standard deviations of it).
    Samples that are not ``trusted`` drive the operator but have no weight. With ``amplifier``, a
    charge amplifier is identified as well: a negative corner is set to zero, and dropped if noise
    does not explain it. Raises EstimatorError if there is no loop.
    """
    if not (time.size == v.size == output.size):
        raise ParameterError(f'{time.size} times, {v.size} inputs, {output.size} outputs')
    if np.ptp(output) == 0.0:
        raise EstimatorError(f'the output is constant ({output[0]})')
    trusted = np.ones(v.size, dtype=bool) if trusted is None else trusted
    band = DEAD_BAND_NOISE_FACTOR * noise_level(v) if dead_band is None else dead_band
    fit = _identify(_Model(time, v, output, band, amplifier), output, trusted, float(np.ptp(v)))
    corner = fit.low_corner
    if not amplifier or corner.value >= 0.0 and fit.determined:
        return fit
    without_amplifier = identify(time, v, output, dead_band=band, trusted=trusted, amplifier=False)
    if corner.value < -NEGATIVE_SIGMAS * corner.sigma:
        return without_amplifier
    if corner.value < 0.0:  # zero has the standard error of the negative estimate
        return _with(without_amplifier, 0.0, fit.covariance)
    # the losses of a small loop and of an amplifier are similar: include their difference
    difference = fit.values - without_amplifier.values
    return _with(fit, corner.value, fit.covariance + np.outer(difference, difference))


def _with(fit: FilmFit, low_corner: float, covariance: Array) -> FilmFit:
    """Return the fit with this corner, and the standard errors of ``covariance``."""
    values = np.where(np.arange(5) == 3, low_corner, fit.values)
    alpha_gain, a_gain, b_gain, corner, drift = map(
        Uncertain, values.tolist(), np.sqrt(np.diag(covariance)).tolist())
    return replace(fit, alpha_gain=alpha_gain, a_gain=a_gain, b_gain=b_gain, low_corner=corner,
                   drift=drift, covariance=covariance)


def _identify(model: _Model, output: Array, trusted: npt.NDArray[np.bool_],
              span: float) -> FilmFit:
    coarse = slice(None, None, max(output.size // COARSE_SAMPLES, 1))
    alpha_gain = min((float(k) / span for k in ALPHA_GAIN_GRID), key=lambda k: _cost(
        model.columns(k)[coarse], output[coarse], trusted[coarse]))
    alpha_gain, factors, weights = _refined(model, output, trusted, alpha_gain, span)
    return _fit(model, output, alpha_gain, factors, weights, span)


def _check_loop(path: Array, branches: Branches) -> None:
    """Raise EstimatorError unless the path rises and falls."""
    span = float(np.ptp(path))
    if span == 0.0:
        raise EstimatorError(f'the input is constant ({path[0]})')
    corners = np.concatenate([path[[0]], path[branches.starts], path[[-1]]])
    lengths = np.diff(corners)[1:] if branches.starts.size else np.zeros(0)
    for name, longest in (('rises', lengths.max(initial=0.0)),
                          ('falls', -lengths.min(initial=0.0))):
        if longest < MIN_BRANCH_SHARE * span:
            raise EstimatorError(
                f'the input never {name} by {MIN_BRANCH_SHARE:.0%} of its range of {span:.3g}: a '
                'loop requires both branches')


def _weighted_lstsq(columns: Array, output: Array, weights: Array) -> Array:
    """Return the factors of weighted least squares."""
    root = np.sqrt(weights)
    scale = np.linalg.norm(columns * root[:, None], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled_columns = columns / scale * root[:, None]
    scaled = np.linalg.lstsq(scaled_columns, output * root, rcond=RANK_TOLERANCE)[0]
    factors: Array = scaled.astype(float) / scale
    return factors


def _weights(residual: Array, trusted: npt.NDArray[np.bool_], huber: bool) -> Array:
    ratio = residual / max(mad_sigma(residual[trusted]), np.finfo(float).tiny)
    weights = (huber_weights(ratio, HUBER_THRESHOLD) if huber
               else tukey_weights(ratio, TUKEY_THRESHOLD))
    return np.where(trusted, weights, 0.0)


def _cost(columns: Array, output: Array, trusted: npt.NDArray[np.bool_]) -> float:
    """Return the mean absolute residual after a few rounds of reweighting."""
    weights = trusted.astype(float)
    for _ in range(HUBER_ROUNDS):
        residual = output - columns @ _weighted_lstsq(columns, output, weights)
        weights = _weights(residual, trusted, huber=True)
    return float(np.mean(np.abs(residual[trusted])))


def _refined(model: _Model, output: Array, trusted: npt.NDArray[np.bool_], alpha_gain: float,
             span: float) -> tuple[float, Array, Array]:
    """Return alpha K, factors and weights after Gauss-Newton steps with reweighting."""
    weights = trusted.astype(float)
    for number in range(REWEIGHTING_ROUNDS):
        columns = model.columns(alpha_gain)
        factors = _weighted_lstsq(columns, output, weights)
        slope = model.slope(alpha_gain, factors)
        extended = _weighted_lstsq(np.column_stack([columns, slope]), output, weights)
        step = float(np.clip(extended[-1], -MAX_LOG_STEP, MAX_LOG_STEP))
        alpha_gain = float(np.clip(alpha_gain * math.exp(step), *ALPHA_GAIN_GRID[[0, -1]] / span))
        columns = model.columns(alpha_gain)
        factors = _weighted_lstsq(columns, output, weights)
        weights = _weights(output - columns @ factors, trusted, huber=number < HUBER_ROUNDS)
        if abs(step) < LOG_TOLERANCE and number > HUBER_ROUNDS:
            break
    return alpha_gain, factors, weights


def _fit(model: _Model, output: Array, alpha_gain: float, factors: Array, weights: Array,
         span: float) -> FilmFit:
    columns = model.columns(alpha_gain)
    fitted = columns @ factors
    residual = output - fitted
    # derivatives of the model by log(alpha K) and the linear part
    jacobian = np.column_stack([model.slope(alpha_gain, factors), columns])
    correlation = _correlation(weights * residual)
    derivatives = _derivatives(alpha_gain, factors, model.center)
    covariance = derivatives @ _covariance(jacobian, weights, residual) @ derivatives.T
    covariance *= correlation
    # an offset may be that of the converter, or initial charge of the amplifier, which decays
    covariance[4, 4] += (2.0 * math.pi * factors[OFFSET_COLUMN])**2 * (
        factors[LOW_CORNER_COLUMN]**2 + covariance[3, 3])
    sigma = np.sqrt(np.diag(covariance))
    drain = 2.0 * math.pi * factors[LOW_CORNER_COLUMN] * (model.center - factors[OFFSET_COLUMN])
    values = [alpha_gain, factors[A_COLUMN], factors[B_COLUMN], factors[LOW_CORNER_COLUMN],
              factors[DRIFT_COLUMN] + drain]
    alpha, a, b, corner, drift = (
        Uncertain(float(value), float(error)) for value, error in zip(values, sigma))
    if not columns[:, LOW_CORNER_COLUMN].any():
        corner = Uncertain(0.0, math.inf)
    return FilmFit(
        alpha, a, b, corner, drift, float(factors[OFFSET_COLUMN]), covariance, fitted, residual,
        weights > 0.0, correlation, span, noise_level(output))


def _derivatives(alpha_gain: float, factors: Array, center: float) -> Array:
    """Return the derivatives (5, 7) of the fit's values by log(alpha K) and the factors."""
    derivatives = np.zeros((5, 1 + factors.size))
    derivatives[0, 0] = alpha_gain
    derivatives[1, 1 + A_COLUMN] = derivatives[2, 1 + B_COLUMN] = 1.0
    if factors[LOW_CORNER_COLUMN] != 0.0:
        derivatives[3, 1 + LOW_CORNER_COLUMN] = 1.0
        # the amplifier discharges relative to the offset, the model relative to the median
        derivatives[4, 1 + LOW_CORNER_COLUMN] = 2.0 * math.pi * (center - factors[OFFSET_COLUMN])
        derivatives[4, 1 + OFFSET_COLUMN] = -2.0 * math.pi * factors[LOW_CORNER_COLUMN]
    derivatives[4, 1 + DRIFT_COLUMN] = 1.0
    return derivatives


def _covariance(jacobian: Array, weights: Array, residual: Array) -> Array:
    """Return the covariance of an M-estimate (Huber 1981) for independent residuals."""
    used = weights > 0.0
    scale = np.linalg.norm(jacobian[used], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    _, singular, rows = np.linalg.svd(jacobian[used] / scale, full_matrices=False)
    clipped = np.maximum(singular, RANK_TOLERANCE * singular[0])
    pseudo_inverse = rows.T / clipped
    root = np.sqrt(weights[used])  # Tukey's weight is (1 - u^2)^2, so this is 1 - u^2
    slope = float(np.mean(root * (5.0 * root - 4.0)))
    psi = float(np.sum((weights * residual)**2)) / max(int(used.sum()) - jacobian.shape[1], 1)
    covariance: Array = pseudo_inverse @ pseudo_inverse.T / np.outer(scale, scale) * psi / slope**2
    return covariance


def _correlation(residual: Array) -> float:
    """Return the correlation length of the residuals in samples: 1 if they are white."""
    n = residual.size
    power = np.abs(np.fft.rfft(residual, 2 * n))**2
    lags = np.fft.irfft(power)[:n]
    if lags[0] <= 0.0:
        return 1.0
    ratio = lags / lags[0]
    small = np.flatnonzero(ratio < 2.0 / math.sqrt(n))
    end = int(small[0]) if small.size else n
    return float(1.0 + 2.0 * ratio[1:end].sum())
