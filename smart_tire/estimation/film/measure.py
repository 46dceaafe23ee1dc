"""
Measuring with a film: charge -> inverse hysteresis -> stroke -> deflection, each with its sigma.

The recording begins with the film flat and at rest and the amplifier settled, as zeroing a sensor
does. A fresh film carries no charge then; that of a used one is unknown within the band, and so
its zero stays unknown by as much: the sigma shows it.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from scipy.integrate import cumulative_trapezoid

from smart_tire.arrays import Array
from smart_tire.errors import ParameterError
from smart_tire.estimation.film.denoise import DEAD_BAND, smoothed, without_spikes
from smart_tire.estimation.film.film_file import FilmParams
from smart_tire.estimation.film.recording import check_series
from smart_tire.models.film import elastica
from smart_tire.models.film.hysteresis import DuhemParams
from smart_tire.models.film.hysteresis_inverse import invert
from smart_tire.models.film.monotone_branches import lasting_branches

PULLED = 4.0      # sigmas on the other side of flat: no buckled film
EDGE = 2.67       # noise of a smoothed signal at its first sample over that in its middle
PAIR = 2.0**0.5   # a branch is measured from its turning point, which has the same noise


@dataclass(frozen=True)
class FilmMeasurement:
    """What a film has measured, NaN with infinite sigma where that can not be told."""

    time: Array   # s
    value: Array  # m, deflection; of a film without geometry the operator's input
    sigma: Array  # likewise

    @property
    def told(self) -> int:
        """Return the number of samples with a value."""
        return int(np.isfinite(self.value).sum())


def measure(time: Array, charge: Array, params: FilmParams, *, used: bool = False
            ) -> FilmMeasurement:
    """Return the deflection behind ``charge`` [C] (n,); ``used``: of a film that is not fresh."""
    check_series(time, charge=charge)
    calm, noise = smoothed(without_spikes(charge)[0])
    calm, since = calm - calm[0], time - time[0]
    drained = 2.0 * math.pi * cumulative_trapezoid(calm, since, initial=0.0)
    band = DEAD_BAND * noise

    def passed(amplifier: Array) -> Array:
        """Return the charge that an amplifier with this lower corner and drift makes ``calm``."""
        corrected: Array = calm + amplifier[0] * drained - amplifier[1] * since
        return corrected

    operator, y = params.operator, passed(np.array([params.low_corner, params.drift]))
    v = invert(y, operator, dead_band=band)
    spread = math.hypot(PAIR * noise, params.misfit)
    variance = (spread / _slope(y, v, operator, band))**2
    # everything else is the same error for all samples: each once more with it
    for other, amplifier in _neighbours(params):
        variance += (invert(passed(amplifier), other, dead_band=band) - v)**2
    zero = EDGE * noise * (1.0 + 2.0 * math.pi * params.low_corner * since)
    variance += (invert(y + zero, operator, dead_band=band) - v)**2
    if used:
        # evenly spread over the band: a standard deviation of its half width over sqrt(3)
        z = operator.band / 3.0**0.5
        variance += (invert(y + z, operator, start=(0.0, z), dead_band=band) - v)**2
    # once beyond the reach, the way back is unknown too
    beyond = np.maximum.accumulate(np.abs(v) > params.reach)
    return _converted(time, np.where(beyond, np.nan, v),
                      np.where(beyond, np.inf, np.sqrt(variance)), params)


def _slope(y: Array, v: Array, operator: DuhemParams, band: float) -> Array:
    """Return dy / dv on the branch of every sample: b - s alpha z of A(17)."""
    branches = lasting_branches(np.concatenate([[0.0], y]), band)
    slope: Array = operator.b - branches.signs[branches.numbers] * operator.alpha * (
        y - operator.a * v)
    return np.maximum(slope, 2.0 * operator.b - operator.a)


def _neighbours(params: FilmParams) -> list[tuple[DuhemParams, Array]]:
    """Return operators and amplifiers one sigma away, along the axes of the covariance."""
    values = np.array([params.alpha_gain, params.a_gain, params.b_gain, params.low_corner,
                       params.drift])
    # in relative units, for they differ by many orders of magnitude
    sigmas = np.sqrt(np.diag(params.covariance))
    units = np.where(sigmas > 0.0, sigmas, 1.0)
    units[:3] = values[:3]
    variances, axes = np.linalg.eigh(params.covariance / np.outer(units, units))
    found = []
    for variance, axis in zip(np.maximum(variances, 0.0), axes.T):
        away = units * math.sqrt(float(variance)) * axis
        for side in (away, -away):
            try:
                alpha, a, b = (values + side)[:3].tolist()
                found.append((DuhemParams(alpha=alpha, a=a, b=b), (values + side)[3:]))
                break
            except ParameterError:
                continue
        else:
            raise ParameterError('the products are too uncertain: operators within one sigma of '
                                 'them have no inverse (a > b >= a / 2)')
    return found


def _converted(time: Array, v: Array, sigma: Array, params: FilmParams) -> FilmMeasurement:
    if params.film is None:
        return FilmMeasurement(time, v, sigma)
    told = (v < PULLED * sigma) & (v > -1.0)
    stroke = elastica.stroke_from_charge(np.where(told, np.minimum(v, 0.0), 0.0))
    per_stroke = float(params.film.deflection(0.5)) / 0.5
    sigma = sigma / np.abs(elastica.charge_slope(stroke)) * per_stroke
    return FilmMeasurement(time, np.where(told, params.film.deflection(stroke), np.nan),
                           np.where(told, sigma, np.inf))
