# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

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
from smart_tire.estimation.contact.constants import BENDING_SIGMA, MIN_SAMPLES, POSITION_GATE
from smart_tire.estimation.contact.records import CrossingSamples
from smart_tire.estimation.friction import constants as c
from smart_tire.estimation.friction.waveform_model import (
    BUMPS, film_index, PerFilm, SHAPE, Shared, WaveformModel)
from smart_tire.estimation.friction.waveform_shape import ShapeEstimator
from smart_tire.estimation.ground.unknowns import LEAST_NORMALIZED
from smart_tire.numerics.levenberg_marquardt import (
    FitResult, HUBER_THRESHOLD, inverse_spd, JointPrior, LevenbergMarquardt, solve_spd,
    upper_median)
from smart_tire.numerics.robust import MAD_TO_SIGMA
from smart_tire.parameters.robot import RobotParams
from smart_tire.uncertain import Uncertain


@dataclass(frozen=True, slots=True)
class CrossingSlipPrior:
    """Prior on slip and its change within a crossing, from other sources than the films."""

    slip: Uncertain = Uncertain(0.0, c.SLIP_SIGMA)  # -, at the reference
    change: Uncertain = Uncertain(0.0, 0.0)         # -, of the slip over a contact length


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
    result: FitResult

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

    @property
    def shape(self) -> tuple[Array, Array]:
        """Return the shape of release and bumps, if fitted, and the information of its data."""
        result, prior = self.result, self.result.prior
        own = (prior.free >= SHAPE.start) & (prior.free < SHAPE.stop)
        # residuals of a wrong model carry less information than noise
        hessian = prior.precision + (result.hessian - prior.precision) / self.excess
        correction = solve_spd(hessian, prior.precision @ (prior.value - result.p)[prior.free])
        # what the other parameters leave of the information (Schur complement)
        data, others = (hessian - prior.precision)[own], hessian[own][:, ~own]
        information = data[:, own] - others @ solve_spd(hessian[~own][:, ~own], others.T)
        return result.p[SHAPE] + (1.0 - 1.0 / self.excess) * correction[own], information


class WaveformFitter:
    """
    Fits ``WaveformModel`` to the crossings of one wheel.

    ``gains`` [V/m] and ``bending`` [V] are the nominal ones of all films of the wheel.
    ``shape`` has the prior of release and bumps. ``gain_sigma`` (by default the robot's tolerance)
    and ``length_sigma`` are relative standard deviations of gains and contact length; where they
    are 0, these are fixed.
    """

    def __init__(self, robot: RobotParams, gains: Sequence[float], bending: Sequence[float],
                 shape: ShapeEstimator, *, gain_sigma: float | None = None,
                 length_sigma: float = 0.0) -> None:
        self._robot, film = robot, robot.film
        self._gains, self._bending = tuple(gains), tuple(bending)
        self._gain_sigma = film.stretch_gain_tolerance if gain_sigma is None else gain_sigma
        self._length_sigma = length_sigma
        self._shape = shape

    def fit(self, samples: CrossingSamples, slips: CrossingSlipPrior = CrossingSlipPrior(),
            start: WaveformFit | None = None) -> WaveformFit | None:
        """
        Return the fit of ``samples``, None where a film has too few of them.

        A fit of the same samples with another prior is a good ``start``.
        """
        if min(len(film.distance) for film in samples.films) < MIN_SAMPLES:
            return None
        solver = LevenbergMarquardt(
            self._model(samples),
            np.concatenate([one.volts for one in samples.films]),
            np.concatenate([one.rail for one in samples.films]), self._robot.film.sample_variance)
        p = self._start(samples) if start is None else start.parameters
        slip = float(p[Shared.SLIP])
        # the prior of a relative change of slip is that of the detected slip for all starts
        prior = self._prior(samples, slips, slip)
        if start is not None:
            return self._evaluate(samples, solver.run(p, prior))
        best = self._solve(samples, solver, prior, p)
        for other in (-slip, 0.0):
            if best.excess <= c.POOR_EXCESS:
                break
            p = p.copy()
            p[Shared.SLIP] = other
            if not other:  # the release has a wrong share, which the detector takes for slip
                p[Shared.NORM_SLIP] = LEAST_NORMALIZED
            best = min(best, self._solve(samples, solver, prior, p), key=lambda fit: fit.excess)
        return best

    def _solve(self, samples: CrossingSamples, solver: LevenbergMarquardt, prior: JointPrior,
               p: Array) -> WaveformFit:
        """Fit with the bumps as learned before all parameters: far from the minimum it is fast."""
        rough = solver.run(p, prior.without(BUMPS), c.ROUGH_REDUCTION).point
        return self._evaluate(samples, solver.run(rough, prior))

    def volts(self, fit: WaveformFit) -> list[Array]:
        """Return the fitted output [V] above baseline at each sample, film by film."""
        return self.expected(fit.samples, fit.parameters)

    def expected(self, samples: CrossingSamples, parameters: Array | None = None) -> list[Array]:
        """Return the output as ``volts``; by default that of detections and mean priors."""
        p = self._start(samples) if parameters is None else parameters
        output, _ = self._model(samples).linearized(p)
        return np.split(output, np.cumsum([len(film.distance) for film in samples.films])[:-1])

    def _model(self, samples: CrossingSamples) -> WaveformModel:
        return WaveformModel(self._robot, self._gains, samples.films, samples.reference,
                             len(samples.errors.shape_sigmas))

    def _start(self, samples: CrossingSamples) -> Array:
        count = film_index(len(samples.films), PerFilm.CENTER)
        p = np.zeros(count + len(samples.errors.shape_sigmas))
        p[SHAPE] = self._shape.prior.value
        for i, (film, detection) in enumerate(zip(samples.films, samples.detections)):
            bump = c.BUMP_SHARE * self._bending[film.film]
            p[film_index(i, PerFilm.CENTER):film_index(i, PerFilm.GAIN)] = (
                detection.center, 0.0, detection.bending, bump, bump)
        p[[Shared.SLIP, Shared.NORM_SLIP]] = np.mean(
            [(one.slip, one.normalized_slip) for one in samples.detections], axis=0)
        return p

    def _prior(self, samples: CrossingSamples, slips: CrossingSlipPrior,
               slip: float) -> JointPrior:
        """Return the prior on all parameters; ``slip`` is that of the start."""
        count, errors = len(samples.films), samples.errors
        value, sigma = np.zeros((2, film_index(count, PerFilm.CENTER) + len(errors.shape_sigmas)))
        scale = math.copysign(max(abs(slip), c.CHANGE_SIGMA), slip)  # CHANGE is relative
        value[:Shared.SCALE] = slips.slip.value, 0.0, slips.change.value / scale
        sigma[:len(Shared)] = (
            slips.slip.sigma, c.SLIP_SIGMA, slips.change.sigma / abs(scale),
            errors.scale_sigma, c.LOG_ALPHA_SIGMA, self._length_sigma)
        sigma[film_index(count, PerFilm.CENTER):] = errors.shape_sigmas
        value[SHAPE], sigma[SHAPE] = self._shape.prior.value, 1.0
        baseline = math.sqrt(self._robot.film.sample_variance)  # V, assumed, as of a sample
        for i, (film, detection) in enumerate(zip(samples.films, samples.detections)):
            peak, block = self._bending[film.film], slice(
                film_index(i, PerFilm.CENTER), film_index(i + 1, PerFilm.CENTER))
            bump = c.BUMP_SHARE * peak
            value[block] = detection.center, 0.0, peak, bump, bump, 0.0, 0.0
            sigma[block] = (POSITION_GATE * self._robot.film.length, baseline,
                            BENDING_SIGMA * peak, bump, bump, self._gain_sigma,
                            c.LOG_RECOVERY_SIGMA)
        free = np.flatnonzero(sigma > 0.0)
        prior = JointPrior(value, np.diag(sigma[free]**-2), free)
        shape = prior.rows(np.arange(SHAPE.start, SHAPE.stop))
        prior.precision[shape[:, np.newaxis], shape] = self._shape.prior.precision
        return prior

    def _evaluate(self, samples: CrossingSamples, result: FitResult) -> WaveformFit:
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
        # the slip prior, gains and shape have the same errors in all crossings
        both = covariance[[Shared.SLIP, Shared.NORM_SLIP]]
        same = np.zeros(len(p), dtype=bool)
        same[[Shared.SLIP, *range(SHAPE.start, SHAPE.stop), *(
            film_index(i, PerFilm.GAIN) for i in range(len(samples.films)))]] = True
        rows = same[prior.free].nonzero()[0]
        gain = both[:, prior.free[rows]]
        systematic = gain @ prior.precision[rows[:, np.newaxis], rows] @ gain.T
        white = excess * (both[:, [Shared.SLIP, Shared.NORM_SLIP]] - systematic)
        return WaveformFit(samples, p, excess * covariance, white, systematic,
                           math.sqrt(float(squares.sum()) / len(squares)), excess, result)
