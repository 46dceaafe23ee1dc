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
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from smart_tire.arrays import Array
from smart_tire.calibration.film_crossings import GainObservation
from smart_tire.numerics.least_squares import Prior, solve_with_prior
from smart_tire.numerics.robust import huber_weights
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S

# shares of the smoothed slip's sigma, from simulations with default sensors: 0.55 of it lasts
# through a segment and hardly longer; 0.2 is new in every crossing at steady speed, 0.6 otherwise
SEGMENT_SLIP_SHARE, CROSSING_SLIP_SHARE = 0.6, 0.5
SEGMENT_SLIP_TOLERANCE = 0.03  # -, deviation of slip that begins a new segment
MAX_SEGMENT_PAUSE = 3.0  # s between two crossings of a segment: a revolution of a slow wheel
MIN_SIGMA = 1e-6  # -, of parameters that are configured as exact
HUBER_THRESHOLD = 2.5   # sigmas, beyond which a crossing or segment has lower weight
REWEIGHTING_ROUNDS = 8  # more do not change the result
GAIN_SIGMA, LENGTH_SIGMA, ALPHA_SIGMA, POSITION_SIGMA = 10.0, 1.0, 0.3, 1.0  # -, -, -, m; wide
FILM_LENGTH_SIGMA = 0.005  # relative, of film.length: 0.1 mm of 20 mm; assumed


@dataclass(frozen=True, slots=True, eq=False)
class ParameterIndex:
    """Order of the parameters that all crossings share."""

    wheels: tuple[str, ...]
    count: int  # films of a wheel

    def gain(self, wheel: str, film: int) -> int:
        """Return the index of the relative error of a film's gain."""
        return self.count * self.wheels.index(wheel) + film

    @property
    def length(self) -> int:
        """Return the index of ln(contact length over the nominal one)."""
        return self.count * len(self.wheels)

    @property
    def alpha(self) -> int:
        """Return the index of ln(alpha of the bending shape over the nominal one)."""
        return self.length + 1

    @property
    def radius(self) -> int:
        """Return the index of the relative error of the wheel radius."""
        return self.length + 2

    @property
    def film(self) -> int:
        """Return the index of the relative error of the film length."""
        return self.length + 3

    def position(self, film: int) -> int:
        """Return the index of the error of a film's position [m] on the circumference."""
        return self.film + 1 + film

    @property
    def size(self) -> int:
        """Return the number of these parameters."""
        return self.position(self.count)


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


def adjust(observations: Sequence[GainObservation], recordings: Sequence[int],
           robot: RobotParams) -> Adjustment:
    """Return the adjustment; ``recordings`` holds the recording's number of each observation."""
    return _Adjuster(observations, recordings, robot).solve()


def constant_slip_segments(observations: Sequence[GainObservation],
                           recordings: Sequence[int]) -> NDArray[np.intp]:
    """Return the number of each observation's segment, -1 without gains."""
    segments = np.full(len(observations), -1, dtype=np.intp)
    number, last = -1, None
    chosen = [i for i, observation in enumerate(observations) if observation.gains]
    for i in sorted(chosen, key=lambda i: (recordings[i], observations[i].crossing.wheel,
                                           observations[i].crossing.stamp_ns)):
        crossing = observations[i].crossing
        source = recordings[i], crossing.wheel
        pause = math.inf if last is None else (crossing.stamp_ns - last[1]) / NS_PER_S
        if last is None or source != last[0] or pause > MAX_SEGMENT_PAUSE or abs(
                crossing.slip[0] - last[2] / last[3]) > SEGMENT_SLIP_TOLERANCE:
            number, last = number + 1, (source, 0, 0.0, 0)
        last = source, crossing.stamp_ns, last[2] + crossing.slip[0], last[3] + 1
        segments[i] = number
    return segments


class _Adjuster:
    def __init__(self, observations: Sequence[GainObservation], recordings: Sequence[int],
                 robot: RobotParams) -> None:
        self._observations, self._recordings = observations, recordings
        self._index = index = ParameterIndex(robot.film.wheels, robot.film.count)
        self._positions = robot.film.centers
        self._segment = constant_slip_segments(observations, recordings)
        self._count = int(self._segment.max(initial=-1)) + 1
        radius = max(robot.wheel_radius_sigma, MIN_SIGMA)
        # followed by an offset of the slips of each recording, and the slip error of each segment
        sigma = np.full(index.size + max(recordings, default=-1) + 1, radius)
        sigma[:index.length] = GAIN_SIGMA
        sigma[index.length:index.position(0)] = (
            LENGTH_SIGMA, ALPHA_SIGMA, radius, FILM_LENGTH_SIGMA)
        sigma[index.position(0):index.size] = POSITION_SIGMA
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
        new = math.hypot(CROSSING_SLIP_SHARE * sigma, crossing.deviation) / abs(slip)
        excess = SEGMENT_SLIP_SHARE * max(sigma / abs(slip) - sustained, 0.0)
        return SEGMENT_SLIP_SHARE * sustained, math.hypot(new, excess)

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
