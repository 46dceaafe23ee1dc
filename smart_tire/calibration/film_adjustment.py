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
Joint adjustment of all patch crossings: gains, contact length and film positions.

Weighted least squares over the observations of the crossings. The error of the slip scales the
gains; it is split into a part that is new in every crossing and a part that lasts through a
segment of constant slip of a wheel: more crossings of one steady turn do not improve the gains
beyond the accuracy of the slip estimate in that turn. An error of the wheel radius adds the same
to all slips; it is observable if a recording contains both signs of slip. Errors of the wheel
radius and of the film length scale all measured lengths. Observations and segments with large
residuals have lower weight (Huber); if segments scatter more than expected, all their variances
are scaled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from smart_tire.arrays import Array
from smart_tire.calibration.film_crossings import (
    CrossingWithSlip, EXACT_SIGMA, GainObservation, ObservationFitter)
from smart_tire.calibration.priors import LIMITS, PRIORS, UNINFORMATIVE
from smart_tire.calibration.results import MIN_ROBUST, SIGNIFICANT_SIGMAS
from smart_tire.errors import EstimatorError
from smart_tire.numerics.least_squares import (
    HUBER_THRESHOLD, Prior, REWEIGHTING_ROUNDS, solve_with_prior)
from smart_tire.numerics.robust import huber_weights, winsorized_mean
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain

# of the smoothed slip's sigma: lasts through a segment and hardly longer, and is new in every
# crossing with changing speed; from simulations with default sensors
SLIP_SHARE = 0.6
# -, slip below which the stretch signal of a crossing is lost in that of bending, and deviation of
# slip that begins a new segment
MIN_SLIP = 0.03
MAX_ITERATIONS = 5      # of fits, each with the result of the previous one
CONVERGED_SIGMAS = 0.3  # standard errors; a smaller change ends the iteration


class ParameterIndex:
    """
    Order of the parameters that all crossings share.

    Relative errors of the gains, ``length`` and ``alpha`` of the bending shape as ln over the
    nominal ones, relative errors of wheel ``radius`` and ``film`` length, and errors of the films'
    positions on the circumference [m].
    """

    def __init__(self, robot: RobotParams) -> None:
        self._wheels, self._count = robot.film.wheels, robot.film.count
        self.length = self._count * len(self._wheels)
        self.alpha, self.radius, self.film, self._first = range(self.length + 1, self.length + 5)
        self.size = self._first + self._count

    def gain(self, wheel: str, film: int) -> int:
        """Return the index of the gain of a film."""
        return self._count * self._wheels.index(wheel) + film

    def position(self, film: int) -> int:
        """Return the index of the position of a film."""
        return self._first + film


@dataclass(frozen=True, slots=True, eq=False)
class Adjustment:
    """Result of the joint adjustment."""

    index: ParameterIndex
    value: Array                # (n,), in the order of ``index``
    covariance: Array           # (n, n)
    segments: int               # of constant slip
    slip_variance_ratio: float  # of the segments' slip errors over the expected, at least 1

    def estimate(self, index: int) -> tuple[float, float]:
        """Return a parameter and its standard error."""
        return float(self.value[index]), math.sqrt(float(self.covariance[index, index]))


def constant_slip_segments(observations: Sequence[GainObservation],
                           recordings: Sequence[int]) -> NDArray[np.intp]:
    """Return the number of each observation's segment, -1 without gains: such ones end it."""
    segments = np.full(len(observations), -1, dtype=np.intp)
    number, wheel, slips = -1, None, [0.0]
    for i, crossing in sorted(
            ((i, one.crossing) for i, one in enumerate(observations)),
            key=lambda item: (recordings[item[0]], item[1].wheel, item[1].stamp_ns)):
        if not observations[i].gains:
            wheel = None
            continue
        source, slip = (recordings[i], crossing.wheel), crossing.slip.value
        if source != wheel or abs(slip - sum(slips) / len(slips)) > MIN_SLIP:
            number, wheel, slips = number + 1, source, []
        slips.append(slip)
        segments[i] = number
    return segments


class _Adjuster:
    """Adjusts observations; ``recordings`` holds the recording's number of each of them."""

    def __init__(self, observations: Sequence[GainObservation], recordings: Sequence[int],
                 robot: RobotParams) -> None:
        self._observations, self._recordings = observations, recordings
        self._index = index = ParameterIndex(robot)
        self._positions = robot.film.centers
        self._segment = constant_slip_segments(observations, recordings)
        self._count = int(self._segment.max(initial=-1)) + 1
        radius = max(robot.wheel_radius_sigma, EXACT_SIGMA)
        # followed by an offset of the slips of each recording, and the slip error of each segment
        sigma = np.full(index.size + max(recordings, default=-1) + 1, radius)
        sigma[:index.size] = UNINFORMATIVE.sigma
        sigma[index.alpha:index.position(0)] = (
            PRIORS['ln of alpha'].sigma, radius, PRIORS['length of a film'].sigma)
        self._common = sigma
        relative = np.array([one.crossing.slip[1] / abs(one.crossing.slip[0])
                             for one in observations])
        self._relative = [float(np.median(relative[self._segment == number]))
                          for number in range(self._count)]  # relative sigma of slip per segment

    def _row(self, i: int) -> tuple[Array, Array]:
        """Return derivatives (k, p) by all parameters and values (k,), with unit noise."""
        observation, index, first = self._observations[i], self._index, self._observations[i].films
        size, count = len(observation.value), len(observation.films) * observation.gains
        rows = np.zeros((size, len(self._common) + self._count))
        value, precision = observation.value.copy(), observation.precision
        length, alpha = count, count + 1
        # an error of the scale of distances, and of the film length
        rows[:, index.radius], rows[:, index.film] = -observation.by_scale, observation.by_scale
        rows[length, [index.length, index.film]] += 1.0, -1.0
        rows[alpha, [index.alpha, index.film]] += 1.0, 1.0
        for row, film in enumerate(observation.films[1:], count + 2):
            distance = self._positions[film] - self._positions[first[0]]
            rows[row, [index.position(film), index.position(first[0]), index.film]] += (
                1.0, -1.0, -distance)
            value[row] -= distance
        if observation.gains:
            slip, (sustained, new) = observation.crossing.slip[0], self._slip_errors(i)
            gains = np.arange(size) < count
            for row, film in enumerate(observation.films):
                rows[row, index.gain(observation.crossing.wheel, film)] = 1.0
            rows[:, index.size + self._recordings[i]] = gains * (1.0 - slip) / slip
            rows[:, len(self._common) + self._segment[i]] = sustained * gains
            # Sherman-Morrison: adds the variance of the new part of the slip error
            product = precision @ (new * gains)
            precision = precision - np.outer(product, product) / (1.0 + new * gains @ product)
        root = np.linalg.cholesky(precision).T
        return root @ rows, root @ value

    def _slip_errors(self, i: int) -> tuple[float, float]:
        """
        Return the relative slip errors: the part common to the segment, and the new part.

        The first is the same for all crossings of a segment. If it followed each sigma, it would
        be observable from the difference of two crossings, which it is not.
        """
        crossing = self._observations[i].crossing
        slip, sigma = crossing.slip
        sustained = self._relative[self._segment[i]]
        new = math.hypot(SLIP_SHARE * sigma, crossing.deviation) / abs(slip)
        excess = SLIP_SHARE * max(sigma / abs(slip) - sustained, 0.0)
        return SLIP_SHARE * sustained, math.hypot(new, excess)

    def solve(self) -> Adjustment:
        """Solve by iteratively reweighted least squares, of observations and of segments."""
        blocks = [self._row(i) for i in range(len(self._observations))]
        matrix, value = (np.concatenate(part) for part in zip(*blocks))
        dof = np.array([len(block) for _, block in blocks])
        own, of = len(self._common), np.repeat(np.arange(len(blocks)), dof)
        weight, segment_weight, ratio = np.ones(len(blocks)), np.ones(self._count), 1.0
        for _ in range(REWEIGHTING_ROUNDS):
            prior = np.concatenate([self._common, np.sqrt(ratio / segment_weight)])
            scale = np.sqrt(weight)[of]
            rows = matrix * scale[:, None]
            found, _ = solve_with_prior(rows, value * scale, Prior(np.zeros(len(prior)), prior))
            covariance = np.linalg.inv(rows.T @ rows + np.diag(prior ** -2.0))
            squares = np.bincount(of, (value - matrix @ found) ** 2)
            excess = max(1.0, float(np.median(squares / chdtri(dof, 0.5))))
            weight = huber_weights(np.sqrt(squares / (dof * excess)), HUBER_THRESHOLD) / excess
            ratio = _slip_variance_ratio(found[own:], np.diag(covariance)[own:], ratio)
            segment_weight = huber_weights(found[own:] / math.sqrt(ratio), HUBER_THRESHOLD)
        size = self._index.size
        return Adjustment(self._index, found[:size], covariance[:size, :size], self._count, ratio)


def _slip_variance_ratio(errors: Array, variance: Array, previous: float) -> float:
    """Return the variance of the segments' slip ``errors`` over the expected one, at least 1."""
    dof = float(np.sum(1.0 - variance / previous))
    if dof < 1.0:
        return previous
    clipped = np.minimum(errors ** 2, HUBER_THRESHOLD ** 2 * previous)
    return max(1.0, float(np.sum(clipped)) / dof)


@dataclass(frozen=True, eq=False)
class GainAdjustment:
    """An adjustment with the observations, the robot and the fitter it is based on."""

    observations: list[GainObservation]
    recordings: list[int]          # number of the recording of each observation
    robot: RobotParams             # nominal parameters of ``result``
    groups: list[tuple[int, ...]]  # of films that cross the patch together
    fitter: ObservationFitter
    result: Adjustment


def bending_peaks(observations: Sequence[GainObservation], wheel: str, film: int) -> list[float]:
    """Return the bending peaks [V] of a film in all observations."""
    return [observation.bending[observation.films.index(film)] for observation in observations
            if observation.crossing.wheel == wheel and film in observation.films]


def relative_position(result: Adjustment, film: int, reference: int) -> Uncertain:
    """Return the offset [m] of a film from its nominal position, relative to another film."""
    both = [result.index.position(film), result.index.position(reference)]
    variance = np.array([1.0, -1.0]) @ result.covariance[np.ix_(both, both)] @ [1.0, -1.0]
    return Uncertain(float(result.value[both[0]] - result.value[both[1]]),
                     math.sqrt(max(float(variance), 0.0)))


def per_film(robot: RobotParams) -> RobotParams:
    """Return ``robot`` with one value per film of each wheel."""
    film = robot.film
    gains, bending = ([value for wheel in film.wheels for value in values(wheel)]
                      for values in (film.gains, film.bending))
    return replace(robot, film=replace(film, stretch_gain=tuple(gains),
                                       bending_peak=tuple(bending)))


def iterate(recordings: Sequence[Sequence[CrossingWithSlip]],
            robot: RobotParams) -> GainAdjustment:
    """Fit all crossings until the shared parameters converge."""
    groups = robot.film_groups
    for _ in range(MAX_ITERATIONS):
        fitter = ObservationFitter(robot)
        observed = [(observation, i) for i, crossings in enumerate(recordings)
                    for crossing in crossings
                    if (observation := fitter.fit_crossing(
                        crossing, gains=_makes_gains_observable(crossing))) is not None]
        observations, sources = [observation for observation, _ in observed], [
            i for _, i in observed]
        if len(observations) < MIN_ROBUST:
            raise EstimatorError(
                f'{len(observations)} crossings of films could be fitted, of '
                f'{sum(map(len, recordings))} with known slip; expected at least {MIN_ROBUST}')
        result = _Adjuster(observations, sources, robot).solve()
        found = GainAdjustment(observations, sources, robot, groups, fitter, result)
        change = result.value / np.sqrt(np.diag(result.covariance))
        robot = _updated(found)
        if np.max(np.abs(change[:result.index.radius])) < CONVERGED_SIGMAS:
            break
    return found


def _makes_gains_observable(crossing: CrossingWithSlip) -> bool:
    slip, sigma = crossing.slip
    return abs(slip) > max(MIN_SLIP, SIGNIFICANT_SIGMAS * sigma)


def _updated(found: GainAdjustment) -> RobotParams:
    """Return the robot with the adjusted parameters."""
    robot, result = found.robot, found.result
    film, index = robot.film, result.index
    factor = 1.0 + result.value[:index.length]
    factor = np.where(factor > 0.0, factor, 1.0)  # else its poles are swapped
    length, alpha = np.exp(result.value[[index.length, index.alpha]]).tolist()
    peaks = (bending_peaks(found.observations, wheel, i)
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


def _position_offsets(found: GainAdjustment) -> list[float]:
    """Return the offset [m] of each film from its nominal position, relative to its group."""
    offsets = [0.0] * found.robot.film.count
    for group in found.groups:
        for film in group[1:]:
            offset = relative_position(found.result, film, group[0])
            if offset.sigma < LIMITS['film position'].sigma:
                offsets[film] = offset.value
    return offsets
