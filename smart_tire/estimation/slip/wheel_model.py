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

"""Measurement model of the rolled distances, B(7), plain and as printed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.robust_ekf import Measurement
from smart_tire.estimation.slip.state import (
    N, SIDE_SIGNS, SLIP_VELS, State, TRAVELS, WheelMeasurement)
from smart_tire.parameters import RobotParams

WHEEL_SPEED_SIGMA = 0.003  # m/s, of a side, in addition to quantization and timestamps


class TravelModel:
    """
    Distance that the wheels of each side have rolled since the last sample.

    It is a state, so neither the change of slip between two samples nor the timestamp errors of
    both, which are not independent, need a model of their own.
    """

    def __init__(self, robot: RobotParams) -> None:
        self._stamp_jitter = robot.encoder.stamp_jitter
        # m, lever arms of the yaw rate in v_x of the left and of the right side, at the IMU
        self.arms = [robot.imu.position[1] + sign * 0.5 * robot.track_width
                     for sign in SIDE_SIGNS]

    def ground_speeds(self, wheels: WheelMeasurement) -> list[float]:
        """Return the mean v_x [m/s] of both sides' wheel centers over the period of ``wheels``."""
        return [wheels.ground_speed + arm * wheels.yaw_rate for arm in self.arms]

    def linearize(self, x: Sequence[float], wheels: WheelMeasurement,
                  extra_variance: float) -> Measurement:
        """Return both distances as a measurement; ``extra_variance`` [m2/s2] is that of speeds."""
        H, expected, R = np.zeros((2, N)), np.zeros(2), np.zeros((2, 2))
        # a mean velocity depends on two timestamps, of which each also enters its neighbor
        jitter = self._stamp_jitter * (1.0 if wheels.from_positions else math.sqrt(2.0))
        for row, (travel, slip_vel) in enumerate(zip(TRAVELS, SLIP_VELS)):
            expected[row] = x[travel] - travel_after(x, wheels)[row]
            H[row, travel] = 1.0
            H[row, State.V_X] = H[row, slip_vel] = -wheels.lag
            R[row, row] = wheels.duration ** 2 * (
                wheels.variance + WHEEL_SPEED_SIGMA ** 2 + extra_variance)
        late = jitter * np.array(wheels.side_speeds)  # m, one timestamp for both sides
        R += np.outer(late, late) if wheels.from_positions else np.diag(late ** 2)
        return Measurement(wheels.duration * np.array(wheels.side_speeds), expected, H, R)


def travel_after(x: Sequence[float], wheels: WheelMeasurement) -> list[float]:
    """Return the distance [m] that each side has rolled since the wheel sample."""
    return [wheels.lag * (x[State.V_X] + x[slip_vel]) + change
            for slip_vel, change in zip(SLIP_VELS, wheels.travel_change)]


def plain_constraint(measurement: Measurement, x: Array, duration: float) -> Measurement:
    """Return the distances unchanged."""
    return measurement


def printed_constraint(measurement: Measurement, x: Array, duration: float) -> Measurement:
    """
    Return the distances as printed in B(7): the mean, with lambda', and the difference.

    Lambda' is 0 for a faster side that brakes and for a slower side that drives. ``x`` (N,) is
    the state at which ``measurement`` was linearized, ``duration`` [s] its period.
    """
    z, expected, H, R = measurement
    mix = np.array([[0.5, 0.5], [-1.0, 1.0]])
    slip_vels = x[list(SLIP_VELS)]
    faster = np.abs(z) >= np.abs(z[::-1])
    dropped = np.where(faster, slip_vels * z < 0.0, slip_vels * z > 0.0)
    H, expected = mix @ H, mix @ expected
    expected[0] -= 0.5 * duration * slip_vels[dropped].sum()
    H[0, np.array(SLIP_VELS)[dropped]] -= 0.5 * duration
    return Measurement(mix @ z, expected, H, mix @ R @ mix.T)


CONSTRAINTS: dict[str, Callable[[Measurement, Array, float], Measurement]] = {
    'plain': plain_constraint, 'printed': printed_constraint}
