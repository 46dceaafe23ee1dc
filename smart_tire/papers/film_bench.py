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
Identification of a film on a test stand: the products alpha K, a K and b K of paper A.

The input is v = Q_en / K, which follows from the deflection, or any input of a Duhem operator.
Gain K, alpha, a and b are not observable separately from v and Q_e, but their products are:
``Q_e = b K h + a K (v - h) + ...`` with ``dh = dv - alpha K |dv| h``. For a given alpha K the
model is linear in the other parameters: a K, b K, the initial state, an offset, a drift, and the
integral of the output, whose factor is exactly the lower corner of a charge amplifier. The search
starts with these fits for a grid of alpha K.

A periodic loop discharges the amplifier at a constant rate, like a drift. The two are then
correlated, which the covariance shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import cumulative_trapezoid
from smart_tire.arrays import Array
from smart_tire.calibration.priors import PRIORS
from smart_tire.calibration.results import SIGNIFICANT_SIGMAS
from smart_tire.errors import EstimatorError, ParameterError
from smart_tire.estimation.film.calibration import (
    AMPLIFIER, EXTRAPOLATION_FACTOR, FilmParams, PRODUCTS)
from smart_tire.models.film.buckling_film import BucklingFilm
from smart_tire.models.film.elastica import TOUCHING_STROKE
from smart_tire.models.film.hysteresis import Branches, monotone_branches, relaxed
from smart_tire.numerics.least_squares import nonlinear_fit, Prior, regression, Rows
from smart_tire.numerics.robust import mad_sigma, noise_level
from smart_tire.papers.film_files import FilmRecording
from smart_tire.papers.film_measurement import DEAD_BAND_NOISE_FACTOR, smoothed, without_spikes
from smart_tire.paths import write_text
from smart_tire.uncertain import Uncertain
import yaml

ALPHA_GAIN_GRID = np.geomspace(0.03, 100.0, 24)  # of alpha K times the range of the input
COARSE_SAMPLES = 2000    # of the coarse search
OUTLIER_SIGMAS = 5.0     # beyond which a sample is an outlier
MIN_BRANCH_SHARE = 0.05  # of the range of the input: shorter branches do not make a loop
LOG_ALPHA, A, B, CORNER, DRIFT, INITIAL, OFFSET = range(7)  # fitted values


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
    """The output as a function of the fitted values."""

    def __init__(self, time: Array, v: Array, output: Array, dead_band: float) -> None:
        self._v, self._path = v, np.concatenate([v[:1], v])
        self._branches = monotone_branches(self._path, dead_band)
        _check_loop(self._path, self._branches)
        self._elapsed = time - time[0]
        self._center = float(np.median(output))  # decorrelates the integral from the drift
        self._integral = cumulative_trapezoid(output - self._center, self._elapsed, initial=0.0)

    def columns(self, alpha_gain: float) -> Array:
        """Return the factors (n, 3) of a K, b K and the initial state."""
        h, initial = (relaxed(self._path, self._branches, alpha_gain, limit, z)
                      for limit, z in ((-1.0 / alpha_gain, 0.0), (0.0, 1.0)))
        return np.column_stack([self._v - h, h, initial])

    def slow(self) -> Array:
        """Return the factors (n, 3) of offset, drift and corner, of which the last two mix."""
        return np.column_stack([np.ones(self._v.size), self._elapsed,
                                -2.0 * math.pi * self._integral])

    def output(self, values: Array) -> Array:
        """Return the predicted output, shape (n,)."""
        # the amplifier discharges relative to the offset, the integral is that from the median
        drain = 2.0 * math.pi * values[CORNER] * (self._center - values[OFFSET])
        return np.asarray(
            self.columns(math.exp(values[LOG_ALPHA])) @ values[[A, B, INITIAL]]
            + self.slow() @ [values[OFFSET], values[DRIFT] - drain, values[CORNER]])


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
    fit = _fit(_Model(time, v, output, band), output, trusted, float(np.ptp(v)),
               amplifier=amplifier)
    corner = fit.low_corner
    if not amplifier or corner.value >= 0.0 and fit.determined:
        return fit
    without_amplifier = identify(time, v, output, dead_band=band, trusted=trusted, amplifier=False)
    if corner.value < -SIGNIFICANT_SIGMAS * corner.sigma:
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


def _fit(model: _Model, output: Array, trusted: npt.NDArray[np.bool_], span: float, *,
         amplifier: bool) -> FilmFit:
    slow = model.slow() if amplifier else model.slow()[:, :2]
    coarse = np.flatnonzero(trusted)[::max(output.size // COARSE_SAMPLES, 1)]
    found, unit = [], float(np.ptp(output))  # residuals as shares of the range
    for alpha_gain in (ALPHA_GAIN_GRID / span).tolist():
        matrix = np.column_stack([model.columns(alpha_gain), slow])[coarse]
        linear = regression(
            Rows(coarse.astype(float), matrix / unit, output[coarse] / unit,
                 np.zeros(coarse.size)),
            Prior.of(*[None] * matrix.shape[1]))
        found.append((float(np.mean(np.abs(linear.residuals))), alpha_gain, linear.values))
    _, alpha_gain, factors = min(found, key=lambda item: item[0])
    a, b, initial, offset, *_ = factors
    corner = None if amplifier else (0.0, 1e-12)
    fit = nonlinear_fit(
        lambda values: (output - model.output(values))[trusted] / unit,
        np.array([math.log(alpha_gain), a, b, 0.0, 0.0, initial, offset]),
        Prior.of((math.log(alpha_gain), PRIORS['ln of alpha K'].sigma), None, None, corner,
                 None, None, None),
        lambda values: np.zeros(int(trusted.sum())))
    fitted, alpha_gain = model.output(fit.values), math.exp(fit.values[LOG_ALPHA])
    residual = output - fitted
    counted = trusted & (np.abs(residual) <= OUTLIER_SIGMAS * max(
        mad_sigma(residual[trusted]), 1e-9 * float(np.ptp(output))))
    correlation = _correlation(np.where(counted, residual, 0.0))
    scale = np.array([alpha_gain, 1.0, 1.0, 1.0, 1.0])  # of log(alpha K)
    covariance = correlation * fit.covariance[:5, :5] * np.outer(scale, scale)
    # an offset may be that of the converter, or initial charge of the amplifier, which decays
    covariance[DRIFT, DRIFT] += (2.0 * math.pi * fit.values[OFFSET])**2 * (
        fit.values[CORNER]**2 + covariance[CORNER, CORNER])
    values = [alpha_gain, *fit.values[[A, B, CORNER, DRIFT]].tolist()]
    alpha, a, b, corner_hz, drift = (Uncertain(float(value), float(error)) for value, error in zip(
        values, np.sqrt(np.diag(covariance))))
    return FilmFit(
        alpha, a, b, corner_hz if amplifier else Uncertain(0.0, math.inf), drift,
        float(fit.values[OFFSET]), covariance, fitted, residual, counted, correlation, span,
        noise_level(output))


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


def identify_film(recording: FilmRecording, film: BucklingFilm | None
                  ) -> tuple[FilmParams, FilmFit, list[str]]:
    """
    Return the parameters of a film from a recording, the fit, and notes for the user.

    Without a ``film`` the recorded input is that of the operator.
    """
    notes = []
    deflection, spikes = without_spikes(recording.input)
    noise = noise_level(deflection)
    deflection, _ = smoothed(deflection)
    trusted = np.ones(deflection.size, dtype=bool)
    if film is not None:
        trusted = deflection >= -OUTLIER_SIGMAS * noise
        if trusted.mean() < 0.5:
            raise EstimatorError(
                f'{(~trusted).sum()} of {deflection.size} deflections are negative: they must be '
                'measured from the flat film, positive when its ends approach each other')
        deflection = np.maximum(deflection, 0.0)
        if (film.stroke(deflection) >= TOUCHING_STROKE).any():
            notes.append(f'the film touches itself (a stroke above {TOUCHING_STROKE:.3f})')
    v = deflection if film is None else film.normalized_charge(deflection)
    fit = identify(recording.time, v, recording.output, trusted=trusted,
                   amplifier=film is not None)
    for count, what in ((spikes, 'spikes of the input were removed'),
                        (int((~trusted).sum()), 'samples with a film under tension were excluded'),
                        (int((trusted & ~fit.counted).sum()), 'outputs were outliers')):
        if count:
            notes.append(f'{count} {what}')
    turns = v[monotone_branches(v, DEAD_BAND_NOISE_FACTOR * noise_level(v)).starts]
    strokes = np.abs(np.diff(turns))
    if strokes.max(initial=0.0) < EXTRAPOLATION_FACTOR * strokes.min(initial=math.inf):
        notes.append('all strokes are of one size: errors of the Duhem operator in others are not '
                     'in the standard deviations; record small and large strokes')
    params = FilmParams(
        film=film, alpha_gain=fit.alpha_gain.value, a_gain=fit.a_gain.value,
        b_gain=fit.b_gain.value, low_corner=fit.low_corner.value, drift=fit.drift.value,
        covariance=fit.covariance, span=fit.span, noise=fit.noise,
        model_error=math.sqrt(max(fit.rms**2 - fit.noise**2, 0.0)))
    return params, fit, notes + _notes(fit)


def _notes(fit: FilmFit) -> list[str]:
    """Return notes on the reliability of the values."""
    notes = []
    unknown = [name for name in PRODUCTS if not getattr(fit, name).determined]
    if unknown:
        notes.append(
            f'not determined: {", ".join(unknown)}: the loop is too small (range {fit.span:.3g} '
            f'times alpha_gain is {fit.span * fit.alpha_gain.value:.2g}); small loops show b_gain '
            'only')
    corner = fit.low_corner
    if math.isfinite(corner.sigma) and not corner.determined:
        notes.append(
            f'not determined: low_corner ({corner.value:.2g} ± {corner.sigma:.2g} Hz): the '
            'discharge of the amplifier cannot be separated from a drift of the output; with '
            'these parameters the sigma of other motions grows with time')
    if not fit.valid:
        notes.append('not a > b >= a / 2: no branch-wise inverse, the film cannot measure')
    if fit.rms > SIGNIFICANT_SIGMAS * fit.noise:
        notes.append(f'residuals of the Duhem operator are {fit.share:.1%} of half the range, '
                     f'{fit.rms / fit.noise:.0f} times the noise' if fit.noise > 0.0 else
                     f'residuals of the Duhem operator are {fit.share:.1%} of half the range')
    return notes


def write_params(path: Path, params: FilmParams, fit: FilmFit, notes: list[str],
                 gain: float | None = None) -> None:
    """Write the YAML file that ``read_params`` reads; ``gain`` [C] is a K set by the user."""
    tree: dict[str, Any] = {
        'film': None if params.film is None else {
            'length_m': params.film.length, 'width_m': params.film.width,
            'thickness_m': params.film.thickness, 'convention': params.film.convention},
        'products': {name: _entry(getattr(fit, name)) for name in PRODUCTS},
        'covariance': [[float(value) for value in row] for row in params.covariance],
        'amplifier': {name: _entry(getattr(fit, name)) for name in AMPLIFIER},
        'span': params.span, 'noise': params.noise, 'model_error': params.model_error,
        'residual': {'rms': fit.rms, 'share_of_half_range': fit.share,
                     'correlated_samples': fit.correlation},
        'notes': notes}
    if gain is not None:
        tree['at_gain'] = {'K': gain, 'alpha': params.alpha_gain / gain,
                           'a': params.a_gain / gain, 'b': params.b_gain / gain}
    write_text(path, yaml.safe_dump(tree, sort_keys=False))


def _entry(estimate: Uncertain) -> dict[str, float | bool]:
    return {'value': estimate.value, 'sigma': estimate.sigma, 'determined': estimate.determined}
