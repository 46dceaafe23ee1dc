"""How the robot turns for the speeds of its wheels, learned for the time when the gyro is gone."""

from __future__ import annotations

import math

MEMORY = 30.0        # s of turning, by which what was learned is forgotten; another ground
PRIOR = 0.05         # (rad/s)^2 s, the worth of the geometric track, which nobody has seen yet
UNKNOWN = 0.3        # of the yaw rate, one sigma of what nobody has learned
SMALLEST = 0.05      # of the yaw rate, one sigma: the next turn is never quite the same
STRAIGHT_RATE = 0.02  # rad/s, one sigma of the yaw rate while both sides are as fast


class SteeringEfficiency:
    """
    Regression of the yaw rate on the sides' difference of speeds over the track.

    A skid-steered robot turns by less than its wheels seem to say, often by half; the share is
    nearly the same from turn to turn on one ground, whatever the slips are.
    """

    def __init__(self) -> None:
        self._squares = PRIOR   # (rad/s)^2 s, of what the wheels say
        self._products = PRIOR  # of wheels and gyro
        self._misfits = PRIOR * UNKNOWN ** 2

    @property
    def share(self) -> float:
        """Return the yaw rate over what the wheels say, 1 without slip."""
        return self._products / self._squares

    def update(self, by_wheels: float, yaw_rate: float, duration: float) -> None:
        """Learn that the robot turned at ``yaw_rate`` [rad/s] for ``duration`` [s]."""
        weight = by_wheels ** 2 * duration
        if weight <= 0.0:
            return
        keep = math.exp(-duration / MEMORY * min(1.0, by_wheels ** 2 / self._mean_square()))
        misfit = yaw_rate - self.share * by_wheels
        self._squares = keep * self._squares + weight
        self._products = keep * self._products + by_wheels * yaw_rate * duration
        self._misfits = keep * self._misfits + misfit ** 2 * duration

    def _mean_square(self) -> float:
        return max(self._squares / MEMORY, STRAIGHT_RATE ** 2)

    def predict(self, by_wheels: float) -> tuple[float, float]:
        """Return the yaw rate to expect and one sigma of it [rad/s]."""
        relative = max(SMALLEST, math.sqrt(self._misfits / self._squares))
        return self.share * by_wheels, math.hypot(relative * by_wheels, STRAIGHT_RATE)
