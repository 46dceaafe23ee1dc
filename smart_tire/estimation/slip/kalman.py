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

from array import array
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.equations import Correction
from smart_tire.estimation.slip.state import ESTIMATED, N, State

IDENTITY = np.eye(N)
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
    Mean ``x`` (N numbers) and covariance ``P`` (N, N) of a state, both changed in place.

    The states from ``ESTIMATED`` on are considered (Schmidt): a correction leaves them and their
    covariance unchanged and only updates their correlation with the others. The recorder, if there
    is one, receives the transitions of the estimated states.
    """

    def __init__(self, x: Sequence[float], P: Array, recorder: StateRecorder | None = None
                 ) -> None:
        self.x, self.P = array('d', x), P
        correction = Correction(self.x, P)
        self.correct, self.correct_jointly = correction.correct, correction.correct_jointly
        self.covariance, self._propagate = correction.covariance, correction.propagate
        self._correction = correction
        self._recorder = recorder

    def predict(self, next_x: array[float], F: Array, Q: Array) -> None:
        """Replace the state by ``next_x``, with Jacobian ``F`` (N, N) and noise ``Q`` (N, N)."""
        n, recorder = ESTIMATED, self._recorder
        before = None if recorder is None else (np.array(self.x[:n]), self.P[:n, :n].copy())
        self._propagate(F, Q)
        self.x[:] = next_x
        if recorder is not None and before is not None:
            recorder.record_transition(
                *before, F[:n, :n], np.array(next_x[:n]), self.P[:n, :n])

    @property
    def ground_covariance(self) -> list[float]:
        """Return the covariances (3,) of the last scalar innovation with the ground."""
        found: list[float] = self._correction.ground
        return found

    def add_noise(self, Q: Array) -> None:
        """Add ``Q`` (N, N) to the covariance."""
        self.predict(self.x, IDENTITY, Q)

    def set_states(self, rows: Sequence[int], value: float, sigma: float) -> None:
        """Set the states in ``rows``, uncorrelated with the others."""
        for row in rows:
            self.x[row] = value
            self.P[row, :] = self.P[:, row] = 0.0
            self.P[row, row] = sigma ** 2
