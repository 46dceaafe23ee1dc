# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Delay of the wheels behind the gyroscope, and the filter that runs at their time."""

import math

import numpy as np
import pytest
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.state import MAX_LAG_RATE
from smart_tire.estimation.slip.wheel_lag import WheelLag
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.samples import GRAVITY, ImuSample, NS_PER_S, Odometry, WheelSample

STEP, TRACK, RADIUS = 0.01, 0.38, 0.087  # s, of the IMU; m; m
REST = 1.0  # s, at the start
CURVE = 1.2  # rad/s, largest yaw rate


def yaw_rate(time):
    """Return the true yaw rate [rad/s]."""
    return CURVE * np.sin(1.3 * time) * np.sin(0.37 * time + 1.0) * (time > 0.0)


def speed(time):
    """Return the true speed [m/s]: starts and stops."""
    return 0.3 * (1.0 - np.cos(1.7 * np.maximum(time, 0.0)))


def found_lag(lag, *, period=0.05, duration=60.0, turning=yaw_rate, noise=0.0):
    """Return the lag that is found, and its largest change in a second."""
    model, values = WheelLag(), [0.0]
    rng = np.random.default_rng(7)
    every = round(period / STEP)
    for i in range(round(duration / STEP)):
        time = i * STEP
        model.add_rate(time, float(turning(time)))
        if i % every == 0 and i:
            late = float(turning(time - lag - 0.5 * period)) * TRACK
            model.add_turn(time, late + rng.normal(0.0, noise), period, True)
        if i % 100 == 0:
            values.append(model.value)
    return model.value, float(np.abs(np.diff(values)).max())


@pytest.mark.parametrize('period', [0.02, 0.05, 0.25])
@pytest.mark.parametrize('lag', [0.05, 0.13, 0.22])
def test_the_lag_is_found_at_any_rate_of_the_wheels(lag, period):
    assert found_lag(lag, period=period)[0] == pytest.approx(lag, abs=0.01)


def test_the_lag_changes_slowly_and_noise_hardly_moves_it():
    lag, change = found_lag(0.13, noise=0.05)
    assert lag == pytest.approx(0.13, abs=0.03)
    assert 0.5 * MAX_LAG_RATE < change <= 1.1 * MAX_LAG_RATE


def test_wheels_without_lag_or_early_have_none():
    assert found_lag(0.0)[0] < 0.005
    assert found_lag(-0.05)[0] == 0.0
    assert found_lag(0.03)[0] == 0.0  # slip that builds up looks like this


def test_a_straight_drive_shows_no_lag():
    assert found_lag(0.13, turning=lambda time: 0.0 * time, noise=0.01)[0] < 0.06


def test_standstill_and_a_gap_of_the_gyroscope_begin_new_windows():
    model = WheelLag()
    model.add_turn(1.0, 0.5, 0.05, True)
    for i in range(100):
        model.add_turn(1.05 + 0.05 * i, 0.1, 0.05, i % 2 == 0)
    assert model.value == 0.0


def drive(lag, duration=40.0, spike=None):
    """Return the estimator, and times, speed errors and yaw rates (n, 3) of a drive."""
    estimator = SlipEstimator(build(SlipEstimatorParams, {'imu.position': [0.0, 0.0, 0.0]}))
    found, position, stamp = [], [0.0, 0.0], 0
    for i in range(round(duration / STEP)):
        time = i * STEP - REST
        stamp = NS_PER_S + round(i * STEP * NS_PER_S)
        rate, v = float(yaw_rate(time)), float(speed(time))
        accel = (float(speed(time + 1e-4) - speed(time - 1e-4))) / 2e-4
        measured = 50.0 if i == spike else rate
        samples = [ImuSample(stamp, (accel, rate * v, GRAVITY), (0.0, 0.0, measured))]
        if i % 5 == 0:
            then = time - lag
            sides = [float(speed(then)) + sign * 0.5 * TRACK * float(yaw_rate(then))
                     for sign in (-1.0, 1.0)]
            position = [old + 0.05 * side / RADIUS for old, side in zip(position, sides)]
            left, right = (side / RADIUS for side in sides)
            samples.append(WheelSample(stamp, (left, right) * 2, tuple(position) * 2, None))
        found += [(time, one.linear[0] - v, one.angular[2]) for sample in samples
                  for one in estimator.update(sample) if isinstance(one, Odometry)]
    return estimator, np.array(found)


def test_the_speed_of_a_robot_with_late_wheels():
    """Without the lag its error is 47 mm/s; punctual wheels: 4 mm/s."""
    estimator, late = drive(0.12)
    assert estimator.status()['wheel_lag'] == pytest.approx(0.12, abs=0.03)
    settled = late[:, 0] > 15.0
    assert math.sqrt(np.mean(late[settled, 1] ** 2)) < 0.02


def test_yaw_rate_is_that_of_the_newest_reading_without_spikes():
    spike = 3200
    _, found = drive(0.12, spike=spike)
    settled = found[found[:, 0] > 20.0]
    error = settled[:, 2] - yaw_rate(settled[:, 0])
    assert np.abs(error).max() < 0.1
