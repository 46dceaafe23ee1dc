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
Constraint B(7) as printed, with lambda' in place of lambda.

Lambda' is 0 for a faster side that brakes and for a slower side that drives: slip of both sides in
the same direction is discarded. It is a constraint of speeds, so distances are counted from the
timestamps, not between positions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.filter import SlipFilter
from smart_tire.estimation.slip.inputs import WheelSpeeds
from smart_tire.estimation.slip.state import SLIP_VELS


class PrintedSlipFilter(SlipFilter):
    """Slip filter with B(7) as printed."""

    def _correct_distances(self, y: Array, H: Array, R: Array, sides: list[float], dt: float,
                           slip_held: bool) -> float:
        """Correct with the mean of both distances, with lambda', and with their difference."""
        mix = np.array([[0.5, 0.5], [-1.0, 1.0]])
        y, H = mix @ y, mix @ H
        for slip, own, other in zip(SLIP_VELS, sides, sides[::-1]):
            value = self.kalman.x[slip] * own
            if value < 0.0 if abs(own) >= abs(other) else value > 0.0:
                y[0] += 0.5 * dt * self.kalman.x[slip]
                H[0, slip] -= 0.5 * dt
        return super()._correct_distances(y, H, mix @ R @ mix.T, sides, dt, slip_held)

    def _restart_travel(self, wheels: WheelSpeeds, sides: list[float], lag: float,
                        change: list[float], W: float) -> None:
        super()._restart_travel(replace(wheels, from_positions=False), sides, lag, change, W)


class PrintedSlipEstimator(SlipEstimator):
    """
    Slip estimator with B(7) as printed, with the inputs and outputs of ``SlipEstimator``.

    >>> from smart_tire.parameters import SlipEstimatorParams
    >>> PrintedSlipEstimator(SlipEstimatorParams()).status()['state']
    'waiting for imu/data'
    """

    new_filter = PrintedSlipFilter
