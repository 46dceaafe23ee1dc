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

"""Spike removal and smoothing of signals for an operator that remembers every reversal."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import savgol_coeffs, savgol_filter

from smart_tire.arrays import Array
from smart_tire.models.film.monotone_branches import dead_band_branches
from smart_tire.numerics.robust import noise_level

DEAD_BAND_NOISE_FACTOR = 10.0  # of the noise: white noise of 1e5 samples spans 9
MAX_SPIKE_SAMPLES = 2                             # width of the widest spike that is detected
SPIKE_THRESHOLD = 4.0                             # times the signal's own fast changes
WINDOW_LENGTHS = (81, 61, 41, 31, 21, 15, 11, 7)  # samples
POLYNOMIAL_ORDER = 3  # differs from 2 at the ends only, where 2 would bend a start at standstill
MAX_REVERSAL_BIAS = 0.3  # of the noise, at reversals: smoothing must not round them off
MAX_POWER_RATIO = 1.2                             # of the slow residuals over that of noise alone


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
    reversals = dead_band_branches(signal, DEAD_BAND_NOISE_FACTOR * noise)
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
