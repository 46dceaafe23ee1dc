# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random crossings synthesized from the exact model with sensor errors."""

from __future__ import annotations

from benchmarks.friction.grid import Case, ERRORS, LOAD, WHEEL
import numpy as np
from smart_tire.arrays import Array
from smart_tire.estimation.contact.constants import OUTER_LENGTH
from smart_tire.estimation.contact.detection import CrossingDetector
from smart_tire.estimation.contact.records import (
    CrossingSamples, Detection, FilmSamples, PatchCrossing)
from smart_tire.estimation.ground.estimator import WheelState
from smart_tire.models.tire import tread_film
from smart_tire.samples import NS_PER_S
from smart_tire.simulation.films import bump, SignalChain
from smart_tire.uncertain import Uncertain

BUMP_RANGE = min(ERRORS.bumps), max(ERRORS.bumps)
TRUE_SLIP_SIGMA = 1e-6                  # -
SEARCH_RANGE = 0.019          # m, around the true position of a film, for its detection


class CrossingSynthesizer:
    """
    Generates random crossings of a case.

    ``gain_error`` is the relative standard deviation of the gains between crossings, by default
    their tolerance.
    """

    def __init__(self, case: Case, seed: int, gain_error: float | None = None) -> None:
        self._case, self._robot = case, case.robot
        film = self._robot.film
        self._gain_error = film.stretch_gain_tolerance if gain_error is None else gain_error
        self._rng = np.random.default_rng(seed)
        self._detector = CrossingDetector(self._robot)
        self._chain = SignalChain(film)
        self._margin = OUTER_LENGTH * film.length  # m, of samples around a crossing

    def crossing(self) -> PatchCrossing:
        """Return the next crossing at a time of 1 s; the reference distance is 0."""
        film, patch = self._robot.film, self._robot.tire.contact_length
        half, speed = 0.5 * (patch + film.length), self._case.speed
        step = speed / film.sample_rate
        distance = np.arange(-half - self._margin + step * self._rng.uniform(),
                             half + self._margin + film.spacing, step)
        positions = (0.0, film.spacing)  # of the film centers; film 1 enters first
        samples = [self._film(i, distance, position, half)
                   for i, position in enumerate(positions)]
        detections = [self._detect(one, position) for one, position in zip(samples, positions)]
        seen = [(one, detection) for one, detection in zip(samples, detections)
                if detection is not None]
        inside = round(0.5 * (patch - film.length) / speed * NS_PER_S)
        first = NS_PER_S - round(0.5 * film.spacing / speed * NS_PER_S)
        detected = CrossingSamples(tuple(one for one, _ in seen),
                                   tuple(detection for _, detection in seen), 0.0)
        return PatchCrossing(
            NS_PER_S, 1, speed, 0.0, 0.0, 2.0 * half + film.spacing, first - inside,
            first + inside, detected if seen else None)

    def _film(self, film: int, distance: Array, position: float, half: float) -> FilmSamples:
        case, params, rng = self._case, self._robot.film, self._rng
        patch = self._robot.tire.contact_length
        relative = distance - position
        relative = relative[np.abs(relative) < half + self._margin]
        x = relative + 0.5 * (patch - params.length)
        spread = ERRORS.bending_variation
        peak = params.bending(WHEEL)[film] * (1.0 + rng.uniform(-spread, spread))
        gain = params.gains(WHEEL)[film] * (1.0 + self._gain_error * rng.standard_normal())
        before, after = rng.uniform(*BUMP_RANGE, 2).tolist()
        voltage = {release: tread_film.crossing_voltage(
            x, slip=case.slip, total_slip=case.total_slip, critical_slip=case.critical_slip,
            film_length=params.length, contact_length=patch, bending_peak=peak,
            bending_alpha=params.bending_alpha, stretch_gain=gain, release=release)
            for release in tread_film.RELEASES}
        volts = voltage.pop(params.release)
        if case.release_share > 0.0:
            other, = voltage.values()
            volts = (1.0 - case.release_share) * volts + case.release_share * other
        volts = (volts - peak * self._bumps(relative, half, before, after)
                 + params.noise * rng.standard_normal(len(x)))
        counts = self._chain.counts(volts)
        rail = (counts == self._chain.max_count).astype(np.int8) - (counts == 0)
        return FilmSamples(film, position + relative, self._chain.volts(counts), rail)

    def _bumps(self, relative: Array, half: float, before: float, after: float) -> Array:
        """Return the bumps with heights ``before`` and ``after`` the contact."""
        case, first = self._case, relative < 0.0
        offset = np.abs(relative) - half - np.where(first, *case.bump_distance)
        return np.where(first, before, after) * bump(
            offset, np.where(first, *case.bump_width), case.bump_shape)

    def _detect(self, one: FilmSamples, position: float) -> Detection | None:
        film, usable = self._robot.film, one.rail == 0
        return self._detector.detect(
            one.distance[usable], one.volts[usable], bending=film.bending(WHEEL)[one.film],
            gain=film.gains(WHEEL)[one.film],
            between=(position - SEARCH_RANGE, position + SEARCH_RANGE))

    def state(self) -> WheelState:
        """Return the true state of the wheel."""
        case = self._case
        return WheelState(
            slip=Uncertain(case.slip, TRUE_SLIP_SIGMA), load=Uncertain(LOAD, 0.0),
            normalized_slip=Uncertain(case.normalized_slip, 0.0),
            stiffness=Uncertain(self._robot.tire.longitudinal_stiffness, 0.0),
            friction=Uncertain(case.mu, 0.0), critical_slip=Uncertain(case.critical_slip, 0.0))
