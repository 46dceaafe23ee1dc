# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True, infer_types=True, show_performance_hints=False

"""
Kalman filter with considered (Schmidt) states, robust to outliers.

It predicts, and corrects with one or two innovations; motion and measurement models are those of
the caller (``filter``, ``ground``). ``state`` names the rows.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler (types:
``kalman.pxd``). Without one, numpy takes the place of loops over the covariance.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
import math
import sys
from typing import Protocol

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip import state
from smart_tire.estimation.slip.state import ESTIMATED, N, State

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.libc.math import sqrt
else:
    from math import sqrt

COMPILED: bool = cython.compiled
LOOPS = COMPILED  # over the covariance, otherwise numpy: loops in Python would take milliseconds

INFINITY, OUTLIER_SIGMAS = math.inf, state.OUTLIER_SIGMAS
MIN_SHARE = math.sqrt(sys.float_info.epsilon)  # of a variance given other states: half the digits
X, Y, YAW, GYRO_BIAS_Z, LN_STIFFNESS, LN_FRICTION, RESISTANCE = map(int, (
    State.X, State.Y, State.YAW, State.GYRO_BIAS_Z, State.LN_STIFFNESS, State.LN_FRICTION,
    State.RESISTANCE))

IDENTITY = np.eye(N)
CONSIDERED = (np.arange(N) >= ESTIMATED).astype(float)  # (N,), 1 for states never corrected
# values of ``held``: lasting slip and unequal radii of the sides would be taken for a gyro bias,
# which is observed at standstill, and vibrations of the accelerometer in turns for a lever arm
GYRO_HELD = CONSIDERED.copy()
GYRO_HELD[[State.YAW, State.GYRO_BIAS_Z, State.IMU_Y]] = 1.0
# lasting errors of the force balance and of the ICR kinematics must not be taken for sensor errors
SENSORS_HELD = GYRO_HELD.copy()
SENSORS_HELD[[State.ACCEL_BIAS_X, State.ACCEL_BIAS_Y, State.RADIUS]] = 1.0
FORCES_HELD = SENSORS_HELD.copy()  # the window knows the position of the IMU
FORCES_HELD[[State.IMU_X, State.IMU_Y]] = 1.0


class LearnedVariance:
    """Exponential mean of a variance over ``time`` [s], from a prior standard deviation."""

    def __init__(self, sigma: float, floor: float, time: float) -> None:
        self._variance, self._floor, self._time = sigma * sigma, floor * floor, time
        self.variance = max(self._variance, self._floor)  # at least the square of the floor

    def add_square(self, square: float, duration: float) -> None:
        """Add a squared value that held for ``duration`` [s]."""
        gain = min(duration / self._time, 1.0)
        self._variance += gain * (square - self._variance)
        self.variance = max(self._variance, self._floor)


class StateRecorder(Protocol):
    """Records state transitions for the RTS smoother."""

    def record_transition(self, x: Array, P: Array, F: Array, next_x: Array,
                          next_P: Array) -> None:
        """Record the transition of ``x`` (n,), ``P`` (n, n) by ``F`` to ``next_x``, ``next_P``."""


class KalmanFilter:
    """
    Mean ``x`` (n numbers) and covariance ``P`` (n, n) of a state, both changed in place.

    ``held`` (n,) is 1 for states that are considered (Schmidt): a correction leaves them and their
    covariance unchanged and only updates their correlation with the others. The recorder, if there
    is one, receives the transitions of the estimated states.
    """

    def __init__(self, x: Sequence[float], P: Array, recorder: StateRecorder | None = None
                 ) -> None:
        self.x, self.P, self._recorder = array('d', x), P, recorder
        self._x, self._P = self.x, P
        # of the last scalar innovation with ln C_x, ln mu and rolling resistance
        self.ground = [0.0] * 3
        self._A, self._G = np.empty_like(P), np.empty((3, len(x)))

    def predict(self, next_x: array[float], F: Array, Q: Array) -> None:
        """Replace the state by ``next_x``, with Jacobian ``F`` (n, n) and noise ``Q`` (n, n)."""
        n, recorder = ESTIMATED, self._recorder
        if recorder is None:
            self._propagate(F, Q)
            self.x[:] = next_x
            return
        x, P = np.array(self.x[:n]), self.P[:n, :n].copy()
        self._propagate(F, Q)
        self.x[:] = next_x
        recorder.record_transition(
            x, P, np.asarray(F)[:n, :n], np.array(next_x[:n]), self.P[:n, :n])

    def add_noise(self, Q: Array) -> None:
        """Add ``Q`` (n, n) to the covariance."""
        if self._recorder is None:
            self.P += Q
        else:
            self.predict(self.x, IDENTITY, Q)

    def is_sound(self) -> bool:
        """Return whether the state is finite and no variance is negative."""
        x, P = self._x, self._P
        for i in range(P.shape[0]):
            # comparisons with NaN are false
            if not (-INFINITY < x[i] < INFINITY and 0.0 <= P[i, i] < INFINITY):
                return False
        return True

    def fade_ground(self, keep: float) -> None:
        """Multiply the covariances of the corrected states with the changing ground."""
        P = self._P
        for i in range(LN_STIFFNESS):
            for j in range(LN_STIFFNESS, RESISTANCE + 1):
                P[i, j] *= keep
                P[j, i] *= keep

    def set_states(self, rows: Sequence[int], value: float, sigma: float) -> None:
        """Set the states in ``rows``, uncorrelated with the others."""
        for row in rows:
            self.x[row] = value
            self.P[row, :] = self.P[:, row] = 0.0
            self.P[row, row] = sigma ** 2

    def _propagate(self, F: Array, Q: Array) -> None:
        """Replace the covariance by F P F' + Q."""
        A, P = self._A, self._P
        if not LOOPS:
            full = np.asarray(F) @ np.asarray(P) @ np.asarray(F).T + np.asarray(Q)
            np.asarray(P)[:] = 0.5 * (full + full.T)  # rounding errors would grow
            return
        A[:, :] = 0.0
        for i in range(P.shape[0]):
            for k in range(P.shape[0]):
                by = F[i, k]
                if by != 0.0:
                    for j in range(P.shape[0]):
                        A[i, j] += by * P[k, j]
        P[:, :] = Q
        for j in range(P.shape[0]):
            self._fill_column(F, j)

    def _fill_column(self, F: Array, j: cython.Py_ssize_t) -> None:
        """Add (F P) F' to the lower half of a column of Q, and copy it to the row."""
        A, P = self._A, self._P
        for k in range(P.shape[0]):
            by = F[j, k]
            if by != 0.0:
                for i in range(j, P.shape[0]):
                    P[i, j] += by * A[i, k]
        for i in range(j, P.shape[0]):
            P[j, i] = P[i, j]

    def correct(self, y: float, h: Array, variance: float, held: Array, row: cython.int = 0,
                shared: float = 0.0) -> float:
        """
        Correct with an innovation ``y`` with Jacobian ``h`` (n,); return its variance.

        ``shared`` is the covariance of the error of the state in ``row`` with that of the
        measurement. An innovation beyond ``OUTLIER_SIGMAS`` counts less, the more the larger it
        is.
        """
        g = self._G[0]
        self._project(h, g)
        total = variance + _dot(h, g) + 2.0 * shared * h[row]
        g[row] += shared
        self.ground = [g[LN_STIFFNESS], g[LN_FRICTION], g[RESISTANCE]]
        self._apply(g, y, max(total, _least_variance(y)), held)
        return total

    def correct_jointly(self, y: Array, H: Array, R: Array, held: Array) -> float:
        """
        Correct with two innovations ``y`` with Jacobian ``H`` (2, n); return the NIS over 2.

        First with ``y[0]``, then with the part of ``y[1]`` that is not correlated with it. NIS:
        normalized innovation squared.
        """
        g, other = self._G[0], self._G[1]
        first, both, second = self.covariance(H, R)
        first = max(first, _least_variance(y[0]))
        scale = 1.0 / sqrt(first)
        root = both * scale
        share = root * scale
        new = y[1] - share * y[0]
        second = max(second - root * root, _least_variance(new))
        for i in range(g.shape[0]):
            other[i] -= share * g[i]
        self._apply(g, y[0], first, held)
        self._apply(other, new, second, held)
        return 0.5 * (y[0] * y[0] / first + new * new / second)

    def covariance(self, H: Array, R: Array) -> tuple[float, float, float]:
        """Return variance, covariance and variance of two innovations: H P H' + R."""
        self._project(H[0], self._G[0])
        self._project(H[1], self._G[1])
        return (_dot(H[0], self._G[0]) + R[0, 0], _dot(H[0], self._G[1]) + R[0, 1],
                _dot(H[1], self._G[1]) + R[1, 1])

    def _project(self, h: Array, out: Array) -> None:
        """Set ``out`` to P h."""
        P = self._P
        if not LOOPS:
            np.matmul(P, h, out=np.asarray(out))
            return
        out[:] = 0.0
        for i in range(h.shape[0]):
            by = h[i]
            if by != 0.0:
                for j in range(h.shape[0]):
                    out[j] += by * P[i, j]

    def _apply(self, g: Array, y: float, variance: float, held: Array) -> None:
        """Correct with an innovation ``y``; ``g``, its covariance with ``x``, is overwritten."""
        x, P = self._x, self._P
        d = self._G[2]  # of g, the part that is not applied
        scale = 1.0 / sqrt(variance)
        for i in range(g.shape[0]):
            g[i] *= scale
            d[i] = held[i] * g[i]
        if held[YAW]:
            self._hold_position(d)
        for i in range(g.shape[0]):
            x[i] += (g[i] - d[i]) * (y * scale)
        if not LOOPS:
            np.asarray(P)[:] -= np.outer(g, g) - np.outer(d, d)
            return
        for i in range(g.shape[0]):
            applied, held_part = g[i], d[i]
            for j in range(g.shape[0]):
                P[i, j] -= applied * g[j] - held_part * d[j]

    def _hold_position(self, d: Array) -> None:
        """
        Hold the part of the position that it shares with the held heading and gyro bias.

        Otherwise an error that must not be taken for one of the gyroscope moves the robot as if it
        were one: by decimeters at rest after a drive of 10 m. ``d`` are the parts not applied; the
        regression of the position on heading and bias is by their covariance.
        """
        P = self._P
        yaw, bias = P[YAW, YAW], P[GYRO_BIAS_Z, GYRO_BIAS_Z]
        share = P[YAW, GYRO_BIAS_Z] / bias if bias > 0.0 else 0.0
        rest = yaw - share * P[YAW, GYRO_BIAS_Z]
        # unless the bias determines the heading
        by_yaw = (d[YAW] - share * d[GYRO_BIAS_Z]) / rest if rest > MIN_SHARE * yaw else 0.0
        by_bias = d[GYRO_BIAS_Z] / bias - share * by_yaw if bias > 0.0 else 0.0
        for row in (X, Y):
            d[row] = P[row, YAW] * by_yaw + P[row, GYRO_BIAS_Z] * by_bias


def _least_variance(y: float) -> float:
    """Return the least variance of an innovation: outliers count less, the larger they are."""
    return (y / OUTLIER_SIGMAS) * (y / OUTLIER_SIGMAS)


def _dot(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total
