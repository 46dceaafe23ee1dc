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
Waveform method: slip and normalized slip from fits of a crossing's whole waveform.

The films alone are fitted first, because ``film_slip`` must be independent of the slip estimator;
then the same fit continues with the estimated slip as a prior.
"""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.brush_inversion import (
    consistency_inflation, flag_full_sliding, SlipFit)
from smart_tire.estimation.friction.crossing_method import MethodResult
from smart_tire.estimation.friction.motion_history import WheelMotion
from smart_tire.estimation.friction.slip_variation import (
    estimated_variation, MIN_CHANGE_SIGMA, unknown_variation)
from smart_tire.estimation.friction.waveform_fit import (
    CrossingSlipPrior, MIN_SLIP, WaveformFit, WaveformFitter)
from smart_tire.estimation.friction.waveform_model import film_index, PerFilm, Shared
from smart_tire.estimation.friction.waveform_shape import ShapeEstimator
from smart_tire.models.tire import strain_charge
from smart_tire.parameters.robot import RobotParams
from smart_tire.uncertain import Uncertain, UNKNOWN

PLAUSIBLE_BENDING = (0.3, 3.0)  # range of the bending peak over its nominal value
MAX_RESIDUAL = 0.2       # of the bending peak, rms
MAX_CENTER_SIGMA = 0.003  # m, of a film's center
MAX_PEAK_SIGMA = 0.3     # of the contact length, of x_m
UNKNOWN_COUPLING = 0.5   # of normalized slip to slip, where the lateral slip is unknown
CURVATURE_SHARE = 0.5    # of the squared relative change of slip: error of the linear model
MIN_SLIP_SCALE = 0.01    # -, below which a relative change is undefined
MIN_NORMALIZED_SCALE = 0.1  # -, of normalized slip, in the same role
COMPARISON_EXCESS = 1.25  # mean square of normalized residuals that triggers a film comparison
DIFFERENCE_SIGMAS = 2.0  # between two films, beyond which they crossed two surfaces
UNKNOWN_GAIN_SIGMA = 1.0  # relative, of gains that carry no information
SLOPE_STEP = 1e-3        # -, of normalized slip, for a finite difference


class WaveformMethod:
    """Estimates slip and normalized slip of one wheel's crossings by waveform fits."""

    def __init__(self, wheel: str, robot: RobotParams) -> None:
        self._film, self._patch = robot.film, robot.tire.contact_length
        self._gains, self._bending = robot.film.gains(wheel), robot.film.bending(wheel)
        self.shape = ShapeEstimator()
        self._fitter = WaveformFitter(robot, self._gains, self._bending, shape=self.shape)
        # with film_aided the slip estimate contains the films' slip: do not use the gains twice
        self._fusing_fitter = self._fitter if not robot.slip.film_aided else WaveformFitter(
            robot, self._gains, self._bending, gain_sigma=UNKNOWN_GAIN_SIGMA,
            shape=self.shape)

    def evaluate(self, crossing: PatchCrossing, motion: WheelMotion) -> MethodResult | None:
        """Return the result of ``crossing``, None if its waveform is implausible."""
        if crossing.samples is None:
            return None
        variation = unknown_variation(crossing, self._patch)
        first = self._fitter.fit(crossing.samples, CrossingSlipPrior(change=variation.change))
        if first is None or not self._plausible(first):
            return None
        shape = self._fitter.shape(first)
        varied = _with_slip_variation(first, variation.residual)
        films_only = flag_full_sliding(varied, first.white_cov)
        last, fused = first, films_only
        if math.isfinite(motion.slip.value):
            full_sliding = films_only is not varied
            last, fused = self._fuse(crossing, motion, first, full_sliding)
            fused = fused.inflated(consistency_inflation(films_only, motion.slip))
        self.shape.update(
            *shape, excess=first.excess, speed_change=crossing.speed_change)
        return MethodResult(films_only, fused, self._shift(first),
                            *self._peaks(last, crossing), waveform=last)

    def _fuse(self, crossing: PatchCrossing, motion: WheelMotion, first: WaveformFit,
              full_sliding: bool) -> tuple[WaveformFit, SlipFit]:
        """Continue the fit with the estimated slip as a prior; return it and its slips."""
        variation = estimated_variation(crossing, motion, self._patch)
        prior = CrossingSlipPrior(motion.slip, variation.change, *_coupling(
            motion, crossing.speed, variation.change.value))
        start = _moved_to_slip(first, motion.slip.value) if full_sliding else first
        # a slip that the films do not determine has not aided the slip estimate
        fitter = self._fitter if full_sliding else self._fusing_fitter
        fit = fitter.fit(first.samples, prior, start)
        assert fit is not None  # the first fit had enough samples
        return fit, self._compare_films(fitter, fit, prior, variation.residual)

    def _plausible(self, fit: WaveformFit) -> bool:
        low, high = PLAUSIBLE_BENDING
        for i, film in enumerate(fit.samples.films):
            bending = fit.film_parameter(i, PerFilm.BENDING).value
            if not (low < bending / self._bending[film.film] < high
                    and fit.residual_rms < MAX_RESIDUAL * bending
                    and fit.film_parameter(i, PerFilm.CENTER).sigma < MAX_CENTER_SIGMA):
                return False
        return True

    @staticmethod
    def _compare_films(fitter: WaveformFitter, fit: WaveformFit, prior: CrossingSlipPrior,
                       residual: float) -> SlipFit:
        """Return the slips of ``fit``, with a larger covariance if films crossed two surfaces."""
        slips, samples = _with_slip_variation(fit, residual), fit.samples
        if fit.excess < COMPARISON_EXCESS or len(samples.films) < 2 or not _differ(
                fitter.per_film_normalized_slip(fit), fit):
            return slips
        single = [fitter.fit(
            replace(samples, films=(film,), detections=(detection,)), prior)
            for film, detection in zip(samples.films, samples.detections)]
        per_film = [one.normalized_slip for one in single if one is not None]
        if not _differ(per_film, fit):
            return slips
        error = np.array([one.value for one in per_film]) - fit.normalized_slip.value
        return replace(slips, white_cov=slips.white_cov + np.diag(
            [0.0, float(np.mean(error**2))]))

    @staticmethod
    def _shift(fit: WaveformFit) -> float:
        """Return the distance [m] by which the films crossed later than detected."""
        detections = fit.samples.detections
        return float(np.average(
            [fit.film_parameter(i, PerFilm.CENTER).value - detection.center
             for i, detection in enumerate(detections)],
            weights=[detection.coverage for detection in detections]))

    def _peaks(self, fit: WaveformFit, crossing: PatchCrossing) -> tuple[Uncertain, Uncertain]:
        """Return stretch voltage and peak interval of film 1 by Fig. 8, UNKNOWN when braking."""
        length = self._film.length
        slip, t = fit.slip.value, fit.normalized_slip
        if fit.samples.films[0].film or length >= self._patch or slip <= 0.0 or t.value <= 0.0:
            return UNKNOWN, UNKNOWN

        def position(normalized_slip: float) -> float:
            adhesion = max(1.0 - normalized_slip, 0.0) * self._patch
            return float(strain_charge.peak_position(adhesion, length, self._patch))

        x_m = position(t.value)
        slope = (position(t.value + SLOPE_STEP) - position(t.value - SLOPE_STEP)) / (
            2.0 * SLOPE_STEP)
        if slope * t.sigma > MAX_PEAK_SIGMA * self._patch:
            return UNKNOWN, UNKNOWN
        scale = fit.shared(Shared.SCALE)
        interval = (self._patch - x_m) / (crossing.speed * (1.0 + scale.value))
        sigma = math.hypot(slope * t.sigma / crossing.speed, scale.sigma * interval)
        return self._stretch_voltage(fit, x_m), Uncertain(interval, sigma)

    def _stretch_voltage(self, fit: WaveformFit, x_m: float) -> Uncertain:
        """Return the stretch output [V] of film 1 at position ``x_m`` [m]."""
        slip = fit.slip.value
        strain = strain_charge.overlap(
            np.array([x_m]), fit.normalized_slip.value, self._film.length, self._patch)
        per_slip, nominal = float(strain.value[0]), self._gains[0]
        gain = nominal * (1.0 + fit.film_parameter(0, PerFilm.GAIN).value)
        chosen = [Shared.SLIP, Shared.NORM_SLIP, film_index(0, PerFilm.GAIN)]
        slope = np.array([gain * per_slip, gain * slip * float(strain.by_normalized_slip[0]),
                          nominal * slip * per_slip])
        covariance = fit.covariance[np.ix_(chosen, chosen)]
        return Uncertain(gain * slip * per_slip, math.sqrt(slope @ covariance @ slope))


def _differ(per_film: list[Uncertain], fit: WaveformFit) -> bool:
    """Return whether a normalized slip of one film differs from that of ``fit``."""
    return any(abs(one.value - fit.normalized_slip.value) > DIFFERENCE_SIGMAS * one.sigma
               for one in per_film)


def _coupling(motion: WheelMotion, speed: float, change: float) -> tuple[float, float]:
    """
    Return the coupling of normalized slip to slip, and sigma of its independent change.

    Normalized slip is proportional to the total slip, to which longitudinal and lateral slip
    contribute by their squares; while one changes, the other may change as much, in any direction.
    """
    square, scale = motion.slip.value**2, max(abs(motion.slip.value), MIN_SLIP)
    lateral = (motion.lateral_velocity.value / speed)**2
    known = math.isfinite(lateral) and square > 0.0
    coupling = square / (square + lateral) if known else UNKNOWN_COUPLING
    return coupling, (1.0 - coupling) * math.hypot(change, MIN_CHANGE_SIGMA) / scale


def _moved_to_slip(fit: WaveformFit, slip: float) -> WaveformFit:
    """Return ``fit`` scaled to ``slip`` at constant slip / normalized slip: a start value."""
    factor = slip / fit.slip.value if fit.slip.value else 0.0
    if not factor > 0.0:
        return fit
    parameters = fit.parameters.copy()
    parameters[[Shared.SLIP, Shared.NORM_SLIP]] *= factor
    return replace(fit, parameters=parameters)


def _with_slip_variation(fit: WaveformFit, residual: float) -> SlipFit:
    """
    Return the slips of ``fit`` with the error of its model of a linear change of slip.

    ``residual`` [-] is the rms deviation of the slip from a linear change; a large relative change
    adds a deviation of second order.
    """
    slip, normalized_slip = fit.slip.value, fit.normalized_slip.value
    scale = max(abs(slip), MIN_SLIP_SCALE)
    growth, spread = (math.hypot(CURVATURE_SHARE * sum(map(_squared, fit.shared(which))),
                                 residual / scale)
                      for which in (Shared.SLIP_CHANGE, Shared.NORM_SLIP_CHANGE))
    sigma = np.array([growth * scale, spread * max(abs(normalized_slip), MIN_NORMALIZED_SCALE)])
    return SlipFit(slip, normalized_slip, fit.white_cov + np.diag(sigma**2), fit.systematic_cov)


def _squared(value: float) -> float:
    return value * value
