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
Measurement with a film: its smoothed charge through the filter of ``film_sensor``.

The recording must begin with the film flat and stationary and the amplifier settled, like the
zeroing of a sensor. A fresh film has no charge then; the charge of a used one is unknown within
the hysteresis band, which the sigma includes as an unknown offset. Signals are smoothed first, as
the operator remembers every reversal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import median_filter
from scipy.signal import savgol_coeffs, savgol_filter

from smart_tire.arrays import Array
from smart_tire.estimation.film.branch_filter import BranchFilter
from smart_tire.estimation.film.calibration import FilmParams
from smart_tire.models.film.hysteresis import monotone_branches
from smart_tire.numerics.robust import noise_level
from smart_tire.papers.film_files import check_series

# value, unit, meaning; origin; the run that needs it
DEAD_BAND_NOISE_FACTOR = 10.0  # of the noise; derived: white noise of 1e5 samples spans 9; all
MAX_SPIKE_SAMPLES, SPIKE_THRESHOLD = 2, 4.0  # width; times the fast changes; assumed; spikes
WINDOW_LENGTHS = (81, 61, 41, 31, 21, 15, 11, 7)  # samples; assumed; the largest that fits, all
POLYNOMIAL_ORDER = 3  # differs from 2 at the ends only, where 2 would bend a start at standstill
MAX_REVERSAL_BIAS = 0.3  # of the noise, at reversals; assumed: not rounded off; corners
MAX_POWER_RATIO = 1.2  # of the slow residuals over those of noise alone; assumed; corners
EDGE_NOISE_FACTOR = 2.67  # of a smoothed signal at its first sample; derived from the filter; all
LEAST_NOISE_SHARE = 1e-8  # of the largest charge: signals without noise; assumed; exact


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
    noise = max(noise, LEAST_NOISE_SHARE * params.max_charge)
    film = BranchFilter(params, noise, fresh=not used, zero_sigma=EDGE_NOISE_FACTOR * noise)
    signals = np.column_stack([smooth, cumulative_trapezoid(smooth, elapsed, initial=0.0), elapsed,
                               np.zeros(elapsed.size)])
    value, sigma = np.array([film.add_signal(one, 0.0) for one in signals]).T
    # after an input beyond the limit, all further values are unknown
    value[np.maximum.accumulate(np.abs(value) > params.max_input)] = np.nan
    return FilmMeasurement(time, *params.deflections(value, sigma))


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
