"""
Identification of a film from a recording: the products alpha K, a K and b K of paper A.

The input is v = Q_en / K, which follows from the deflection, or any input of a Duhem operator. A
gain K, alpha, a and b can not be told apart from v and Q_e, but their products can:
``Q_e = b K h + a K (v - h) + ...`` with ``dh = dv - alpha K |dv| h``. For a given alpha K all else
is linear: a K, b K, the state before the recording, an offset, a drift, and the integral of the
output, whose factor is the lower corner of a charge amplifier, exactly.

A loop that repeats itself drains evenly, just like a drift: the two are then told together only,
and nothing but their covariance knows it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np
import numpy.typing as npt
from scipy.integrate import cumulative_trapezoid

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError, ParameterError
from smart_tire.estimation.film.denoise import DEAD_BAND
from smart_tire.models.film.monotone_branches import (
    Branches, lasting_branches, relaxation, relaxation_at_starts)
from smart_tire.numerics.robust import MAD_TO_SIGMA, noise_level
from smart_tire.uncertain import Uncertain

GRID = np.geomspace(0.03, 100.0, 24)  # of alpha K times the range of the input
FEW = 2000           # samples that do for the coarse search
NUDGE = 1e-4         # relative, of alpha K, for the derivative
LONGEST_STEP = 0.7   # of log(alpha K)
HUBER, TUKEY = 1.345, 4.685  # standard deviations, both with 95 % efficiency
ROUNDS, FIRST_ROUNDS = 40, 4  # of reweighting; the first ones after Huber, which has no traps
SETTLED = 1e-5       # of alpha K: a smaller change ends the search
LEAST_BRANCH = 0.05  # of the range of the input: shorter ones do not make a loop
FAINT = 1e-9         # of the largest singular value: directions that the data do not see
NEGATIVE = 3.0       # sigmas below zero: no corner, whose estimate noise has moved, lies there

A, B, OFFSET, DRIFT, LOW_CORNER = 0, 1, 3, 4, 5  # columns of the linear part


@dataclass(frozen=True)
class FilmFit:
    """What a recording tells about a Duhem operator behind a known input v."""

    alpha_gain: Uncertain    # alpha K, 1 / unit of v
    a_gain: Uncertain        # a K, unit of the output / unit of v
    b_gain: Uncertain        # b K, likewise
    low_corner: Uncertain    # Hz, of the amplifier; infinite sigma where none is assumed
    drift: Uncertain         # unit of the output / s, beside what the amplifier drains
    offset: float           # output where v is zero
    covariance: Array       # (5, 5) of alpha K, a K, b K, lower corner, drift
    fitted: Array           # output (n,)
    residual: Array         # measured minus fitted (n,)
    counted: npt.NDArray[np.bool_]  # samples that are no outliers (n,)
    correlation: float      # samples that the noise of the residual lasts
    span: float             # range of v
    noise: float            # of the output, from sample to sample

    @property
    def values(self) -> Array:
        """Return alpha K, a K, b K, lower corner and drift."""
        return np.array([estimate.value for estimate in (
            self.alpha_gain, self.a_gain, self.b_gain, self.low_corner, self.drift)])

    @property
    def determined(self) -> bool:
        """Return whether the recording tells all three products."""
        return all(product.determined for product in (self.alpha_gain, self.a_gain, self.b_gain))

    @property
    def rms(self) -> float:
        """Return the rms residual of the samples that count."""
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
    """The linear part of the output for any alpha K."""

    def __init__(self, time: Array, v: Array, output: Array, dead_band: float,
                 amplifier: bool) -> None:
        self._v, self._path = v, np.concatenate([v[:1], v])
        self._branches = lasting_branches(self._path, dead_band)
        _check_loop(self._path, self._branches)
        since = time - time[0]
        self.middle = float(np.median(output))  # around which the integral tells most
        integral = cumulative_trapezoid(output - self.middle, since, initial=0.0)
        drained = -2.0 * math.pi * integral if amplifier else np.zeros(v.size)
        self._slow = np.column_stack([np.ones(v.size), since, drained])

    def columns(self, alpha_gain: float) -> Array:
        """Return what a K, b K, the state before, offset, drift and low corner multiply."""
        h = -self._relaxed(alpha_gain, 1.0 / alpha_gain, 0.0)
        before = self._relaxed(alpha_gain, 0.0, 1.0)
        return np.column_stack([self._v - h, h, before, self._slow])

    def slope(self, alpha_gain: float, factors: Array) -> Array:
        """Return the derivative of the output with respect to log(alpha K)."""
        up, down = (self.columns(alpha_gain * math.exp(nudge))[:, :3] for nudge in (NUDGE, -NUDGE))
        slope: Array = (up - down) @ factors[:3] / (2.0 * NUDGE)
        return slope

    def _relaxed(self, alpha: float, limit: float, z: float) -> Array:
        begin = float(self._path[0])
        starts = relaxation_at_starts(self._path, self._branches, alpha, limit, z, begin)
        return relaxation(self._path, self._branches, alpha, limit, starts, begin)


def identify(time: Array, v: Array, output: Array, *, dead_band: float | None = None,
             trusted: npt.NDArray[np.bool_] | None = None, amplifier: bool = True) -> FilmFit:
    """
    Return the operator that turns the input ``v`` into ``output``, all (n,).

    Ways back of ``v`` up to ``dead_band`` are noise (default: ten standard deviations of it).
    Samples that are not ``trusted`` move the operator but are not compared with. An ``amplifier``
    is looked for between operator and output; a corner that comes out negative is zero, and not
    assumed where noise does not explain it. Raises EstimatorError where there is no loop.
    """
    if not (time.size == v.size == output.size):
        raise ParameterError(f'{time.size} times, {v.size} inputs, {output.size} outputs')
    if np.ptp(output) == 0.0:
        raise EstimatorError(f'the output is {output[0]} all the time')
    trusted = np.ones(v.size, dtype=bool) if trusted is None else trusted
    band = DEAD_BAND * noise_level(v) if dead_band is None else dead_band
    fit = _identified(_Model(time, v, output, band, amplifier), output, trusted, float(np.ptp(v)))
    corner = fit.low_corner
    if not amplifier or corner.value >= 0.0 and fit.determined:
        return fit
    none = identify(time, v, output, dead_band=band, trusted=trusted, amplifier=False)
    if corner.value < -NEGATIVE * corner.sigma:
        return none
    if corner.value < 0.0:  # zero is as sure as the corner below it was
        return _with(none, 0.0, fit.covariance)
    # the losses of a small loop and of an amplifier look alike, all the way from one to the other
    way = fit.values - none.values
    return _with(fit, corner.value, fit.covariance + np.outer(way, way))


def _with(fit: FilmFit, low_corner: float, covariance: Array) -> FilmFit:
    """Return the fit with this corner, and standard errors of the covariance."""
    values = np.where(np.arange(5) == 3, low_corner, fit.values)
    alpha_gain, a_gain, b_gain, corner, drift = map(
        Uncertain, values.tolist(), np.sqrt(np.diag(covariance)).tolist())
    return replace(fit, alpha_gain=alpha_gain, a_gain=a_gain, b_gain=b_gain, low_corner=corner,
                   drift=drift, covariance=covariance)


def _identified(model: _Model, output: Array, trusted: npt.NDArray[np.bool_],
                span: float) -> FilmFit:
    some = slice(None, None, max(output.size // FEW, 1))
    alpha_gain = min((float(k) / span for k in GRID), key=lambda k: _cost(
        model.columns(k)[some], output[some], trusted[some]))
    alpha_gain, factors, weights = _refined(model, output, trusted, alpha_gain, span)
    return _fit(model, output, alpha_gain, factors, weights, span)


def _check_loop(path: Array, branches: Branches) -> None:
    """Raise EstimatorError unless the path rises and falls."""
    span = float(np.ptp(path))
    if span == 0.0:
        raise EstimatorError(f'the input is {path[0]} all the time')
    corners = np.concatenate([path[[0]], path[branches.starts], path[[-1]]])
    lengths = np.diff(corners)[1:] if branches.starts.size else np.zeros(0)
    for name, longest in (('rises', lengths.max(initial=0.0)),
                          ('falls', -lengths.min(initial=0.0))):
        if longest < LEAST_BRANCH * span:
            raise EstimatorError(
                f'the input never {name} by {LEAST_BRANCH:.0%} of its range of {span:.3g}: one '
                'branch alone does not tell a loop')


def _solved(columns: Array, output: Array, weights: Array) -> Array:
    """Return the factors of weighted least squares."""
    root = np.sqrt(weights)
    scale = np.linalg.norm(columns * root[:, None], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = np.linalg.lstsq(columns / scale * root[:, None], output * root, rcond=FAINT)[0]
    factors: Array = scaled.astype(float) / scale
    return factors


def _weights(residual: Array, trusted: npt.NDArray[np.bool_], huber: bool) -> Array:
    size = MAD_TO_SIGMA * float(np.median(np.abs(residual[trusted])))
    ratio = np.abs(residual) / max(size, np.finfo(float).tiny)
    weights = (HUBER / np.maximum(ratio, HUBER) if huber
               else np.maximum(1.0 - (ratio / TUKEY)**2, 0.0)**2)
    return np.where(trusted, weights, 0.0)


def _cost(columns: Array, output: Array, trusted: npt.NDArray[np.bool_]) -> float:
    """Return how large the residuals are that outliers leave after a few rounds."""
    weights = trusted.astype(float)
    for _ in range(FIRST_ROUNDS):
        residual = output - columns @ _solved(columns, output, weights)
        weights = _weights(residual, trusted, huber=True)
    return float(np.mean(np.abs(residual[trusted])))


def _refined(model: _Model, output: Array, trusted: npt.NDArray[np.bool_], alpha_gain: float,
             span: float) -> tuple[float, Array, Array]:
    """Return alpha K, factors and weights after steps of Gauss and Newton with new weights."""
    weights = trusted.astype(float)
    for number in range(ROUNDS):
        columns = model.columns(alpha_gain)
        factors = _solved(columns, output, weights)
        slope = model.slope(alpha_gain, factors)
        both = _solved(np.column_stack([columns, slope]), output, weights)
        step = float(np.clip(both[-1], -LONGEST_STEP, LONGEST_STEP))
        alpha_gain = float(np.clip(alpha_gain * math.exp(step), GRID[0] / span, GRID[-1] / span))
        columns = model.columns(alpha_gain)
        factors = _solved(columns, output, weights)
        weights = _weights(output - columns @ factors, trusted, huber=number < FIRST_ROUNDS)
        if abs(step) < SETTLED and number > FIRST_ROUNDS:
            break
    return alpha_gain, factors, weights


def _fit(model: _Model, output: Array, alpha_gain: float, factors: Array, weights: Array,
         span: float) -> FilmFit:
    columns = model.columns(alpha_gain)
    fitted = columns @ factors
    residual = output - fitted
    # the derivative of the model: log(alpha K) first, then the linear part
    jacobian = np.column_stack([model.slope(alpha_gain, factors), columns])
    correlation = _correlation(weights * residual)
    told = _told(alpha_gain, factors, model.middle)
    covariance = told @ _covariance(jacobian, weights, residual) @ told.T * correlation
    # an offset may be the converter's, or what the amplifier had drained before: then it recovers
    covariance[4, 4] += (2.0 * math.pi * factors[OFFSET])**2 * (
        factors[LOW_CORNER]**2 + covariance[3, 3])
    sigma = np.sqrt(np.diag(covariance))
    drained = 2.0 * math.pi * factors[LOW_CORNER] * (model.middle - factors[OFFSET])
    values = [alpha_gain, factors[A], factors[B], factors[LOW_CORNER], factors[DRIFT] + drained]
    alpha, a, b, corner, drift = (
        Uncertain(float(value), float(error)) for value, error in zip(values, sigma))
    if not columns[:, LOW_CORNER].any():
        corner = Uncertain(0.0, math.inf)
    return FilmFit(
        alpha, a, b, corner, drift, float(factors[OFFSET]), covariance, fitted, residual,
        weights > 0.0, correlation, span, noise_level(output))


def _told(alpha_gain: float, factors: Array, middle: float) -> Array:
    """Return the derivative (5, 7) of the fit's values: of log(alpha K) and the factors."""
    told = np.zeros((5, 1 + factors.size))
    told[0, 0] = alpha_gain
    told[1, 1 + A] = told[2, 1 + B] = 1.0
    if factors[LOW_CORNER] != 0.0:
        told[3, 1 + LOW_CORNER] = 1.0
        # the amplifier drains what differs from the offset, the model what differs from the middle
        told[4, 1 + LOW_CORNER] = 2.0 * math.pi * (middle - factors[OFFSET])
        told[4, 1 + OFFSET] = -2.0 * math.pi * factors[LOW_CORNER]
    told[4, 1 + DRIFT] = 1.0
    return told


def _covariance(jacobian: Array, weights: Array, residual: Array) -> Array:
    """Return Huber's covariance of an estimate with outliers, for independent residuals."""
    used = weights > 0.0
    scale = np.linalg.norm(jacobian[used], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    _, singular, rows = np.linalg.svd(jacobian[used] / scale, full_matrices=False)
    seen = np.maximum(singular, FAINT * singular[0])
    spread = rows.T / seen
    root = np.sqrt(weights[used])  # Tukey's weight is (1 - u^2)^2, so this is 1 - u^2
    slope = float(np.mean(root * (5.0 * root - 4.0)))
    psi = float(np.sum((weights * residual)**2)) / max(int(used.sum()) - jacobian.shape[1], 1)
    covariance: Array = spread @ spread.T / np.outer(scale, scale) * psi / slope**2
    return covariance


def _correlation(residual: Array) -> float:
    """Return how many samples share one piece of noise: 1 if it is white."""
    n = residual.size
    power = np.abs(np.fft.rfft(residual, 2 * n))**2
    lags = np.fft.irfft(power)[:n]
    if lags[0] <= 0.0:
        return 1.0
    ratio = lags / lags[0]
    below = np.flatnonzero(ratio < 2.0 / math.sqrt(n))
    end = int(below[0]) if below.size else n
    return float(1.0 + 2.0 * ratio[1:end].sum())
