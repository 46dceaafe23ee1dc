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
    """Weighted mean of 1 / mu; ``slip`` and ``constant`` are mean relative lasting sigmas."""

    inverse: float
    variance: float
    slip: float
    constant: float
    count: int = 1

    @staticmethod
    def of(single: Single) -> _Average:
        return _Average(single.inverse, single.noise**2, single.slip, single.constant)

    def join(self, other: _Average) -> None:
        gain = self.variance / (self.variance + other.variance)
        self.inverse += gain * (other.inverse - self.inverse)
        self.slip += gain * (other.slip - self.slip)
        self.constant += gain * (other.constant - self.constant)
        self.variance *= 1.0 - gain
        self.count += other.count

    def distance(self, other: _Average) -> float:
        """Return by how many sigmas the two differ; what errs alike in both does not count."""
        slips = math.hypot(self.slip * self.inverse, other.slip * other.inverse)
        return abs(self.inverse - other.inverse) / math.sqrt(
            self.variance + other.variance + slips**2)


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

    def estimate(self) -> Estimate:
        """Return mu and one sigma; UNKNOWN before anything was told."""
        average = self._average
        if average is None:
            return UNKNOWN
        mu, sigma = friction_estimate(
            average.inverse,
            math.hypot(math.sqrt(average.variance), average.slip * average.inverse),
            average.constant)
        unseen = SPREAD * math.sqrt(1.0 - (1.0 - CHANGE_RATE)**self._silent)
        rival = mu - 1.0 / self._rival.inverse if self._rival is not None else 0.0
        sigma = math.hypot(sigma, unseen, rival)
        return (mu, sigma) if sigma < mu else UNKNOWN
