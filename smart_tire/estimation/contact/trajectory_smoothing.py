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

"""Minimum-jerk smoothing of a wheel's angle, and the smoothed trajectory with its errors."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dpbsv

from smart_tire.arrays import Array, Instants
from smart_tire.errors import EstimatorError
from smart_tire.estimation.contact.trajectory_error import shape_error_sigmas, TrajectoryErrors
from smart_tire.samples import NS_PER_S

JERK_DENSITY = 3.0       # (rad/s3)^2 s, white jerk of a speed-controlled wheel
MAX_EXTRAPOLATION = 1.0  # s, beyond the newest sample
MIN_DURATION = 1e-3      # s, of an interval with errors, ...
MIN_DISTANCE = 1e-3      # m, ... and its distance: no division by zero


class SmoothedTrajectory:
    """
    Smoothed distance [m] over instants [ns] with its error model.

    ``density`` [rad^2 s] is that of the white noise of the smoothed angles.
    """

    def __init__(self, origin_ns: int, times: Array, distance: Array, radius: float,
                 density: float) -> None:
        self._origin_ns = origin_ns
        self._times, self._distance = times, distance
        self._slopes, self._cubics = _monotone_cubics(times, distance)
        self._radius, self._density = radius, density
        self._cutoff = (JERK_DENSITY / density)**(1.0 / 6.0)  # rad/s, of the low-pass filter

    @property
    def speed_sigma(self) -> float:
        """Return the standard deviation of the speed [m/s]."""
        return self._radius * (self._density * JERK_DENSITY)**0.25

    def errors(self, begin_ns: int, end_ns: int) -> TrajectoryErrors:
        """Return the standard deviations of the distances between two instants."""
        seconds = max((end_ns - begin_ns) / NS_PER_S, MIN_DURATION)
        begin, end = self.distance_at(np.array([begin_ns, end_ns]))
        speed = max(abs(float(end - begin)), MIN_DISTANCE) / seconds
        return TrajectoryErrors(self.speed_sigma / speed, shape_error_sigmas(
            self._radius**2 * self._density, self._cutoff, seconds))

    def distance_at(self, instants: Instants) -> Array:
        """Return the distance [m] at ``instants`` [ns], with constant speed beyond the ends."""
        knots, slopes = self._times, self._slopes
        times = (instants - self._origin_ns) / NS_PER_S
        if len(knots) < 2:
            return np.full(len(times), self._distance[0])
        inner = np.minimum(np.maximum(times, knots[0]), knots[-1])
        knot, value, per_second, rise, begin, end = self._cubics[
            :, knots[1:-1].searchsorted(inner, side='right')]
        t = (inner - knot) * per_second
        remaining = 1.0 - t
        distance: Array = value + t * (rise + remaining * (remaining * begin - t * end))
        beyond = times - inner
        if beyond.any():
            beyond = np.clip(beyond, -MAX_EXTRAPOLATION, MAX_EXTRAPOLATION)
            distance += np.where(beyond > 0.0, slopes[-1], slopes[0]) * beyond
        return distance


def _monotone_cubics(times: Array, distance: Array) -> tuple[Array, Array]:
    """
    Return the slopes (n,) at the knots of a monotone cubic spline, and its pieces (6, n - 1).

    The rows of a piece: time and distance at its beginning, 1 / duration, its rise, and the
    additional rise with the slope at its beginning and with that at its end.
    """
    if len(times) < 2:
        return np.zeros(len(times)), np.empty((6, 0))
    step, rise = times[1:] - times[:-1], distance[1:] - distance[:-1]
    secant = rise / step
    before, after = secant[:-1], secant[1:]
    near, far = 2.0 * step[1:] + step[:-1], step[1:] + 2.0 * step[:-1]
    product = before * after
    # weighted harmonic means of the secants (Fritsch and Butland)
    inner = (near + far) * product / np.where(product > 0.0, near * after + far * before, np.inf)
    slopes = np.concatenate([secant[:1], inner, secant[-1:]])
    cubics = np.empty((6, len(step)))
    cubics[0], cubics[1], cubics[3] = times[:-1], distance[:-1], rise
    np.divide(1.0, step, out=cubics[2])
    np.subtract(step * slopes[:-1], rise, out=cubics[4])
    np.subtract(step * slopes[1:], rise, out=cubics[5])
    return slopes, cubics


def smooth_angles(times: Array, angles: Array, sigma: Array) -> Array:
    """
    Return ``angles`` (n,) [rad] smoothed: least squares against white jerk of ``JERK_DENSITY``.

    ``sigma`` (n,) [rad] are the standard deviations of the angles at ``times`` (n,) [s].
    """
    n = len(times)
    if n < 4:
        return angles
    # jerk over four consecutive samples: six times their third divided difference
    first, second, third, fourth = (times[j:n - 3 + j] for j in range(4))
    early, middle, late = second - first, third - second, fourth - third
    begin, end, whole = third - first, fourth - second, fourth - first
    rows = np.sqrt(12.0 / JERK_DENSITY * whole) / np.stack([
        -early * begin * whole, early * middle * end, -begin * middle * late, whole * end * late])
    products = rows[:, np.newaxis] * rows
    banded = np.zeros((4, n))  # upper form: row 3 - k holds the k-th superdiagonal
    for j in range(4):
        for k in range(j, 4):
            banded[3 - (k - j), k:n - 3 + k] += products[j, k]
    weight = 1.0 / sigma**2
    banded[3] += weight
    _, smoothed, failed = dpbsv(banded, (angles - angles[0]) * weight)
    if failed:
        raise EstimatorError(f'cannot smooth the wheel angles at {times} s: singular equations')
    found: Array = angles[0] + smoothed
    return found
