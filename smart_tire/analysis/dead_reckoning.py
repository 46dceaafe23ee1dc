# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Dead reckoning by wheels, and by gyroscope and wheels: the baselines of all estimates.

They get the best possible inputs: angles instead of speeds, speeds by central differences (not
causal), the gyroscope bias from the initial standstill, and the configured delay of the wheels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.errors import EstimatorError
from smart_tire.estimates import at, PoseEstimate, SlipEstimate
from smart_tire.models.vehicle.skid_steer import slip_ratio
from smart_tire.parameters import RobotParams
from smart_tire.recording import SampleArrays
from smart_tire.rotation import matrix
from smart_tire.samples import ImuSample, LEFT, NS_PER_S, RIGHT, WheelSample

GYRO_WHEELS, WHEELS_ONLY = 'gyroscope + wheels', 'wheels only'
STANDSTILL_MARGIN = 0.3        # s, before the first motion, excluded from the standstill
MIN_STANDSTILL_DURATION = 0.5  # s, for the estimation of biases
MAX_STANDSTILL_SPEED = 0.01    # m/s, of a stationary wheel
MAX_GAP = 5.0                  # s, bridged by linear interpolation


@dataclass(frozen=True)
class ReckoningInputs:
    """Sensor samples sorted by timestamp, without duplicates."""

    robot: RobotParams
    imu_ns: Instants
    rate: Array         # (n,) rad/s about z of base_link
    wheel_ns: Instants  # corrected for the known latency
    travel: Array       # (m, 2) m, rolled distance of left and right side
    stationary: int     # number of IMU samples before the robot first moves

    @property
    def rolling(self) -> Array:
        """Return r w [m/s] of the sides (m, 2), by central differences."""
        time = (self.wheel_ns - self.wheel_ns[0]) / NS_PER_S
        return np.asarray(np.gradient(self.travel, time, axis=0))


def baselines(recording: SampleArrays, robot: RobotParams) -> Mapping[str, PoseEstimate]:
    """Return the poses of both methods by name; none if a recording has too few samples."""
    try:
        inputs = as_inputs(recording, robot)
    except EstimatorError:
        return {}
    return {GYRO_WHEELS: gyro_odometry(inputs)[0], WHEELS_ONLY: wheel_odometry(inputs)[0]}


def as_inputs(recording: SampleArrays, robot: RobotParams) -> ReckoningInputs:
    """Return the inputs in ``recording``; raise EstimatorError for too few of them."""
    imu, wheels = recording.stream(ImuSample).ordered, recording.stream(WheelSample).ordered
    angles, speeds = (_side_means(wheels[name]) for name in ('position', 'velocity'))
    if np.isnan(angles).any():
        known = np.isfinite(speeds).all(axis=1)
        wheels, speeds = wheels.where(known), speeds[known]
        angles = _integrated(wheels.stamp_ns, speeds)
    if len(imu) < 2 or len(wheels) < 3:
        raise EstimatorError('too few samples of the IMU or the wheels')
    wheel_ns = wheels.stamp_ns - round(robot.encoder.latency * NS_PER_S)
    travel = robot.wheel_radius * angles
    z_row = matrix(*robot.imu.rotation)[2] / robot.imu.gyro_scale
    return ReckoningInputs(robot, imu.stamp_ns, imu['rate'] @ z_row, wheel_ns, travel,
                           _stationary_count(imu.stamp_ns, wheel_ns, travel))


def _side_means(values: Array) -> Array:
    """Return the means (n, 2) of the wheels of each side of ``values`` (n, 4) that are known."""
    sides = values[:, [LEFT, RIGHT]]
    with np.errstate(invalid='ignore'):
        means: Array = np.nansum(sides, axis=2) / np.isfinite(sides).sum(axis=2)
    return means


def _integrated(stamp_ns: Instants, velocity: Array) -> Array:
    """Return angles [rad] from velocities averaged over the period before each timestamp."""
    time = np.diff(stamp_ns) / NS_PER_S
    return np.concatenate([np.zeros((1, velocity.shape[1])),
                           np.cumsum(velocity[1:] * time[:, np.newaxis], axis=0)])


def _stationary_count(imu_ns: Instants, wheel_ns: Instants, travel: Array) -> int:
    speed = np.abs(np.diff(travel, axis=0)).max(axis=1) / np.diff(wheel_ns) * NS_PER_S
    moving = np.flatnonzero(speed > MAX_STANDSTILL_SPEED)
    end = wheel_ns[moving[0]] if len(moving) else wheel_ns[-1]
    count = int(np.searchsorted(imu_ns, end - round(STANDSTILL_MARGIN * NS_PER_S)))
    long_enough = count and imu_ns[count - 1] - imu_ns[0] >= MIN_STANDSTILL_DURATION * NS_PER_S
    return count if long_enough else 0


def wheel_odometry(inputs: ReckoningInputs) -> tuple[PoseEstimate, SlipEstimate]:
    """Return the odometry of a differential drive with the track of the wheels."""
    travel, rolling, track = inputs.travel, inputs.rolling, inputs.robot.track_width
    difference = travel[:, 1] - travel[:, 0]
    yaw = (difference - difference[0]) / track
    rate = (rolling[:, 1] - rolling[:, 0]) / track
    return _dead_reckoning(inputs, inputs.wheel_ns, yaw, travel.mean(axis=1), rate, rolling)


def gyro_odometry(inputs: ReckoningInputs) -> tuple[PoseEstimate, SlipEstimate]:
    """Return dead reckoning by gyroscope heading and mean wheel distance."""
    stamps = inputs.imu_ns
    bias = inputs.rate[:inputs.stationary].mean() if inputs.stationary else 0.0
    rate = inputs.rate - bias
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(stamps) / NS_PER_S
    yaw = np.concatenate([[0.0], np.cumsum(steps)])
    travel = at(stamps, inputs.wheel_ns, inputs.travel, MAX_GAP)
    rolling = at(stamps, inputs.wheel_ns, inputs.rolling, MAX_GAP)
    known = np.isfinite(travel[:, 0])
    return _dead_reckoning(inputs, stamps[known], yaw[known], travel[known].mean(axis=1),
                           rate[known], rolling[known])


def _dead_reckoning(inputs: ReckoningInputs, stamps: Instants, yaw: Array, distance: Array,
                    rate: Array, rolling: Array) -> tuple[PoseEstimate, SlipEstimate]:
    """Return the estimate for travel of ``distance`` [m] with heading ``yaw`` [rad] along arcs."""
    turn = np.diff(yaw)
    chord = np.diff(distance) * np.sinc(0.5 * turn / math.pi)
    mean_yaw = yaw[:-1] + 0.5 * turn
    x, y = (np.concatenate([[0.0], np.cumsum(chord * f(mean_yaw))]) for f in (np.cos, np.sin))
    v_x = rolling.mean(axis=1)
    twist = np.column_stack([v_x, np.zeros(len(v_x)), rate])
    unknown = np.full((len(yaw), 3, 3), math.nan)
    poses = PoseEstimate(stamps, np.column_stack([x, y, yaw]), twist, unknown, unknown[:, 0])
    half = 0.5 * inputs.robot.track_width
    ground = np.column_stack([v_x - half * rate, v_x + half * rate])
    ratio, velocity = (values[:, [0, 1, 0, 1]] for values in (
        slip_ratio(rolling, ground, inputs.robot.slip.standstill_speed), rolling - ground))
    return poses, SlipEstimate(stamps, ratio, np.full_like(ratio, math.nan), velocity)
