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
Fit of the whole waveform of a patch crossing: all films of a wheel together.

Least squares with priors by the Levenberg-Marquardt method. Slip and normalized slip are shared
by all films, other parameters belong to each film.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.estimation.contact.records import CrossingSamples
from smart_tire.estimation.friction.levenberg_marquardt import (
    FitResult, HUBER_THRESHOLD, inverse_spd, LevenbergMarquardt, Prior, upper_median)
from smart_tire.estimation.friction.waveform_model import (
    BUMPS, film_index, PerFilm, SHAPE, Shared, WaveformModel)
from smart_tire.estimation.friction.waveform_shape import ShapeEstimator
from smart_tire.numerics.robust import MAD_TO_SIGMA
from smart_tire.parameters.robot import RobotParams
from smart_tire.uncertain import Uncertain

MIN_SAMPLES = 8          # of a film; priors make up for what they do not determine
CENTER_SIGMA = 0.005     # m, of a film's detected center
BASELINE_SIGMA = 0.01    # V, of the tracked baseline
BENDING_SIGMA = 0.5      # relative, of the bending peak: varies by cycle, poorly calibrated
BUMP_SHARE, BUMP_SHARE_SIGMA = 0.12, 0.12  # of the bending peak; 0.10 to 0.15 in Fig. 11(b)
LOG_RECOVERY_SIGMA = 0.5  # of ln of the recovery length of some millimeters
LOG_ALPHA_SIGMA = 0.03   # of ln of the bending shape parameter: assumed
SLIP_SIGMA = 1.0         # -, of the weak prior on slip
PRIOR_NORMALIZED_SLIP, NORMALIZED_SLIP_SIGMA = 0.3, 3.0  # of the weak prior
TYPICAL_SLIP = 0.08      # -, slip at which the start value is at most the prior's normalized slip
MIN_START_NORMALIZED_SLIP = 0.1
RESTART_EXCESS = 1.5     # mean square of normalized residuals that triggers a second start
ROUGH_REDUCTION = 3.0    # chi-squared; smallest reduction in the fit with fixed bumps
MIN_SLIP = 0.02          # -, below which a relative change of slip is undefined
MIN_GAIN_SIGMA = 1e-6    # relative, of gains that are given as exact


@dataclass(frozen=True, slots=True)
class CrossingSlipPrior:
    """Prior on slip and its change within a crossing, from other sources than the films."""

    slip: Uncertain = Uncertain(0.0, SLIP_SIGMA)  # -, at the reference
    change: Uncertain = Uncertain(0.0, 0.0)       # -, of the slip over a contact length


@dataclass(frozen=True, slots=True, eq=False)
class WaveformFit:
    """
    Parameters fitted to one crossing.

    ``parameters`` and their ``covariance`` have the order of ``WaveformModel``. ``white_cov`` and
    ``systematic_cov`` split the covariance (2, 2) of slip and normalized slip into errors that are
    independent between crossings, and those of gains and of the slip prior.
    """

    samples: CrossingSamples
    parameters: Array
    covariance: Array
    white_cov: Array
    systematic_cov: Array
    residual_rms: float  # V
    excess: float        # mean square of residuals over that of the noise, at least 1

    @property
    def slip(self) -> Uncertain:
        """Return the longitudinal slip ratio."""
        return self._estimate(Shared.SLIP)

    @property
    def normalized_slip(self) -> Uncertain:
        """Return total slip / critical slip; noise may make it negative."""
        return self._estimate(Shared.NORM_SLIP)

    def shared(self, which: Shared) -> Uncertain:
        """Return a parameter that the films share."""
        return self._estimate(which)

    def film_parameter(self, position: int, which: PerFilm) -> Uncertain:
        """Return a parameter of the film at ``position`` in ``samples``."""
        return self._estimate(film_index(position, which))

    def _estimate(self, index: int) -> Uncertain:
        return Uncertain(float(self.parameters[index]),
                         math.sqrt(max(float(self.covariance[index, index]), 0.0)))


class WaveformFitter:
    """
    Fits ``WaveformModel`` to the crossings of one wheel.

    ``gains`` [V/m] and ``bending`` [V] are the nominal ones of all films of the wheel.
    ``gain_sigma`` (by default the robot's tolerance) and ``length_sigma`` are relative standard
    deviations of gains and contact length; the contact length is fixed where its sigma is 0.
    ``shape`` has the prior of release and bumps; without it they have their nominal shape.
    """

    def __init__(self, robot: RobotParams, gains: Sequence[float], bending: Sequence[float], *,
                 gain_sigma: float | None = None, length_sigma: float = 0.0,
                 shape: ShapeEstimator | None = None) -> None:
        self._robot, film = robot, robot.film
        self._gains, self._bending = tuple(gains), tuple(bending)
        tolerance = film.stretch_gain_tolerance if gain_sigma is None else gain_sigma
        self._gain_sigma = max(tolerance, MIN_GAIN_SIGMA)
        self._length_sigma = length_sigma
        self._shape = shape
        self._variance = film.sample_variance
        self._samples: CrossingSamples | None = None  # of the last fit
        self._solver: LevenbergMarquardt
        self._last: tuple[WaveformFit, FitResult] | None = None

    def fit(self, samples: CrossingSamples, prior: CrossingSlipPrior = CrossingSlipPrior(),
            start: WaveformFit | None = None) -> WaveformFit | None:
        """
        Return the fit of ``samples``, None where a film has too few of them.

        A fit of the same samples with another prior is a good ``start``.
        """
        if min(len(film.distance) for film in samples.films) < MIN_SAMPLES:
            return None
        if samples is not self._samples:
            self._solver = LevenbergMarquardt(self._model(samples), samples.films, self._variance)
            self._samples, self._last = samples, None
        if start is not None:
            last = self._last
            # the model is already evaluated where the last fit ended
            p = last[1].point.p if last and last[0] is start else start.parameters
            return self._solve(samples, self._prior(samples, prior, float(p[Shared.SLIP])), p)
        p = self._start(samples)
        # the prior of a relative change of slip is that of the detected slip for all starts
        whole = self._prior(samples, prior, float(p[Shared.SLIP]))
        best = self._solve_in_steps(samples, whole, p), self._last
        for slip in (-float(p[Shared.SLIP]), 0.0):
            if best[0].excess <= RESTART_EXCESS:
                break
            p = p.copy()
            p[Shared.SLIP] = slip
            if not slip:  # the release has a wrong share, which the detector takes for slip
                p[Shared.NORM_SLIP] = MIN_START_NORMALIZED_SLIP
            best = min(best, (self._solve_in_steps(samples, whole, p), self._last),
                       key=lambda found: found[0].excess)
        found, self._last = best
        return found

    def _solve_in_steps(self, samples: CrossingSamples, prior: Prior, p: Array) -> WaveformFit:
        """Fit with the bumps as learned before all parameters: far from the minimum it is fast."""
        if self._shape is None:
            return self._solve(samples, prior, p)
        return self._solve(samples, prior, self._solver.run(
            p, prior.without(BUMPS), ROUGH_REDUCTION).point.p)

    def _solve(self, samples: CrossingSamples, prior: Prior, p: Array) -> WaveformFit:
        result = self._solver.run(p, prior)
        found = _waveform_fit(samples, result)
        self._last = found, result
        return found

    def shape(self, fit: WaveformFit) -> tuple[Array, Array]:
        """
        Return the shape of release and bumps by ``fit``, and the information of its data.

        ``fit`` must be the last one of this fitter.
        """
        if self._shape is None or self._last is None or self._last[0] is not fit:
            raise EstimatorError('the shape is available for the last fit only, if it is fitted')
        result = self._last[1]
        prior = result.prior
        own = np.searchsorted(prior.free, np.arange(SHAPE.start, SHAPE.stop))
        # residuals of a wrong model carry less information than noise
        hessian = prior.precision + (result.hessian - prior.precision) / fit.excess
        covariance = inverse_spd(hessian)[own]
        correction = covariance @ (prior.precision @ (prior.value - result.p)[prior.free])
        information = inverse_spd(covariance[:, own]) - self._shape.prior.precision
        return result.p[SHAPE] + (1.0 - 1.0 / fit.excess) * correction, information

    def volts(self, fit: WaveformFit) -> list[Array]:
        """Return the fitted output [V] above baseline at each sample, film by film."""
        samples = fit.samples
        output, _ = self._model(samples).linearized(fit.parameters)
        ends = np.cumsum([len(film.distance) for film in samples.films])[:-1]
        return np.split(output, ends)

    def _model(self, samples: CrossingSamples) -> WaveformModel:
        return WaveformModel(self._robot, self._gains, samples.films, samples.reference,
                             len(samples.errors.shape_sigmas))

    def _start(self, samples: CrossingSamples) -> Array:
        count = film_index(len(samples.films), PerFilm.CENTER)
        p = np.zeros(count + len(samples.errors.shape_sigmas))
        if self._shape is not None:
            p[SHAPE] = self._shape.prior.value
        for i, (film, detection) in enumerate(zip(samples.films, samples.detections)):
            bump = BUMP_SHARE * self._bending[film.film]
            p[film_index(i, PerFilm.CENTER):film_index(i, PerFilm.GAIN)] = (
                detection.center, 0.0, detection.bending, bump, bump)
        slip, normalized_slip = np.mean([(detection.slip, detection.normalized_slip)
                                         for detection in samples.detections], axis=0).tolist()
        # at a small slip the waveform hardly depends on normalized slip, which is likely small
        likely = max(PRIOR_NORMALIZED_SLIP * abs(slip) / TYPICAL_SLIP, MIN_START_NORMALIZED_SLIP)
        p[Shared.SLIP], p[Shared.NORM_SLIP] = slip, min(normalized_slip, likely)
        return p

    def _prior(self, samples: CrossingSamples, prior: CrossingSlipPrior, slip: float) -> Prior:
        """Return the prior on all parameters; ``slip`` is that of the start."""
        count, errors = len(samples.films), samples.errors
        value, sigma = np.zeros((2, film_index(count, PerFilm.CENTER) + len(errors.shape_sigmas)))
        scale = math.copysign(max(abs(slip), MIN_SLIP), slip)  # CHANGE is relative
        value[:Shared.SCALE] = prior.slip.value, PRIOR_NORMALIZED_SLIP, prior.change.value / scale
        sigma[:len(Shared)] = (
            prior.slip.sigma, NORMALIZED_SLIP_SIGMA, prior.change.sigma / abs(scale),
            errors.scale_sigma, LOG_ALPHA_SIGMA, self._length_sigma)
        sigma[film_index(count, PerFilm.CENTER):] = errors.shape_sigmas
        if self._shape is not None:
            value[SHAPE], sigma[SHAPE] = self._shape.prior.value, 1.0
        for i, (film, detection) in enumerate(zip(samples.films, samples.detections)):
            peak, block = self._bending[film.film], slice(
                film_index(i, PerFilm.CENTER), film_index(i + 1, PerFilm.CENTER))
            value[block] = (detection.center, 0.0, peak, BUMP_SHARE * peak, BUMP_SHARE * peak,
                            0.0, 0.0)
            sigma[block] = (CENTER_SIGMA, BASELINE_SIGMA, BENDING_SIGMA * peak,
                            BUMP_SHARE_SIGMA * peak, BUMP_SHARE_SIGMA * peak, self._gain_sigma,
                            LOG_RECOVERY_SIGMA)
        free = np.flatnonzero(sigma > 0.0)
        precision = np.diag(sigma[free]**-2)
        systematic = [Shared.SLIP, *(film_index(i, PerFilm.GAIN) for i in range(count))]
        if self._shape is not None:
            shape = np.searchsorted(free, np.arange(SHAPE.start, SHAPE.stop))
            precision[shape[:, np.newaxis], shape] = self._shape.prior.precision
            systematic += range(SHAPE.start, SHAPE.stop)
        return Prior(value, precision, free, np.array(systematic, dtype=np.intp))


def _waveform_fit(samples: CrossingSamples, result: FitResult) -> WaveformFit:
    """Return the fitted parameters with their covariance."""
    p, prior, used = result.p, result.prior, result.weight > 0.0
    residual, weight = result.point.residual[used], result.weight[used]
    inverse = inverse_spd(result.hessian)
    # the priors determine part of the parameters, the samples the remaining ones
    fitted = len(prior.free) - float(np.sum(inverse * prior.precision))
    freedom = max(len(residual) - fitted, 1.0)
    # outliers count by their weight, a wrong model with the whole median of its residuals
    squares = residual * residual
    normalized = weight * squares
    excess = max(1.0, float(np.minimum(normalized, HUBER_THRESHOLD**2).sum()) / freedom,
                 upper_median(normalized) * MAD_TO_SIGMA**2)
    covariance = np.zeros((len(p), len(p)))
    covariance[prior.free[:, np.newaxis], prior.free] = inverse
    both = covariance[[Shared.SLIP, Shared.NORM_SLIP]]
    gain = both[:, prior.systematic]
    rows = np.searchsorted(prior.free, prior.systematic)
    systematic = gain @ prior.precision[rows[:, np.newaxis], rows] @ gain.T
    white = excess * (both[:, [Shared.SLIP, Shared.NORM_SLIP]] - systematic)
    return WaveformFit(samples, p, excess * covariance, white, systematic,
                       math.sqrt(float(squares.sum()) / len(squares)), excess)
