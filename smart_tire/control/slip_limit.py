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

"""Slip limits of the wheels from the friction that films have measured."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.models.constants import GRAVITY
from smart_tire.parameters.control import TractionParams
from smart_tire.samples import Four, Friction, LEFT, RIGHT, WHEELS
from smart_tire.uncertain import fused, Uncertain

MIN_LOAD, MIN_CRITICAL_SLIP = 1e-3, 1e-3  # N, -; lower limits in denominators
PRIOR_FRICTION_SIGMA = 0.15  # -, of the friction coefficient of unknown ground
PRIOR_RELATIVE_SIGMA = 0.5   # of the critical slip of unknown ground
MIN_BOUND = 0.1              # lower bound of the critical slip over its estimate, at least


@dataclass(frozen=True)
class Measured:
    """Properties of the ground from one patch crossing."""

    per_load: Uncertain  # 1/N, critical slip over load: 3 mu / C_x
    friction: Uncertain  # -
    distance: float      # m, traveled until then


@dataclass(frozen=True)
class WheelGround:
    """Ground under one wheel."""

    limit: float     # -, total slip aimed at
    critical: float  # -, critical slip expected
    friction: float  # N, force of a sliding wheel: mu F_z


Sides = tuple[Measured | None, Measured | None]  # of the ground: left, right


class GroundKnowledge:
    """Latest measurement of the ground for each instrumented wheel."""

    def __init__(self) -> None:
        self._measured: dict[str, Measured] = {}

    def clear(self) -> None:
        """Discard all measurements."""
        self._measured.clear()

    def update(self, friction: Friction, distance: float) -> None:
        """Add a patch crossing at a ``distance`` [m] traveled; without a result it is ignored."""
        critical, load = friction.critical_slip, friction.normal_load.value
        known = (friction.wheel in WHEELS and math.isfinite(critical.value + critical.sigma)
                 and critical.value > 0.0 and critical.sigma >= 0.0 and load > 0.0)
        if known and math.isfinite(load):
            per_load = Uncertain(critical.value / load, critical.sigma / load)
            self._measured[friction.wheel] = Measured(
                per_load, friction.friction_coefficient, distance)

    def on_sides(self, distance: float, max_distance: float) -> Sides:
        """
        Return what is known of the ground on the left and on the right; None if unknown.

        Measurements more than ``max_distance`` [m] back are unknown. The latest one of a side
        holds there; a side without any has the ground of the other one.
        """
        def latest(side: tuple[int, ...]) -> Measured | None:
            found = [self._measured[WHEELS[i]] for i in side if WHEELS[i] in self._measured]
            recent = [one for one in found if distance - one.distance <= max_distance]
            return max(recent, key=lambda one: one.distance, default=None)

        left, right = latest(LEFT), latest(RIGHT)
        return left or right, right or left


def prior_critical_slip(load_share: float, params: TractionParams) -> Uncertain:
    """
    Return the critical slip [-] of ground that no film has measured.

    It is the one whose limit is ``unknown_slip`` for the mean load; ``load_share`` is the load
    over the mean.
    """
    mean = params.unknown_slip / (params.share * max(
        1.0 - params.sigmas * PRIOR_RELATIVE_SIGMA, MIN_BOUND))
    return Uncertain(load_share * mean, load_share * mean * PRIOR_RELATIVE_SIGMA)


def expected_friction(ground: Measured | None, params: TractionParams) -> Uncertain:
    """
    Return the friction coefficient, fused with that of unknown ground.

    >>> friction = Uncertain(0.2, 0.02)
    >>> params = TractionParams(unknown_friction=0.15)
    >>> expected_friction(Measured(friction, friction, 0.0), params).value > 0.199
    True
    """
    prior = Uncertain(params.unknown_friction, PRIOR_FRICTION_SIGMA)
    if ground is None or not math.isfinite(sum(ground.friction)):
        return prior
    return fused(prior, ground.friction)


def slip_limit(critical: Uncertain, params: TractionParams) -> float:
    """
    Return the total slip [-] aimed at: a share of the lower bound of the critical slip.

    >>> params = TractionParams(share=0.5, sigmas=1.0)
    >>> slip_limit(Uncertain(0.4, 0.1), params)
    0.15
    """
    bound = max(critical.value - params.sigmas * critical.sigma, MIN_BOUND * critical.value)
    return min(params.share * bound, params.max_slip)


def wheel_grounds(sides: Sides, loads: Four, acceleration: float, params: TractionParams) -> tuple[
        WheelGround, ...]:
    """
    Return the ground under each wheel with its load [N].

    Critical slip is proportional to the load; what was measured is fused with the prior. Friction
    is at least what the ``acceleration`` [m/s2] of the robot uses where it was not measured.
    """
    mean = max(sum(loads) / len(loads), MIN_LOAD)

    def ground(wheel: int, load: float) -> WheelGround:
        known, critical = sides[wheel % 2], prior_critical_slip(load / mean, params)
        friction = expected_friction(known, params).value
        if known is None:
            friction = max(friction, abs(acceleration) / GRAVITY)
        else:
            value, sigma = known.per_load
            critical = fused(critical, Uncertain(value * load, sigma * load))
        return WheelGround(slip_limit(critical, params), max(critical.value, MIN_CRITICAL_SLIP),
                           friction * load)

    return tuple(map(ground, range(len(WHEELS)), loads))
