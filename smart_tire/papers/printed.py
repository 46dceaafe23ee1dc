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
Printed variants of paper B: the constraint B(7), and the two-peak method, B(22) to B(26), Fig. 8.

In B(7) lambda' stands in place of lambda. It is 0 for a faster side that brakes and for a slower
side that drives: slip of both sides in the same direction is discarded. It is a constraint of
speeds, so distances are counted from the timestamps, not between positions.

In the two-peak method the highest sample is taken for the stretch peak at x_m, the lowest for the
release. The travel between them gives the adhesion length, by the exact or the printed map; slip
is that of the motion of the robot. At 400 Hz the peaks have errors of some millimeters and 0.1 V,
and only in traction do these two samples represent the two peaks. ``two_peaks`` applies it to the
crossings that the friction estimator of this package finds.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.estimation.contact.records import FilmSamples, PatchCrossing
from smart_tire.estimation.friction.estimator import EvaluatedCrossing, FrictionEstimator
from smart_tire.estimation.friction.output import friction_record
from smart_tire.estimation.friction.waveform_method import FilmResult, SlipFit
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.filter import SlipFilter
from smart_tire.estimation.slip.inputs import WheelSpeeds
from smart_tire.estimation.slip.state import SLIP_VELS
from smart_tire.models.tire import strain_charge, tread_film
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import Friction, Sample
from smart_tire.uncertain import Uncertain, UNKNOWN

SEARCH_MARGIN = 0.005   # m of travel beyond the film inside the patch, in which peaks are searched
MIN_COVERAGE = 0.9      # of that travel
FLAT_TOP_SIGMAS = 2.0   # standard deviations of noise below the top, within which any sample
#                         may be the highest
SLOPE_STEP = 1e-4       # m, for a finite difference
MIN_NORMALIZED_SLIP = 0.01  # below, there is no stretch peak
UNIFORM_VARIANCE = 12.0  # a uniform distribution of width 1 has a variance of 1/12


def printed_adhesion_length(x_m: ArrayLike, film_length: float, contact_length: float) -> Array:
    """
    Return the adhesion length of the paper, ``L_a = x_m + l`` [m], B(25).

    It is far too short where much of the patch slides; ``strain_charge.adhesion_length`` is exact.

    >>> print(f'{printed_adhesion_length(0.0208, 0.020, 0.046) * 1e3:.1f} mm')
    40.8 mm
    """
    return np.asarray(x_m, dtype=float) + film_length


MAPS = {'exact': strain_charge.adhesion_length, 'printed': printed_adhesion_length}


@dataclass(frozen=True, slots=True)
class FilmPeaks:
    """Peaks of one film, with slip and normalized slip derived from them."""

    film: int
    slip: Uncertain             # -
    normalized_slip: Uncertain  # -
    stretch_voltage: Uncertain  # V, q_sm
    peak_travel: Uncertain      # m, between the peaks


def two_peaks(samples: Iterable[Sample], params: FrictionEstimatorParams,
              map_name: str = 'exact') -> list[Friction]:
    """
    Return the crossings in ``samples``, in order of reception, by the method of the paper.

    Load, slip and fused friction are those of ``FrictionEstimator``; ``map_name`` is ``exact`` or
    ``printed``.
    """
    found: list[Friction] = []
    robot = params.robot
    methods = {wheel: TwoPeakMethod(wheel, robot, map_name) for wheel in robot.film.wheels}

    def evaluate(one: EvaluatedCrossing) -> None:
        wheel = one.friction.wheel
        found.append(friction_record(
            wheel, robot.tire.contact_length, one.crossing,
            methods[wheel].measure(one.crossing, one.state.slip), one.state))

    estimator = FrictionEstimator(params, evaluate)
    for sample in samples:
        estimator.update(sample)
    estimator.finish()
    return found


class TwoPeakMethod:
    """
    Estimates normalized slip of one wheel's crossings; ``map_name`` is the map of x_m.

    Raises ParameterError for films without two peaks.
    """

    def __init__(self, wheel: str, robot: RobotParams, map_name: str) -> None:
        self._film, self._patch, self._map = robot.film, robot.tire.contact_length, MAPS[map_name]
        if robot.film.length >= self._patch:
            raise ParameterError(f'two peaks need a film.length ({robot.film.length} m) below '
                                 f'tire.contact_length ({self._patch} m)')
        if robot.film.release != 'fig8':
            raise ParameterError(f'two peaks need film.release fig8, not {robot.film.release}: '
                                 'the second peak occurs only with fig8')
        self._gains = robot.film.gains(wheel)
        half_inside = 0.5 * (self._patch - robot.film.length)
        half_crossing = 0.5 * (self._patch + robot.film.length)
        # m, about a film's center
        self._search = -half_inside - SEARCH_MARGIN, half_crossing + SEARCH_MARGIN
        # V/m per volt of the bending peak, before and after the minimum
        x = self._patch + np.array([-SLOPE_STEP, 0.0, SLOPE_STEP])
        bend = tread_film.bending(x, robot.film.length, self._patch,
                                  robot.film.bending_alpha)
        self._release_slope = float(np.mean(np.abs(np.diff(bend)))) / SLOPE_STEP

    def measure(self, crossing: PatchCrossing, slip: Uncertain) -> FilmResult | None:
        """Return the result of ``crossing``, None unless in traction with both peaks sampled."""
        if crossing.samples is None or not slip.value > 0.0:
            return None
        found = [peaks for film, detection in zip(
            crossing.samples.films, crossing.samples.detections)
            if (peaks := self._peaks(film, detection.center, slip.value)) is not None]
        if not found:
            return None
        table = np.array([(*peaks.slip, *peaks.normalized_slip) for peaks in found])
        film_slip, normalized_slip = table[:, [0, 2]].mean(axis=0).tolist()
        white = np.diag(np.sum(table[:, [1, 3]]**2, axis=0) / len(found)**2)
        gains = self._film.stretch_gain_tolerance * film_slip
        films_only = SlipFit(film_slip, normalized_slip, white,
                             np.diag([gains**2 / len(found), 0.0]))
        return FilmResult(
            films_only, 0.0, False, *self._reported_peaks(crossing, found[0]))

    def _peaks(self, film: FilmSamples, center: float, slip: float) -> FilmPeaks | None:
        """Return the peaks of one film, None if they are not sampled or contradict the model."""
        travel = film.distance - center
        near = (travel > self._search[0]) & (travel < self._search[1])
        if np.count_nonzero(near) < 3:
            return None
        travel, volts = travel[near], film.volts[near]
        step = float(np.median(np.diff(travel)))
        if len(travel) * step < MIN_COVERAGE * (self._search[1] - self._search[0]):
            return None
        top, low = int(np.argmax(volts)), int(np.argmin(volts))
        between, height = float(travel[low] - travel[top]), float(volts[top] + volts[low])
        normalized_slip = 1.0 - self._adhesion_length(between) / self._patch
        if not normalized_slip > MIN_NORMALIZED_SLIP:  # NaN on the plateau of the exact map
            return None
        flat = self._flatness(normalized_slip, slip, film.film, step)
        between_sigma = math.hypot(step / math.sqrt(UNIFORM_VARIANCE), flat)
        slope = abs(self._adhesion_length(between + SLOPE_STEP)
                    - self._adhesion_length(between - SLOPE_STEP)) / (2.0 * SLOPE_STEP)
        missed = self._release_slope * abs(float(volts[low])) * step / math.sqrt(UNIFORM_VARIANCE)
        height_sigma = math.hypot(missed, math.sqrt(2.0 * self._film.sample_variance))
        per_slip = self._gains[film.film] * self._stretch_per_slip(
            self._patch - between, normalized_slip)
        if not (per_slip > 0.0 and math.isfinite(slope)):
            return None
        return FilmPeaks(
            film.film, Uncertain(height / per_slip, height_sigma / per_slip),
            Uncertain(normalized_slip, slope * between_sigma / self._patch),
            Uncertain(height, height_sigma), Uncertain(between, between_sigma))

    def _adhesion_length(self, between: float) -> float:
        """Return the adhesion length [m] from the travel between the peaks, NaN if undefined."""
        return float(self._map(self._patch - between, self._film.length, self._patch))

    def _stretch_per_slip(self, x: float, normalized_slip: float) -> float:
        return float(strain_charge.overlap_integral(
            x, normalized_slip, normalized_slip, 1.0, self._film.length,
            self._patch)) / normalized_slip

    def _flatness(self, normalized_slip: float, slip: float, film: int, step: float) -> float:
        """Return the standard deviation [m] of the highest sample's position on the flat top."""
        x = np.linspace(0.0, self._patch, 100)
        volts = self._gains[film] * slip * strain_charge.overlap_integral(
            x, normalized_slip, normalized_slip, 1.0, self._film.length,
            self._patch) / normalized_slip
        high = x[volts > volts.max() - FLAT_TOP_SIGMAS * math.sqrt(self._film.sample_variance)]
        return max(float(np.ptp(high)), step) / math.sqrt(UNIFORM_VARIANCE)

    @staticmethod
    def _reported_peaks(crossing: PatchCrossing,
                        peaks: FilmPeaks) -> tuple[Uncertain, Uncertain]:
        """Return stretch voltage [V] and peak interval [s] if ``peaks`` are those of film 1."""
        if peaks.film:
            return UNKNOWN, UNKNOWN
        interval = peaks.peak_travel.value / crossing.speed
        sigma = math.hypot(
            peaks.peak_travel.sigma, crossing.speed_sigma * interval) / crossing.speed
        return peaks.stretch_voltage, Uncertain(interval, sigma)


class PrintedSlipFilter(SlipFilter):
    """Slip filter with B(7) as printed."""

    def _correct_distances(self, y: Array, H: Array, R: Array, sides: list[float], dt: float
                           ) -> float:
        """Correct with the mean of both distances, with lambda', and with their difference."""
        mix = np.array([[0.5, 0.5], [-1.0, 1.0]])
        y, H = mix @ y, mix @ H
        for slip, own, other in zip(SLIP_VELS, sides, sides[::-1]):
            value = self.kalman.x[slip] * own
            if value < 0.0 if abs(own) >= abs(other) else value > 0.0:
                y[0] += 0.5 * dt * self.kalman.x[slip]
                H[0, slip] -= 0.5 * dt
        return super()._correct_distances(y, H, mix @ R @ mix.T, sides, dt)

    def _restart_travel(self, wheels: WheelSpeeds, sides: list[float], lag: float,
                        change: tuple[float, float], W: float, *, continued: bool = True) -> None:
        super()._restart_travel(replace(wheels, from_positions=False), sides, lag, change, W,
                                continued=continued)


class PrintedSlipEstimator(SlipEstimator):
    """
    Slip estimator with B(7) as printed, with the inputs and outputs of ``SlipEstimator``.

    >>> from smart_tire.parameters import SlipEstimatorParams
    >>> PrintedSlipEstimator(SlipEstimatorParams()).status()['state']
    'waiting for imu/data'
    """

    new_filter = PrintedSlipFilter
