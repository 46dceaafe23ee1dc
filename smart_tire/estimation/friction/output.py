"""Assembly of one ``Friction`` record per patch crossing: fit, invert, fuse."""

from __future__ import annotations

import math

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.bayes_filter import FrictionFilter
from smart_tire.estimation.friction.brush_inversion import (
    FrictionSample, single_friction, SlipFit, total_slip, traction_force)
from smart_tire.estimation.friction.crossing_method import MethodResult
from smart_tire.estimation.friction.methods import make_method
from smart_tire.estimation.friction.motion_history import WheelMotion
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

    def build(self, crossing: PatchCrossing, motion: WheelMotion) -> Friction:
        """Return the record of ``crossing`` of a wheel with the given ``motion``."""
        nominal = self._tire.longitudinal_stiffness
        relative = (self._tire.longitudinal_stiffness_sigma if motion.stiffness_sigma is None
                    else motion.stiffness_sigma)
        load, stiffness = motion.load, Uncertain(nominal, relative * nominal)
        lateral = Uncertain(-motion.lateral_velocity.value / crossing.speed,
                            motion.lateral_velocity.sigma / crossing.speed)
        result = self._method.evaluate(crossing, motion)
        if result is None:
            sample, slip, stamp_ns, measured = None, motion.slip, crossing.stamp_ns, {}
        else:
            sample = single_friction(result.fused, lateral, load, stiffness)
            slip = Uncertain(result.fused.slip, result.fused.slip_sigma)
            stamp_ns = crossing.stamp_ns + round(result.shift / crossing.speed * NS_PER_S)
            measured = self._measured(result)
            measured['traction_force'] = traction_force(
                result.fused, lateral, crossing.direction, load, stiffness)
        return Friction(
            stamp_ns, self._wheel, slip=slip, total_slip=total_slip(slip, lateral),
            normal_load=load, stiffness=stiffness, **measured,
            **self._friction(sample, load, stiffness))

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
                  stiffness: Uncertain) -> dict[str, Uncertain]:
        """Update the filter; return friction of this and of all crossings, and critical slip."""
        likely = self.filter.estimate().value
        mu = self.filter.update(sample)
        found = {'friction_coefficient': mu}
        if sample is not None:
            found['friction_coefficient_single'] = sample.estimate(likely)
        if math.isfinite(mu.value) and math.isfinite(load.value):
            scale = 3.0 * load.value / stiffness.value
            # errors of stiffness and load cancel with those of mu
            found['critical_slip'] = Uncertain(
                scale * mu.value, scale * self.filter.estimate(scale_error=False).sigma)
        return found


def _adhesion_ratio(fit: SlipFit) -> Uncertain:
    """Return the adhesion ratio, UNKNOWN where its standard deviation is too large."""
    sigma = fit.normalized_slip_sigma
    if not sigma < MAX_RATIO_SIGMA:
        return UNKNOWN
    return Uncertain(min(max(1.0 - fit.normalized_slip, 0.0), 1.0), sigma)
