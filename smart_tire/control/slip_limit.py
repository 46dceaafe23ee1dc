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

from smart_tire.parameters.control import TractionParams
from smart_tire.samples import Four, Friction, LEFT, RIGHT, WHEELS
from smart_tire.uncertain import Uncertain

MAX_RELATIVE_SIGMA = 0.5  # of the critical slip, above which it counts as unknown


@dataclass(frozen=True)
class Measured:
    """Properties of the ground from one patch crossing."""

    per_load: Uncertain  # 1/N, critical slip over load: 3 mu / C_x
    friction: Uncertain  # -
    distance: float      # m, traveled until then


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
                 and critical.value > 0.0 and critical.sigma >= 0.0 and load > 0.0
                 and critical.sigma <= MAX_RELATIVE_SIGMA * critical.value)
        if known and math.isfinite(load):
            per_load = Uncertain(critical.value / load, critical.sigma / load)
            self._measured[friction.wheel] = Measured(
                per_load, friction.friction_coefficient, distance)

    def on_sides(self, distance: float, max_distance: float) -> tuple[
            Measured | None, Measured | None]:
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


def slip_limit(critical: Uncertain, slip_sigma: float, params: TractionParams) -> float:
    """
    Return the total slip [-] aimed at: a share of the critical slip, less the uncertainty.

    The latter is that of the critical slip and ``slip_sigma`` [-] of the present slip. The limit
    is not below that for unknown ground, unless the estimate itself is.

    >>> params = TractionParams(share=0.5, sigmas=1.0, unknown_slip=0.1)
    >>> slip_limit(Uncertain(0.4, 0.06), 0.04, params)
    0.15
    >>> slip_limit(Uncertain(0.1, 0.06), 0.04, params)
    0.05
    """
    target = params.share * critical.value
    margin = params.sigmas * math.hypot(params.share * critical.sigma, slip_sigma)
    return min(max(target - margin, min(target, params.unknown_slip)), params.max_slip)


def slip_limits(sides: tuple[Measured | None, Measured | None], loads: Four, slip_sigma: float,
                params: TractionParams) -> Four:
    """Return the total slip [-] aimed at for each wheel with its load [N]."""
    def limit(wheel: int) -> float:
        known = sides[wheel % 2]
        if known is None:
            return min(params.unknown_slip, params.max_slip)
        value, sigma = known.per_load
        return slip_limit(Uncertain(value * loads[wheel], sigma * loads[wheel]), slip_sigma,
                          params)

    a, b, c, d = map(limit, range(len(WHEELS)))
    return a, b, c, d
