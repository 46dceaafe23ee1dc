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

"""Waveform method: slip and normalized slip from a fit of a crossing's whole waveform."""

from __future__ import annotations

import math

import numpy as np

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.brush_inversion import flag_full_sliding, SlipFit
from smart_tire.estimation.friction.crossing_method import MethodResult
from smart_tire.estimation.friction.slip_variation import slip_variation
from smart_tire.estimation.friction.waveform_fit import (
    CrossingSlipPrior, WaveformFit, WaveformFitter)
from smart_tire.estimation.friction.waveform_model import film_index, PerFilm, Shared
from smart_tire.estimation.friction.waveform_shape import ShapeEstimator
from smart_tire.models.tire import strain_charge
from smart_tire.parameters.robot import RobotParams
from smart_tire.uncertain import Uncertain, UNKNOWN

PLAUSIBLE_BENDING = (0.3, 3.0)  # range of the bending peak over its nominal value
MAX_RESIDUAL = 0.2       # of the bending peak, rms
MAX_CENTER_SIGMA = 0.003  # m, of a film's center
MAX_PEAK_SIGMA = 0.3     # of the contact length, of x_m
CURVATURE_SHARE = 0.5    # of the squared relative change of slip: error of the linear model
MIN_SLIP_SCALE = 0.01    # -, below which a relative change is undefined
MIN_NORMALIZED_SCALE = 0.1  # -, of normalized slip, in the same role
SLOPE_STEP = 1e-3        # -, of normalized slip, for a finite difference


class WaveformMethod:
    """Estimates slip and normalized slip of one wheel's crossings by waveform fits."""

    needs_slip = False

    def __init__(self, wheel: str, robot: RobotParams) -> None:
        self._film, self._patch = robot.film, robot.tire.contact_length
        self._gains, self._bending = robot.film.gains(wheel), robot.film.bending(wheel)
        self.shape = ShapeEstimator()
        self._fitter = WaveformFitter(robot, self._gains, self._bending, shape=self.shape)

    def measure(self, crossing: PatchCrossing, slip: Uncertain = UNKNOWN) -> MethodResult | None:
        """Return what the films show of ``crossing``, None if its waveform is implausible."""
        if crossing.samples is None:
            return None
        variation = slip_variation(crossing, self._patch)
        fit = self._fitter.fit(crossing.samples, CrossingSlipPrior(change=variation.change))
        if fit is None or not self._plausible(fit):
            return None
        shape = self._fitter.shape(fit)
        varied = _with_slip_variation(fit, variation.residual)
        found = flag_full_sliding(varied, fit.white_cov)
        self.shape.update(*shape, excess=fit.excess, speed_change=crossing.speed_change)
        return MethodResult(found, self._shift(fit), found is not varied,
                            *self._peaks(fit, crossing), waveform=fit)

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


def _with_slip_variation(fit: WaveformFit, residual: float) -> SlipFit:
    """
    Return the slips of ``fit`` with the error of its model of a linear change of slip.

    ``residual`` [-] is the rms deviation of the slip from a linear change; a large relative change
    adds a deviation of second order.
    """
    slip, normalized_slip = fit.slip.value, fit.normalized_slip.value
    scale = max(abs(slip), MIN_SLIP_SCALE)
    change = fit.shared(Shared.CHANGE)
    growth = math.hypot(CURVATURE_SHARE * (change.value**2 + change.sigma**2), residual / scale)
    sigma = growth * np.array([scale, max(abs(normalized_slip), MIN_NORMALIZED_SCALE)])
    return SlipFit(slip, normalized_slip, fit.white_cov + np.diag(sigma**2), fit.systematic_cov)
