# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Inversion of the brush model: from slip and normalized slip of a crossing to friction, B(22).

The films measure two quantities: their stretch, which is proportional to longitudinal slip through
the calibrated gains, and the normalized slip t = total slip / critical slip. Both together show
``mu / C_x = |s| / (3 F_z t)`` only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.uncertain import Uncertain, UNKNOWN

FULL_SLIDING_ONSET = 0.8      # normalized slip above which the waveform hardly depends on it
FULL_SLIDING_SIGMAS = 4.0     # standard deviations within which the onset counts as reached ...
MIN_RATIO_CORRELATION = 0.5   # ... if slip and normalized slip are at least so correlated
MAX_INVERSE_SIGMA = 0.35      # sigma of 1 / mu over 1 / mu of a likely surface, to be informative
PRIOR_MEDIAN = 0.45  # of mu, log-normal; assumed
PRIOR_LOG_SIGMA = math.log(2.0)  # standard deviation of ln mu; assumed
NEGLIGIBLE_PRIOR_SIGMA = 0.12  # relative sigma of mu below which the prior does not matter
MU_GRID = np.geomspace(0.02, 4.0, 1000)
MU_PRIOR = np.exp(-0.5 * (np.log(MU_GRID / PRIOR_MEDIAN) / PRIOR_LOG_SIGMA)**2)  # per ln mu


@dataclass(frozen=True, slots=True)
class SlipFit:
    """
    Slip and normalized slip of one crossing with the covariances (2, 2) of their errors.

    Noise may make a small normalized slip negative.
    """

    slip: float             # -, B(3)'s lambda
    normalized_slip: float  # -, total slip / critical slip
    white_cov: Array        # independent between revolutions
    systematic_cov: Array   # of gains and of the slip estimator

    @property
    def slip_sigma(self) -> float:
        """Return the standard deviation of ``slip``."""
        return math.sqrt(self.white_cov[0, 0] + self.systematic_cov[0, 0])

    @property
    def normalized_slip_sigma(self) -> float:
        """Return the standard deviation of ``normalized_slip``."""
        return math.sqrt(self.white_cov[1, 1] + self.systematic_cov[1, 1])


def friction_estimate(inverse_mu: float, sigma: float, likely: float = math.nan) -> Uncertain:
    """
    Return mu from 1 / mu with its ``sigma``.

    Posterior median and deviation with ``MU_PRIOR``, since the reciprocal of a noisy 1 / mu would
    be arbitrarily large. UNKNOWN where the measurement adds little to the prior, on a typical
    surface and on one with friction ``likely``. That decision must not depend on the measured
    value: keeping only the low outcomes of noisy measurements would bias mu low.
    """
    if sigma < NEGLIGIBLE_PRIOR_SIGMA * inverse_mu:
        return Uncertain(1.0 / inverse_mu, sigma / inverse_mu**2)
    lowest = min(PRIOR_MEDIAN, likely if math.isfinite(likely) else PRIOR_MEDIAN)
    if not sigma * lowest < MAX_INVERSE_SIGMA:
        return UNKNOWN
    weight = MU_PRIOR * np.exp(-0.5 * ((1.0 / MU_GRID - inverse_mu) / sigma)**2)
    cumulative = np.cumsum(weight)
    if not cumulative[-1] > 0.0:
        return UNKNOWN
    mu = float(MU_GRID[np.searchsorted(cumulative, 0.5 * cumulative[-1])])
    return Uncertain(mu, math.sqrt(float(weight @ (MU_GRID - mu)**2) / float(cumulative[-1])))


def flag_full_sliding(fit: SlipFit, fit_cov: Array | None = None) -> SlipFit:
    """
    Return ``fit``, inflated along slip / normalized slip if the whole patch may slide.

    The waveform then determines that ratio only. Whether both are correlated is judged by
    ``fit_cov`` (2, 2), the white covariance before additions that would hide the correlation.
    """
    white = fit.white_cov
    fit_cov = white if fit_cov is None else fit_cov
    correlation = fit_cov[0, 1] * math.copysign(1.0, fit.slip)
    upper = fit.normalized_slip + FULL_SLIDING_SIGMAS * math.sqrt(white[1, 1])
    if (upper < FULL_SLIDING_ONSET
            or correlation < MIN_RATIO_CORRELATION * math.sqrt(fit_cov[0, 0] * fit_cov[1, 1])):
        return fit
    both = np.array([fit.slip, fit.normalized_slip])
    return replace(fit, white_cov=white + np.outer(both, both))
