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

"""Ground as given, with its errors considered, and corrections with the balance of forces."""

from __future__ import annotations

import math

from smart_tire.estimation.slip.equations import TireForces
from smart_tire.estimation.slip.imu_input import ImuInput
from smart_tire.estimation.slip.kalman import KalmanFilter, SENSORS_HELD
from smart_tire.estimation.slip.noise import LearnedVariance, MAX_NIS
from smart_tire.estimation.slip.state import State
from smart_tire.parameters import RobotParams
from smart_tire.samples import Four, GroundState
from smart_tire.uncertain import Uncertain

PRIORS = (Uncertain(0.45, 0.315), Uncertain(0.025, 0.025), Uncertain(0.5, 0.3),
          Uncertain(0.9, 0.15))  # -, mu, rolling resistance, its lateral share, C_y / C_x
GROUND_SIGMAS = (0.5, 0.7, 0.04, 0.3, 0.2, 0.0, 0.0)  # of another ground, in the order of State:
# ln C_x, ln mu, rolling resistance, its lateral share, ln C_y / C_x; the robot stays the same
SILENT_TIME = 1.25        # s without ground_state, two and a half periods, after which it ends
EXPIRY_TIME = 5.0         # s after which it has ended
MIN_ROLLING_SPEED = 0.1   # m/s, of the slower side: the forces are not used below
BALANCE_SIGMA = 0.05      # m/s2, prior error of the model, which is learned ...
MIN_BALANCE_SIGMA = 0.02  # m/s2, ... down to this one
MODEL_TIME = 0.3          # s, correlation time of that error
NOISE_TIME = 5.0          # s, over which it is learned
DOUBT_TIME = 2.0          # s after a change that the filter has found: the window needs them
CHANGE_TIME = 0.3         # s, time constant of the innovations that show a change of the ground
CHANGE_NIS = 5.0          # their mean square, each at most MAX_NIS, beyond which it has changed


class ForceBalance:
    """Ground as given by ``GroundState``, and the corrections by the balance of forces."""

    def __init__(self, robot: RobotParams, kalman: KalmanFilter) -> None:
        self._kalman, self._forces = kalman, TireForces(robot)
        self._center_of_mass = tuple(map(
            Uncertain, robot.center_of_mass[:2], robot.center_of_mass_sigma))
        self._given = (1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)  # in the order of State
        self._noise = [LearnedVariance(BALANCE_SIGMA, MIN_BALANCE_SIGMA, NOISE_TIME) for _ in 'xy']
        self._innovations = LearnedVariance(1.0, 0.0, CHANGE_TIME)
        self._silent = math.inf  # s, since the last ground_state
        self._since_change = math.inf  # s, since the filter has found a change of the ground
        self.changes = 0         # of the ground, found by the filter
        self.innovation = 0.0    # of the last balance along y, in standard deviations

    @property
    def active(self) -> bool:
        """Return whether the ground is known."""
        return self._silent < SILENT_TIME + EXPIRY_TIME

    def set_ground(self, ground: GroundState) -> None:
        """
        Take the ground as given, with the errors that are reported.

        After a change that this filter has found, a ground as before is not news yet.
        """
        self._silent = 0.0
        if self._since_change < DOUBT_TIME and self._is_as_before(ground):
            return
        self._since_change = math.inf
        reported = (ground.friction_coefficient, ground.rolling_resistance, ground.lateral_share,
                    ground.lateral_stiffness_ratio, ground.center_of_mass_x,
                    ground.center_of_mass_y)
        stiffness = ground.stiffness
        mu, resistance, share, ratio, *center = (
            one if math.isfinite(one.value) and math.isfinite(one.sigma) else prior
            for one, prior in zip(reported, (*PRIORS, *self._center_of_mass)))
        self._given = (  # type: ignore[assignment]
            stiffness.value, mu.value, resistance.value, share.value, ratio.value,
            *(one.value for one in center))
        sigmas = (stiffness.sigma / stiffness.value, mu.sigma / mu.value, resistance.sigma,
                  share.sigma, ratio.sigma / ratio.value, *(one.sigma for one in center))
        P = self._kalman.P
        for row, sigma in enumerate(sigmas, int(State.LN_STIFFNESS)):
            # of what was known the share is kept that the new error has of the old one
            old = math.sqrt(P[row, row])
            keep = min(1.0, sigma / old) if old > 0.0 else 0.0
            P[row, :] *= keep
            P[:, row] *= keep
            P[row, row] = sigma ** 2
        a, b = State.LN_STIFFNESS, State.LN_FRICTION
        P[a, b] = P[b, a] = ground.stiffness_friction_correlation * sigmas[0] * sigmas[1]

    def _is_as_before(self, ground: GroundState) -> bool:
        """Return whether C_x and rolling resistance are within their errors of those given."""
        return all(abs(new.value - old) < 2.0 * new.sigma for new, old in (
            (ground.stiffness, self._given[0]), (ground.rolling_resistance, self._given[2])))

    def age(self, dt: float) -> None:
        """Let the ground become unknown while ``ground_state`` is silent; ``dt`` [s] passed."""
        self._silent += dt
        self._since_change += dt
        if self.active and self._silent > SILENT_TIME:
            self._widen(min(dt / EXPIRY_TIME, 1.0))

    def add_wheel_innovation(self, nis: float, duration: float) -> None:
        """Widen the covariance of the ground if wheels and forces contradict each other."""
        if not self.active:
            return
        self._innovations.add(min(nis, MAX_NIS), duration)
        if self._innovations.variance > CHANGE_NIS:
            self._widen(1.0)
            self._innovations = LearnedVariance(1.0, 0.0, CHANGE_TIME)
            self.changes += 1
            self._since_change = 0.0

    def _widen(self, share: float) -> None:
        for row, sigma in enumerate(GROUND_SIGMAS, int(State.LN_STIFFNESS)):
            variance = float(self._kalman.P[row, row])
            self._kalman.P[row, row] += share * max(sigma ** 2 - variance, 0.0)

    def correct(self, imu: ImuInput, residual: Four, dt: float) -> bool:
        """
        Correct with the balance along x and y at the last IMU reading, after a step of ``dt`` [s].

        Return False if it does not hold: ground unknown, or robot too slow.
        """
        reading, x = imu.reading, self._kalman.x
        assert reading is not None
        W = reading.yaw_rate - x[State.GYRO_BIAS_Z]
        rolling = self._forces.rolling_speeds(x, W, residual)
        if not self.active or min(map(abs, rolling)) < MIN_ROLLING_SPEED:
            return False
        expected = self._forces.balance(
            x, rolling, W, imu.yaw_accel, reading.force_x, reading.force_y, self._given)
        noise = imu.force_variance
        shared = -0.5 * dt * noise  # the sample ends the step that was predicted
        for error, level, h, velocity in zip(
                expected, self._noise, self._forces.H, (State.V_X, State.V_Y)):
            # the error of the model lasts: as white noise it has the same mean over its time
            total = self._kalman.correct(-error, h, 2.0 * MODEL_TIME / dt * level.variance + noise,
                                         SENSORS_HELD, (velocity, shared))
            level.add(level.variance + error ** 2 - total, dt)
            self.innovation = error / math.sqrt(total)
        return True
