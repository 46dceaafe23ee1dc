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
Film gains, contact length and film positions from the patch crossings of recordings.

The slip comes from the slip estimator without films. Gains are inversely proportional to it, so
its error limits their accuracy. The accuracy of contact length and spacing is limited by that of
the wheel radius (``wheel_radius_sigma``) and of the film length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.film_adjustment import (
    bending_peaks, GainAdjustment, iterate, MIN_SLIP, per_film, relative_position)
from smart_tire.calibration.film_crossings import CrossingWithSlip, GainObservation
from smart_tire.calibration.priors import LIMITS, PRIORS, require
from smart_tire.calibration.results import Found, MIN_ROBUST, SIGNIFICANT_SIGMAS
from smart_tire.errors import EstimatorError
from smart_tire.numerics.least_squares import Prior, regression, Rows
from smart_tire.numerics.robust import winsorized_mean
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain, weighted_mean

MAX_SCATTER = 0.1      # rad, 9 mm of the paper's wheel: more than the error of any fit


def film_angle(angles: Sequence[float], speeds: Sequence[float]) -> Uncertain:
    """
    Return the angle [rad], 0 to 2 pi, from readings ``angles`` at ``speeds`` [rad/s].

    Raises EstimatorError with the reason if it is not observable.
    """
    if not all(map(math.isfinite, angles)):
        raise EstimatorError('wheel_states without positions')
    if len(angles) < MIN_ROBUST:
        raise EstimatorError(f'{len(angles)} crossings, expected at least {MIN_ROBUST}')
    mean = float(np.angle(np.sum(np.exp(1j * np.asarray(angles)))))
    deviations = np.angle(np.exp(1j * (np.asarray(angles) - mean)))
    fit = regression(
        Rows(np.arange(float(len(angles))), np.column_stack([np.ones(len(angles)), speeds]),
             deviations, np.zeros(len(angles))),
        Prior.of(None, PRIORS['latency of films'].prior))
    scatter = float(fit.row_sigma[0])
    if scatter > MAX_SCATTER:
        raise EstimatorError(f'angles of crossings scatter by {scatter:.2f} rad: wheel_states '
                             'positions restart within the recording')
    angle, sigma = fit.estimate(0)
    return Uncertain((mean + angle) % math.tau, sigma)


@dataclass(frozen=True, eq=False)
class FilmGain:
    """Calibration of one film, and its n crossings for figures."""

    wheel: str
    film: int                   # index, 0 for film 1
    gain: Uncertain | None      # V/m, film.stretch_gain; None if not observable
    per_slip: Uncertain | None  # V per unit of slip, see ``volts_per_slip``
    bending: Uncertain          # V, film.bending_peak: mean and its standard error
    slip: Array                 # (n,) -, of the slip estimator
    slip_sigma: Array           # (n,)
    stretch: Array              # (n,) V, observed product of ``per_slip`` and slip
    stretch_sigma: Array        # (n,) V, of the waveform alone


@dataclass(frozen=True, eq=False)
class Waveform:
    """An example: distances [m] from the patch center and voltages above the baseline."""

    wheel: str
    slip: float
    films: tuple[int, ...]
    distance: tuple[Array, ...]
    volts: tuple[Array, ...]
    fitted: tuple[Array, ...]


@dataclass(eq=False, kw_only=True)
class GainFit(Found):
    """Calibration of the films."""

    robot: RobotParams  # with all calibrated parameters
    films: list[FilmGain] = field(default_factory=list)
    length: Uncertain | None = None                             # m, of the contact
    places: dict[int, Uncertain] = field(default_factory=dict)  # m, film index -> from film 1
    # recording, wheel -> rad
    angles: dict[tuple[int, str], Uncertain] = field(default_factory=dict)
    crossings: int = 0    # with a valid waveform fit
    informative: int = 0  # of these, crossings that make gains observable
    segments: int = 0     # of constant slip
    excess: float = 1.0   # mean squared slip error of segments over the expected one, at least 1
    example: Waveform | None = None


def volts_per_slip(gain: float, film_length: float, contact_length: float) -> float:
    """
    Return the peak stretch voltage of a crossing per unit slip [V], in the limit of small slip.

    In full adhesion the stretch is largest when the film's leading edge is at the end of the
    patch, where its integral is ``slip * l (1 - l / (2 L))``.
    """
    inside = min(film_length, contact_length)
    return gain * inside * (1.0 - 0.5 * inside / contact_length)


class Results:
    """Fills a ``GainFit`` from the adjustment of the shared parameters."""

    def __init__(self, fit: GainFit, found: GainAdjustment) -> None:
        self._fit, self._found, self._robot = fit, found, found.robot
        self._result, self._index = found.result, found.result.index

    def fill(self) -> None:
        """Fill in all values and reasons."""
        self._fill_contact_length()
        for wheel in self._robot.film.wheels:
            for film in range(self._robot.film.count):
                self._fill_film(wheel, film)
        self._fill_angles()
        self._fill_positions()
        self._fit.example = self._example_crossing()

    def _fill_contact_length(self) -> None:
        fit, index = self._fit, self._index
        value, sigma = self._result.estimate(index.length)
        length = self._robot.tire.contact_length * math.exp(value)
        fit.length = fit.attempt('contact length', lambda: require(
            'contact length', Uncertain(length, sigma * length)))

    def _fill_film(self, wheel: str, film: int) -> None:
        name = f'gain of film {film + 1}, {wheel}'
        observed = [one for one in self._found.observations
                    if one.crossing.wheel == wheel and film in one.films]
        if len(observed) < MIN_ROBUST:
            self._fit.refused[name] = (f'detected in {len(observed)} crossings, expected at least '
                                       f'{MIN_ROBUST}')
            return
        informative = [observation for observation in observed if observation.gains]
        index = self._index.gain(wheel, film)
        value, sigma = self._result.estimate(index)
        nominal = self._robot.film.gains(wheel)[film]
        gain = self._fit.attempt(name, lambda: _checked(
            Uncertain(nominal * (1.0 + value), nominal * sigma), observed, informative))
        columns = np.array([self._stretch(observation, film)
                            for observation in informative]).reshape(-1, 4).T
        self._fit.films.append(FilmGain(
            wheel, film, gain, None if gain is None else self._per_slip(gain, index),
            winsorized_mean(bending_peaks(self._found.observations, wheel, film),
                            SIGNIFICANT_SIGMAS), *columns))

    def _per_slip(self, gain: Uncertain, index: int) -> Uncertain:
        """Return the volts per unit slip with the errors of gain and contact length."""
        robot, length = self._robot, self._index.length
        film, patch = robot.film.length, robot.tire.contact_length * math.exp(
            self._result.value[length])
        value = volts_per_slip(gain.value, film, patch)
        derivatives = np.array([1.0, 0.5 * film / patch / (1.0 - 0.5 * film / patch)
                                if film < patch else 0.0])
        covariance = self._result.covariance[np.ix_([index, length], [index, length])]
        return Uncertain(value, value * math.sqrt(float(derivatives @ covariance @ derivatives)))

    def _stretch(self, observation: GainObservation,
                 film: int) -> tuple[float, float, float, float]:
        """Return slip, its sigma, and the stretch voltage with the sigma of the waveform."""
        index, i, shared = self._index, observation.films.index(film), len(observation.films)
        others = np.zeros(len(observation.value))
        others[[shared, shared + 1]] = self._result.value[[index.length, index.alpha]]
        others[shared + 2:] = observation.value[shared + 2:]
        weighted = observation.precision @ (observation.value - others)
        gains = np.linalg.inv(observation.precision[:shared, :shared])
        gain = 1.0 + float((gains @ weighted[:shared])[i])
        slip, sigma = observation.crossing.slip
        scale = volts_per_slip(self._robot.film.gains(observation.crossing.wheel)[film],
                               self._robot.film.length, self._robot.tire.contact_length)
        return (slip, sigma, scale * gain * slip,
                scale * abs(slip) * math.sqrt(float(gains[i, i])))

    def _fill_angles(self) -> None:
        for recording in sorted(set(self._found.recordings)):
            for wheel in self._robot.film.wheels:
                angle = self._fit.attempt(f'angle of film 1, {wheel}',
                                          partial(self._angle, recording, wheel))
                if angle is not None:
                    self._fit.angles[recording, wheel] = angle

    def _angle(self, recording: int, wheel: str) -> Uncertain:
        """Return the angle of film 1; raise EstimatorError if not observable."""
        observed = self._angle_readings(recording, wheel, 0)
        found = film_angle([angle for _, angle, _ in observed],
                           [speed for _, _, speed in observed])
        quantum = math.tau / self._robot.encoder.counts_per_revolution  # rad
        return Uncertain(found.value, math.hypot(found.sigma, quantum / math.sqrt(12.0)))

    def _angle_readings(self, recording: int, wheel: str,
                        group: int) -> list[tuple[int, float, float]]:
        """Return time [ns], angle of a group's first film [rad] and speed [rad/s] of crossings."""
        radius, places = self._robot.wheel_radius, self._robot.film.centers
        members, found = self._found.groups[group], []
        for observation, number in zip(self._found.observations, self._found.recordings):
            crossing = observation.crossing
            film = observation.films[0]
            if number == recording and crossing.wheel == wheel and film in members:
                distance = observation.position - (places[film] - places[members[0]])
                found.append((crossing.stamp_ns, crossing.origin + distance / radius,
                              crossing.direction * crossing.speed / radius))
        return found

    def _fill_positions(self) -> None:
        """Fill positions within groups from single crossings, of groups from their angles."""
        robot = self._robot
        for number, group in enumerate(self._found.groups):
            start = Uncertain(0.0, 0.0)
            if number:
                distance = self._fit.attempt(f'spacing, film 1 to {group[0] + 1}',
                                             partial(self._distance_from_film_1, number))
                if distance is None:
                    continue
                self._fit.places[group[0]] = start = distance
            for film in group[1:]:
                offset = relative_position(self._result, film, group[0])
                if offset.sigma > LIMITS['film position'].sigma:
                    self._fit.refused[f'spacing, film 1 to {film + 1}'] = (
                        f'never detected together with film {group[0] + 1} in a crossing')
                    continue
                nominal = robot.film.centers[film] - robot.film.centers[group[0]]
                self._fit.places[film] = Uncertain(
                    start.value + nominal + offset.value, math.hypot(start.sigma, offset.sigma))

    def _distance_from_film_1(self, group: int) -> Uncertain:
        """Return the distance [m] of a group's first film from film 1; raise EstimatorError."""
        radius, parts = self._robot.wheel_radius, []
        for recording, wheel in self._fit.angles:
            references = self._angle_readings(recording, wheel, 0)
            # against the nearest crossing in time: a latency cancels
            pairs = [(reading, min(references, key=lambda other: abs(other[0] - reading[0])))
                     for reading in self._angle_readings(recording, wheel, group)]
            angle = film_angle([reading[1] - reference[1] for reading, reference in pairs],
                               [reading[2] - reference[2] for reading, reference in pairs])
            parts.append(Uncertain(radius * angle.value, radius * angle.sigma))
        if not parts:
            raise EstimatorError('requires the angle of film 1')
        mean = weighted_mean(parts)
        return Uncertain(mean.value, math.hypot(
            mean.sigma, self._robot.wheel_radius_sigma * mean.value))

    def _example_crossing(self) -> Waveform | None:
        """Return a crossing of many films with a large, yet not extreme slip."""
        informative = [one for one in self._found.observations if one.gains]
        if not informative:
            return None
        count = max(len(observation.films) for observation in informative)
        ranked = sorted((observation for observation in informative
                         if len(observation.films) == count),
                        key=lambda observation: abs(observation.crossing.slip[0]))
        observation = ranked[(3 * len(ranked)) // 4]
        samples = observation.fit.samples
        center = float(np.mean([samples.detections[i].center for i in range(len(samples.films))]))
        return Waveform(
            observation.crossing.wheel, observation.crossing.slip[0], observation.films,
            tuple(film.distance - center for film in samples.films),
            tuple(film.volts for film in samples.films),
            tuple(self._found.fitter.volts(observation)))


def _checked(gain: Uncertain, observed: Sequence[GainObservation],
             informative: Sequence[GainObservation]) -> Uncertain:
    """Return a gain; raise EstimatorError with the reason if it is refused."""
    if len(informative) < MIN_ROBUST:
        slip, sigma = max((one.crossing.slip for one in observed), key=lambda slip: abs(slip[0]))
        raise EstimatorError(
            f'{len(informative)} of {len(observed)} crossings with a slip above {MIN_SLIP:g} and '
            f'{SIGNIFICANT_SIGMAS:g} times its sigma, expected at least {MIN_ROBUST}; the largest '
            f'is {slip:.3f} ± {sigma:.3f}: turn, accelerate and brake')
    if gain.value <= 0.0:
        raise EstimatorError('negative: the poles of the film, or the direction in which it '
                             'crosses the patch, are swapped')
    return require('film gain', gain, 'the slip is not accurate enough; turn left and right')


def identify_gains(recordings: Sequence[Sequence[CrossingWithSlip]],
                   robot: RobotParams) -> GainFit:
    """
    Return the calibration from the crossings of one or more recordings.

    Raises EstimatorError if there are too few crossings that can be fitted.
    """
    robot = per_film(robot)
    found = iterate(recordings, robot)
    fit = GainFit(robot=found.robot, crossings=len(found.observations),
                  informative=sum(observation.gains for observation in found.observations),
                  segments=found.result.segments, excess=found.result.slip_variance_ratio)
    Results(fit, found).fill()
    return fit
