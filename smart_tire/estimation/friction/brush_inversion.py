"""
Inversion of the brush model: from slip and normalized slip of a crossing to friction, B(22).

The films measure two quantities: their stretch, which is proportional to longitudinal slip through
the calibrated gains, and the normalized slip t = total slip / critical slip. Then
``mu = C_x |s| / (3 F_z t)``. Errors are kept in two parts: white errors, independent between
revolutions, and systematic errors (slip, gains, stiffness, load), which averaging must not reduce.
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
PRIOR_MEDIAN, PRIOR_FACTOR = 0.45, 2.0  # of mu and one standard deviation, log-normal; assumed
NEGLIGIBLE_PRIOR_SIGMA = 0.12  # relative sigma of mu below which the prior does not matter
MIN_NORMALIZED_SLIP = 0.005
MU_GRID = np.geomspace(0.02, 4.0, 1000)
MU_PRIOR = np.exp(-0.5 * (np.log(MU_GRID / PRIOR_MEDIAN) / math.log(PRIOR_FACTOR))**2)  # per ln mu


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
        """Standard deviation of ``slip``."""
        return math.sqrt(self.white_cov[0, 0] + self.systematic_cov[0, 0])

    @property
    def normalized_slip_sigma(self) -> float:
        """Standard deviation of ``normalized_slip``."""
        return math.sqrt(self.white_cov[1, 1] + self.systematic_cov[1, 1])

    def inflated(self, factor: float) -> SlipFit:
        """Return the same values with covariances multiplied by ``factor``."""
        return replace(self, white_cov=factor * self.white_cov,
                       systematic_cov=factor * self.systematic_cov)


@dataclass(frozen=True, slots=True)
class FrictionSample:
    """
    Friction from one crossing, as 1 / mu: that is what is measured with Gaussian noise.

    White errors are independent between revolutions. Systematic errors, from slip and gains, vary
    slowly; the scale error, from stiffness and load, is constant.
    """

    inverse_mu: float        # 1 / mu; noise may make it negative
    white_sigma: float       # of 1 / mu
    systematic_sigma: float  # of 1 / mu
    scale_sigma: float       # relative

    def estimate(self, likely: float = math.nan) -> Uncertain:
        """Return mu; ``likely`` is mu before this crossing, NaN if unknown."""
        return friction_estimate(self.inverse_mu, math.hypot(
            self.white_sigma, self.systematic_sigma), self.scale_sigma, likely)


def friction_estimate(inverse_mu: float, sigma: float, scale_sigma: float,
                      likely: float = math.nan) -> Uncertain:
    """
    Return mu from 1 / mu with its ``sigma``, and an additional relative ``scale_sigma``.

    Posterior median and deviation with ``MU_PRIOR``, since the reciprocal of a noisy 1 / mu would
    be arbitrarily large. UNKNOWN where the measurement adds little to the prior, on a typical
    surface and on one with friction ``likely``. That decision must not depend on the measured
    value: keeping only the low outcomes of noisy measurements would bias mu low.
    """
    if sigma < NEGLIGIBLE_PRIOR_SIGMA * inverse_mu:
        return Uncertain(1.0 / inverse_mu,
                         math.hypot(sigma / inverse_mu, scale_sigma) / inverse_mu)
    lowest = min(PRIOR_MEDIAN, likely if math.isfinite(likely) else PRIOR_MEDIAN)
    if not sigma * lowest < MAX_INVERSE_SIGMA:
        return UNKNOWN
    weight = MU_PRIOR * np.exp(-0.5 * ((1.0 / MU_GRID - inverse_mu) / sigma)**2)
    cumulative = np.cumsum(weight)
    if not cumulative[-1] > 0.0:
        return UNKNOWN
    mu = float(MU_GRID[np.searchsorted(cumulative, 0.5 * cumulative[-1])])
    spread = math.sqrt(float(weight @ (MU_GRID - mu)**2) / float(cumulative[-1]))
    return Uncertain(mu, math.hypot(spread, mu * scale_sigma))


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


def single_friction(fit: SlipFit, lateral_slip: Uncertain, load: Uncertain,
                    stiffness: Uncertain) -> FrictionSample | None:
    """Return mu of one crossing, None where slip, lateral slip or load are unknown."""
    total = math.hypot(fit.slip, lateral_slip.value)
    if not (total > 0.0 and load.value > 0.0):
        return None
    scale = 3.0 * load.value / (stiffness.value * total)
    inverse_mu = scale * fit.normalized_slip
    slope = scale * np.array([-fit.normalized_slip * fit.slip / total**2, 1.0])
    white, systematic = (math.sqrt(max(float(slope @ part @ slope), 0.0))
                         for part in (fit.white_cov, fit.systematic_cov))
    lateral = inverse_mu * lateral_slip.value * lateral_slip.sigma / total**2
    return FrictionSample(inverse_mu, white, math.hypot(systematic, lateral), math.hypot(
        load.sigma / load.value, stiffness.sigma / stiffness.value))


def traction_force(fit: SlipFit, lateral_slip: Uncertain, direction: int, load: Uncertain,
                   stiffness: Uncertain) -> Uncertain:
    """
    Return the longitudinal force [N] on the robot, positive forward, from the brush model.

    It does not need a friction coefficient: normalized slip takes its role.
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
    return Uncertain(nominal, math.hypot(
        force(slip + fit.slip_sigma, t, slope) - nominal,
        force(slip, t + fit.normalized_slip_sigma, slope) - nominal,
        force(slip, t, slope + stiffness.sigma) - nominal))
