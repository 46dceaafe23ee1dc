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

"""Kalman filter with considered states: plain prediction, scalar and joint corrections."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Protocol

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.state import ESTIMATED, N, SLIP_VELS, State

OUTLIER_SIGMAS = 3.0  # beyond, the variance of an innovation grows with its square; Huber's share


CONSIDERED = (np.arange(N) >= ESTIMATED).astype(float)  # (N,), 1 for states never corrected
# lasting errors of the forces and of the ICR kinematics must not calibrate sensors
SENSORS_HELD = CONSIDERED.copy()
SENSORS_HELD[[State.GYRO_BIAS_Z, State.ACCEL_BIAS_X, State.ACCEL_BIAS_Y, State.RADIUS]] = 1.0
# unequal radii and slip of the sides last: they would be taken for a bias, which a rest shows
GYRO_HELD = CONSIDERED.copy()
GYRO_HELD[[State.YAW, State.GYRO_BIAS_Z]] = 1.0


class StateRecorder(Protocol):
    """Records state transitions for the RTS smoother."""

    def record_transition(self, x: Array, P: Array, F: Array, next_x: Array,
                          next_P: Array) -> None:
        """Record the transition of ``x`` (n,), ``P`` (n, n) by ``F`` to ``next_x``, ``next_P``."""


class KalmanFilter:
    """
    Mean ``x`` (N numbers) and covariance ``P`` (N, N) of a state.

    The states from ``ESTIMATED`` on are considered (Schmidt): a correction leaves them and their
    covariance unchanged and only updates their correlation with the others. The recorder, if there
    is one, receives the transitions of the estimated states.
    """

    def __init__(self, x: list[float], P: Array, recorder: StateRecorder | None = None) -> None:
        self.x, self.P = x, P
        self._recorder = recorder

    def predict(self, next_x: list[float], F: Array, Q: Array) -> None:
        """Replace the state by ``next_x``, with Jacobian ``F`` (N, N) and noise ``Q`` (N, N)."""
        P = F @ self.P @ F.T
        P += Q
        P = 0.5 * (P + P.T)  # rounding errors would grow
        if self._recorder is not None:
            n = ESTIMATED
            self._recorder.record_transition(
                np.array(self.x[:n]), self.P[:n, :n], F[:n, :n], np.array(next_x[:n]), P[:n, :n])
        self.x, self.P = next_x, P

    def add_noise(self, Q: Array) -> None:
        """Add ``Q`` (N, N) to the covariance."""
        self.predict(list(self.x), np.eye(N), Q)

    def correct(self, y: float, rows: list[int], h: list[float], variance: float,
                shared: tuple[int, float] | None = None,
                held: Array = CONSIDERED) -> float:
        """
        Correct with the innovation ``y`` of a value with Jacobian ``h`` by the states in ``rows``.

        ``shared`` is a row and the covariance of its error with that of the measurement. Those of
        ``held`` (N,) that are 1 are not corrected but considered. An innovation beyond
        ``OUTLIER_SIGMAS`` counts less, the more the larger it is. Return its variance.
        """
        weights = np.array(h)
        PH = self.P[:, rows] @ weights
        total = float(weights @ PH[rows]) + variance
        if shared is not None:
            row, covariance = shared
            PH[row] += covariance
            total += 2.0 * covariance * h[rows.index(row)]
        scale = math.sqrt(1.0 / max(total, (y / OUTLIER_SIGMAS) ** 2))
        self._apply(scale * PH[:, None], np.array([scale * y]), held)
        return total

    def correct_jointly(self, y: Array, H: Array, R: Array, held: Array,
                        slip_held: bool) -> float:
        """
        Correct with m innovations ``y`` with Jacobian ``H`` (m, N); return the NIS over m.

        With ``slip_held`` the mean of both slips is considered, only their difference corrected.
        """
        PH = self.P @ H.T
        S = H @ PH + R
        excess = np.maximum(y ** 2 / np.diag(S) / OUTLIER_SIGMAS ** 2, 1.0) - 1.0
        S += np.diag(excess * np.diag(S))
        root = np.linalg.inv(np.linalg.cholesky(S)).T  # S^-1 = root root'
        whitened = y @ root
        self._apply(PH @ root, whitened, held, slip_held)
        return float(whitened @ whitened) / len(y)

    def _apply(self, G: Array, whitened: Array, held: Array = CONSIDERED,
               slip_held: bool = False) -> None:
        """Correct the states that are not held with independent innovations of unit variance."""
        D = G * held[:, None]  # of the optimal gain, the part that is not applied
        if slip_held:
            D[SLIP_VELS, :] = 0.5 * (G[State.SLIP_VEL_L] + G[State.SLIP_VEL_R])
        self.P = self.P - G @ G.T + D @ D.T
        self.x = (np.array(self.x) + (G - D) @ whitened).tolist()

    def set_states(self, rows: Sequence[int], value: float, sigma: float) -> None:
        """Set the states in ``rows``, uncorrelated with the others."""
        for row in rows:
            self.x[row] = value
            self.P[row, :] = self.P[:, row] = 0.0
            self.P[row, row] = sigma ** 2
