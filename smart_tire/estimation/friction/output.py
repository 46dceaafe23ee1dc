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

"""Assembly of one ``Friction`` record per patch crossing."""

from __future__ import annotations

import math

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.brush_inversion import friction_estimate, SlipFit
from smart_tire.estimation.friction.crossing_method import MethodResult
from smart_tire.estimation.friction.methods import make_method
from smart_tire.estimation.ground.estimator import WheelState
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import Friction, NS_PER_S
from smart_tire.uncertain import Uncertain, UNKNOWN

MAX_SLIP_SIGMA = 0.3   # of ``film_slip``; above, it is unknown
MAX_RATIO_SIGMA = 0.3  # of the adhesion ratio; above, it is unknown


class OutputBuilder:
    """Builds the records of one wheel's crossings."""

    def __init__(self, wheel: str, params: FrictionEstimatorParams) -> None:
        self._wheel, self._length = wheel, params.robot.tire.contact_length
        self.method = make_method(wheel, params)
        self.friction = UNKNOWN  # latest friction coefficient, from all crossings

    def build(self, crossing: PatchCrossing, result: MethodResult | None, state: WheelState
              ) -> Friction:
        """Return the record of ``crossing``, while the wheel was in ``state``."""
        total = _product(state.normalized_slip, state.critical_slip)
        self.friction = state.friction
        found = {} if result is None else self._measured(result, state, total)
        return Friction(
            stamp_of(crossing, result), self._wheel, slip=state.slip, total_slip=total,
            normal_load=state.load, stiffness=state.stiffness,
            friction_coefficient=state.friction, critical_slip=state.critical_slip,
            traction_force=state.traction_force, **found)

    def _measured(self, result: MethodResult, state: WheelState, total: Uncertain
                  ) -> dict[str, Uncertain]:
        """Return the quantities that need the films."""
        films = result.films_only
        known, ratio = films.slip_sigma < MAX_SLIP_SIGMA, _adhesion_ratio(films)
        return {'film_slip': Uncertain(films.slip, films.slip_sigma) if known else UNKNOWN,
                'adhesion_ratio': ratio,
                'adhesion_length': Uncertain(
                    ratio.value * self._length, ratio.sigma * self._length),
                'stretch_voltage': result.stretch_voltage, 'peak_interval': result.peak_interval,
                'friction_coefficient_single': _single(films, total, state)}


def stamp_of(crossing: PatchCrossing, result: MethodResult | None) -> int:
    """Return the instant [ns] at which the films are at the patch's middle."""
    shift = 0.0 if result is None else result.shift / crossing.speed
    return crossing.stamp_ns + round(shift * NS_PER_S)


def _single(films: SlipFit, total: Uncertain, state: WheelState) -> Uncertain:
    """
    Return mu from one crossing alone, C_x |s| / (3 F_z t).

    Its normalized slip t is that of the films, given the slip of the motion.
    """
    if not (total.value > 0.0 and state.load.value > 0.0 and state.stiffness.value > 0.0):
        return UNKNOWN
    covariance = films.white_cov + films.systematic_cov
    gain = float(covariance[0, 1] / (covariance[0, 0] + state.slip.sigma ** 2))
    ratio = films.normalized_slip + gain * (state.slip.value - films.slip)
    sigma = math.sqrt(max(float(covariance[1, 1]) - gain * float(covariance[0, 1]), 0.0))
    scale = 3.0 * state.load.value / (state.stiffness.value * total.value)
    mu, spread = friction_estimate(scale * ratio, scale * sigma, state.friction.value)
    if not math.isfinite(mu):
        return UNKNOWN
    return Uncertain(mu, math.hypot(spread, *(mu * one.sigma / one.value for one in (
        state.load, state.stiffness, total))))


def _product(first: Uncertain, second: Uncertain) -> Uncertain:
    """Return the product of two independent quantities, UNKNOWN if one of them is."""
    if not math.isfinite(first.value * second.value):
        return UNKNOWN
    return Uncertain(first.value * second.value, math.hypot(
        first.value * second.sigma, first.sigma * second.value))


def _adhesion_ratio(fit: SlipFit) -> Uncertain:
    """Return the adhesion ratio, UNKNOWN where its standard deviation is too large."""
    sigma = fit.normalized_slip_sigma
    if not sigma < MAX_RATIO_SIGMA:
        return UNKNOWN
    return Uncertain(min(max(1.0 - fit.normalized_slip, 0.0), 1.0), sigma)
