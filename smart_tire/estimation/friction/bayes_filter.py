"""
One friction coefficient from many revolutions, that notices when the ground changes.

A Bayesian filter over the grounds that there are: between two revolutions the ground stays, or,
rarely, is any other. So nothing is forgotten on one surface and everything at a change, a single
passage that misleads moves little, and revolutions that tell nothing widen the sigma, for the
ground may have changed unseen. What a passage measures with Gaussian noise is 1 / mu; where slip
is too small to see mu, that still bounds it from below.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.friction.brush_inversion import FrictionSample, GROUNDS, PRIOR
from smart_tire.estimation.friction.motion_history import UNKNOWN, ValueSigma

CHANGE_PROBABILITY = 0.02   # chance per revolution that the ground changes; assumed
OUTLIER_PROBABILITY = 0.01  # that a crossing is an outlier (e.g. spans two surfaces); assumed
CHANGING = 0.3       # share of what lasts that is new in each revolution after all
SHARPEST = 0.004     # relative noise below which the grid of grounds is too coarse
FORGETS = 0.05       # least share of a new revolution in what is said to last
CHANGED = 3.0        # sigmas between what was known and what is, that make a new ground ...
IN_DOUBT = 2.0       # ... and growth of the sigma while it is not yet clear


class FrictionFilter:
    """Recursive estimate of a wheel's friction coefficient; ``changes`` counts new grounds."""

    def __init__(self) -> None:
        self._know(PRIOR / PRIOR.sum())
        self._ground: ValueSigma = UNKNOWN  # mu and spread of the ground that was last clear
        self._told = 0.0      # information, 1 / variance of 1 / mu, on the present ground
        self._lasting = 0.0   # relative sigma of mu that the revolutions share ...
        self._constant = 0.0  # ... and from stiffness and load
        self.changes = 0

    def update(self, single: FrictionSample | None) -> ValueSigma:
        """Take in one revolution, None if it tells nothing; return mu and one sigma."""
        chance = self._chance + CHANGE_PROBABILITY * (PRIOR / PRIOR.sum() - self._chance)
        if single is None:
            self._know(chance)
            return self.estimate()
        noise = math.hypot(single.noise, CHANGING * single.lasting,
                           SHARPEST * abs(single.inverse))
        likely = np.exp(-0.5 * ((1.0 / GROUNDS - single.inverse) / noise)**2)
        # one that misleads could have told of any ground
        likely += OUTLIER_PROBABILITY * (float(PRIOR @ likely) / float(PRIOR.sum()) - likely)
        chance *= likely
        total = float(chance.sum())
        if total > 0.0:
            self._know(chance / total)
            self._count_change()
            self._remember(single, noise)
        return self.estimate()

    def _count_change(self) -> None:
        mu, spread = self._new
        before, certain = self._ground
        if abs(mu - before) > CHANGED * math.hypot(spread, certain):
            self.changes += 1
            self._told = 0.0
        elif spread > IN_DOUBT * certain:
            return
        self._ground = mu, spread

    def _remember(self, single: FrictionSample, noise: float) -> None:
        information = noise**-2
        self._told += information
        share = max(information / self._told, FORGETS)
        mu = 1.0 / max(single.inverse, single.noise)
        self._lasting += share * (single.lasting * mu - self._lasting)
        self._constant += share * (single.constant - self._constant)

    def _know(self, chance: Array) -> None:
        """Take over the chance of each ground, with the median of mu and the deviation from it."""
        self._chance, share = chance, np.cumsum(chance) - 0.5 * chance
        mu = float(np.interp(0.5, share, GROUNDS))
        self._new = mu, math.sqrt(float(chance @ (GROUNDS - mu)**2))  # of what does not last

    def estimate(self, constant: bool = True) -> ValueSigma:
        """
        Return mu and one sigma; UNKNOWN while little more is known than what grounds there are.

        Without ``constant`` the sigma is that of what uses the same stiffness and load again.
        """
        mu, spread = self._new
        sigma = math.hypot(spread, mu * self._lasting, mu * self._constant * constant)
        return (mu, sigma) if self._told > 0.0 and sigma < mu else UNKNOWN
