"""
Whether the stiffness can be that of this ground: ``m dv/dt = sum F_x(slip)``, PHYSICS.md B.

A film shows mu / C_x only, and C_x belongs to tire and ground: sand is softer, and drags. Slips
that by the calibrated C_x would push the robot forward while it does not accelerate contradict
it. What is wrong, C_x or a drag that nobody knows, the balance does not tell, and mu must not be
assumed to find out; so the stiffness is doubted, not corrected.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

from smart_tire.models.vehicle.skid_steer import GRAVITY
from smart_tire.parameters.robot import RobotParams

LEAST_SHARE = 0.5    # of the force without sliding that a brush tire still has below t = 0.63
NOISE_FACTOR = 2.0   # sigmas of force that are no contradiction
FIRM_DRAG = 0.02     # of the weight, rolling drag of tires on firm ground: none either
GROUND_SPREAD = 0.6  # relative, one sigma of C_x on a ground that is not the calibrated one


class StiffnessConsistencyCheck:
    """Compares the forces that slips mean with the acceleration that there is."""

    def __init__(self, robot: RobotParams) -> None:
        self._mass = robot.mass
        self._stiffness = robot.tire.longitudinal_stiffness
        self._tolerance = robot.tire.longitudinal_stiffness_sigma

    def stiffness_sigma(self, slips: Sequence[float], sigma: float, acceleration: float) -> float:
        """
        Return the relative sigma of C_x.

        ``slips`` are the wheels' s_x, positive where they push forward, with the ``sigma`` of
        what they share; ``acceleration`` [m/s2] is the longitudinal one of the centre of mass.
        """
        forces = [self._stiffness * slip for slip in slips]
        scale = LEAST_SHARE * sum(map(abs, forces))
        if not (math.isfinite(acceleration) and scale > 0.0):  # NaN where a wheel stands
            return self._tolerance
        low, high = sorted((LEAST_SHARE * sum(forces), sum(forces)))
        needed = self._mass * acceleration
        noise = (NOISE_FACTOR * self._stiffness * len(forces) * sigma
                 + FIRM_DRAG * self._mass * GRAVITY)
        contradiction = max(low - needed, needed - high, 0.0) - noise
        doubt = min(max(contradiction / scale, 0.0), 1.0)
        return math.hypot(self._tolerance, GROUND_SPREAD * doubt)
