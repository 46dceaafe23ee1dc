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
Slopes and rough ground for simulated events: tilt and vibration of the IMU.

The simulated robot moves on a horizontal plane. These functions add what its IMU would measure on
a slope, gravity in body axes and the attitude rates, and on rough ground. The motion stays that of
the plane: the force of gravity along the slope, which the speed control compensates by slip below
slope * weight / (4 C_x), is neglected.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.parameters.robot import RobotParams
from smart_tire.rotation import euler, matrix
from smart_tire.samples import GRAVITY, ImuSample, NS_PER_S, Odometry, Sample
from smart_tire.simulation.offline import Event

Terrain = Callable[[Array, Array], tuple[Array, Array]]  # x, y [m] -> slopes dh/dx, dh/dy [-]

TRUTH_TOPIC = 'ground_truth/odom'
WAVES = 6                # superposed waves of rolling hills


def rolling_hills(sigma: float, wavelengths: tuple[float, float], seed: int) -> Terrain:
    """
    Return hills with a slope of standard deviation ``sigma`` [rad] along any direction.

    They are waves in random directions, with ``wavelengths`` [m] between the two limits.
    """
    rng = np.random.default_rng(seed)
    direction, phase = rng.uniform(0.0, math.tau, (2, WAVES))
    wavenumber = math.tau / np.exp(rng.uniform(
        math.log(wavelengths[0]), math.log(wavelengths[1]), WAVES))
    amplitude = 2.0 * sigma / math.sqrt(WAVES)
    k_x, k_y = wavenumber * np.cos(direction), wavenumber * np.sin(direction)

    def slopes(x: Array, y: Array) -> tuple[Array, Array]:
        waves = amplitude * np.cos(np.multiply.outer(x, k_x) + np.multiply.outer(y, k_y) + phase)
        return waves @ np.cos(direction), waves @ np.sin(direction)
    return slopes


def on_slopes(events: Sequence[Event], robot: RobotParams, terrain: Terrain, *,
              with_rates: bool = True) -> list[Event]:
    """
    Return ``events`` with the IMU on ``terrain``, at the true pose of ``ground_truth/odom``.

    ``with_rates`` adds the rates of roll and pitch to the gyroscope, too.
    """
    imu_ns = [event[2].stamp_ns for event in events if isinstance(event[2], ImuSample)]
    roll, pitch = _attitude(events, terrain, np.array(imu_ns))
    time = (np.array(imu_ns) - imu_ns[0]) / NS_PER_S
    rates = np.gradient(np.column_stack([roll, pitch]), time, axis=0) * with_rates
    up = np.column_stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch),
                          np.cos(roll) * np.cos(pitch) - 1.0])
    to_imu = matrix(*robot.imu.rotation)
    force, rate = GRAVITY * up @ to_imu, np.column_stack([rates, np.zeros(len(time))]) @ to_imu
    return _with_added(events, force, rate)


def _attitude(events: Sequence[Event], terrain: Terrain, stamps_ns: Array) -> tuple[Array, Array]:
    """Return roll and pitch [rad] of the ground under the robot."""
    truth = [event[2] for event in events
             if event[1] == TRUTH_TOPIC and isinstance(event[2], Odometry)]
    true_ns = [sample.stamp_ns for sample in truth]
    x, y = (np.interp(stamps_ns, true_ns, [sample.position[axis] for sample in truth])
            for axis in (0, 1))
    yaw = np.interp(stamps_ns, true_ns,
                    np.unwrap([euler(sample.orientation)[2] for sample in truth]))
    g_x, g_y = terrain(x, y)
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.arctan(cos * g_y - sin * g_x), -np.arctan(cos * g_x + sin * g_y)


def _with_added(events: Sequence[Event], force: Array, rate: Array) -> list[Event]:
    """Return ``events`` with ``force`` [m/s2] and ``rate`` [rad/s] (n, 3) added to the IMU's."""
    added = iter(zip(force.tolist(), rate.tolist()))

    def changed(sample: Sample) -> Sample:
        if not isinstance(sample, ImuSample):
            return sample
        a, w = next(added)
        return replace(sample, acceleration=_sum(sample.acceleration, a),
                       rate=_sum(sample.rate, w))
    return [(received, topic, changed(sample)) for received, topic, sample in events]


def _sum(left: Sequence[float], right: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (a + b for a, b in zip(left, right))
    return x, y, z
