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

"""Assembly of one ``Friction`` record per patch crossing: fit, invert, fuse."""

from __future__ import annotations

import math

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.bayes_filter import FrictionFilter
from smart_tire.estimation.friction.brush_inversion import (
    FrictionSample, GroundStiffness, single_friction, SlipFit, total_slip, traction_force)
from smart_tire.estimation.friction.crossing_method import MethodResult
from smart_tire.estimation.friction.methods import make_method
from smart_tire.estimation.friction.motion_history import WheelMotion
from smart_tire.estimation.friction.waveform_fit import WaveformFit
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import Friction, NS_PER_S
from smart_tire.uncertain import Uncertain, UNKNOWN

MAX_SLIP_SIGMA = 0.3   # of ``film_slip``; above, it is unknown
MAX_RATIO_SIGMA = 0.3  # of the adhesion ratio; above, it is unknown


class OutputBuilder:
    """Builds the records of one wheel's crossings, and filters friction over revolutions."""

    def __init__(self, wheel: str, params: FrictionEstimatorParams) -> None:
        self._wheel, self._tire = wheel, params.robot.tire
        self._method = make_method(wheel, params)
        self.filter = FrictionFilter()
        self.friction = UNKNOWN  # latest friction coefficient, from all crossings
        self.waveform: WaveformFit | None = None  # of the latest crossing, None without

    def build(self, crossing: PatchCrossing, motion: WheelMotion) -> Friction:
        """Return the record of ``crossing`` of a wheel with the given ``motion``."""
        nominal, load, stiffness = (
            self._tire.longitudinal_stiffness, motion.load, motion.stiffness)
        ground = GroundStiffness(stiffness.value / nominal, stiffness.sigma / stiffness.value,
                                 motion.slip_correlation)
        lateral = Uncertain(-motion.lateral_velocity.value / crossing.speed,
                            motion.lateral_velocity.sigma / crossing.speed)
        result = self._method.evaluate(crossing, motion)
        self.waveform = None if result is None else result.waveform
        if result is None:
            sample, slip, stamp_ns, measured = None, motion.slip, crossing.stamp_ns, {}
        else:
            sample = single_friction(result.fused, lateral, load, nominal, motion.slip.sigma)
            slip = Uncertain(result.fused.slip, result.fused.slip_sigma)
            stamp_ns = crossing.stamp_ns + round(result.shift / crossing.speed * NS_PER_S)
            measured = self._measured(result)
            measured['traction_force'] = traction_force(
                result.fused, lateral, crossing.direction, load, stiffness,
                motion.slip_correlation)
        return Friction(
            stamp_ns, self._wheel, slip=slip, total_slip=total_slip(slip, lateral),
            normal_load=load, stiffness=stiffness, **measured,
            **self._friction(sample, load, ground))

    def _measured(self, result: MethodResult) -> dict[str, Uncertain]:
        """Return the quantities that do not depend on load and stiffness."""
        films_only = result.films_only
        known = films_only.slip_sigma < MAX_SLIP_SIGMA
        ratio = _adhesion_ratio(films_only)
        length = self._tire.contact_length
        return {'film_slip': (Uncertain(films_only.slip, films_only.slip_sigma) if known
                              else UNKNOWN),
                'adhesion_ratio': ratio,
                'adhesion_length': Uncertain(ratio.value * length, ratio.sigma * length),
                'stretch_voltage': result.stretch_voltage, 'peak_interval': result.peak_interval}

    def _friction(self, sample: FrictionSample | None, load: Uncertain,
                  ground: GroundStiffness) -> dict[str, Uncertain]:
        """Update the filter; return friction of this and of all crossings, and critical slip."""
        likely = self.filter.estimate(ground).value
        self.friction = self.filter.update(sample, ground)
        found = {'friction_coefficient': self.friction}
        if sample is not None:
            found['friction_coefficient_single'] = sample.estimate(ground, likely)
        if math.isfinite(load.value):
            # 3 kappa F_z: C_x does not enter, and errors of the load cancel
            mu_0, sigma = self.filter.estimate_nominal()
            scale = 3.0 * load.value / self._tire.longitudinal_stiffness
            found['critical_slip'] = Uncertain(scale * mu_0, scale * sigma)
        return found


def _adhesion_ratio(fit: SlipFit) -> Uncertain:
    """Return the adhesion ratio, UNKNOWN where its standard deviation is too large."""
    sigma = fit.normalized_slip_sigma
    if not sigma < MAX_RATIO_SIGMA:
        return UNKNOWN
    return Uncertain(min(max(1.0 - fit.normalized_slip, 0.0), 1.0), sigma)
