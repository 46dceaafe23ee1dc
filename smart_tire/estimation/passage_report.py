"""The record of one passage: every quantity of ``tire_friction`` with its sigma."""

from __future__ import annotations

import math

import numpy as np

from smart_tire.estimation.friction import (
    Evidence, FilmReading, join_slip, map_sliding, Single, single_friction, total_slip,
    traction_force, weigh)
from smart_tire.estimation.fusion import FrictionFusion
from smart_tire.estimation.motion import Estimate, UNKNOWN, WheelMotion
from smart_tire.estimation.peaks import PassageMeter, Shape
from smart_tire.estimation.wheel_films import WheelPassage
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import Friction, FRICTION_QUANTITIES

SMALL_SLIP = 0.01    # below, a relative change of slip means nothing
CHANGE_NOISE = 0.02  # of the slip estimator, relative, over one contact length
MISSED = 0.1         # share of a wheel's change of speed that the slip estimator may miss
SPEED_NOISE = 0.05   # relative change of speed that a jittering angle shows in one pass
LINEAR_CHANGE = 0.1  # relative change of slip, beyond which first order does not hold
KNOWN_SLIP = 0.3     # sigma of a slip above which it is not known
KNOWN_RATIO = 0.3    # sigma of the adhesion ratio above which it is not known


class PassageReporter:
    """Turns measured passages of one wheel into ``Friction``; fuses its revolutions."""

    def __init__(self, wheel: str, params: FrictionEstimatorParams) -> None:
        self._wheel = wheel
        self._map = params.map
        self._film, self._tire = params.robot.film, params.robot.tire
        self._gains = self._film.gains(wheel)
        self._meter = PassageMeter(params.robot)
        self.fusion = FrictionFusion()

    def report(self, passage: WheelPassage, motion: WheelMotion) -> Friction:
        """Return what ``passage`` tells of a wheel that moved as ``motion`` says."""
        found = dict.fromkeys(FRICTION_QUANTITIES, UNKNOWN)
        stiffness = self._tire.longitudinal_stiffness
        relative = (self._tire.longitudinal_stiffness_sigma if motion.stiffness_sigma is None
                    else motion.stiffness_sigma)
        found['stiffness'] = stiffness, relative * stiffness
        found['normal_load'] = motion.load
        lateral = -motion.lateral[0] / passage.speed, motion.lateral[1] / passage.speed
        change = self._slip_change(passage, motion)
        readings = [self._reading(film, shape, change) for film, shape in passage.shapes.items()]
        single = None
        if readings:
            alone = weigh(readings, self._film.stretch_gain_tolerance)
            if alone.slip_sigma < KNOWN_SLIP:
                found['film_slip'] = alone.slip, alone.slip_sigma
            evidence = map_sliding(join_slip(alone, motion.slip), self._film.length,
                                   self._tire.contact_length, self._map)
            found['slip'] = evidence.slip, evidence.slip_sigma
            found['total_slip'] = total_slip(found['slip'], lateral)
            if evidence.slip > 0.0:
                found.update(self._adhesion(evidence), **self._peaks(passage, change))
                single = single_friction(evidence, lateral, motion.load, found['stiffness'])
            found['traction_force'] = traction_force(
                evidence, lateral, passage.direction, motion.load, found['stiffness'])
        else:
            found['slip'] = motion.slip
            found['total_slip'] = total_slip(motion.slip, lateral)
        found.update(self._friction(single, motion.load, found['stiffness']))
        return Friction(passage.stamp_ns, self._wheel,
                        {name: value for name, (value, _) in found.items()},
                        {name: sigma for name, (_, sigma) in found.items()})

    def _slip_change(self, passage: WheelPassage, motion: WheelMotion) -> float:
        """
        Return the relative change of slip over a contact length, as far as it may disturb.

        It is what the slip estimator says, beyond its own noise, and what it may have missed: a
        part of the wheel's change of speed.
        """
        slip = max(abs(motion.slip[0]), SMALL_SLIP) if math.isfinite(motion.slip[0]) else 1.0
        told = abs(motion.slip_rate) * self._tire.contact_length / passage.speed / slip
        missed = MISSED * max(passage.speed_change - SPEED_NOISE, 0.0) / slip
        change = math.hypot(max(told - CHANGE_NOISE, 0.0), missed)
        return change * (1.0 + change / LINEAR_CHANGE)

    def _reading(self, film: int, shape: Shape, change: float) -> FilmReading:
        # film 2 feels the slip of later or earlier than film 1, for which slip is told
        later = film * self._film.spacing / self._tire.contact_length
        drift = shape.drift[1:] + later * np.array([shape.stretch, shape.sliding])
        return FilmReading(shape.stretch, shape.sliding, shape.covariance[1:, 1:],
                           self._gains[film], change * drift)

    def _adhesion(self, evidence: Evidence) -> dict[str, Estimate]:
        sigma = evidence.sliding_sigma
        if sigma > KNOWN_RATIO:
            return {}
        ratio, length = max(1.0 - evidence.sliding, 0.0), self._tire.contact_length
        return {'adhesion_ratio': (ratio, sigma),
                'adhesion_length': (ratio * length, sigma * length)}

    def _peaks(self, passage: WheelPassage, change: float) -> dict[str, Estimate]:
        """Return the two peaks of film 1 as Fig. 8 draws them."""
        shape = passage.shapes.get(0)
        if shape is None or self._film.length >= self._tire.contact_length:
            return {}
        peaks = self._meter.peaks(shape, change)
        if peaks.position_sigma > KNOWN_RATIO * self._tire.contact_length:
            return {}
        interval = (self._tire.contact_length - peaks.position) / passage.speed
        sigma = math.hypot(peaks.position_sigma, passage.speed_sigma * interval) / passage.speed
        return {'stretch_voltage': (peaks.height, peaks.height_sigma),
                'peak_interval': (interval, sigma)}

    def _friction(self, single: Single | None, load: Estimate,
                  stiffness: Estimate) -> dict[str, Estimate]:
        mu = self.fusion.update(single)
        found = {'friction_coefficient': mu}
        if single is not None:
            found['friction_coefficient_single'] = single.estimate()
        if math.isfinite(mu[0]) and math.isfinite(load[0]):
            critical = 3.0 * load[0] / stiffness[0]
            # wrong by the same factor as mu, stiffness and load cancel
            found['critical_slip'] = (critical * mu[0],
                                      critical * self.fusion.estimate(constant=False)[1])
        return found
