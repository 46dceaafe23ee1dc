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

"""Acceleration that the friction estimated by the tires allows."""

from __future__ import annotations

import math

from smart_tire.parameters.path_following import FrictionLimitParams
from smart_tire.samples import Friction
from smart_tire.uncertain import fused, Uncertain

GRAVITY = 9.81        # m/s2
PRIOR_SIGMA = 0.1     # -, of the friction coefficient of unknown ground
MAX_FADE_LENGTHS = 3.0  # older estimates, in fade distances, do not count


class FrictionLimit:
    """
    Lower bound of the friction coefficient, from the latest estimate of each wheel.

    The bound of a wheel is mu - k sigma, after fusion with a prior whose bound is ``unknown``: an
    estimate that is less certain than the prior does not lower the bound. Its difference from
    ``unknown`` decays exponentially with the distance driven since, and the smallest of the
    bounds counts.
    """

    def __init__(self) -> None:
        self._driven = 0.0  # m
        self._estimates: dict[str, tuple[float, float, float]] = {}  # mu, sigma, m driven

    def drive(self, distance: float) -> None:
        """Add a distance driven [m]."""
        self._driven += distance

    def update(self, friction: Friction) -> None:
        """Add the friction of one patch crossing; ignored if not estimated."""
        mu, sigma = friction.friction_coefficient.value, friction.friction_coefficient.sigma
        if math.isfinite(mu) and math.isfinite(sigma):
            self._estimates[friction.wheel] = (mu, sigma, self._driven)

    def lower_bound(self, params: FrictionLimitParams) -> float:
        """Return the lower bound of the friction coefficient of the present ground."""
        bounds = []
        for mu, sigma, at in self._estimates.values():
            lengths = (self._driven - at) / params.fade_distance
            if lengths <= MAX_FADE_LENGTHS:
                bound = max(_fused_bound(mu, sigma, params), params.minimum)
                bounds.append(params.unknown + math.exp(-lengths) * (bound - params.unknown))
        return min(bounds, default=params.unknown)

    def acceleration(self, params: FrictionLimitParams) -> float:
        """Return the acceleration [m/s2] of the body, in any direction, that is allowed."""
        return params.share * self.lower_bound(params) * GRAVITY


def _fused_bound(mu: float, sigma: float, params: FrictionLimitParams) -> float:
    """Return the lower bound from an estimate and the prior."""
    prior = params.unknown + params.sigmas * PRIOR_SIGMA
    mean, sigma = fused(Uncertain(prior, PRIOR_SIGMA), Uncertain(mu, sigma))
    return mean - params.sigmas * sigma
