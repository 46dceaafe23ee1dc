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
Smoothed trajectory of one wheel and its error.

For the waveform fit the trajectory is smoothed: 1 ms of timestamp jitter is 1 mm at 1 m/s, as
large as the effect of friction. The error of that minimum-jerk smoothing is noise below its
cut-off frequency: it is slow, so within a crossing a shift, a scale error and a few more Legendre
polynomials represent it.
"""

from __future__ import annotations

from functools import cache
import math

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.estimation.contact import constants as c
from smart_tire.estimation.contact.records import TrajectoryErrors
from smart_tire.estimation.plausibility import JERK_DENSITY
from smart_tire.numerics.jerk_smoothing import jerk_information, jerk_rows, solve_smoothed
from smart_tire.samples import NS_PER_S


class SmoothedTrajectory:
    """
    Smoothed distance [m] over instants [ns] with its error model.

    ``density`` [rad^2 s] is that of the white noise of the smoothed ``angles`` [rad].
    """

    def __init__(self, origin_ns: int, times: Array, angles: Array, radius: float,
                 density: float) -> None:
        self._origin_ns, self._radius, self._density = origin_ns, radius, density
        self._times = times
        slopes, self._cubics = _monotone_cubics(times, radius * angles)
        self._speeds = slopes[-1], slopes[0]

    @property
    def speed_sigma(self) -> float:
        """Return the standard deviation of the speed [m/s]."""
        return self._radius * (self._density * JERK_DENSITY)**0.25

    def errors(self, begin_ns: int, end_ns: int) -> TrajectoryErrors:
        """Return the standard deviations of the distances between two different instants."""
        seconds = (end_ns - begin_ns) / NS_PER_S
        begin, end = self.distance_at(np.array([begin_ns, end_ns]))
        cutoff = (JERK_DENSITY / self._density)**(1.0 / 6.0)  # rad/s, of the low-pass filter
        sigmas = self._radius * shape_error_sigmas(self._density, cutoff, seconds)
        needed = np.flatnonzero(sigmas > c.MIN_SHAPE_SIGMA * self._radius)
        return TrajectoryErrors(
            self.speed_sigma * seconds / max(abs(float(end - begin)), np.finfo(float).tiny),
            tuple(sigmas[:needed[-1] + 1].tolist()) if len(needed) else ())

    def distance_at(self, instants: Instants) -> Array:
        """Return the distance [m] at ``instants`` [ns], with constant speed beyond the ends."""
        times = (instants - self._origin_ns) / NS_PER_S
        # np.clip takes twice as long
        inner = np.minimum(np.maximum(times, self._times[0]), self._times[-1])
        piece = self._times[1:-1].searchsorted(inner, side='right')
        offset = inner - self._times[piece]
        cubic, square, linear, constant = self._cubics[:, piece]
        area = offset * offset
        distance: Array = constant + linear * offset + square * area + cubic * (area * offset)
        limit = c.MAX_SILENCE_NS / NS_PER_S
        beyond = times - inner
        if beyond.any():
            distance += np.where(beyond > 0.0, *self._speeds) * np.clip(beyond, -limit, limit)
        return distance


def _monotone_cubics(times: Array, distance: Array) -> tuple[Array, Array]:
    """
    Return slopes (n,) and coefficients (4, n - 1) of a spline without overshoot at a stop.

    The slopes are harmonic means of those of both secants (Fritsch and Butland). Each cubic is a
    column, highest power first, of the time since its beginning.
    """
    step = np.diff(times)
    secant = np.diff(distance) / step
    before, after = secant[:-1], secant[1:]
    product, near = before * after, step[:-1] + 2.0 * step[1:]
    far = 3.0 * (step[:-1] + step[1:]) - near
    inner = (near + far) * product / np.where(
        product > 0.0, near * after + far * before, np.inf)
    slopes = np.concatenate([secant[:1], inner, secant[-1:]])
    bend = (slopes[:-1] + slopes[1:] - 2.0 * secant) / step
    return slopes, np.array([
        bend / step, (secant - slopes[:-1]) / step - bend, slopes[:-1], distance[:-1]])


def shape_error_sigmas(density: float, cutoff: float, duration: float) -> Array:
    """
    Return the standard deviation of the Legendre polynomial of each of ``ORDERS``.

    The error has the two-sided density ``density / (1 + (w / cutoff)^6)`` over angular frequency
    w [rad/s]; ``duration`` [s] is that of the interval.
    """
    response = 1.0 / (1.0 + (c.PHASES / (cutoff * duration))**6)
    found: Array = np.sqrt(density / duration * (_polynomial_gains() @ response))
    return found


@cache
def _polynomial_gains() -> Array:
    """Return the squared coefficients of the polynomials of a unit wave, (orders, phases)."""
    from scipy.special import spherical_jn  # see docs/architecture.md, "Libraries"
    # e^(iwt) over an interval T has the coefficient (2k + 1) j_k(w T / 2) of polynomial k
    return np.array([(2 * k + 1)**2 * spherical_jn(k, 0.5 * c.PHASES)**2
                     for k in c.ORDERS]) * (c.PHASES[1] / math.pi)


def smooth_angles(times: Array, angles: Array, sigma: Array) -> Array:
    """
    Return ``angles`` (n,) [rad] smoothed: least squares against white jerk of ``JERK_DENSITY``.

    ``sigma`` (n,) [rad] are the standard deviations of the angles at ``times`` (n,) [s].
    """
    if len(times) < 4:
        return angles
    weight = 1.0 / sigma**2
    smoothed: Array = angles[0] + solve_smoothed(
        jerk_information(jerk_rows(times, JERK_DENSITY)), weight, (angles - angles[0]) * weight)
    return smoothed
