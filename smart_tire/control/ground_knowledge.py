# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction and stiffness of the present ground, as ``ground_state`` reports them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.control import constants as c
from smart_tire.parameters.path_following import FrictionLimitParams, GroundParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GRAVITY, GroundState, NS_PER_S
from smart_tire.uncertain import fused, Uncertain


# x, y [m] in ``odom`` and k -> mu - k sigma of a map; NaN where it is unknown
LowerBound = Callable[[Array, Array, float], Array]


def allowed_acceleration(lower: ArrayLike, params: FrictionLimitParams) -> Array:
    """Return the acceleration [m/s2] of the body with lower bounds of the friction (n,)."""
    allowed: Array = params.share * np.maximum(lower, params.minimum) * GRAVITY
    return allowed


@dataclass(frozen=True)
class MappedGround:
    """Friction that a map knows, under the wheels of a robot."""

    lower_bound: LowerBound
    params: FrictionLimitParams
    robot: RobotParams

    def acceleration(self, x: Array, y: Array, yaw: Array) -> Array:
        """
        Return the acceleration [m/s2] that is allowed at poses (n,) of ``base_link``.

        It is that of the wheel with the least lower bound; infinite where the map knows none.
        """
        cos, sin = np.cos(yaw), np.sin(yaw)
        lower = np.full(len(x), math.inf)
        for along in (-0.5 * self.robot.wheelbase, 0.5 * self.robot.wheelbase):
            for across in (-0.5 * self.robot.track_width, 0.5 * self.robot.track_width):
                lower = np.fmin(lower, self.lower_bound(
                    x + along * cos - across * sin, y + along * sin + across * cos,
                    self.params.sigmas))
        return allowed_acceleration(lower, self.params)


Measured = tuple[Uncertain, int, float]  # timestamp [ns], and distance driven until then [m]


class GroundKnowledge:
    """
    Latest plausible friction coefficient and stiffness in ``ground_state``.

    Their weight decreases exponentially with the distance driven and the time since; times are
    nanoseconds of the message clock.
    """

    def __init__(self) -> None:
        self._driven, self._now_ns = 0.0, 0
        self._friction: Measured | None = None
        self._stiffness: Measured | None = None

    def drive(self, distance: float, now_ns: int) -> None:
        """Add a distance driven [m] until ``now_ns``; a clock that is set back: another run."""
        if now_ns < self._now_ns - c.CLOCK_JUMP_NS:
            self._friction = self._stiffness = None
        self._driven += distance
        self._now_ns = now_ns

    def set_ground(self, ground: GroundState, behind: float = 0.0) -> None:
        """Use the state of the ground, ``behind`` [m] back; what is not plausible is ignored."""
        (mu, sigma), (stiffness, _) = ground.friction_coefficient, ground.stiffness
        distance = self._driven - behind
        if 0.0 < stiffness < math.inf:
            self._stiffness = ground.stiffness, ground.stamp_ns, distance
        if c.MIN_FRICTION <= mu <= c.MAX_FRICTION and 0.0 <= sigma < math.inf:
            self._friction = ground.friction_coefficient, ground.stamp_ns, distance

    def friction(self, unknown: float, fading: GroundParams) -> Uncertain:
        """Return the friction coefficient: the measured one fused with that of unknown ground."""
        prior = Uncertain(unknown, c.PRIOR_SIGMA)
        estimate, weight = self._weighted(self._friction, prior, fading)
        mean, sigma = fused(prior, estimate)
        return Uncertain(prior.value + weight * (mean - prior.value),
                         prior.sigma + weight * (sigma - prior.sigma))

    def stiffness(self, nominal: float, fading: GroundParams) -> float:
        """Return C_x [N]: the measured one, at first and after a while the ``nominal`` one."""
        estimate, weight = self._weighted(self._stiffness, Uncertain(nominal, 0.0), fading)
        return nominal + weight * (estimate.value - nominal)

    def acceleration(self, params: FrictionLimitParams) -> float:
        """
        Return the acceleration [m/s2] of the body, in any direction, that is allowed.

        It is a share of the lower bound of the friction, mu - k sigma. That of unknown ground is
        ``unknown``; an estimate that is less certain does not lower the bound.
        """
        mu, sigma = self.friction(params.unknown + params.sigmas * c.PRIOR_SIGMA, params)
        return float(allowed_acceleration(mu - params.sigmas * sigma, params))

    def _weighted(self, measured: Measured | None, prior: Uncertain, fading: GroundParams
                  ) -> tuple[Uncertain, float]:
        """Return what was measured and its weight; the ``prior`` and 0 before."""
        if measured is None:
            return prior, 0.0
        estimate, stamp_ns, distance = measured
        lengths = ((self._driven - distance) / fading.fade_distance
                   + abs(self._now_ns - stamp_ns) / NS_PER_S / fading.fade_time)
        return estimate, math.exp(-lengths)
