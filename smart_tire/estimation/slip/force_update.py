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
Corrections of the slip EKF by forces, and changes of the ground.

The force balance corrects slip and lateral velocity at the rate of the IMU. The parameters of the
ground are considered there (Schmidt-Kalman filter): their errors are part of the covariance, but
only distances and film slips correct them, through their correlation with the slips. Their
Jacobians are forces, which are as noisy as the residuals of the balance: corrected by it, C_x
would drift. Torques consider it for the same reason, unless it is unknown and the slips are
certain: then their bias is small against its uncertainty.

The exception is the lateral balance, which corrects C_x: where the lateral speed changes, the IMU
measures by how much, and the forces do so in proportion to 1 / C_x. In a steady turn they do not
determine C_x, and are not used for it. The Jacobian contains a low-pass filtered lateral speed, an
instrumental variable: its noise is almost independent of that of the innovation.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.force_model import ForceModel, MIN_ROLLING_SPEED
from smart_tire.estimation.slip.motion_model import DRAG_MEAN, SOFT_GROUND_CORRELATION
from smart_tire.estimation.slip.robust_ekf import Measurement, RobustEkf
from smart_tire.estimation.slip.slip_process import InnovationChangeDetector
from smart_tire.estimation.slip.state import DelayedSpeed, ImuReading, N, SLIP_VEL_ROWS, State
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.samples import Four
from smart_tire.uncertain import Uncertain

GROUND_CHANGE_SIGMAS = 3.0    # of two consecutive common innovations of the wheels, same sign
RATIO_CHANGE_SIGMAS = 3.5     # of the innovation of one adhesion ratio
MAX_PRIOR_SIGMAS = 3.0        # of ln C_x, beyond which the estimate has diverged
SAME_FORCES_SIGMA = 0.15      # -, of ln C_x after a change of mu / C_x that no force shows
CHANGED_DRAG_SIGMA = 0.05     # -, of the rolling resistance on new ground
LATERAL_CORRELATION_TIME = 0.1  # s, of errors of the lateral balance, and of the speed in it
LATERAL_CHANGE_TIME = 1.0     # s, over which the lateral speed is compared
LATERAL_SPEED_CHANGE = 0.004  # m/s, of the lateral speed, below which C_x is not observable
PLAUSIBLE_SIGMAS = 2.0        # of an innovation of the lateral balance that corrects C_x
IMPLAUSIBLE_TORQUES = 2       # failed checks: not a motor, but the balance of forces is wrong
RATIO_ITERATIONS = 3          # of a correction that is not linear in ln mu / C_x
MAX_TORQUE_REPEATS = 6        # equal readings in a row: torques are noisy at 10 mA
TORQUE_CHECK_GAIN = 0.1       # weight of a new reading in the mean of normalized innovations
TORQUE_FAULT_SIGMAS = 2.0     # of that mean; it is 0.25 for correct torques
MAX_TORQUE_SIGMAS = 6.0       # at which one innovation is limited
UNKNOWN_STIFFNESS_SIGMA = 0.3  # -, of ln C_x, above which torques determine it directly
CERTAIN_SLIP_SIGMAS = 4.0     # of slip velocities that are certain enough for that
ACCELERATION_GAIN = 0.2       # weight of a new sample in the variance of wheel accelerations

GROUND_ROWS = (State.LN_STIFFNESS, State.LN_RATIO, State.DRAG)


class TorqueCheck:
    """
    Detects a failed torque measurement of one motor, or a lifted wheel.

    Its readings repeat, or persistently differ from the expected ones.
    """

    def __init__(self) -> None:
        self._last = math.nan
        self._repeats = 0
        self._mean = 0.0  # -, of the normalized innovations
        self.failed = False

    def update(self, torque: float, innovation: float) -> None:
        """Add a reading [N m] with its ``innovation`` over its standard deviation."""
        if not math.isfinite(torque):
            return
        self._repeats = self._repeats + 1 if torque == self._last else 0
        self._last = torque
        limited = min(max(innovation, -MAX_TORQUE_SIGMAS), MAX_TORQUE_SIGMAS)
        self._mean += TORQUE_CHECK_GAIN * (limited - self._mean)
        limit = TORQUE_FAULT_SIGMAS * (0.5 if self.failed else 1.0)  # hysteresis
        self.failed = self._repeats >= MAX_TORQUE_REPEATS or abs(self._mean) > limit


class LateralSpeed:
    """Low-pass filtered lateral speed of base_link: ``mean`` [m/s], and whether it ``changes``."""

    def __init__(self) -> None:
        self.mean = self._slow = math.nan

    @property
    def changes(self) -> bool:
        """Return whether it differs from its mean over the last second."""
        return abs(self.mean - self._slow) > LATERAL_SPEED_CHANGE

    def update(self, speed: float, dt: float) -> None:
        """Add the ``speed`` [m/s] ``dt`` [s] after the last one."""
        if math.isnan(self.mean):
            self.mean = self._slow = speed
        self.mean += dt / (dt + LATERAL_CORRELATION_TIME) * (speed - self.mean)
        self._slow += dt / (dt + LATERAL_CHANGE_TIME) * (self.mean - self._slow)


class ForceUpdate:
    """
    Corrects the filter by forces while ``enabled`` and rolling fast enough: ``active``.

    ``ground_changes`` counts the detected changes of the ground.
    """

    def __init__(self, params: SlipEstimatorParams, ekf: RobustEkf) -> None:
        robot = params.robot
        self._ekf, self._imu, self._x_imu = ekf, robot.imu, robot.imu.position[0]
        self._model = ForceModel(robot)
        self._sigmas = (params.ground_stiffness_sigma, params.ground_friction_sigma,
                        CHANGED_DRAG_SIGMA)
        self._contradiction = InnovationChangeDetector(GROUND_CHANGE_SIGMAS)
        self._checks = [TorqueCheck() for _ in range(4)]
        self._acceleration_variance: Array = np.zeros(4)  # (m/s2)^2
        self._lateral_speed = LateralSpeed()
        self.enabled = params.force_balance == 'on'
        self.active = False
        self.ground_changes = 0

    def correct_balance(self, dt: float, imu: ImuReading, vibration: float, residual: Four
                        ) -> None:
        """Correct with a reading of the IMU and the force balance, ``dt`` [s] after the last."""
        x = self._ekf.x
        H = np.zeros((3, N))
        for i, (row, bias) in enumerate(((State.FORCE_X, State.ACCEL_BIAS_X),
                                         (State.FORCE_Y, State.ACCEL_BIAS_Y),
                                         (State.YAW_RATE, State.GYRO_BIAS_Z))):
            H[i, row] = H[i, bias] = 1.0
        force = self._imu.accel_noise ** 2 + vibration ** 2
        self._ekf.correct(Measurement(
            np.array([imu.force_x, imu.force_y, imu.yaw_rate]), H @ x, H,
            np.diag([force, force, self._imu.gyro_noise ** 2])))
        rolling = self._model.wheels(self._ekf.x.tolist(), residual).rolling
        self.active = self.enabled and min(
            abs(rolling[0] + rolling[2]), abs(rolling[1] + rolling[3])) > 2.0 * MIN_ROLLING_SPEED
        if not self.active:
            self._contradiction.update(0.0, 1.0)
            self._lateral_speed = LateralSpeed()
            return
        self._ekf.correct(self._longitudinal(residual), considered=GROUND_ROWS)
        lateral = self._lateral(residual, dt)
        self._ekf.correct(lateral, considered=(
            GROUND_ROWS[1:] if self._lateral_speed.changes and self._is_plausible(lateral)
            else GROUND_ROWS))
        if abs(self._ekf.x[State.LN_STIFFNESS]) > MAX_PRIOR_SIGMAS * self._sigmas[0]:
            self._forget_ground()

    def _longitudinal(self, residual: Four) -> Measurement:
        """Return the balance, linearized where it is fulfilled: slip is nonlinear at low speed."""
        before, P = self._ekf.x, self._ekf.P
        z, expected, H, R = self._model.longitudinal_balance(before.tolist(), residual)
        step = P @ H.T @ np.linalg.solve(H @ P @ H.T + R, z - expected)
        step[list(GROUND_ROWS)] = 0.0
        z, expected, H, R = self._model.longitudinal_balance((before + step).tolist(), residual)
        return Measurement(z, expected - H @ step, H, R)

    def _lateral(self, residual: Four, dt: float) -> Measurement:
        """Return the lateral balance; its errors are correlated over several readings."""
        x = self._ekf.x
        self._lateral_speed.update(
            float(x[State.V_Y] - self._x_imu * x[State.YAW_RATE]), dt)
        balance = self._model.lateral_balance(x.tolist(), residual, self._lateral_speed.mean)
        return balance._replace(R=max(LATERAL_CORRELATION_TIME / dt, 1.0) * balance.R)

    def _is_plausible(self, balance: Measurement) -> bool:
        """Return whether nothing contradicts ``balance``, as a push or a lifted wheel does."""
        z, expected, H, R = balance
        variance = float((H @ self._ekf.P @ H.T + R)[0, 0])
        return (float(z[0] - expected[0]) ** 2 < PLAUSIBLE_SIGMAS ** 2 * variance
                and sum(check.failed for check in self._checks) < IMPLAUSIBLE_TORQUES)

    def correct_torques(self, torques: Four, residual: Four, accelerations: Four) -> None:
        """
        Correct with the measured motor torques [N m], NaN where unknown.

        ``accelerations`` [m/s2] are those of the wheels' circumferences, from the encoders.
        """
        if not self.active:
            return
        x = self._ekf.x.tolist()
        deviation = np.array(accelerations) - self._model.wheel_accelerations(x)
        self._acceleration_variance = self._acceleration_variance + ACCELERATION_GAIN * (
            deviation ** 2 - self._acceleration_variance)
        z, expected, H, R = self._model.torques(x, torques, residual, self._acceleration_variance)
        sigma = np.sqrt(np.diag(H @ self._ekf.P @ H.T + R))
        trusted = [not check.failed for check in self._checks]
        for check, torque, normalized in zip(
                self._checks, torques, ((z - expected) / sigma).tolist()):
            check.update(torque, normalized)
        if any(check.failed and before for check, before in zip(self._checks, trusted)):
            self._inflate_ground()  # it has been estimated with wrong torques
        used = np.isfinite(torques) & [not check.failed for check in self._checks]
        if used.any():
            self._ekf.correct(Measurement(
                z[used], expected[used], H[used], R[np.ix_(used, used)]),
                considered=GROUND_ROWS[:2] if not self._determines_stiffness()
                else [State.LN_RATIO])

    def _determines_stiffness(self) -> bool:
        """Return whether C_x is unknown, and slips are known that torques have to explain."""
        sigma = np.sqrt(np.diag(self._ekf.P))
        slips = np.abs(self._ekf.x[SLIP_VEL_ROWS]) / sigma[SLIP_VEL_ROWS]
        return bool(sigma[State.LN_STIFFNESS] > UNKNOWN_STIFFNESS_SIGMA
                    and slips.min() > CERTAIN_SLIP_SIGMAS)

    def correct_adhesion(self, wheel: int, ratio: Uncertain, slip: Uncertain,
                         then: DelayedSpeed) -> None:
        """Correct mu / C_x with the adhesion ratio and the slip that the films measured."""
        measurement = self._model.adhesion(self._ekf.x.tolist(), wheel, ratio, slip, then)
        if measurement is None:
            return
        z, expected, H, R = measurement
        y = float(z[0] - expected[0])
        if y * y > RATIO_CHANGE_SIGMAS ** 2 * float((H @ self._ekf.P @ H.T + R)[0, 0]):
            self._change_ground((SAME_FORCES_SIGMA, *self._sigmas[1:]))
        before, P = self._ekf.x, self._ekf.P
        x = before
        for _ in range(RATIO_ITERATIONS):
            again = self._model.adhesion(x.tolist(), wheel, ratio, slip, then)
            if again is None:
                return
            z, expected, H, R = again
            expected = expected + H @ (before - x)
            x = before + P @ H.T @ np.linalg.solve(H @ P @ H.T + R, z - expected)
        self._ekf.correct(Measurement(z, expected, H, R))

    def detect_ground_change(self, travels: Measurement) -> None:
        """
        Increase the uncertainty of the ground after two contradicting wheel samples.

        ``travels`` are the distances rolled by both sides. A single late timestamp is followed by
        an innovation of the opposite sign.
        """
        if not self.active:
            return
        S = travels.H @ self._ekf.P @ travels.H.T + travels.R
        score = float((travels.z - travels.expected).sum()) / math.sqrt(float(S.sum()))
        if self._contradiction.update(score, 1.0) > 0.0:
            self._change_ground()
            self._contradiction.update(0.0, 1.0)

    def _forget_ground(self) -> None:
        """Return to the priors of the ground: no ground has such a stiffness."""
        x, F, Q = self._ekf.x.copy(), np.eye(N), np.zeros((N, N))
        for row, sigma in zip(GROUND_ROWS, self._sigmas):
            x[row] = DRAG_MEAN if row is State.DRAG else 0.0
            F[row, row], Q[row, row] = 0.0, sigma ** 2
        self._ekf.predict(x, F, Q)
        self.ground_changes += 1

    def _change_ground(self, sigmas: tuple[float, ...] | None = None) -> None:
        self._inflate_ground(sigmas)
        self.ground_changes += 1

    def _inflate_ground(self, sigmas: tuple[float, ...] | None = None) -> None:
        """
        Make the ground uncertain about its present estimate.

        ``sigmas`` are those of its states, by default of unknown ground.
        """
        Q, P = np.zeros((N, N)), self._ekf.P
        for row, sigma in zip(GROUND_ROWS, sigmas or self._sigmas):
            Q[row, row] = max(sigma ** 2 - P[row, row], 0.0)
        stiffness, drag = State.LN_STIFFNESS, State.DRAG
        Q[stiffness, drag] = Q[drag, stiffness] = SOFT_GROUND_CORRELATION * math.sqrt(
            Q[stiffness, stiffness] * Q[drag, drag])
        self._ekf.predict(self._ekf.x, np.eye(N), Q)
