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
``kappa = mu / C_x = |s| / (3 F_z t)`` only. It is kept as ``mu_0 = kappa C_0``, mu at the nominal
stiffness C_0 of the tire, and ``mu = mu_0 C_x / C_0`` with C_x of the present ground. Errors of
mu_0 are kept in two parts: white errors, independent between revolutions, and systematic errors
(slip, gains, load), which averaging must not reduce.

C_x comes from a balance of forces that uses the same slip, so their errors are correlated. To
first order, with the relative errors e of C_x and q of mu_0 from slip (of standard deviations c
and q, correlation rho), the relative variance of mu adds ``c^2 + 2 rho c q`` to that of mu_0. If
the force ``F = C_x |s| (1 - t + t^2 / 3)`` is known and the slip is not, then e = -q: both cancel,
and what remains is the error of ``mu = |F| / (F_z (1 - (1 - t)^3))``, which needs neither C_x nor
the amount of slip (1 - t is the adhesion ratio; 3 t (1 - t + t^2 / 3) = 1 - (1 - t)^3). Both
routes are thus one estimate, in which no information is used twice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.models.tire import brush_tire
from smart_tire.uncertain import Uncertain, UNKNOWN

FULL_SLIDING_ONSET = 0.8      # normalized slip above which the waveform hardly depends on it
FULL_SLIDING_SIGMAS = 4.0     # standard deviations within which the onset counts as reached ...
MIN_RATIO_CORRELATION = 0.5   # ... if slip and normalized slip are at least so correlated
MAX_SQUARED_DIFFERENCE = 4.0  # squared normalized difference of two slips that are consistent
MAX_INVERSE_SIGMA = 0.35      # sigma of 1 / mu over 1 / mu of a likely surface, to be informative
PRIOR_MEDIAN = 0.45  # of mu, log-normal; assumed
PRIOR_LOG_SIGMA = math.log(2.0)  # standard deviation of ln mu; assumed
NEGLIGIBLE_PRIOR_SIGMA = 0.12  # relative sigma of mu below which the prior does not matter
MIN_NORMALIZED_SLIP = 0.005
TINY_SIGMA = 1e-12  # -, avoids a division by zero
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

    def inflated(self, factor: float) -> SlipFit:
        """Return the same values with covariances multiplied by ``factor``."""
        return replace(self, white_cov=factor * self.white_cov,
                       systematic_cov=factor * self.systematic_cov)


@dataclass(frozen=True, slots=True)
class GroundStiffness:
    """C_x of the present ground, with the correlation of its error with that of the slip."""

    ratio: float = 1.0  # C_x / C_0
    sigma: float = 0.0  # relative
    slip_correlation: float = 0.0  # of ln C_x with the wheel's slip

    def variance(self, slip_effect: float) -> float:
        """
        Return the relative variance that C_x adds to that of mu_0.

        ``slip_effect`` is the relative change of mu_0 by one standard deviation of the slip.
        """
        return self.sigma * (self.sigma + 2.0 * self.slip_correlation * slip_effect)

    def prior(self) -> Array:
        """Return the prior of mu_0 on ``MU_GRID``, from that of mu on any ground."""
        log_sigma = math.hypot(PRIOR_LOG_SIGMA, self.sigma)
        weight: Array = np.exp(
            -0.5 * (np.log(MU_GRID * self.ratio / PRIOR_MEDIAN) / log_sigma)**2)
        return weight / weight.sum()


NOMINAL_GROUND = GroundStiffness()


@dataclass(frozen=True, slots=True)
class FrictionSample:
    """
    Friction from one crossing, as 1 / mu_0: that is what is measured with Gaussian noise.

    White errors are independent between revolutions. Systematic errors, from slip and gains, vary
    slowly; the scale error, from the load, is constant.
    """

    inverse_mu: float        # 1 / mu_0; noise may make it negative
    white_sigma: float       # of 1 / mu_0
    systematic_sigma: float  # of 1 / mu_0
    scale_sigma: float       # relative
    slip_effect: float = 0.0  # change of 1 / mu_0 by one standard deviation of the estimated slip

    def estimate(self, stiffness: GroundStiffness = NOMINAL_GROUND,
                 likely: float = math.nan) -> Uncertain:
        """Return mu; ``likely`` is mu before this crossing, NaN if unknown."""
        sigma = math.hypot(self.white_sigma, self.systematic_sigma)
        mu, spread = friction_estimate(
            self.inverse_mu / stiffness.ratio, sigma / stiffness.ratio, likely)
        if not math.isfinite(mu):
            return UNKNOWN
        relative = spread / mu
        # mu falls as 1 / mu rises
        effect = -self.slip_effect / sigma * relative if sigma > 0.0 else 0.0
        variance = relative**2 + self.scale_sigma**2 + stiffness.variance(effect)
        return Uncertain(mu, mu * math.sqrt(max(variance, 0.0)))


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


def consistency_inflation(fit: SlipFit, slip: Uncertain) -> float:
    """
    Return the factor on variances that makes the films' slip consistent with another ``slip``.

    1 if their difference is within its standard deviation times two, or ``slip`` is unknown.
    """
    if not math.isfinite(slip.value):
        return 1.0
    variance = fit.slip_sigma**2 + slip.sigma**2
    return max(1.0, (slip.value - fit.slip)**2 / variance / MAX_SQUARED_DIFFERENCE)


def total_slip(slip: Uncertain, lateral_slip: Uncertain) -> Uncertain:
    """Return the magnitude of the combined slip."""
    total = math.hypot(slip.value, lateral_slip.value)
    if not total > 0.0:
        return UNKNOWN
    return Uncertain(total, math.hypot(
        slip.value * slip.sigma, lateral_slip.value * lateral_slip.sigma) / total)


def single_friction(fit: SlipFit, lateral_slip: Uncertain, load: Uncertain, nominal: float,
                    slip_sigma: float = math.inf) -> FrictionSample | None:
    """
    Return mu_0 of one crossing, None where slip, lateral slip or load are unknown.

    ``nominal`` [N] is the nominal stiffness C_0, ``slip_sigma`` that of the slip estimator.
    """
    total = math.hypot(fit.slip, lateral_slip.value)
    if not (total > 0.0 and load.value > 0.0):
        return None
    scale = 3.0 * load.value / (nominal * total)
    inverse_mu = scale * fit.normalized_slip
    relative = np.array([fit.slip, lateral_slip.value]) / total**2  # change of ln |s|
    slope = scale * np.array([-fit.normalized_slip * relative[0], 1.0])
    white = math.sqrt(max(float(slope @ fit.white_cov @ slope), 0.0))
    # the effect of a slip error is proportional to the true normalized slip, not to a noisy one
    likely = max(fit.normalized_slip, math.sqrt(fit.white_cov[1, 1]))
    slope = scale * np.array([-likely * relative[0], 1.0])
    systematic = math.sqrt(max(float(slope @ fit.systematic_cov @ slope), 0.0))
    lateral = scale * likely * relative[1] * lateral_slip.sigma
    return FrictionSample(
        inverse_mu, white, math.hypot(systematic, lateral), load.sigma / load.value,
        float(slope @ _slip_effect(fit, slip_sigma)))


def _slip_effect(fit: SlipFit, slip_sigma: float) -> Array:
    """
    Return the change (2,) of the fit's slips by one ``slip_sigma`` of its prior on slip.

    In a least-squares fit it is the covariance with slip over ``slip_sigma``.
    """
    if not 0.0 < slip_sigma < math.inf:
        return np.zeros(2)
    effect = (fit.white_cov[:, 0] + fit.systematic_cov[:, 0]) / slip_sigma
    limited: Array = effect * min(1.0, slip_sigma / effect[0]) if effect[0] > 0.0 else effect
    return limited


def traction_force(fit: SlipFit, lateral_slip: Uncertain, direction: int, load: Uncertain,
                   stiffness: Uncertain, slip_correlation: float = 0.0) -> Uncertain:
    """
    Return the longitudinal force [N] on the robot, positive forward, from the brush model.

    It does not need a friction coefficient: normalized slip takes its role. ``slip_correlation``
    is that of the errors of ``stiffness`` and slip.
    """
    if not math.isfinite(lateral_slip.value) or not load.value > 0.0:
        return UNKNOWN

    def force(slip: float, normalized_slip: float, slope: float) -> float:
        total = math.hypot(slip, lateral_slip.value)
        mu = slope * total / (3.0 * load.value * max(normalized_slip, MIN_NORMALIZED_SLIP))
        return float(brush_tire.brush_force(
            direction * slip, lateral_slip.value, mu, load.value, slope)[0])

    slip, t, slope = fit.slip, fit.normalized_slip, stiffness.value
    nominal = force(slip, t, slope)
    shared = slip_correlation * math.sqrt(float(fit.systematic_cov[0, 0])) / max(
        fit.slip_sigma, TINY_SIGMA)
    by_slip, by_t, by_stiffness = (
        changed - nominal for changed in (
            force(slip + fit.slip_sigma, t, slope),
            force(slip, t + fit.normalized_slip_sigma, slope),
            force(slip, t, slope + stiffness.sigma)))
    return Uncertain(nominal, math.sqrt(max(
        by_slip**2 + by_t**2 + by_stiffness**2
        + 2.0 * shared * by_slip * by_stiffness, 0.0)))
