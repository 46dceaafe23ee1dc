# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Slopes change the IMU only, as gravity and the attitude demand."""

import math

from benchmarks.terrain import on_slopes, rolling_hills
import numpy as np
import pytest
from smart_tire.parameters import build, RobotParams
from smart_tire.samples import GRAVITY, ImuSample, NS_PER_S, WheelSample
from support.ideal_robot import odometry

SPEED = 1.0  # m/s


def events_along(heading=0.0, duration=10.0):
    """Return events of a straight run with this heading [rad], without sensor errors."""
    events = []
    for n in range(round(100.0 * duration)):
        stamp, way = n * NS_PER_S // 100, 0.01 * n * SPEED
        events.append((stamp, 'imu/data', ImuSample(stamp, (0.0, 0.0, GRAVITY), (0.0,) * 3)))
        events.append((stamp, 'ground_truth/odom', odometry(
            stamp, way * math.cos(heading), way * math.sin(heading), heading, SPEED)))
    events.append((stamp, 'wheel_states', WheelSample(stamp, (0.0,) * 4)))
    return events


def rising(x, y):
    """Return the slopes of ground that rises along x."""
    return np.full_like(x, 0.1), np.zeros_like(y)


def bump(x, y):
    """Return the slopes of a bump across x = 5 m, 0.1 m high and 2 m long."""
    phase = math.pi * (x - 5.0)
    return np.where(np.abs(x - 5.0) < 1.0, -0.05 * math.pi * np.sin(phase), 0.0), np.zeros_like(y)


def imu(events):
    """Return forces and rates (n, 3) of the IMU."""
    samples = [sample for _, _, sample in events if isinstance(sample, ImuSample)]
    return (np.array([sample.acceleration for sample in samples]),
            np.array([sample.rate for sample in samples]))


@pytest.mark.parametrize('heading, axis, sign', [
    (0.0, 0, 1.0), (math.pi, 0, -1.0), (0.5 * math.pi, 1, -1.0), (-0.5 * math.pi, 1, 1.0)])
def test_gravity_points_down_the_slope_for_each_heading(heading, axis, sign):
    # the ground rises along x: the specific force points uphill
    force, _ = imu(on_slopes(events_along(heading), RobotParams(), rising))
    expected = np.zeros(3)
    expected[axis], expected[2] = sign * math.sin(math.atan(0.1)), math.cos(math.atan(0.1))
    assert force == pytest.approx(np.tile(GRAVITY * expected, (len(force), 1)), abs=1e-9)


def test_the_attitude_rates_integrate_to_the_slope():
    changed = on_slopes(events_along(), RobotParams(), bump)
    force, rate = imu(changed)
    pitch = np.cumsum(rate[:, 1]) * 0.01
    assert np.ptp(pitch) > 0.25
    assert -np.sin(pitch) * GRAVITY == pytest.approx(force[:, 0], abs=0.03)
    assert np.all(imu(on_slopes(events_along(), RobotParams(), bump, with_rates=False))[1] == 0)


def test_the_mounting_of_the_imu_is_applied():
    robot = build(RobotParams, {'imu.rotation': [0.0, 0.0, math.pi]})
    force, _ = imu(on_slopes(events_along(), robot, rising))
    assert force[-1, 0] == pytest.approx(-GRAVITY * math.sin(math.atan(0.1)))


def test_hills_have_the_given_spread_along_both_axes():
    x, y = np.random.default_rng(1).uniform(-500.0, 500.0, (2, 1000))
    spreads = [np.std(rolling_hills(0.02, (5.0, 30.0), seed)(x, y), axis=1)
               for seed in range(50)]
    assert np.sqrt(np.mean(np.square(spreads), axis=0)) == pytest.approx([0.02, 0.02], rel=0.15)
