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
Shape of release and bumps, learned recursively over the crossings of one wheel.

The state is the part ``SHAPE`` of the waveform's parameters, a Gaussian random walk. It is the
prior of the next crossing; the fit of that crossing without the slip estimator is its measurement.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.friction.levenberg_marquardt import inverse_spd
from smart_tire.estimation.friction.waveform_model import KNOTS, Release, SHAPE
from smart_tire.models.tire import bump_splines

SHARE_SIGMA, SIZE_SIGMA = 0.2, 0.1  # -, of the release, about the configured convention
BUMP_SIGMA = 0.6            # of a bump's shape over its height, outside the contact
LEAK_LENGTH = 0.004         # m inside the contact, in which that decays by e
CORRELATION_LENGTH = 0.003  # m, of the deviations from the nominal shape of a bump
UNCORRELATED_SIGMA = 0.03   # of the shape, uncorrelated between knots
RANDOM_WALK_SHARE = 0.001   # of the initial standard deviations, random walk per crossing
# of a crossing's information that is used: the errors of its samples over distance are correlated
INFORMATION_SHARE = 0.5
# relative change of the wheel speed in a crossing that halves the information: the slip changes,
# too, in a way that the fit takes for a shape
STEADY_SPEED_CHANGE = 0.02
OUTLIER_SIGMAS = 5.0        # of the squared innovation, beyond which a crossing has less weight
POOR_EXCESS = 2.0         # of a fit that contradicts the shape
MAX_OUTLIERS = 3            # consecutive, after which the shape has changed


@dataclass(frozen=True, slots=True, eq=False)
class ShapePrior:
    """Gaussian distribution of the shape."""

    value: Array
    precision: Array


class ShapeEstimator:
    """Kalman filter of the shape of release and bumps."""

    def __init__(self) -> None:
        self._initial = initial_covariance()
        self._covariance = self._initial
        self._outliers = 0
        self.prior = ShapePrior(np.zeros(len(self._initial)), inverse_spd(self._covariance))

    def update(self, value: Array, information: Array, *, excess: float = 1.0,
               speed_change: float = 0.0) -> None:
        """
        Correct with the estimate ``value`` of a crossing and the information matrix of its data.

        ``value`` is the posterior mean with ``prior`` and ``information``. Less of the information
        is used if the wheel speed changes by the share ``speed_change`` in the crossing.
        ``excess`` is that of the fit.
        """
        prior, innovation = self.prior, value - self.prior.value
        whole = prior.precision + information
        # the squared innovation relative to the prior, and its limit
        square = float(innovation @ prior.precision @ innovation)
        freedom = max(float(np.sum(information * inverse_spd(whole))), 1.0)
        limit = freedom + OUTLIER_SIGMAS * math.sqrt(2.0 * freedom)
        poor = square > limit or excess > POOR_EXCESS and speed_change < STEADY_SPEED_CHANGE
        self._outliers = self._outliers + 1 if poor else 0
        if self._outliers == MAX_OUTLIERS:
            self._outliers = 0
            self._set(prior.value, self._covariance + self._initial)
            return
        weight = INFORMATION_SHARE * limit / max(square, limit) / (
            1.0 + (speed_change / STEADY_SPEED_CHANGE)**2)
        posterior = inverse_spd(prior.precision + weight * information)
        self._set(prior.value + weight * posterior @ (whole @ innovation), posterior)

    def _set(self, value: Array, covariance: Array) -> None:
        self._covariance = covariance + RANDOM_WALK_SHARE**2 * self._initial
        self.prior = ShapePrior(value, inverse_spd(self._covariance))


def initial_covariance() -> Array:
    """Return the covariance of the shape before any crossing."""
    knots = bump_splines.KNOTS
    sigma = BUMP_SIGMA * np.exp(np.minimum(knots, 0.0) / LEAK_LENGTH)
    distance = (knots[:, np.newaxis] - knots) / CORRELATION_LENGTH
    bump = np.outer(sigma, sigma) * np.exp(-0.5 * distance**2) + UNCORRELATED_SIGMA**2 * np.eye(
        KNOTS)
    covariance = np.zeros((SHAPE.stop - SHAPE.start,) * 2)
    covariance[Release.SHARE, Release.SHARE] = SHARE_SIGMA**2
    covariance[Release.SIZE, Release.SIZE] = SIZE_SIGMA**2
    first, second = (slice(len(Release) + i * KNOTS, len(Release) + (i + 1) * KNOTS)
                     for i in range(2))
    covariance[first, first] = covariance[second, second] = bump
    return covariance
