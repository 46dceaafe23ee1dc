"""
From what the films of a passage tell to friction: the physics of B(22) and its sigma.

Films tell two things: their stretch, which with the calibrated gains is the longitudinal slip, and
the sliding share w = total slip / critical slip. Then ``mu = C_x |s| / (3 F_z w)``. What limits it
splits in two: noise, new in every revolution, and what stays from one to the next (slip, gains,
stiffness, load), which averaging must not remove.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.friction.motion_history import UNKNOWN, ValueSigma
from smart_tire.models.tire import brush_tire


SLIDES = 0.8              # of the critical slip: above, the waveform no longer shows how far
SLIDES_SIGMAS = 4.0       # within which of it noise may hide that ...
TIED = 0.5                # ... if slip and sliding are so correlated that both may be larger
DISAGREEMENT = 4.0        # square of a normalised difference that is believed
KNOWN = 0.35              # sigma of 1 / mu, over 1 / mu of a likely ground, above which it is not
TYPICAL, FACTOR = 0.45, 2.0  # mu of the grounds that there are, and one sigma; assumed
SHARP = 0.12              # relative sigma of mu below which other grounds do not matter
SMALLEST_SLIDING = 0.005  # of the critical slip
GROUNDS = np.geomspace(0.02, 4.0, 1000)  # mu, -
PRIOR = np.exp(-0.5 * (np.log(GROUNDS / TYPICAL) / math.log(FACTOR))**2)  # per ln(mu)


@dataclass(frozen=True, slots=True)
class SlipFit:
    """
    Slip and sliding share of one passage with covariances (2, 2) of what errs in them.

    Noise may make a small sliding share negative.
    """

    slip: float     # -, B(3)'s lambda
    sliding: float  # -, total slip / critical slip
    noise: Array    # new in every revolution
    lasting: Array  # gains and the error of the slip estimator

    @property
    def slip_sigma(self) -> float:
        """One sigma of ``slip``."""
        return math.sqrt(self.noise[0, 0] + self.lasting[0, 0])

    @property
    def sliding_sigma(self) -> float:
        """One sigma of ``sliding``."""
        return math.sqrt(self.noise[1, 1] + self.lasting[1, 1])

    def inflated(self, scale: float) -> SlipFit:
        """Return the same values with covariances ``scale`` times as large."""
        return replace(self, noise=scale * self.noise, lasting=scale * self.lasting)


@dataclass(frozen=True, slots=True)
class FrictionSample:
    """
    Friction from one passage: what is measured with Gaussian noise is 1 / mu.

    ``noise`` is new in every revolution, ``lasting`` is from slip and gains and lasts but may
    change; ``constant``, relative to mu, is from stiffness and load.
    """

    inverse: float   # 1 / mu; noise may make it negative
    noise: float     # sigma of it
    lasting: float   # sigma of it
    constant: float  # relative

    def estimate(self, likely: float = math.nan) -> ValueSigma:
        """Return mu and one sigma; ``likely`` is mu as it was before this passage, if known."""
        return friction_estimate(
            self.inverse, math.hypot(self.noise, self.lasting), self.constant, likely)


def friction_estimate(inverse: float, sigma: float, relative: float,
                      likely: float = math.nan) -> ValueSigma:
    """
    Return mu and one sigma from 1 / mu and its sigma, and a ``relative`` sigma of mu on top.

    Median and deviation over the grounds that there are: a noisy 1 / mu alone would make large
    or tiny mu out of nothing. UNKNOWN where the passage would say little beyond them on a typical
    ground and on the ``likely`` one: whatever it says, for of noisy ones to tell those only that
    came out low would tell too low a friction.
    """
    if sigma < SHARP * inverse:
        return 1.0 / inverse, math.hypot(sigma / inverse, relative) / inverse
    if not sigma * min(TYPICAL, likely if math.isfinite(likely) else TYPICAL) < KNOWN:
        return UNKNOWN
    weight = PRIOR * np.exp(-0.5 * ((1.0 / GROUNDS - inverse) / sigma)**2)
    share = np.cumsum(weight)
    if not share[-1] > 0.0:
        return UNKNOWN
    mu = float(GROUNDS[np.searchsorted(share, 0.5 * share[-1])])
    spread = math.sqrt(float(weight @ (GROUNDS - mu)**2) / float(share[-1]))
    return mu, math.hypot(spread, mu * relative)


def flag_full_sliding(evidence: SlipFit, shown: Array | None = None) -> SlipFit:
    """
    Return ``evidence`` that knows: if the whole patch may slide, slip / sliding shows only.

    Whether the two are tied, the covariance (2, 2) that was ``shown`` tells where what was added
    to the noise since, by size only, hides it.
    """
    noise = evidence.noise
    shown = noise if shown is None else shown
    tied = shown[0, 1] * math.copysign(1.0, evidence.slip)
    if (evidence.sliding + SLIDES_SIGMAS * math.sqrt(noise[1, 1]) < SLIDES
            or tied < TIED * math.sqrt(shown[0, 0] * shown[1, 1])):
        return evidence
    both = np.array([evidence.slip, evidence.sliding])
    return replace(evidence, noise=noise + np.outer(both, both))


def consistency_inflation(evidence: SlipFit, slip: ValueSigma) -> float:
    """
    Return by how much variances must grow for the films' slip and another one to agree.

    1 where they do, within what a Gaussian error may be.
    """
    if not math.isfinite(slip[0]):
        return 1.0
    spread = evidence.slip_sigma**2 + slip[1]**2
    return max(1.0, (slip[0] - evidence.slip)**2 / spread / DISAGREEMENT)


def total_slip(slip: ValueSigma, lateral_slip: ValueSigma) -> ValueSigma:
    """Return the magnitude of the combined slip."""
    total = math.hypot(slip[0], lateral_slip[0])
    if not total > 0.0:
        return UNKNOWN
    return total, math.hypot(slip[0] * slip[1], lateral_slip[0] * lateral_slip[1]) / total


def single_friction(evidence: SlipFit, lateral_slip: ValueSigma, load: ValueSigma,
                    stiffness: ValueSigma) -> FrictionSample | None:
    """Return mu of one passage, None where slip, lateral slip or load are not known."""
    total = math.hypot(evidence.slip, lateral_slip[0])
    if not (total > 0.0 and load[0] > 0.0):
        return None
    scale = 3.0 * load[0] / (stiffness[0] * total)
    inverse = scale * evidence.sliding
    slope = scale * np.array([-evidence.sliding * evidence.slip / total**2, 1.0])
    noise, lasting = (math.sqrt(max(float(slope @ part @ slope), 0.0))
                      for part in (evidence.noise, evidence.lasting))
    lateral = inverse * lateral_slip[0] * lateral_slip[1] / total**2
    return FrictionSample(inverse, noise, math.hypot(lasting, lateral),
                  math.hypot(load[1] / load[0], stiffness[1] / stiffness[0]))


def traction_force(evidence: SlipFit, lateral_slip: ValueSigma, direction: int, load: ValueSigma,
                   stiffness: ValueSigma) -> ValueSigma:
    """
    Return the longitudinal force [N] on the robot, positive forward, from the brush model.

    It needs no friction coefficient: the sliding share stands for it.
    """
    if not math.isfinite(lateral_slip[0]) or not load[0] > 0.0:
        return UNKNOWN

    def force(slip: float, sliding: float, slope: float) -> float:
        total = math.hypot(slip, lateral_slip[0])
        mu = slope * total / (3.0 * load[0] * max(sliding, SMALLEST_SLIDING))
        return float(brush_tire.brush_force(
            direction * slip, lateral_slip[0], mu, load[0], slope)[0])

    slip, sliding, slope = evidence.slip, evidence.sliding, stiffness[0]
    slip_sigma, sliding_sigma = evidence.slip_sigma, evidence.sliding_sigma
    here = force(slip, sliding, slope)
    return here, math.hypot(force(slip + slip_sigma, sliding, slope) - here,
                            force(slip, sliding + sliding_sigma, slope) - here,
                            force(slip, sliding, slope + stiffness[1]) - here)
