"""Measured signals made fit for an operator that remembers every turn: spikes and noise."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import savgol_coeffs, savgol_filter

from smart_tire.arrays import Array
from smart_tire.models.film.monotone_branches import lasting_branches
from smart_tire.numerics.robust import noise_level

DEAD_BAND = 10.0            # of the noise: white noise of 1e5 samples spans 9
SPIKE_WIDTH = 2             # samples, the widest that is seen as a spike
SPIKE = 4.0                 # of the signal's own fast motion
WINDOWS = (81, 61, 41, 31, 21, 15, 11, 7)
ORDER = 3                   # the same as 2 but at the ends, where 2 would bend a start from rest
LARGEST_BIAS = 0.3          # of the noise, at the turns: smoothing must not blunt them
LARGEST_EXCESS = 1.2        # of the power of slow residuals over that of noise alone


def without_spikes(signal: Array) -> tuple[Array, int]:
    """Return the signal with spikes replaced by the median around them, and their number."""
    width = 2 * SPIKE_WIDTH + 1
    calm = median_filter(signal, width, mode='nearest')
    fast = np.quantile(np.abs(signal[width:] - signal[:-width]), 0.95)
    spikes = np.abs(signal - calm) > SPIKE * fast
    return np.where(spikes, calm, signal), int(spikes.sum())


def smoothed(signal: Array) -> tuple[Array, float]:
    """Return the signal smoothed as much as its shape allows, and the noise that is left."""
    noise = noise_level(signal)
    turns = lasting_branches(signal, DEAD_BAND * noise)
    for window in WINDOWS:
        if window > signal.size // 4:
            continue
        calm: Array = savgol_filter(signal, window, ORDER, mode='interp')
        kernel = savgol_coeffs(window, ORDER)
        # what is left and lasts a third of the window is noise, or a bend that was smoothed away
        third = np.full(window // 3, 1.0 / (window // 3))
        left = np.convolve(signal - calm, third, 'same')
        alone = np.convolve((np.arange(window) == window // 2) - kernel, third)
        if (np.mean(left**2) <= LARGEST_EXCESS * noise**2 * np.sum(alone**2)
                and all(abs(np.mean(left[turns.starts[turns.signs[1:] == sign]]))
                        <= LARGEST_BIAS * noise
                        for sign in (-1.0, 1.0) if sign in turns.signs[1:])):
            return calm, noise * float(kernel[window // 2])**0.5
    return signal, noise
