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
Film gains, contact length and film positions from the patch crossings of recordings.

The slip comes from the slip estimator without films. Gains are inversely proportional to it, so
its error limits their accuracy. The accuracy of contact length and spacing is limited by that of
the wheel radius (``wheel_radius_sigma``) and of the film length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.film.adjustment import adjust, Adjustment
from smart_tire.calibration.film.crossing_collector import CrossingWithSlip
from smart_tire.calibration.film.observations import GainObservation, ObservationFitter
from smart_tire.calibration.film.results import (
    bending_peaks, GainAdjustment, GainFit, MAX_POSITION_SIGMA, MIN_CROSSINGS, MIN_SLIP,
    relative_position, Results)
from smart_tire.calibration.results import SIGNIFICANT_SIGMAS
from smart_tire.errors import EstimatorError
from smart_tire.numerics.robust import winsorized_mean
from smart_tire.parameters import RobotParams

MAX_ITERATIONS = 5      # of fits, each with the result of the previous one
CONVERGED_SIGMAS = 0.3  # standard errors; a smaller change ends the iteration
MAX_FACTORS = 3.0, 1.3  # of gains and contact length in one iteration


def identify_gains(recordings: Sequence[Sequence[CrossingWithSlip]],
                   robot: RobotParams) -> GainFit:
    """
    Return the calibration from the crossings of one or more recordings.

    Raises EstimatorError if there are too few crossings that can be fitted.
    """
    robot = _per_film(robot)
    observations, sources, found = _iterate(recordings, robot)
    fit = GainFit(found.robot, crossings=len(observations),
                  informative=sum(observation.gains for observation in observations),
                  segments=found.result.segments, excess=found.result.slip_variance_ratio)
    Results(fit, observations, sources, found).fill()
    return fit


def _per_film(robot: RobotParams) -> RobotParams:
    """Return ``robot`` with one value per film of each wheel."""
    film = robot.film
    gains, bending = ([value for wheel in film.wheels for value in values(wheel)]
                      for values in (film.gains, film.bending))
    return replace(robot, film=replace(film, stretch_gain=tuple(gains),
                                       bending_peak=tuple(bending)))


def _iterate(recordings: Sequence[Sequence[CrossingWithSlip]],
             robot: RobotParams) -> tuple[list[GainObservation], list[int], GainAdjustment]:
    """Fit all crossings until the shared parameters converge."""
    groups, refined = robot.film_groups, False
    for _ in range(MAX_ITERATIONS):
        fitter = ObservationFitter(robot, refined=refined)
        observed = [(observation, i) for i, crossings in enumerate(recordings)
                    for crossing in crossings
                    if (observation := fitter.fit_crossing(
                        crossing, gains=_makes_gains_observable(crossing))) is not None]
        observations, sources = [observation for observation, _ in observed], [
            i for _, i in observed]
        if len(observations) < MIN_CROSSINGS:
            raise EstimatorError(
                f'{len(observations)} crossings of films could be fitted, of '
                f'{sum(map(len, recordings))} with known slip; expected at least {MIN_CROSSINGS}')
        result = adjust(observations, sources, robot)
        found = GainAdjustment(robot, groups, fitter, result)
        change = result.value / np.sqrt(np.diag(result.covariance))
        robot = _updated(found, observations)
        if refined and np.max(np.abs(change[:result.index.radius])) < CONVERGED_SIGMAS:
            break
        refined = bool(np.all(_gain_factors(result) > 0.0))  # no film has its poles swapped
    return observations, sources, found


def _makes_gains_observable(crossing: CrossingWithSlip) -> bool:
    slip, sigma = crossing.slip
    return abs(slip) > max(MIN_SLIP, SIGNIFICANT_SIGMAS * sigma)


def _updated(found: GainAdjustment, observations: Sequence[GainObservation]) -> RobotParams:
    """Return the robot with the adjusted parameters, within the limits of one iteration."""
    robot, result = found.robot, found.result
    film, index = robot.film, result.index
    max_gain, max_length = MAX_FACTORS
    factor = _gain_factors(result)
    factor = np.where(factor > 0.0, np.clip(factor, 1.0 / max_gain, max_gain), 1.0)
    length, alpha = np.exp(np.clip(result.value[[index.length, index.alpha]],
                                   -math.log(max_length), math.log(max_length))).tolist()
    peaks = (bending_peaks(observations, wheel, i)
             for wheel in film.wheels for i in range(film.count))
    bending = [winsorized_mean(values, SIGNIFICANT_SIGMAS).value if values else nominal
               for values, nominal in zip(peaks, film.bending_peak)]
    positions = [nominal + offset
                 for nominal, offset in zip(film.centers, _position_offsets(found))]
    layout = ({'positions': tuple(positions)} if film.positions
              else {'spacing': positions[1]}) if positions == sorted(positions) else {}
    film = replace(film, stretch_gain=tuple((factor * film.stretch_gain).tolist()),
                   bending_peak=tuple(bending), bending_alpha=alpha * film.bending_alpha, **layout)
    return replace(robot, film=film, tire=replace(
        robot.tire, contact_length=length * robot.tire.contact_length))


def _gain_factors(result: Adjustment) -> Array:
    """Return the gains over the nominal ones."""
    factors: Array = 1.0 + result.value[:result.index.length]
    return factors


def _position_offsets(found: GainAdjustment) -> list[float]:
    """Return the offset [m] of each film from its nominal position, relative to its group."""
    offsets = [0.0] * found.robot.film.count
    for group in found.groups:
        for film in group[1:]:
            offset = relative_position(found.result, film, group[0])
            if offset.sigma < MAX_POSITION_SIGMA:
                offsets[film] = offset.value
    return offsets
