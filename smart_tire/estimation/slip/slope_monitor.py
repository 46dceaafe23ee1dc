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
Slope of the ground, learned from driving and from rests.

- Wheels and accelerometer: on a slope, the speed of the wheels beyond the integrated acceleration
  changes at a constant rate. Slip of both sides changes only with the speeds or with the surface,
  and then at once.
- Gyroscope: changes of roll and pitch.
- Lateral acceleration beyond that of the turn.
- Rests: change of the mean specific force since the last rest at another place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from smart_tire.arrays import Array
from smart_tire.estimation.slip.slope_residuals import SlopeResiduals
from smart_tire.estimation.slip.slope_spread import (
    change_sensitivity, IMU_OUTLIER_SHARE, SlopeResidual, SlopeSpread)
from smart_tire.estimation.slip.state import ImuStep
from smart_tire.estimation.slip.tilt_rates import TiltConsistency
from smart_tire.estimation.slip.wheel_odometry import WheelSpeeds
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import RobotParams

MIN_WINDOW, MAX_WINDOW = 2.0, 6.0  # s, of driving, for a residual
GYRO_WINDOW = 1.0                # s, for a residual of the gyroscope
RESIDUAL_SIGMA = 0.03            # m/s2, noise of a residual at which its window ends; 3 mrad
DISTURBANCE_WINDOW = 2.0         # s
DISTURBANCE_TIME = 3.0           # s, decay of the variance of a disturbance
DISTURBANCE_SIGMAS = 3.0         # a smaller residual is noise
MIN_REST = 1.0                   # s of standstill
REST_SIGMA = 0.005               # m/s2, of the mean specific force of a rest: suspension
MIN_REST_SENSITIVITY = 0.1       # of two rests to the slope between them


@dataclass(frozen=True, slots=True)
class Rest:
    """Mean specific force [m/s2] of a standstill."""

    force: tuple[float, float]
    variance: float
    distance: float  # m, driven before
    yaw: float       # rad


class SlopeMonitor:
    """
    Standard deviation of the slope: the learned spread, and the present disturbance.

    A disturbance is an acceleration about which the IMU disagrees with both sides' wheels, beyond
    what the learned spread and slip explain.
    """

    def __init__(self, robot: RobotParams, slope_sigma: float) -> None:
        self._rolling_speed = robot.slip.standstill_speed
        self._spread = SlopeSpread(slope_sigma)
        self._residuals = SlopeResiduals(robot)
        self._tilt = TiltConsistency()
        self._begin: float | None = None  # s, of the present window; None unless rolling
        self._gyro_begin = 0.0            # s, of the present window of the gyroscope
        self._disturbance = 0.0           # rad^2
        self._force_sums: list[float] | None = None  # m/s, over a rest, and its duration [s]
        self._rest: Rest | None = None    # the last one

    @property
    def sigma(self) -> float:
        """Return the standard deviation [rad] of the slope."""
        return math.hypot(self._spread.sigma, math.sqrt(self._disturbance))

    @property
    def tilt_gain(self) -> float:
        """Return the share (0 to 1) of the changes of slope that the gyroscope shows."""
        return self._tilt.gain

    def record_step(self, time: float, dt: float, step: ImuStep, x: Sequence[float]) -> None:
        """Add a prediction step of ``dt`` [s] that ends at ``time`` [s] in the state ``x``."""
        self._residuals.record_step(time, dt, step, x)
        if self._force_sums is not None:
            self._force_sums = [total + value * dt for total, value in zip(
                self._force_sums, (step.mean.force_x, step.mean.force_y, 1.0))]

    def update(self, time: float, wheels: WheelSpeeds, P: Array, stationary: bool) -> None:
        """Add a wheel sample of ``time`` [s]; ``P`` is the covariance of the state."""
        if stationary:
            self._update_rest()
            return
        self._force_sums = None
        if max(map(abs, wheels.side_speeds)) < self._rolling_speed:  # pushed, with locked wheels
            self._pause()
            return
        self._residuals.add_wheels(time, wheels)
        if self._begin is None:
            self._begin = self._gyro_begin = time
        self._disturbance = max(self._recent_disturbance(time, P), self._disturbance * math.exp(
            -wheels.duration / DISTURBANCE_TIME))
        self._update_spread(self._begin, time, P)
        if time - self._gyro_begin >= GYRO_WINDOW:
            self._spread.update_at_least(self._residuals.gyroscope(self._gyro_begin, time))
            self._gyro_begin = time

    def _recent_disturbance(self, time: float, P: Array) -> float:
        """Return the squared slope [rad^2] of the last moments, beyond noise and gyroscope."""
        residual = self._residuals.longitudinal(time - DISTURBANCE_WINDOW, time, P)
        if residual is None:
            return 0.0
        excess = residual.value ** 2 - DISTURBANCE_SIGMAS ** 2 * residual.noise
        return (1.0 - self.tilt_gain) * max(0.0, excess) / GRAVITY ** 2

    def _update_spread(self, begin: float, time: float, P: Array) -> None:
        """End the present window if its residual is precise enough, or if it is too long."""
        residuals, length = self._residuals, time - begin
        if length < MIN_WINDOW:
            return
        if residuals.slip_change_noise(begin) > RESIDUAL_SIGMA ** 2:
            self._begin = time  # the robot accelerates
            return
        longitudinal = residuals.longitudinal(begin, time, P)
        if length < MAX_WINDOW and (
                longitudinal is None or longitudinal.noise > RESIDUAL_SIGMA ** 2):
            return
        lateral = residuals.lateral(begin, time, P)
        self._spread.elapse(length)
        self._spread.update_at_least([lateral])
        if longitudinal is not None:
            self._spread.update(longitudinal)
        self._tilt.update((longitudinal, lateral), residuals.mean_tilts(begin, time),
                          GRAVITY ** 2 * residuals.tilt_density * length)
        self._begin = time

    def _pause(self) -> None:
        """Discard the present window: the wheels do not roll."""
        self._begin, self._disturbance = None, 0.0
        self._residuals.discard_wheels()
        self._tilt.restart()

    def _update_rest(self) -> None:
        """Compare the mean specific force with that of the last rest at another place."""
        if self._force_sums is None:
            self._force_sums = [0.0, 0.0, 0.0]
            self._pause()
        sum_x, sum_y, duration = self._force_sums
        if duration < MIN_REST:
            return
        here, last = self._residuals.latest, self._rest
        rest = Rest((sum_x / duration, sum_y / duration),
                    self._residuals.accel_density / duration + REST_SIGMA ** 2,
                    here.distance, here.yaw)
        if last is not None:
            sensitivity = change_sensitivity(rest.distance - last.distance, rest.yaw - last.yaw)
            if sensitivity > MIN_REST_SENSITIVITY:
                # a road may be level across: the larger change counts
                change = max((after - before for before, after in zip(last.force, rest.force)),
                             key=abs)
                self._spread.update(
                    SlopeResidual(change, rest.variance + last.variance, sensitivity),
                    IMU_OUTLIER_SHARE)
        self._rest = rest
