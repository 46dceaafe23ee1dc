"""
Bayes filter over the friction coefficient with a change-point model.

Grid filter over mu: between two revolutions the surface stays the same or, with a small
probability, changes to any other. So all information is kept on one surface and discarded at a
change, a single outlier has little influence, and revolutions without information increase the
standard deviation because the surface may have changed. A crossing measures 1 / mu with Gaussian
noise; slip too small for an estimate of mu still bounds it from below.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.friction.brush_inversion import FrictionSample, MU_GRID, MU_PRIOR
from smart_tire.uncertain import Uncertain, UNKNOWN

CHANGE_PROBABILITY = 0.02   # per revolution, that the surface changes; assumed
OUTLIER_PROBABILITY = 0.01  # that a crossing is an outlier (e.g. spans two surfaces); assumed
SYSTEMATIC_WHITE_SHARE = 0.3  # of the systematic error that varies between revolutions; assumed
MIN_RELATIVE_NOISE = 0.004  # of 1 / mu; below, the grid is too coarse
MIN_ERROR_MODEL_GAIN = 0.05  # smallest share of a new revolution in the systematic error
CHANGE_SIGMAS = 3.0         # between old and new estimate, that count as a surface change ...
MAX_SIGMA_GROWTH = 2.0      # ... and growth of the standard deviation while that is undecided


class FrictionFilter:
    """Recursive estimate of a wheel's friction coefficient; ``changes`` counts surface changes."""

    def __init__(self) -> None:
        self._set_posterior(MU_PRIOR / MU_PRIOR.sum())
        self._surface: Uncertain = UNKNOWN  # last estimate that was decided, for change counting
        self._information = 0.0   # 1 / variance of 1 / mu, on the present surface
        self._systematic = 0.0    # relative sigma of mu, shared by revolutions ...
        self._scale = 0.0         # ... and from stiffness and load
        self.changes = 0

    def update(self, sample: FrictionSample | None) -> Uncertain:
        """Update with one revolution, None without information; return mu."""
        posterior = self._posterior + CHANGE_PROBABILITY * (
            MU_PRIOR / MU_PRIOR.sum() - self._posterior)
        if sample is None:
            self._set_posterior(posterior)
            return self.estimate()
        noise = math.hypot(sample.white_sigma, SYSTEMATIC_WHITE_SHARE * sample.systematic_sigma,
                           MIN_RELATIVE_NOISE * abs(sample.inverse_mu))
        likelihood = np.exp(-0.5 * ((1.0 / MU_GRID - sample.inverse_mu) / noise)**2)
        # an outlier is equally likely on every surface
        likelihood += OUTLIER_PROBABILITY * (
            float(MU_PRIOR @ likelihood) / float(MU_PRIOR.sum()) - likelihood)
        posterior *= likelihood
        total = float(posterior.sum())
        if total > 0.0:
            self._set_posterior(posterior / total)
            self._count_change()
            self._update_error_model(sample, noise)
        return self.estimate()

    def estimate(self, *, scale_error: bool = True) -> Uncertain:
        """
        Return mu; UNKNOWN while its standard deviation exceeds its value.

        Without ``scale_error`` the standard deviation leaves out stiffness and load: for
        quantities in which they cancel.
        """
        mu, spread = self._estimate
        sigma = math.hypot(spread, mu * self._systematic, mu * self._scale * scale_error)
        return Uncertain(mu, sigma) if self._information > 0.0 and sigma < mu else UNKNOWN

    def _set_posterior(self, posterior: Array) -> None:
        """Set the probability of each mu, with their median and the rms deviation from it."""
        self._posterior = posterior
        cumulative = np.cumsum(posterior) - 0.5 * posterior
        mu = float(np.interp(0.5, cumulative, MU_GRID))
        # without systematic and scale errors
        self._estimate = mu, math.sqrt(float(posterior @ (MU_GRID - mu)**2))

    def _count_change(self) -> None:
        mu, spread = self._estimate
        before, before_sigma = self._surface
        if abs(mu - before) > CHANGE_SIGMAS * math.hypot(spread, before_sigma):
            self.changes += 1
            self._information = 0.0
        elif spread > MAX_SIGMA_GROWTH * before_sigma:
            return
        self._surface = Uncertain(mu, spread)

    def _update_error_model(self, sample: FrictionSample, noise: float) -> None:
        """Average the systematic errors over the revolutions on the present surface."""
        information = noise**-2
        self._information += information
        gain = max(information / self._information, MIN_ERROR_MODEL_GAIN)
        mu = 1.0 / max(sample.inverse_mu, sample.white_sigma)
        self._systematic += gain * (sample.systematic_sigma * mu - self._systematic)
        self._scale += gain * (sample.scale_sigma - self._scale)
