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

"""Standard deviation of the ground's slope, estimated online."""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.models.constants import GRAVITY

MIN_SPREAD, MAX_SPREAD = 2e-5, 0.1  # rad, limits of the grid
GRID_SIZE = 60
PRIOR_LOG_SIGMA = 0.7        # of the spread about the configured one, natural logarithm; assumed
OTHER_GROUND_SHARE = 0.02    # prior probability of any spread, log-uniform; assumed
GROUND_CHANGE_TIME = 200.0   # s, mean time between changes of the kind of ground; assumed
OUTLIER_SHARE = 0.05         # of the residuals: the slip has changed within the window
IMU_OUTLIER_SHARE = 0.001    # of the residuals of the IMU alone: an impact, sideways slip
OUTLIER_SIGMA = 0.5          # m/s2, of such a residual
UPPER_WEIGHT = 0.3           # of a residual that can only raise the spread, against a larger one
SIGNIFICANT_SIGMAS = 2.5     # of a residual that can only raise the spread; below it is noise
SLOPE_CORRELATION_LENGTH = 5.0  # m, of the ground


class SlopeResidual(NamedTuple):
    """Acceleration [m/s2] that a slope explains, and its variances."""

    value: float
    noise: float       # (m/s2)^2, variance without slope
    sensitivity: float  # -, variance due to slope, over that of gravity at a point of the ground


class SlopeSpread:
    """
    Posterior of the standard deviation of the slope, on a logarithmic grid.

    A residual is Gaussian with the variances of its noise and of the slope, or an outlier. The
    prior is log-normal about the configured spread, with a small share of any other.
    """

    def __init__(self, slope_sigma: float) -> None:
        self._grid = np.geomspace(MIN_SPREAD, MAX_SPREAD, GRID_SIZE)
        self._log_grid = np.log(self._grid)
        center = math.log(min(max(slope_sigma, MIN_SPREAD), MAX_SPREAD))
        near = np.exp(-0.5 * ((self._log_grid - center) / PRIOR_LOG_SIGMA) ** 2)
        self._prior: Array = ((1.0 - OTHER_GROUND_SHARE) * near / near.sum()
                              + OTHER_GROUND_SHARE / GRID_SIZE)
        self._probability = self._prior
        self.sigma = slope_sigma  # rad, geometric mean

    def elapse(self, duration: float) -> None:
        """Let the ground change with the probability of ``duration`` [s] of driving."""
        share = 1.0 - math.exp(-duration / GROUND_CHANGE_TIME)
        self._set((1.0 - share) * self._probability + share * self._prior)

    def update(self, residual: SlopeResidual, outlier_share: float = OUTLIER_SHARE) -> None:
        """Add a residual, which is independent of the previous ones."""
        self._set(self._probability * self._likelihood(residual, outlier_share))

    def update_at_least(self, residuals: Iterable[SlopeResidual]) -> None:
        """Add residuals that rule out a smaller spread, but not a larger one."""
        for residual in residuals:
            if residual.value ** 2 > SIGNIFICANT_SIGMAS ** 2 * residual.noise:
                likelihood = self._likelihood(residual, IMU_OUTLIER_SHARE)
                peak = int(likelihood.argmax())
                relative = likelihood / likelihood[peak]
                relative[peak:] **= UPPER_WEIGHT
                self._set(self._probability * relative)

    def _set(self, probability: Array) -> None:
        self._probability = probability / probability.sum()
        self.sigma = math.exp(float(self._probability @ self._log_grid))

    def _likelihood(self, residual: SlopeResidual, outlier_share: float) -> Array:
        variance = residual.noise + residual.sensitivity * (GRAVITY * self._grid) ** 2
        likelihood: Array = (
            (1.0 - outlier_share) * _density(residual.value, variance)
            + outlier_share * _density(residual.value, variance + OUTLIER_SIGMA ** 2))
        return likelihood


def mean_sensitivity(distance: float) -> float:
    """
    Return the variance of the mean slope over ``distance`` [m], over that at a point.

    >>> mean_sensitivity(0.0), round(mean_sensitivity(10.0), 3)
    (1.0, 0.568)
    """
    x = distance / SLOPE_CORRELATION_LENGTH
    return 1.0 if x < 1e-3 else 2.0 * (x - 1.0 + math.exp(-x)) / x ** 2


def change_sensitivity(distance: float, turn: float = 0.0) -> float:
    """
    Return the variance of the change of slope over ``distance`` [m], over that at a point.

    A ``turn`` [rad] changes the slope in the direction of the heading, too.

    >>> change_sensitivity(0.0), round(change_sensitivity(5.0), 3)
    (0.0, 1.264)
    """
    return 2.0 * (1.0 - math.exp(-distance / SLOPE_CORRELATION_LENGTH - abs(turn)))


def _density(value: float, variance: Array) -> Array:
    density: Array = np.exp(-0.5 * value ** 2 / variance) / np.sqrt(variance)
    return density
