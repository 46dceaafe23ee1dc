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

"""Coefficients of the slip of a skid-steer robot, learned recursively from its estimated slip."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.models.vehicle.steady_turn import steady_turn, TurnModel

FIRM_RESISTANCE = 0.01   # -, slip of a tire driving straight on firm ground
SIGMAS = (0.08, 0.02, 0.3, 1.0)   # prior standard deviations, in the order of Coefficient
TIMES = (30.0, 5.0, 60.0, 60.0)   # s, correlation times of each
LOW = (-0.05, -0.2, 0.0, 0.0)     # limits of each
HIGH = (0.5, 0.2, 3.0, 5.0)
STEPS = (0.01, 0.01, 0.02, 0.02)  # of the numerical derivative by each
MODEL_SIGMA = 0.03       # of a slip velocity or lateral speed, over the largest wheel speed
INERTIA_SIGMA = 0.7      # of the slip that accelerates the body, relative
GATE = 9.0               # normalized innovation squared that indicates another ground


class Coefficient(IntEnum):
    """States of the filter."""

    COMMON_RESISTANCE = 0  # -, slip while driving straight, mean of both sides
    RESISTANCE_STEP = 1    # -, half the difference of the right side and the left side
    SCRUB = 2              # -, moment against turning over that of the isotropic brush tire
    COMPLIANCE = 3         # -, lateral compliance over that on the calibrated ground


N = len(Coefficient)
Sides = tuple[float, float]  # left, right


@dataclass(frozen=True)
class Coefficients:
    """Values of the coefficients [-], see ``Coefficient``."""

    resistance: Sides  # of the left and of the right side
    scrub: float
    compliance: float


@dataclass(frozen=True)
class BodyMotion:
    """Mean velocity and acceleration of the body."""

    v_x: float               # m/s
    v_y: float               # m/s
    yaw_rate: float          # rad/s
    acceleration: float      # m/s2, forward
    yaw_acceleration: float  # rad/s2


@dataclass(frozen=True)
class Inertia:
    """Inertia of the robot, divided by C_x of a tire on the calibrated ground."""

    mass: float  # s2/m
    yaw: float   # s2, yaw moment of inertia over the track


class SlipCoefficients:
    """
    Extended Kalman filter of the coefficients, an Ornstein-Uhlenbeck process around the prior.

    ``scrub`` is its prior.
    """

    def __init__(self, model: TurnModel, inertia: Inertia, scrub: float) -> None:
        self._model, self._inertia = model, inertia
        self._prior = np.array([FIRM_RESISTANCE, 0.0, scrub, 1.0])
        self._variance = np.diag(np.square(SIGMAS))
        self.reset()

    def reset(self) -> None:
        """Return to the prior."""
        self._x, self._P = self._prior.copy(), self._variance.copy()

    @property
    def sigmas(self) -> Array:
        """Return the standard deviations, in the order of ``Coefficient``."""
        deviations: Array = np.sqrt(np.diag(self._P))
        return deviations

    def after(self, duration: float) -> Coefficients:
        """Return the coefficients that are expected ``duration`` [s] after the last update."""
        x = self._prior + _kept(duration) * (self._x - self._prior)
        common, step, scrub, compliance = x.tolist()
        return Coefficients((common - step, common + step), scrub, compliance)

    def predict(self, duration: float) -> None:
        """Advance by ``duration`` [s]."""
        kept = _kept(duration)
        self._x = self._prior + kept * (self._x - self._prior)
        self._P = np.outer(kept, kept) * self._P + np.diag(1.0 - kept ** 2) * self._variance

    def update(self, motion: BodyMotion, slip: Sides, sigma: Sides) -> None:
        """Correct with slip velocities [m/s] of both sides and their standard deviations."""
        # of the forward acceleration; that of the yaw rate is too noisy, it is part of sigma
        thrust = 0.25 * self._x[Coefficient.COMPLIANCE] * self._inertia.mass * motion.acceleration
        yaw = 0.5 * self._inertia.yaw * motion.yaw_acceleration
        expected, H = self._expected(self._x, motion, thrust), np.empty((3, N))
        for column, step in enumerate(STEPS):
            moved = self._x.copy()
            moved[column] += step
            H[:, column] = (self._expected(moved, motion, thrust) - expected) / step
        if abs(motion.v_x) < 0.5 * self._model.track * abs(motion.yaw_rate):
            # the sides move in opposite directions: resistance looks like scrub
            H[:, [Coefficient.COMMON_RESISTANCE, Coefficient.RESISTANCE_STEP]] = 0.0
        scale = (abs(motion.v_x) + 0.5 * self._model.track * abs(motion.yaw_rate)
                 + max(map(abs, slip)))
        model = math.hypot(MODEL_SIGMA, INERTIA_SIGMA * thrust, yaw) * scale
        R = np.diag(np.square([*(math.hypot(one, model) for one in sigma), MODEL_SIGMA * scale]))
        self._correct(H, R, np.array([*slip, motion.v_y]) - expected)

    def _correct(self, H: Array, R: Array, innovation: Array) -> None:
        S = H @ self._P @ H.T + R
        nis = float(innovation @ np.linalg.solve(S, innovation))
        if nis > GATE:  # another ground: as uncertain as at the start, at most
            most = np.maximum(np.sqrt(np.diag(self._variance)) / self.sigmas, 1.0)
            growth = np.minimum(math.sqrt(nis / GATE), most)
            self._P = np.outer(growth, growth) * self._P
            S = H @ self._P @ H.T + R
        K = np.linalg.solve(S, H @ self._P).T
        self._x = np.clip(self._x + K @ innovation, LOW, HIGH)
        rest = np.eye(N) - K @ H
        self._P = rest @ self._P @ rest.T + K @ R @ K.T

    def _expected(self, x: Array, motion: BodyMotion, thrust: float) -> Array:
        """Return the slip velocities of both sides and the lateral speed [m/s]."""
        common, step, scrub, compliance = x.tolist()
        turn = steady_turn(self._model, motion.v_x, motion.yaw_rate,
                           (common - step, common + step), scrub, thrust)
        centripetal = motion.v_x * motion.yaw_rate
        return np.array([turn.left, turn.right, -turn.lateral_compliance * compliance
                         * self._inertia.mass * centripetal])


def _kept(duration: float) -> Array:
    share: Array = np.exp(-duration / np.array(TIMES))
    return share
