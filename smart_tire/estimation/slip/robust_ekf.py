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

"""Extended Kalman filter with outlier rejection and a record of its transitions, on filterpy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from filterpy.kalman import ExtendedKalmanFilter
import numpy as np

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError

OUTLIER_SIGMAS = 3.0  # beyond, the variance of a measurement is inflated


class StateRecorder(Protocol):
    """Records state transitions for the RTS smoother."""

    def record_transition(self, x: Array, P: Array, F: Array, next_x: Array,
                          next_P: Array) -> None:
        """Record the transition of ``x`` (N,), ``P`` (N, N) by ``F`` to ``next_x``, ``next_P``."""


class Measurement(NamedTuple):
    """A linearized measurement of m values."""

    z: Array         # (m,), measured
    expected: Array  # (m,), from the state
    H: Array         # (m, N), Jacobian of ``expected``
    R: Array         # (m, m), covariance of ``z``


class _NonlinearEkf(ExtendedKalmanFilter):
    """filterpy's EKF, whose input ``u`` is the predicted state itself."""

    def predict_x(self, u: Array) -> None:
        """Set the predicted state, as filterpy suggests for nonlinear models."""
        self.x = u


class RobustEkf:
    """
    Mean and covariance of a state of N values, with linearized prediction and correction.

    The transitions are passed to the ``recorder`` if there is one. The states in the rows
    ``considered`` are never corrected, but their errors are accounted for (Schmidt).
    """

    def __init__(self, x: Array, P: Array, recorder: StateRecorder | None = None,
                 considered: Sequence[int] = ()) -> None:
        self._size = len(x)
        self._recorder = recorder
        self._considered = list(considered)
        self._ekf = _NonlinearEkf(dim_x=self._size, dim_z=1)
        self._ekf.x, self._ekf.P = x[:, None], P

    @property
    def x(self) -> Array:
        """Return the state, shape (N,)."""
        state: Array = self._ekf.x[:, 0]
        return state

    @property
    def P(self) -> Array:
        """Return the covariance, shape (N, N)."""
        covariance: Array = self._ekf.P
        return covariance

    def predict(self, next_x: Array, F: Array, Q: Array) -> None:
        """Replace the state by ``next_x`` (N,), with Jacobian ``F`` and noise ``Q`` (N, N)."""
        ekf, x, P = self._ekf, self.x, self.P
        ekf.F, ekf.Q = F, Q
        ekf.predict(u=next_x[:, None])
        self._symmetrize()
        if self._recorder is not None:
            self._recorder.record_transition(x, P, F, next_x, ekf.P)

    def correct(self, measurement: Measurement, considered: Sequence[int] = ()) -> float:
        """
        Correct the state; return the normalized innovation squared (NIS) over m.

        The variance of an innovation beyond ``OUTLIER_SIGMAS`` grows with its square: a single
        outlier hardly changes the state, persistent innovations prevail in the end. The states in
        the rows ``considered`` are not corrected either.
        """
        z, expected, H, R = measurement
        y, P = z - expected, self.P
        S = H @ P @ H.T + R
        excess = np.maximum(y ** 2 / np.diag(S) / OUTLIER_SIGMAS ** 2, 1.0)
        if excess.max() > 1.0:
            extra = np.diag((excess - 1.0) * np.diag(S))
            R, S = R + extra, S + extra
        K = np.linalg.solve(S, H @ P).T
        K[[*self._considered, *considered]] = 0.0
        keep = np.eye(self._size) - K @ H
        self._ekf.x = self._ekf.x + (K @ y)[:, None]
        self._ekf.P = keep @ P @ keep.T + K @ R @ K.T  # Joseph form, for any gain
        self._symmetrize()
        return float(y @ np.linalg.solve(S, y)) / len(z)

    def correct_states(self, rows: Sequence[int], z: Array, variances: Array) -> None:
        """Correct with direct measurements of the states in ``rows``."""
        H = np.zeros((len(rows), self._size))
        H[range(len(rows)), rows] = 1.0
        self.correct(Measurement(z, self.x[list(rows)], H, np.diag(variances)))

    def set_states(self, rows: Sequence[int], values: float, sigma: float) -> None:
        """Set the states in ``rows``, uncorrelated with the others."""
        ekf, rows = self._ekf, list(rows)
        ekf.x[rows] = values
        ekf.P[rows, :] = 0.0
        ekf.P[:, rows] = 0.0
        ekf.P[rows, rows] = sigma ** 2

    def _symmetrize(self) -> None:
        ekf, n = self._ekf, self._size
        if ekf.x.shape != (n, 1) or ekf.P.shape != (n, n):  # filterpy broadcasts silently
            raise EstimatorError(f'state {ekf.x.shape}, covariance {ekf.P.shape}, expected {n}')
        ekf.P = 0.5 * (ekf.P + ekf.P.T)
