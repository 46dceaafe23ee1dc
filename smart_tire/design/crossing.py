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
Covariance of what one patch crossing of films shows: that of the estimator on exact samples.

The samples are those that the waveform model predicts at the mean of its priors. The fit then
stays there, and its covariance is the inverse of the Bayesian information: that of samples with
noise and quantization, and of the priors of every nuisance.
"""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np

from smart_tire.design.drive import Place
from smart_tire.estimation.contact.constants import MAX_SPEED_CHANGE, OUTER_LENGTH
from smart_tire.estimation.contact.records import (
    CrossingSamples, Detection, FilmGroup, FilmSamples, PatchCrossing)
from smart_tire.estimation.contact.trajectory import WheelTrajectory
from smart_tire.estimation.friction.waveform_method import FilmResult, WaveformMethod
from smart_tire.estimation.friction.waveform_model import Shared
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import NS_PER_S

REPEATED = 4  # crossings of steady motion: the shape is learned, and the sampling phase varies


class ExactCrossings:
    """
    Fits exact crossings of one wheel, in the order in which they happen on a drive.

    The shape of release and bumps is learned from one to the next, as the estimator does.
    ``length_sigma`` is the relative standard deviation of the contact length, 0: it is known.
    """

    def __init__(self, robot: RobotParams, wheel: str, path: WheelTrajectory,
                 length_sigma: float = 0.0) -> None:
        self._robot, self._wheel, self._path = robot, wheel, path
        self._method = WaveformMethod(wheel, robot, length_sigma)
        self._alike: dict[tuple[object, ...], list[FilmResult | None]] = {}

    def measure(self, films: tuple[int, ...], place: Place) -> FilmResult | None:
        """
        Return what ``films``, by index, show of a crossing; None if the wheel stops in it.

        Of steady motion the first ``REPEATED`` crossings are computed, the others equal the last.
        """
        alike = self._alike.setdefault((films, *(round(one, 3) for one in place[1:])), [])
        if len(alike) < REPEATED:
            alike.append(self._measured(films, place))
        return alike[-1]

    def length_sigma(self, films: tuple[int, ...], place: Place) -> float | None:
        """Return the relative standard deviation of the contact length from such a crossing."""
        result = self.measure(films, place)
        fit = None if result is None else result.waveform
        return None if fit is None else fit.shared(Shared.LENGTH).sigma

    def _measured(self, films: tuple[int, ...], place: Place) -> FilmResult | None:
        robot, period_ns = self._robot, NS_PER_S / self._robot.film.sample_rate
        group = FilmGroup.of(robot, self._wheel, films)
        direction, stamp_ns = (1 if place.speed > 0.0 else -1), round(place.time * NS_PER_S)
        around = OUTER_LENGTH * group.film_length
        half_ns = (group.reach + around) / abs(place.speed) * NS_PER_S
        # the first sample is at any phase: that of the sampling at the instant of the crossing
        instants = np.round(period_ns * np.arange(
            math.ceil((stamp_ns - half_ns) / period_ns),
            math.floor((stamp_ns + half_ns) / period_ns) + 1)).astype(np.int64)
        begin_ns, end_ns = int(instants[0]), int(instants[-1])
        position = float(self._path.interpolate(np.array([stamp_ns]))[0])
        ahead = direction * group.reach
        travel = self._path.segment(position - ahead, position + ahead, end_ns, (begin_ns, end_ns))
        change = travel.speed_change(group.film_length)
        distance = direction * (travel.trajectory.distance_at(instants) - position)
        if not change < MAX_SPEED_CHANGE or min(-distance[0], distance[-1]) < group.reach:
            return None
        centers = [direction * offset for offset in group.offsets]
        near = [distance[np.abs(distance - center) < group.half_crossing + around]
                for center in centers]
        samples = CrossingSamples(
            tuple(FilmSamples(film, own, np.zeros(len(own)), np.zeros(len(own), dtype=np.int8))
                  for film, own in zip(films, near)),
            tuple(Detection(center, bending, place.slip, place.normalized_slip, 1.0)
                  for center, bending in zip(centers, group.bending)),
            centers[0], travel.trajectory.errors(begin_ns, end_ns))
        low, high = (one - robot.film.rest_voltage for one in group.rails)
        exact = tuple(replace(one, volts=np.clip(volts, low, high),
                              rail=(volts > high).astype(np.int8) - (volts < low))
                      for one, volts in zip(samples.films, self._method.fitter.expected(samples)))
        return self._method.measure(PatchCrossing(
            stamp_ns, direction, abs(place.speed), travel.trajectory.speed_sigma, change,
            2.0 * group.reach, begin_ns, end_ns, replace(samples, films=exact)))
