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
Measurement with a film: charge -> inverse hysteresis -> stroke -> deflection, each with its sigma.

The recording must begin with the film flat and stationary and the amplifier settled, like the
zeroing of a sensor. A fresh film has no charge then; the charge of a used one is unknown within
the hysteresis band, which the sigma includes as an unknown offset. Signals are smoothed first, as
the operator remembers every reversal.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import median_filter
from scipy.signal import savgol_coeffs, savgol_filter

from smart_tire.arrays import Array
from smart_tire.errors import ParameterError
from smart_tire.estimation.film.calibration import FilmParams
from smart_tire.models.film import elastica
from smart_tire.models.film.hysteresis import DuhemParams, invert, monotone_branches
from smart_tire.numerics.robust import noise_level
from smart_tire.papers.film_files import check_series

# value, unit, meaning; origin; the run that needs it
DEAD_BAND_NOISE_FACTOR = 10.0  # of the noise; derived: white noise of 1e5 samples spans 9; all
MAX_SPIKE_SAMPLES, SPIKE_THRESHOLD = 2, 4.0  # width; times the fast changes; assumed; spikes
WINDOW_LENGTHS = (81, 61, 41, 31, 21, 15, 11, 7)  # samples; assumed; the largest that fits, all
POLYNOMIAL_ORDER = 3  # differs from 2 at the ends only, where 2 would bend a start at standstill
MAX_REVERSAL_BIAS = 0.3  # of the noise, at reversals; assumed: not rounded off; corners
MAX_POWER_RATIO = 1.2  # of the slow residuals over those of noise alone; assumed; corners
TENSION_SIGMAS = 4.0  # beyond flat: the film is under tension, not buckled; assumed; tension
EDGE_NOISE_FACTOR = 2.67  # of a smoothed signal at its first sample; derived from the filter; all
REVERSAL_NOISE_FACTOR = 2.0**0.5  # derived: a branch is measured from its reversal; all


@dataclass(frozen=True)
class FilmMeasurement:
    """Measurement of a film, NaN with infinite sigma if not observable."""

    time: Array   # s
    value: Array  # m, deflection; for a film without geometry the operator's input
    sigma: Array  # as value

    @property
    def valid_count(self) -> int:
        """Return the number of samples with a value."""
        return int(np.isfinite(self.value).sum())


def measure(time: Array, charge: Array, params: FilmParams, *, used: bool = False
            ) -> FilmMeasurement:
    """Return the deflection of ``charge`` [C] (n,); ``used``: the film is not fresh."""
    check_series(time, charge=charge)
    smooth, noise = smoothed(without_spikes(charge)[0])
    smooth, elapsed = smooth - smooth[0], time - time[0]
    charge_integral = 2.0 * math.pi * cumulative_trapezoid(smooth, elapsed, initial=0.0)
    band = DEAD_BAND_NOISE_FACTOR * noise

    def film_charge(amplifier: Array) -> Array:
        """Return the charge before an amplifier with this lower corner and drift."""
        corrected: Array = smooth + amplifier[0] * charge_integral - amplifier[1] * elapsed
        return corrected

    operator, y = params.operator, film_charge(np.array([params.low_corner, params.drift]))
    v = invert(y, operator, dead_band=band)
    charge_sigma = math.hypot(REVERSAL_NOISE_FACTOR * noise, params.model_error)
    variance = (charge_sigma / _slope(y, v, operator, band))**2
    # errors of the parameters are common to all samples: repeat with each of them perturbed
    for other, amplifier in _perturbed(params):
        variance += (invert(film_charge(amplifier), other, dead_band=band) - v)**2
    zero_error = EDGE_NOISE_FACTOR * noise * (1.0 + 2.0 * math.pi * params.low_corner * elapsed)
    variance += (invert(y + zero_error, operator, dead_band=band) - v)**2
    if used:
        # uniform over the band: a standard deviation of its half width over sqrt(3)
        z = operator.band / 3.0**0.5
        variance += (invert(y + z, operator, start=(0.0, z), dead_band=band) - v)**2
    # after an input beyond the limit, all further values are unknown
    beyond = np.maximum.accumulate(np.abs(v) > params.max_input)
    return _to_deflection(time, np.where(beyond, np.nan, v),
                          np.where(beyond, np.inf, np.sqrt(variance)), params)


def _slope(y: Array, v: Array, operator: DuhemParams, band: float) -> Array:
    """Return dy / dv on the branch of each sample: b - s alpha z of A(17)."""
    branches = monotone_branches(np.concatenate([[0.0], y]), band)
    slope: Array = operator.b - branches.signs[branches.numbers] * operator.alpha * (
        y - operator.a * v)
    return np.maximum(slope, 2.0 * operator.b - operator.a)


def _perturbed(params: FilmParams) -> list[tuple[DuhemParams, Array]]:
    """Return operators and amplifiers, perturbed by sigma along the axes of the covariance."""
    values = np.array([params.alpha_gain, params.a_gain, params.b_gain, params.low_corner,
                       params.drift])
    # in relative units, because they differ by many orders of magnitude
    sigmas = np.sqrt(np.diag(params.covariance))
    units = np.where(sigmas > 0.0, sigmas, 1.0)
    units[:3] = values[:3]
    variances, axes = np.linalg.eigh(params.covariance / np.outer(units, units))
    result = []
    for variance, axis in zip(np.maximum(variances, 0.0), axes.T):
        step = units * math.sqrt(float(variance)) * axis
        for signed_step in (step, -step):
            try:
                alpha, a, b = (values + signed_step)[:3].tolist()
                result.append((DuhemParams(alpha=alpha, a=a, b=b), (values + signed_step)[3:]))
                break
            except ParameterError:
                continue
        else:
            raise ParameterError('the products are too uncertain: operators within one '
                                 'standard deviation have no inverse (a > b >= a / 2)')
    return result


def _to_deflection(time: Array, v: Array, sigma: Array, params: FilmParams) -> FilmMeasurement:
    if params.film is None:
        return FilmMeasurement(time, v, sigma)
    valid = (v < TENSION_SIGMAS * sigma) & (v > -1.0)
    stroke = elastica.stroke_from_charge(np.where(valid, np.minimum(v, 0.0), 0.0))
    per_stroke = float(params.film.deflection(0.5)) / 0.5
    sigma = sigma / np.abs(elastica.charge_slope(stroke)) * per_stroke
    return FilmMeasurement(time, np.where(valid, params.film.deflection(stroke), np.nan),
                           np.where(valid, sigma, np.inf))


def without_spikes(signal: Array) -> tuple[Array, int]:
    """Return the signal with spikes replaced by the local median, and their number."""
    width = 2 * MAX_SPIKE_SAMPLES + 1
    smooth = median_filter(signal, width, mode='nearest')
    speed_scale = np.quantile(np.abs(signal[width:] - signal[:-width]), 0.95)
    spikes = np.abs(signal - smooth) > SPIKE_THRESHOLD * speed_scale
    return np.where(spikes, smooth, signal), int(spikes.sum())


def smoothed(signal: Array) -> tuple[Array, float]:
    """Return the signal smoothed as much as its shape allows, and the remaining noise."""
    noise = noise_level(signal)
    reversals = monotone_branches(signal, DEAD_BAND_NOISE_FACTOR * noise)
    for window in WINDOW_LENGTHS:
        if window > signal.size // 4:
            continue
        smooth: Array = savgol_filter(signal, window, POLYNOMIAL_ORDER, mode='interp')
        kernel = savgol_coeffs(window, POLYNOMIAL_ORDER)
        # residuals that last a third of the window: averaged noise, or a smoothed-out bend
        averaging = np.full(window // 3, 1.0 / (window // 3))
        averaged = np.convolve(signal - smooth, averaging, 'same')
        noise_response = np.convolve((np.arange(window) == window // 2) - kernel, averaging)
        if (np.mean(averaged**2) <= MAX_POWER_RATIO * noise**2 * np.sum(noise_response**2)
                and all(abs(np.mean(averaged[reversals.starts[reversals.signs[1:] == sign]]))
                        <= MAX_REVERSAL_BIAS * noise
                        for sign in (-1.0, 1.0) if sign in reversals.signs[1:])):
            return smooth, noise * float(kernel[window // 2])**0.5
    return signal, noise
