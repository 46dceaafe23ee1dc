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
Bayes filter over the friction coefficient with a change-point model.

Grid filter over ``mu_0 = mu C_0 / C_x``, which is what the films measure (``brush_inversion``):
between two revolutions the surface stays the same or, with a small probability, changes to any
other. So all information is kept on one surface and discarded at a change, a single outlier has
little influence, and revolutions without information increase the standard deviation because the
surface may have changed. A crossing measures 1 / mu_0 with Gaussian noise; slip too small for an
estimate still bounds it from below. ``mu = mu_0 C_x / C_0`` is taken with C_x of the present
ground, of which the error stays out of the filter: it is not independent between revolutions.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.friction.brush_inversion import (
    FrictionSample, GroundStiffness, MU_GRID, NOMINAL_GROUND)
from smart_tire.uncertain import Uncertain, UNKNOWN

CHANGE_PROBABILITY = 0.02   # per revolution, that the surface changes; assumed
OUTLIER_PROBABILITY = 0.01  # that a crossing is an outlier (e.g. spans two surfaces); assumed
SYSTEMATIC_WHITE_SHARE = 0.3  # of the systematic error that varies between revolutions; assumed
MIN_RELATIVE_NOISE = 0.004  # of 1 / mu_0; below, the grid is too coarse
MIN_ERROR_MODEL_GAIN = 0.05  # smallest share of a new revolution in the systematic error
CHANGE_SIGMAS = 3.0         # between old and new estimate, that count as a surface change ...
MAX_SIGMA_GROWTH = 2.0      # ... and growth of the standard deviation while that is undecided


class FrictionFilter:
    """
    Recursive estimate of a wheel's friction coefficient.

    ``changes`` counts surface changes, by mu_0.
    """

    def __init__(self) -> None:
        self._set_posterior(NOMINAL_GROUND.prior())
        self._surface: Uncertain = UNKNOWN  # last mu_0 that was decided, for change counting
        self._information = 0.0   # 1 / variance of 1 / mu_0, on the present surface
        self._systematic = 0.0    # relative sigma of mu_0, shared by revolutions, ...
        self._slip_effect = 0.0   # ... its part that is proportional to the error of slip ...
        self._scale = 0.0         # ... and the one from the load
        self.changes = 0

    def update(self, sample: FrictionSample | None,
               stiffness: GroundStiffness = NOMINAL_GROUND) -> Uncertain:
        """Update with one revolution, None without information; return mu."""
        prior = stiffness.prior()
        posterior = self._posterior + CHANGE_PROBABILITY * (prior - self._posterior)
        if not self._information:  # nothing was measured yet: the prior of the present ground
            posterior = prior.copy()
        if sample is None:
            self._set_posterior(posterior)
            return self.estimate(stiffness)
        noise = math.hypot(sample.white_sigma, SYSTEMATIC_WHITE_SHARE * sample.systematic_sigma,
                           MIN_RELATIVE_NOISE * abs(sample.inverse_mu))
        likelihood = np.exp(-0.5 * ((1.0 / MU_GRID - sample.inverse_mu) / noise)**2)
        # an outlier is equally likely on every surface
        likelihood += OUTLIER_PROBABILITY * (
            float(prior @ likelihood) - likelihood)
        posterior *= likelihood
        total = float(posterior.sum())
        if total > 0.0:
            self._set_posterior(posterior / total)
            self._count_change()
            self._update_error_model(sample, noise)
        return self.estimate(stiffness)

    def estimate(self, stiffness: GroundStiffness = NOMINAL_GROUND) -> Uncertain:
        """Return mu on a ground; UNKNOWN while its standard deviation exceeds its value."""
        mu_0, spread = self._estimate
        variance = ((spread / mu_0)**2 + self._systematic**2 + self._scale**2
                    + stiffness.variance(self._slip_effect))
        return self._known(mu_0 * stiffness.ratio, variance)

    def estimate_nominal(self) -> Uncertain:
        """Return mu_0 without the error of the load: for quantities in which that cancels."""
        mu_0, spread = self._estimate
        return self._known(mu_0, (spread / mu_0)**2 + self._systematic**2)

    def _known(self, value: float, variance: float) -> Uncertain:
        """Return an estimate with a relative variance, UNKNOWN if that is too large."""
        known = self._information > 0.0 and variance < 1.0
        return Uncertain(value, value * math.sqrt(max(variance, 0.0))) if known else UNKNOWN

    def _set_posterior(self, posterior: Array) -> None:
        """Set the probability of each mu_0, with their median and the rms deviation from it."""
        self._posterior = posterior
        cumulative = np.cumsum(posterior) - 0.5 * posterior
        mu_0 = float(np.interp(0.5, cumulative, MU_GRID))
        # without systematic and scale errors
        self._estimate = mu_0, math.sqrt(float(posterior @ (MU_GRID - mu_0)**2))

    def _count_change(self) -> None:
        mu_0, spread = self._estimate
        before, before_sigma = self._surface
        if abs(mu_0 - before) > CHANGE_SIGMAS * math.hypot(spread, before_sigma):
            self.changes += 1
            self._information = 0.0
        elif spread > MAX_SIGMA_GROWTH * before_sigma:
            return
        self._surface = Uncertain(mu_0, spread)

    def _update_error_model(self, sample: FrictionSample, noise: float) -> None:
        """Average the systematic errors over the revolutions on the present surface."""
        information = noise**-2
        self._information += information
        gain = max(information / self._information, MIN_ERROR_MODEL_GAIN)
        mu_0 = 1.0 / max(sample.inverse_mu, sample.white_sigma)
        self._systematic += gain * (sample.systematic_sigma * mu_0 - self._systematic)
        # mu_0 falls as 1 / mu_0 rises
        self._slip_effect += gain * (-sample.slip_effect * mu_0 - self._slip_effect)
        self._scale += gain * (sample.scale_sigma - self._scale)
