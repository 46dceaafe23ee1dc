"""The effective rolling radius, learned while the wheels only roll."""

from __future__ import annotations

from smart_tire.parameters import RobotParams

SAME_ROLLING = 5.0  # s, for which what is seen of rolling wheels errs to one side


class RadiusEstimator:
    """
    Effective rolling radius: speed over ground per wheel speed of wheels that roll freely.

    A wrong radius and slip look the same at any instant. But a radius stays, on any ground and at
    any speed, while wheels that neither drive nor brake nor turn the robot hardly slip on firm
    ground. Speed is known for a while after every start from standstill. Nothing is learned on
    soft ground or in turns; a radius that is said to be exact stays as it is.
    """

    def __init__(self, robot: RobotParams) -> None:
        self._nominal = robot.wheel_radius
        self.scale = 1.0  # rolling radius over the nominal one
        self.variance = robot.wheel_radius_sigma ** 2  # of the scale

    @property
    def radius(self) -> float:
        """Return the radius [m] as learned so far."""
        return self.scale * self._nominal

    def update(self, slip: float, variance: float, weight: float, duration: float) -> None:
        """
        Learn from ``duration`` [s] of rolling at an apparent ``slip`` ratio with ``variance``.

        ``weight``, 0 to 1, is how likely the wheels only roll, on firm ground.
        """
        information = weight * duration / SAME_ROLLING / variance
        gain = self.variance * information / (1.0 + self.variance * information)
        self.scale *= 1.0 - gain * slip
        self.variance *= 1.0 - gain
