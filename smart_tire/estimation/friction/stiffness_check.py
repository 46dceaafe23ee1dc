"""
Consistency of the longitudinal stiffness with the acceleration: ``m dv/dt = sum F_x(slip)``.

A film observes mu / C_x only, and C_x depends on tire and surface: sand has a lower stiffness, and
drag. Slips that with the calibrated C_x imply a forward force while the robot does not accelerate
contradict it. Whether C_x or an unknown drag is the cause is not observable without assuming mu,
so the standard deviation of C_x is increased and its value is not corrected.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

from smart_tire.models.constants import GRAVITY
from smart_tire.parameters.robot import RobotParams

MIN_FORCE_SHARE = 0.5  # of the linear force that a brush tire retains below t = 0.63
FORCE_SIGMAS = 2.0     # standard deviations of force within which there is no contradiction
FIRM_ROLLING_DRAG = 0.02  # of the weight, on firm ground; not a contradiction either
SURFACE_STIFFNESS_SIGMA = 0.6  # relative, of C_x on a surface other than the calibrated one


class StiffnessConsistencyCheck:
    """Compares the forces implied by slips with the measured acceleration."""

    def __init__(self, robot: RobotParams) -> None:
        self._mass = robot.mass
        self._stiffness = robot.tire.longitudinal_stiffness
        self._calibrated_sigma = robot.tire.longitudinal_stiffness_sigma

    def stiffness_sigma(self, slips: Sequence[float], sigma: float, acceleration: float) -> float:
        """
        Return the relative standard deviation of C_x.

        ``slips`` are the wheels' s_x, positive where they drive forward, with the ``sigma`` of
        their common error; ``acceleration`` [m/s2] is the longitudinal one of the center of mass.
        """
        forces = [self._stiffness * slip for slip in slips]
        scale = MIN_FORCE_SHARE * sum(map(abs, forces))
        if not (math.isfinite(acceleration) and scale > 0.0):  # NaN where a wheel is stationary
            return self._calibrated_sigma
        low, high = sorted((MIN_FORCE_SHARE * sum(forces), sum(forces)))
        required = self._mass * acceleration
        tolerance = (FORCE_SIGMAS * self._stiffness * len(forces) * sigma
                     + FIRM_ROLLING_DRAG * self._mass * GRAVITY)
        contradiction = max(low - required, required - high, 0.0) - tolerance
        share = min(max(contradiction / scale, 0.0), 1.0)
        return math.hypot(self._calibrated_sigma, SURFACE_STIFFNESS_SIGMA * share)
