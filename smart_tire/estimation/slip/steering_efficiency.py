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
Steering efficiency, learned online as a fallback for IMU dropouts.

It is the yaw rate over the odometry yaw rate, which is the difference of the side speeds over the
track width.
"""

from __future__ import annotations

import math

HISTORY_LENGTH = 30.0      # s of turning, time constant of forgetting: the surface may change
PRIOR_WEIGHT = 0.05        # (rad/s)^2 s, weight of the prior, an efficiency of one
PRIOR_SIGMA = 0.3          # share of the yaw rate, before anything is learned
MIN_SIGMA = 0.05           # share of the yaw rate: turns are never exactly alike
STRAIGHT_YAW_RATE = 0.02   # rad/s, standard deviation while both sides are equally fast


class SteeringEfficiency:
    """
    Regression of the yaw rate on the odometry yaw rate.

    A skid-steer robot yaws less than its odometry suggests, often by half; on one surface the
    ratio is nearly constant, whatever the slips are.
    """

    def __init__(self) -> None:
        self._squares = PRIOR_WEIGHT   # (rad/s)^2 s, of the odometry yaw rate
        self._products = PRIOR_WEIGHT  # (rad/s)^2 s, of odometry yaw rate and yaw rate
        self._residuals = PRIOR_WEIGHT * PRIOR_SIGMA ** 2  # (rad/s)^2 s, squared residuals

    @property
    def efficiency(self) -> float:
        """Return the yaw rate over the odometry yaw rate, 1 without slip."""
        return self._products / self._squares

    def update(self, odometry_yaw_rate: float, yaw_rate: float, duration: float) -> None:
        """Add mean yaw rates [rad/s], by odometry and by gyro, over ``duration`` [s]."""
        weight = odometry_yaw_rate ** 2 * duration
        if weight <= 0.0:
            return
        keep = math.exp(-duration / HISTORY_LENGTH
                        * min(1.0, odometry_yaw_rate ** 2 / self._mean_square()))
        residual = yaw_rate - self.efficiency * odometry_yaw_rate
        self._squares = keep * self._squares + weight
        self._products = keep * self._products + odometry_yaw_rate * yaw_rate * duration
        self._residuals = keep * self._residuals + residual ** 2 * duration

    def _mean_square(self) -> float:
        return max(self._squares / HISTORY_LENGTH, STRAIGHT_YAW_RATE ** 2)

    def predict(self, odometry_yaw_rate: float) -> tuple[float, float]:
        """Return the expected yaw rate [rad/s] and its standard deviation."""
        relative = max(MIN_SIGMA, math.sqrt(self._residuals / self._squares))
        return (self.efficiency * odometry_yaw_rate,
                math.hypot(relative * odometry_yaw_rate, STRAIGHT_YAW_RATE))
