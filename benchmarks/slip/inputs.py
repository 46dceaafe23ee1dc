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

"""Inputs of a run as arrays, for the methods for comparison."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from benchmarks.slip.series import side_means
import numpy as np
from smart_tire.analysis.series import Floats, Stamps
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams
from smart_tire.recording import Recording
from smart_tire.rotation import matrix
from smart_tire.samples import ImuSample, NS_PER_S, Sample, WheelSample

STANDSTILL_MARGIN = 0.3        # s, before the first motion, excluded from the standstill
MIN_STANDSTILL_DURATION = 0.5  # s, for the estimation of biases
MAX_STANDSTILL_SPEED = 0.01    # m/s, of a stationary wheel


@dataclass(frozen=True)
class Inputs:
    """Sensor samples sorted by timestamp, without duplicates."""

    robot: RobotParams
    imu_ns: Stamps
    rate: Floats         # (n,) rad/s about z of base_link
    force: Floats        # (n, 2) m/s2, specific force along x and y of base_link
    wheel_ns: Stamps     # corrected for the known latency
    travel: Floats       # (m, 2) m, rolled distance of left and right side
    stationary: int      # number of IMU samples before the robot first moves

    @property
    def rolling(self) -> Floats:
        """Return r w [m/s] of the sides (m, 2), by central differences."""
        time = (self.wheel_ns - self.wheel_ns[0]) / NS_PER_S
        return np.asarray(np.gradient(self.travel, time, axis=0))


def as_inputs(samples: Iterable[Sample], robot: RobotParams) -> Inputs:
    """Return the inputs among ``samples``; raise EstimatorError for too few of them."""
    recording = Recording(samples)
    imu, wheels = recording.stream(ImuSample).ordered, recording.stream(WheelSample).ordered
    if len(imu) < 2 or len(wheels) < 3:
        raise EstimatorError('too few samples of the IMU or the wheels')
    wheel_ns = wheels.stamp_ns - round(robot.encoder.latency * NS_PER_S)
    angles = wheels['position']
    if np.isnan(angles).any():
        angles = _integrated(wheel_ns, wheels['velocity'])
    travel = robot.wheel_radius * side_means(angles)
    rotation = matrix(*robot.imu.rotation)
    force, rate = imu['acceleration'] @ rotation.T, imu['rate'] @ rotation.T
    return Inputs(robot, imu.stamp_ns, rate[:, 2], force[:, :2], wheel_ns, travel,
                  _stationary_count(imu.stamp_ns, wheel_ns, travel))


def _integrated(stamp_ns: Stamps, velocity: Floats) -> Floats:
    """Return angles [rad] from velocities averaged over the period before each timestamp."""
    time = np.diff(stamp_ns) / NS_PER_S
    return np.concatenate([np.zeros((1, velocity.shape[1])),
                           np.cumsum(velocity[1:] * time[:, np.newaxis], axis=0)])


def _stationary_count(imu_ns: Stamps, wheel_ns: Stamps, travel: Floats) -> int:
    speed = np.abs(np.diff(travel, axis=0)).max(axis=1) / np.diff(wheel_ns) * NS_PER_S
    moving = np.flatnonzero(speed > MAX_STANDSTILL_SPEED)
    end = wheel_ns[moving[0]] if len(moving) else wheel_ns[-1]
    count = int(np.searchsorted(imu_ns, end - round(STANDSTILL_MARGIN * NS_PER_S)))
    long_enough = count and imu_ns[count - 1] - imu_ns[0] >= MIN_STANDSTILL_DURATION * NS_PER_S
    return count if long_enough else 0
