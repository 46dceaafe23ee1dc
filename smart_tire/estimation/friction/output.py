"""The record of one passage: every quantity of ``tire_friction`` with its sigma."""

from __future__ import annotations

import math

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.bayes_filter import FrictionFilter
from smart_tire.estimation.friction.brush_inversion import (
    FrictionSample, single_friction, SlipFit, total_slip, traction_force)
from smart_tire.estimation.friction.motion_history import UNKNOWN, ValueSigma, WheelMotion
from smart_tire.estimation.friction.two_peak_method import TwoPeakReader
from smart_tire.estimation.friction.waveform_method import WaveformReader, WaveformResult
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import Friction, FRICTION_QUANTITIES, NS_PER_S

KNOWN_SLIP = 0.3   # sigma of a slip above which it is not known
KNOWN_RATIO = 0.3  # sigma of the adhesion ratio above which it is not known


class OutputBuilder:
    """Turns the passages of one wheel into ``Friction``; fuses its revolutions."""

    def __init__(self, wheel: str, params: FrictionEstimatorParams) -> None:
        self._wheel, self._tire = wheel, params.robot.tire
        self._reader = (WaveformReader(wheel, params.robot) if params.method == 'waveform'
                        else TwoPeakReader(wheel, params.robot, params.map))
        self.fusion = FrictionFilter()

    def report(self, passage: PatchCrossing, motion: WheelMotion) -> Friction:
        """Return what ``passage`` tells of a wheel that moved as ``motion`` says."""
        found = dict.fromkeys(FRICTION_QUANTITIES, UNKNOWN)
        stiffness = self._tire.longitudinal_stiffness
        relative = (self._tire.longitudinal_stiffness_sigma if motion.stiffness_sigma is None
                    else motion.stiffness_sigma)
        found['stiffness'] = stiffness, relative * stiffness
        found['normal_load'] = motion.load
        lateral = -motion.lateral[0] / passage.speed, motion.lateral[1] / passage.speed
        reading, single, stamp_ns = self._reader.read(passage, motion), None, passage.stamp_ns
        if reading is None:
            found['slip'] = motion.slip
        else:
            single = self._tell(found, reading, lateral, passage.direction)
            stamp_ns += round(reading.shift / passage.speed * NS_PER_S)
        found['total_slip'] = total_slip(found['slip'], lateral)
        found.update(self._friction(single, motion.load, found['stiffness']))
        return Friction(stamp_ns, self._wheel,
                        {name: value for name, (value, _) in found.items()},
                        {name: sigma for name, (_, sigma) in found.items()})

    def _tell(self, found: dict[str, ValueSigma], reading: WaveformResult, lateral: ValueSigma,
              direction: int) -> FrictionSample | None:
        """Fill in what a passage tells that was read; return its friction."""
        alone, evidence, load = reading.alone, reading.joined, found['normal_load']
        if alone.slip_sigma < KNOWN_SLIP:
            found['film_slip'] = alone.slip, alone.slip_sigma
        found['slip'] = evidence.slip, evidence.slip_sigma
        found.update(self._adhesion(evidence), **reading.peaks)
        found['traction_force'] = traction_force(
            evidence, lateral, direction, load, found['stiffness'])
        return single_friction(evidence, lateral, load, found['stiffness'])

    def _adhesion(self, evidence: SlipFit) -> dict[str, ValueSigma]:
        sigma = evidence.sliding_sigma
        if not sigma < KNOWN_RATIO:
            return {}
        ratio, length = min(max(1.0 - evidence.sliding, 0.0), 1.0), self._tire.contact_length
        return {'adhesion_ratio': (ratio, sigma),
                'adhesion_length': (ratio * length, sigma * length)}

    def _friction(self, single: FrictionSample | None, load: ValueSigma,
                  stiffness: ValueSigma) -> dict[str, ValueSigma]:
        likely = self.fusion.estimate()[0]
        mu = self.fusion.update(single)
        found = {'friction_coefficient': mu}
        if single is not None:
            found['friction_coefficient_single'] = single.estimate(likely)
        if math.isfinite(mu[0]) and math.isfinite(load[0]):
            critical = 3.0 * load[0] / stiffness[0]
            # wrong by the same factor as mu, stiffness and load cancel
            found['critical_slip'] = (critical * mu[0],
                                      critical * self.fusion.estimate(constant=False)[1])
        return found
