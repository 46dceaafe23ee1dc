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
Shape of release and bumps, learned recursively over the crossings of one wheel.

The state is the part ``SHAPE`` of the waveform's parameters, a Gaussian random walk. It is the
prior of the next crossing; the fit of that crossing without the slip estimator is its measurement.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.friction import constants as c
from smart_tire.estimation.friction.waveform_model import KNOTS, Release, SHAPE
from smart_tire.models.tire import film_equations
from smart_tire.numerics.levenberg_marquardt import inverse_spd


@dataclass(frozen=True, slots=True, eq=False)
class ShapePrior:
    """Gaussian distribution of the shape."""

    value: Array
    precision: Array


class ShapeEstimator:
    """Kalman filter of the shape of release and bumps."""

    def __init__(self) -> None:
        self._initial = initial_covariance()
        self._value, self._covariance = np.zeros(len(self._initial)), self._initial
        self._outliers = 0

    @cached_property
    def prior(self) -> ShapePrior:
        """Return the distribution before the next crossing."""
        return ShapePrior(self._value, inverse_spd(self._covariance))

    def correct(self, value: Array, information: Array, *, excess: float = 1.0,
                speed_change: float = 0.0) -> None:
        """
        Correct with the estimate ``value`` of a crossing and the information matrix of its data.

        ``value`` is the posterior mean with ``prior`` and ``information``. Less of the information
        is used if the wheel speed changes by the share ``speed_change`` in the crossing.
        ``excess`` is that of the fit.
        """
        prior = self.prior
        innovation = value - prior.value
        whole = prior.precision + information
        # the squared innovation relative to the prior, and its limit
        square = float(innovation @ prior.precision @ innovation)
        freedom = max(float(np.sum(information * inverse_spd(whole))), 1.0)
        limit = freedom + c.OUTLIER_SIGMAS * math.sqrt(2.0 * freedom)
        poor = square > limit or excess > c.POOR_EXCESS and speed_change < c.STEADY_SPEED_CHANGE
        self._outliers = self._outliers + 1 if poor else 0
        if self._outliers == c.MAX_OUTLIERS:
            self._outliers = 0
            self._set(prior.value, self._covariance + self._initial)
            return
        weight = c.INFORMATION_SHARE * limit / max(square, limit) / (
            1.0 + (speed_change / c.STEADY_SPEED_CHANGE)**2)
        posterior = inverse_spd(prior.precision + weight * information)
        self._set(prior.value + weight * posterior @ (whole @ innovation), posterior)

    def _set(self, value: Array, covariance: Array) -> None:
        self._value = value
        self._covariance = covariance + c.RANDOM_WALK_SHARE**2 * self._initial
        self.__dict__.pop('prior', None)  # that of before


def initial_covariance() -> Array:
    """Return the covariance of the shape before any crossing."""
    knots = film_equations.KNOTS
    sigma = c.BUMP_SIGMA * np.exp(np.minimum(knots, 0.0) / c.CORRELATION_LENGTH)
    distance = (knots[:, np.newaxis] - knots) / c.CORRELATION_LENGTH
    bump = np.outer(sigma, sigma) * np.exp(-0.5 * distance**2) + c.UNCORRELATED_SIGMA**2 * np.eye(
        KNOTS)
    release = c.RELEASE_SIGMA**2 * np.eye(len(Release))
    covariance = np.zeros((SHAPE.stop - SHAPE.start,) * 2)
    for begin, block in ((0, release), (2, bump), (2 + KNOTS, bump)):
        covariance[begin:begin + len(block), begin:begin + len(block)] = block
    return covariance
