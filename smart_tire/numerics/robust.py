"""Robust statistics: standard deviations from medians, insensitive to outliers."""

from __future__ import annotations

import numpy as np

from smart_tire.arrays import Array

MAD_TO_SIGMA = 1.4826       # standard deviation over median absolute deviation, normal noise
THIRD_DIFFERENCE = 20**0.5  # its noise over that of a sample: 1 + 9 + 9 + 1 squares


def noise_level(signal: Array) -> float:
    """
    Return the standard deviation of white noise on a smooth signal of shape (n,).

    It comes from third differences, in which the signal itself adds little: an upper bound.
    """
    third = np.diff(signal, 3)
    return float(MAD_TO_SIGMA * np.median(np.abs(third)) / THIRD_DIFFERENCE)
