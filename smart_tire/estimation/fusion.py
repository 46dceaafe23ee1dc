"""
One friction coefficient from many revolutions, that notices when the ground changes.

What a passage measures with Gaussian noise is 1 / mu, so that is what is averaged. On one surface
nothing is forgotten; a change forgets everything. Revolutions that tell nothing leave the value
and widen its sigma, for the ground may have changed unseen.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.estimation.friction import friction_estimate, Single, TYPICAL
from smart_tire.estimation.motion import Estimate, UNKNOWN

CHANGE = 3.0         # sigmas between passage and average that make a change likely ...
SURE_CHANGE = 6.0    # ... and certain
CONFIRMATIONS = 2    # likely ones in a row, agreeing, that are believed
CHANGE_RATE = 0.02   # chance per revolution that the ground changes; assumed
TELLING = 0.5 / TYPICAL  # noise of 1 / mu, above which its mean is biased, for w is positive
SPREAD = 0.3         # -, one sigma of mu among grounds; assumed


@dataclass(slots=True)
class _Average:
    """Weighted mean of 1 / mu; ``lasting`` and ``constant`` are mean sigmas as of ``Single``."""

    inverse: float
    variance: float
    lasting: float
    constant: float
    count: int = 1

    @staticmethod
    def of(single: Single) -> _Average:
        return _Average(single.inverse, single.noise**2, single.lasting, single.constant)

    def join(self, other: _Average) -> None:
        gain = self.variance / (self.variance + other.variance)
        self.inverse += gain * (other.inverse - self.inverse)
        self.lasting += gain * (other.lasting - self.lasting)
        self.constant += gain * (other.constant - self.constant)
        self.variance *= 1.0 - gain
        self.count += other.count

    def spread(self, other: _Average) -> float:
        """Return one sigma of the difference; what errs alike in both does not count."""
        return math.sqrt(self.variance + other.variance + self.lasting**2 + other.lasting**2)

    def distance(self, other: _Average) -> float:
        """Return by how many sigmas the two differ."""
        return abs(self.inverse - other.inverse) / self.spread(other)

    def estimate(self, constant: bool = True) -> Estimate:
        """Return mu and one sigma, with or without that of stiffness and load."""
        return friction_estimate(
            self.inverse, math.sqrt(self.variance + self.lasting**2),
            self.constant if constant else 0.0)


class FrictionFusion:
    """Recursive estimate of a wheel's friction coefficient; ``changes`` counts new grounds."""

    def __init__(self) -> None:
        self._average: _Average | None = None
        self._rival: _Average | None = None
        self._silent = 0  # revolutions since the last that told something
        self.changes = 0

    def update(self, single: Single | None) -> Estimate:
        """Take in one revolution, None if it tells nothing; return mu and one sigma."""
        if single is None or single.noise > TELLING:
            self._silent += 1
            return self.estimate()
        self._silent = 0
        new = _Average.of(single)
        if self._average is None:
            self._average = new
        elif (distance := self._average.distance(new)) < CHANGE:
            self._average.join(new)
            self._rival = None
        else:
            self._contradict(new, distance)
        return self.estimate()

    def _contradict(self, new: _Average, distance: float) -> None:
        if self._rival is not None and self._rival.distance(new) < CHANGE:
            self._rival.join(new)
        else:
            self._rival = new
        if self._rival.count >= CONFIRMATIONS or distance > SURE_CHANGE:
            self._average, self._rival = self._rival, None
            self.changes += 1

    def estimate(self, constant: bool = True) -> Estimate:
        """
        Return mu and one sigma; UNKNOWN before anything was told.

        Without ``constant`` the sigma is that of what uses the same stiffness and load again.
        """
        average = self._average
        if average is None:
            return UNKNOWN
        mu, sigma = average.estimate(constant)
        unseen = SPREAD * math.sqrt(1.0 - (1.0 - CHANGE_RATE)**self._silent)
        sigma = math.hypot(sigma, unseen, self._doubt(average, mu))
        return (mu, sigma) if sigma < mu else UNKNOWN

    def _doubt(self, average: _Average, mu: float) -> float:
        """Return one sigma for the chance that the ground is the rival's already."""
        if self._rival is None:
            return 0.0
        # densities of what the rival saw, on the old ground and on any other
        spread = average.spread(self._rival)
        old = math.exp(-0.5 * average.distance(self._rival)**2) / spread
        new = 1.0 / math.hypot(spread, SPREAD * average.inverse**2)
        chance = CHANGE_RATE * new / (CHANGE_RATE * new + (1.0 - CHANGE_RATE) * old)
        other = self._rival.estimate()[0]
        return math.sqrt(chance) * (abs(mu - other) if math.isfinite(other) else SPREAD)
