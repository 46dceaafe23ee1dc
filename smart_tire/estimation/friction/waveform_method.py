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
Slip and normalized slip of a patch crossing, from a fit of its whole waveform.

The films measure two quantities: their stretch, which is proportional to longitudinal slip through
the calibrated gains, and the normalized slip t = total slip / critical slip. Both together show
``mu / C_x = |s| / (3 F_z t)`` only, B(22).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.contact.constants import MAX_RESIDUAL
from smart_tire.estimation.contact.detection import is_plausible_bending
from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction import constants as c
from smart_tire.estimation.friction.waveform_fit import (
    CrossingSlipPrior, WaveformFit, WaveformFitter)
from smart_tire.estimation.friction.waveform_model import film_index, PerFilm, Shared
from smart_tire.estimation.friction.waveform_shape import ShapeEstimator
from smart_tire.estimation.ground.unknowns import LEAST_NORMALIZED, MAX_SIGMA
from smart_tire.models.tire import film_equations, strain_charge
from smart_tire.parameters.robot import RobotParams
from smart_tire.uncertain import Uncertain, UNKNOWN


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
    def covariance(self) -> Array:
        """Return the 2 x 2 covariance of all errors."""
        return self.white_cov + self.systematic_cov

    @property
    def slip_sigma(self) -> float:
        """Return the standard deviation of ``slip``."""
        return math.sqrt(self.covariance[0, 0])

    @property
    def normalized_slip_sigma(self) -> float:
        """Return the standard deviation of ``normalized_slip``."""
        return math.sqrt(self.covariance[1, 1])


@dataclass(frozen=True, slots=True)
class FilmResult:
    """What the films show of one crossing, before load and stiffness are used."""

    slips: SlipFit
    shift: float   # m, by which the crossing was later than detected
    sliding: bool  # the whole patch slides: only slip over normalized slip is determined
    stretch_voltage: Uncertain = UNKNOWN  # V, of film 1
    peak_interval: Uncertain = UNKNOWN    # s, of film 1
    waveform: WaveformFit | None = None   # None if the method fits none


@dataclass(frozen=True, slots=True)
class SlipVariation:
    """Linear change of slip over a contact length, and rms residual from it."""

    change: Uncertain
    residual: float


def slip_variation(crossing: PatchCrossing, contact_length: float) -> SlipVariation:
    """Return the variation of slip that the change of wheel speed in ``crossing`` allows."""
    return SlipVariation(
        Uncertain(0.0, math.hypot(c.CHANGE_SIGMA, c.SLIP_CHANGE_SHARE * crossing.speed_change
                                  * contact_length / crossing.distance)),
        c.SLIP_RESIDUAL_SHARE * crossing.speed_change)


class WaveformMethod:
    """
    Estimates slip and normalized slip of one wheel's crossings by waveform fits.

    ``length_sigma`` is the relative standard deviation of the contact length; 0: it is known.
    """

    def __init__(self, wheel: str, robot: RobotParams, length_sigma: float = 0.0) -> None:
        self._film, self._patch = robot.film, robot.tire.contact_length
        self._gains, self._bending = robot.film.gains(wheel), robot.film.bending(wheel)
        self.shape = ShapeEstimator()
        self.fitter = WaveformFitter(robot, self._gains, self._bending, self.shape,
                                     length_sigma=length_sigma)

    def measure(self, crossing: PatchCrossing) -> FilmResult | None:
        """Return what the films show of ``crossing``, None if its waveform is implausible."""
        if crossing.samples is None:
            return None
        variation = slip_variation(crossing, self._patch)
        fit = self.fitter.fit(crossing.samples, CrossingSlipPrior(change=variation.change))
        if fit is None or not self._plausible(fit):
            return None
        varied = _with_slip_variation(fit, variation.residual)
        found = flag_full_sliding(varied)
        self.shape.correct(*fit.shape, excess=fit.excess, speed_change=crossing.speed_change)
        return FilmResult(found, self._shift(fit), found is not varied,
                          *self._peaks(fit, crossing), waveform=fit)

    def _plausible(self, fit: WaveformFit) -> bool:
        for i, film in enumerate(fit.samples.films):
            bending = fit.film_parameter(i, PerFilm.BENDING).value
            center = fit.film_parameter(i, PerFilm.CENTER)
            if not (is_plausible_bending(bending, self._bending[film.film])
                    and fit.residual_rms < MAX_RESIDUAL * bending
                    and center.sigma < c.MAX_CENTER_STEP * self._film.length):
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
        around = t.value + t.sigma * np.array([-1.0, 0.0, 1.0])
        below, x_m, above = strain_charge.peak_position(
            np.maximum(1.0 - around, 0.0) * self._patch, length, self._patch).tolist()
        sigma = 0.5 * (above - below)  # m, of x_m
        if sigma > MAX_SIGMA * self._patch:
            return UNKNOWN, UNKNOWN
        scale = fit.shared(Shared.SCALE)
        interval = (self._patch - x_m) / (crossing.speed * (1.0 + scale.value))
        return self._stretch_voltage(fit, x_m), Uncertain(
            interval, math.hypot(sigma / crossing.speed, scale.sigma * interval))

    def _stretch_voltage(self, fit: WaveformFit, x_m: float) -> Uncertain:
        """Return the stretch output [V] of film 1 at position ``x_m`` [m]."""
        slip = fit.slip.value
        per_slip, _, _, by_normalized_slip = film_equations.overlap(
            x_m, fit.normalized_slip.value, self._film.length, self._patch)
        nominal = self._gains[0]
        gain = nominal * (1.0 + fit.film_parameter(0, PerFilm.GAIN).value)
        chosen = [Shared.SLIP, Shared.NORM_SLIP, film_index(0, PerFilm.GAIN)]
        slope = np.array([gain * per_slip, gain * slip * by_normalized_slip,
                          nominal * slip * per_slip])
        covariance = fit.covariance[np.ix_(chosen, chosen)]
        return Uncertain(gain * slip * per_slip, math.sqrt(slope @ covariance @ slope))


def _with_slip_variation(fit: WaveformFit, residual: float) -> SlipFit:
    """
    Return the slips of ``fit`` with the error of its model of a linear change of slip.

    ``residual`` [-] is the rms deviation of the slip from a linear change; a large relative change
    adds the term of second order of its series.
    """
    slip, normalized_slip = fit.slip.value, fit.normalized_slip.value
    scale = max(abs(slip), c.CHANGE_SIGMA)
    change = fit.shared(Shared.CHANGE)
    growth = math.hypot(0.5 * (change.value**2 + change.sigma**2), residual / scale)
    sigma = growth * np.array([scale, max(abs(normalized_slip), LEAST_NORMALIZED)])
    return SlipFit(slip, normalized_slip, fit.white_cov + np.diag(sigma**2), fit.systematic_cov)


def flag_full_sliding(fit: SlipFit) -> SlipFit:
    """
    Return ``fit``, inflated along slip / normalized slip if the whole patch may slide.

    The waveform then determines that ratio only.
    """
    upper = fit.normalized_slip + c.FULL_SLIDING_SIGMAS * math.sqrt(fit.white_cov[1, 1])
    if upper < c.FULL_SLIDING_ONSET:
        return fit
    both = np.array([fit.slip, fit.normalized_slip])
    return replace(fit, white_cov=fit.white_cov + np.outer(both, both))
