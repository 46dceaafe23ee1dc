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

"""
A sudden change of the ground, from the innovations of the forces.

The errors of the ground as given are considered: their covariance with an innovation, over their
own one, is the effect of a change of the ground on it, through all corrections since (sensitivity
of Friedland's separate bias filter). The change that explains the innovations best is a least
squares fit, its likelihood ratio the test of Willsky and Jones.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.kalman import KalmanFilter
from smart_tire.estimation.slip.noise import MAX_NIS
from smart_tire.estimation.slip.state import ESTIMATED, GROUND, N, State

SUDDEN = slice(State.LN_STIFFNESS, State.RESISTANCE + 1)  # what changes with the ground
GROUND_SIGMAS = (0.5, 0.7, 0.04, 0.3, 0.2, 0.0, 0.0)  # of another ground, in the order of State:
# ln C_x, ln mu, rolling resistance, its lateral share, ln C_y / C_x; the robot stays the same
SPREAD = np.diag(np.square(GROUND_SIGMAS[:3]))
EVIDENCE = 8.0          # twice the log likelihood ratio of a change, as of one the window tries
CHANGE_TIME = 0.3       # s, of the innovations that are compared: a robot length
MIN_VARIANCE = 1e-8     # of an error that is given as zero


class GroundChange:
    """The likelihood ratio of a change in the last ``CHANGE_TIME``."""

    def __init__(self, kalman: KalmanFilter) -> None:
        self._kalman = kalman
        self._restart()

    def _restart(self) -> None:
        self._vector, self._matrix = np.zeros(3), np.zeros((3, 3))
        self._forget_interval()

    def _forget_interval(self) -> None:
        self._new_vector, self._new_matrix = np.zeros(3), np.zeros((3, 3))

    def age(self, dt: float) -> None:
        """Let ``dt`` [s] pass: the errors have an effect since the last ``CHANGE_TIME`` only."""
        P, keep = self._kalman.P, math.exp(-dt / CHANGE_TIME)
        P[:ESTIMATED, SUDDEN] *= keep
        P[SUDDEN, :ESTIMATED] *= keep

    def add(self, covariance: Sequence[float], y: float, variance: float) -> None:
        """Add an innovation ``y`` with its ``covariance`` (3,) with the errors of the ground."""
        limit = math.sqrt(MAX_NIS * variance)
        c = np.array(covariance)
        self._new_vector += c * (min(max(y, -limit), limit) / variance)
        self._new_matrix += c[:, np.newaxis] * (c / variance)

    def find(self, weight: float, dt: float) -> Array | None:
        """
        Return the change (3,) of the ground, None if there is none.

        ``weight`` is that of the innovations since the last call, ``dt`` [s] ago.
        """
        own, keep = self._kalman.P[SUDDEN, SUDDEN], math.exp(-dt / CHANGE_TIME)
        inverse = np.linalg.inv(own + MIN_VARIANCE * np.eye(3))
        self._vector = keep * self._vector + weight * (inverse @ self._new_vector)
        self._matrix = keep * self._matrix + weight * (inverse @ self._new_matrix @ inverse)
        self._forget_interval()
        ratio = np.eye(3) + SPREAD @ self._matrix
        change = np.linalg.solve(ratio, SPREAD @ self._vector)
        if self._vector @ change - np.linalg.slogdet(ratio)[1] < EVIDENCE:
            return None
        self._restart()
        return np.asarray(change, dtype=np.float64)

    def replace(self, change: Array, covariance: Array) -> None:
        """
        Replace the errors of the ground by those (7, 7) of a ground that is ``change`` (7,) away.

        What the errors so far have caused in the state moves with the ground.
        """
        kalman, own = self._kalman, self._kalman.P[GROUND, GROUND]
        effect = kalman.P[:, GROUND] @ np.linalg.inv(own + MIN_VARIANCE * np.eye(len(own)))
        effect[GROUND] = np.eye(len(own))
        rest = np.eye(N)
        rest[:, GROUND] -= effect
        kalman.P[:] = rest @ kalman.P @ rest.T + effect @ covariance @ effect.T
        x = np.array(kalman.x) + effect @ change
        x[GROUND] = 0.0
        kalman.x[:] = array('d', x)
        self._forget_interval()
