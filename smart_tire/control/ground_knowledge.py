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

"""Friction of the present ground from plausible, recent measurements of the films."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Protocol

from smart_tire.models.constants import GRAVITY
from smart_tire.parameters.path_following import FrictionLimitParams
from smart_tire.samples import Friction, NS_PER_S, WHEELS
from smart_tire.uncertain import fused, Uncertain, UNKNOWN

# Rubber on dry ground: 0.8 to 0.9 on asphalt (Wong, Theory of Ground Vehicles, table 1.3),
# above 1 only for soft compounds.
MAX_FRICTION = 1.2
MIN_FRICTION = 1e-3        # -; wet ice: 0.02
# Relative, of friction and critical slip: 5 mm of an unknown center of mass over half a wheelbase.
MIN_RELATIVE_SIGMA = 0.04
PRIOR_SIGMA = 0.1          # -, of the friction coefficient of unknown ground; assumed
MIN_SLIP, MAX_SLIP = 1e-3, 1e2  # -, plausible critical slips
MIN_LOAD, MAX_LOAD = 0.1, 1e5   # N, plausible wheel loads
MAX_FADE_LENGTHS = 3.0     # older measurements, in fade distances or times, do not count


class Fading(Protocol):
    """How fast a measurement of the ground loses its weight."""

    @property
    def fade_distance(self) -> float:
        """Return the distance [m] in which the weight decreases to 1/e."""

    @property
    def fade_time(self) -> float:
        """Return the time [s] in which the weight decreases to 1/e."""


@dataclass(frozen=True)
class Measured:
    """Properties of the ground from one patch crossing."""

    friction: Uncertain  # -
    per_load: Uncertain  # 1/N, critical slip over load: 3 mu / C_x; UNKNOWN if not estimated
    stamp_ns: int
    distance: float      # m, driven until then


class GroundKnowledge:
    """
    Latest plausible measurement of each instrumented wheel.

    Its weight decreases exponentially with the distance driven and the time since; times are
    nanoseconds of the message clock.
    """

    def __init__(self) -> None:
        self._driven, self._now_ns = 0.0, 0
        self._measured: dict[str, Measured] = {}

    def clear(self) -> None:
        """Discard all measurements."""
        self._measured.clear()

    def drive(self, distance: float, now_ns: int) -> None:
        """Add a distance driven [m] until ``now_ns``."""
        self._driven += distance
        self._now_ns = now_ns

    def update(self, friction: Friction, behind: float = 0.0) -> None:
        """
        Add the friction of one patch crossing, ``behind`` [m] back; implausible ones are ignored.

        The standard deviation is at least that of the wheel load.
        """
        mu, sigma = friction.friction_coefficient
        if (friction.wheel in WHEELS and MIN_FRICTION <= mu <= MAX_FRICTION
                and 0.0 <= sigma < math.inf):
            self._measured[friction.wheel] = Measured(
                Uncertain(mu, max(sigma, MIN_RELATIVE_SIGMA * mu)), _slip_per_load(friction),
                friction.stamp_ns, self._driven - behind)

    def latest(self, wheels: Sequence[int], fading: Fading) -> tuple[Measured, float] | None:
        """Return the latest measurement of ``wheels`` (indices) and its weight; None: unknown."""
        found = [self._measured[WHEELS[i]] for i in wheels if WHEELS[i] in self._measured]
        one = max(found, key=lambda one: one.distance, default=None)
        if one is None:
            return None
        lengths = ((self._driven - one.distance) / fading.fade_distance
                   + abs(self._now_ns - one.stamp_ns) / NS_PER_S / fading.fade_time)
        return (one, math.exp(-lengths)) if lengths <= MAX_FADE_LENGTHS else None

    def lower_bound(self, params: FrictionLimitParams) -> float:
        """
        Return the lower bound of the friction coefficient of the present ground.

        That of a wheel is mu - k sigma, after fusion with a prior whose bound is ``unknown``: an
        estimate that is less certain than the prior does not lower the bound. The smallest of the
        bounds counts.
        """
        prior = Uncertain(params.unknown + params.sigmas * PRIOR_SIGMA, PRIOR_SIGMA)
        bounds = []
        for wheel in range(len(WHEELS)):
            if known := self.latest((wheel,), params):
                one, weight = known
                mean, sigma = fused(prior, one.friction)
                bound = max(mean - params.sigmas * sigma, params.minimum)
                bounds.append(params.unknown + weight * (bound - params.unknown))
        return min(bounds, default=params.unknown)

    def acceleration(self, params: FrictionLimitParams) -> float:
        """Return the acceleration [m/s2] of the body, in any direction, that is allowed."""
        return params.share * self.lower_bound(params) * GRAVITY


def _slip_per_load(friction: Friction) -> Uncertain:
    """Return the critical slip over the load [1/N]; UNKNOWN if one of them is not estimated."""
    critical, load = friction.critical_slip, friction.normal_load.value
    if (MIN_SLIP < critical.value <= MAX_SLIP and 0.0 <= critical.sigma < math.inf
            and MIN_LOAD < load <= MAX_LOAD):
        sigma = max(critical.sigma, MIN_RELATIVE_SIGMA * critical.value)
        return Uncertain(critical.value / load, sigma / load)
    return UNKNOWN
