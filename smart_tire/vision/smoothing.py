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
Smoothed motion from poses of a camera: Kalman filter and RTS smoother of filterpy.

Between two measurements, velocities change by white noise, whose intensity changes along the
drive: a robot that moves steadily accelerates within some frames. The intensity of each step is
fitted to the smoothed states (MacKay's fixed point: squares over the degrees of freedom that the
data determine), with an inverse gamma prior about that of steady motion, so that the process noise
has the heavy tails of a Student t distribution. One factor scales the noise of all measurements.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array

ROUNDS = 10           # of the intensities; more change velocities by a small part of their sigma
PRIOR_WEIGHT = 0.5    # degrees of freedom of the prior of an intensity
# of the variance of a rate: three quarters of it are for changes that never come in steady motion
# (of white noise a smoother sees one quarter); that of simulated drives
RATE_SHARE = 0.42
MIN_NOISE = 0.1       # of the measurements, over the given one, where they scatter less
MIN_FREEDOM = 1e-3    # of a step, against rounding errors
START_TIME = 0.3      # s in which velocity changes reach the noise of a value, in the first round
LONGEST_TIME = 10.0    # s in which they do so in the steadiest motion
START_FACTOR = 10.0   # of the largest rate and the first noise: sigmas before the first value


@dataclass(frozen=True)
class Track:
    """Smoothed values and their rates at n instants."""

    times: Array        # (n,) s
    states: Array       # (n, 2 m): the values, then their rates [1/s]
    covariances: Array  # (n, 2 m, 2 m)
    noise: float        # factor of the standard deviations of the measurements
    density: Array      # (n - 1, m) intensity of the velocity changes in each step

    @property
    def values(self) -> Array:
        """Return the smoothed series, (n, m)."""
        return self.states[:, :self.states.shape[1] // 2]

    @property
    def rates(self) -> Array:
        """Return the derivatives of the series [1/s], (n, m)."""
        return self.states[:, self.states.shape[1] // 2:]

    def rates_at(self, times: Array, longest_step: float) -> tuple[Array, Array]:
        """
        Return rates and their variances (k, m) at ``times`` (k,).

        Rates are NaN outside of the track, and in steps above ``longest_step`` [s].
        """
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        known = (times >= self.times[0]) & (times <= self.times[-1]) & (
            self.times[after] - self.times[after - 1] <= longest_step)
        rates = np.column_stack([np.interp(times, self.times, one) for one in self.rates.T])
        spread = np.diagonal(self.covariances, axis1=1, axis2=2)[:, self.rates.shape[1]:]
        return (np.where(known[:, None], rates, np.nan),
                np.maximum(spread[after - 1], spread[after]))


def smooth(times: Array, values: Array, variances: Array, turns: Array | None = None,
           least: Array | float = 0.0, rounds: int = ROUNDS) -> Track:
    """
    Return the smoothed track of m ``values`` (n, m) at ascending ``times`` [s] (n,), n > 1.

    ``variances`` (n, m, m) are their covariances. The rates are those along axes that ``turns``
    (n - 1, m, m) turns into those of the values, by default the same ones.
    """
    model = _Model(times, values.shape[1], turns)
    scale, inverses = np.diagonal(variances.mean(0)), np.linalg.inv(variances)
    own = np.tile(scale / START_TIME ** 3, (len(times) - 1, 1))  # (n - 1, m)
    density, noise = own, 1.0
    for _ in range(rounds):
        x, P, gains = model.smoothed(values, noise * variances, density)
        error = values - x[:, :values.shape[1]]
        used = np.einsum('kij,kji->', inverses, P[:, :values.shape[1], :values.shape[1]]) / noise
        squares = np.einsum('ki,kij,kj->', error, inverses, error)
        noise = max(float(squares / max(error.size - used, 1.0)), MIN_NOISE ** 2)
        steady = 1.0 / np.mean(1.0 / own, axis=0)
        own = np.maximum(model.intensities(x, P, gains, density, steady),
                         np.maximum(scale / LONGEST_TIME ** 3, least))
        # the largest of the neighboring steps: a start does not wait for a frame; beyond the ends
        # anything may come
        padded = np.pad(own, ((1, 1), (0, 0)), 'mean')
        density = np.maximum(np.maximum(padded[:-2], own), padded[2:])
    P[:, values.shape[1]:, values.shape[1]:] *= RATE_SHARE
    return Track(times, x, P, math.sqrt(noise), density)


class _Model:
    """Random walk of the velocities: transitions and shapes of the process noise."""

    def __init__(self, times: Array, size: int, turns: Array | None) -> None:
        self._size, self._steps = size, np.diff(times)
        steps = self._steps
        turns = np.eye(size) if turns is None else turns
        self._F, self._G = (np.tile(np.eye(2 * size), (len(steps), 1, 1)) for _ in range(2))
        self._F[:, :size, size:] = turns * steps[:, None, None]
        self._G[:, :size, :size] = turns
        self._shapes = np.array([[steps ** 3 / 3.0, steps ** 2 / 2.0], [
            steps ** 2 / 2.0, steps]]).transpose(2, 0, 1)  # of white noise with intensity 1

    def smoothed(self, values: Array, variances: Array, density: Array
                 ) -> tuple[Array, Array, Array]:
        """Return states (n, 2 m), their covariances and the gains of the RTS smoother."""
        from filterpy.kalman import KalmanFilter  # its import takes a second
        size = self._size
        fastest = np.max(np.abs(np.diff(values, axis=0)) / self._steps[:, None], axis=0)
        kalman = KalmanFilter(dim_x=2 * size, dim_z=size)
        kalman.H = np.eye(size, 2 * size)
        kalman.x = np.append(values[0], np.zeros(size))[:, None]
        kalman.P = np.diag(START_FACTOR ** 2 * np.append(
            np.diag(variances[0]), fastest ** 2 + 1e-6))
        white = np.einsum('kij,ka,ab->kiajb', self._shapes, density, np.eye(size))
        Q = self._G @ white.reshape(self._G.shape) @ self._G.transpose(0, 2, 1)
        F = np.concatenate([np.eye(2 * size)[None], self._F])  # nothing happens before the first
        Q = np.concatenate([np.zeros((1, 2 * size, 2 * size)), Q])
        # (m, 1): filterpy broadcasts other shapes
        means, spreads, *_ = kalman.batch_filter(values[..., None], Fs=F, Qs=Q, Rs=variances)
        x, P, gains, _ = kalman.rts_smoother(means, spreads, F, Q)
        return x[..., 0], P, gains

    def intensities(self, x: Array, P: Array, gains: Array, density: Array,
                    steady: Array) -> Array:
        """Return intensities, (n - 1, m), for the next pass, from states of this one."""
        F, G, size = self._F, self._G, self._size
        w = np.einsum('kji,kj->ki', G, x[1:] - np.einsum('kij,kj->ki', F, x[:-1]))
        cross = F @ gains[:-1] @ P[1:]  # covariance of the propagated state and the next one
        spread = P[1:] + F @ P[:-1] @ F.transpose(0, 2, 1) - cross - cross.transpose(0, 2, 1)
        spread, inverse = G.transpose(0, 2, 1) @ spread @ G, np.linalg.inv(self._shapes)
        own = w.reshape(-1, 2, size)
        squares = np.einsum('kia,kij,kja->ka', own, inverse, own)
        blocks = spread.reshape(-1, 2, size, 2, size)
        freedom = np.clip(2.0 - np.einsum('kij,kjaia->ka', inverse, blocks) / density,
                          MIN_FREEDOM, 2.0)
        return np.asarray((PRIOR_WEIGHT * steady + squares) / (PRIOR_WEIGHT + freedom))
