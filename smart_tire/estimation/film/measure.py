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
Measurement with a film: charge -> inverse hysteresis -> stroke -> deflection, each with its sigma.

The recording must begin with the film flat and stationary and the amplifier settled, like the
zeroing of a sensor. A fresh film has no charge then; the charge of a used one is unknown within
the hysteresis band, which the sigma includes as an unknown offset.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from scipy.integrate import cumulative_trapezoid

from smart_tire.arrays import Array
from smart_tire.errors import ParameterError
from smart_tire.estimation.film.denoise import DEAD_BAND_NOISE_FACTOR, smoothed, without_spikes
from smart_tire.estimation.film.film_file import FilmParams
from smart_tire.estimation.film.recording import check_series
from smart_tire.models.film import elastica
from smart_tire.models.film.hysteresis import DuhemParams
from smart_tire.models.film.hysteresis_inverse import invert
from smart_tire.models.film.monotone_branches import dead_band_branches

TENSION_SIGMAS = 4.0              # beyond flat: the film is under tension, not buckled
EDGE_NOISE_FACTOR = 2.67          # noise of a smoothed signal at its first sample over that inside
REVERSAL_NOISE_FACTOR = 2.0**0.5  # a branch is measured from its reversal, which has noise, too


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
    branches = dead_band_branches(np.concatenate([[0.0], y]), band)
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
