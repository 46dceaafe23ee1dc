# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wheel odometry: mean side speeds from positions, or from velocities without them."""

from dataclasses import replace
import math

import pytest

from smart_tire.estimation.slip.inputs import WheelOdometry
from smart_tire.estimation.slip.state import LEARNING_TIME
from smart_tire.parameters import JointParams, RobotParams
from smart_tire.samples import WheelSample

ROBOT = RobotParams()
R = ROBOT.wheel_radius


def sample(velocity, position=None):
    return WheelSample(0, (velocity,) * 4, None if position is None else (position,) * 4)


@pytest.fixture
def odometry():
    return WheelOdometry(ROBOT)


def test_positions_give_the_mean_speed_over_the_gap(odometry):
    odometry.add_sample(0.0, sample(10.0, 0.0))
    speeds = odometry.add_sample(0.5, sample(10.4, 5.1))
    assert speeds.side_speeds == pytest.approx((10.2 * R, 10.2 * R))
    assert speeds.duration == 0.5 and speeds.from_positions


def after_a_gap(gap, last=3.0, jump=0.0):
    """Return the speeds after samples of 3 rad/s each 0.1 s and a gap; the last but one jumps."""
    odometry = WheelOdometry(ROBOT)
    for k in range(round(20.0 * LEARNING_TIME)):
        speeds = odometry.add_sample(0.1 * k, sample(3.0 + jump * (k % 2)))
    assert speeds.duration == pytest.approx(0.1) and not speeds.from_positions
    return odometry.add_sample(0.1 * k + gap, sample(last)), odometry


def test_without_positions_the_speed_is_interpolated_over_lost_messages():
    speeds, odometry = after_a_gap(0.5, last=6.0)
    assert speeds.duration == pytest.approx(0.5)
    # the last period is measured; the smoothed period has grown by 0.01 s
    mean = (4.5 * 0.39 + 6.0 * 0.11) / 0.5 * R
    assert speeds.side_speeds == pytest.approx((mean, mean))
    assert speeds.wheel_speeds == pytest.approx((mean,) * 4)
    assert odometry.side_speeds == pytest.approx((6.0 * R, 6.0 * R))


def test_the_variance_of_interpolated_speeds_is_that_of_a_brownian_bridge():
    """Of the distance: q T^3 / 12."""
    for gap in 1.0, 2.0:
        speeds, _ = after_a_gap(gap)
        assert speeds.variance == pytest.approx(
            0.2 ** 2 * (gap - 0.11) ** 3 / 12.0 / gap ** 2, rel=0.01)


def test_the_walk_of_the_speed_is_learned():
    speeds, _ = after_a_gap(1.0, jump=2.0)
    assert speeds.variance == pytest.approx(
        (2.0 * R) ** 2 / 0.1 * 0.89 ** 3 / 12.0, rel=0.2)


def test_an_encoder_reset_is_detected(odometry):
    odometry.add_sample(0.0, sample(10.0, 1000.0))
    speeds = odometry.add_sample(0.1, sample(10.0, 0.0))
    assert odometry.position_jumps == 1
    assert speeds.side_speeds == pytest.approx((10.0 * R, 10.0 * R)) and not speeds.from_positions


def test_samples_that_are_not_newer_are_refused(odometry):
    odometry.add_sample(1.0, sample(1.0))
    assert odometry.add_sample(1.0, sample(1.0)) is None
    assert odometry.add_sample(0.5, sample(1.0)) is None


def test_wheel_residual_is_the_difference_from_the_mean_of_the_side(odometry):
    for k in range(30):
        odometry.add_sample(0.1 * k, WheelSample(0, (10.0, 5.0, 0.0, 5.0)))
    assert odometry.side_speeds == pytest.approx((5.0 * R, 5.0 * R))
    assert odometry.wheel_residual == pytest.approx((5.0 * R, 0.0, -5.0 * R, 0.0), abs=1e-6)


def test_variance_is_that_of_quantization_at_both_ends(odometry):
    odometry.add_sample(0.0, sample(0.0, 0.0))
    count = math.tau / ROBOT.encoder.counts_per_revolution * R
    variance = odometry.add_sample(0.1, sample(0.0, 0.0)).variance
    assert variance == pytest.approx((count / 0.1) ** 2 / 12.0)


def test_the_speed_of_a_side_is_that_of_its_measured_wheels(odometry):
    nan = math.nan
    odometry.add_sample(0.0, WheelSample(0, (10.0, nan, nan, 8.0), (0.0, nan, nan, 0.0)))
    speeds = odometry.add_sample(0.1, WheelSample(0, (10.0, nan, nan, 8.0), (1.1, nan, nan, 0.9)))
    assert speeds.side_speeds == pytest.approx((11.0 * R, 9.0 * R)) and speeds.from_positions
    assert speeds.wheel_speeds == pytest.approx((11.0 * R, 9.0 * R) * 2)
    assert odometry.wheel_residual == (0.0,) * 4


def test_one_encoder_per_side_quantizes_with_twice_the_variance():
    single = replace(ROBOT, joints=JointParams(front_left='l', rear_left='', right='r'))
    both, one = (WheelOdometry(robot).add_sample(0.0, sample(1.0)).variance
                 for robot in (ROBOT, single))
    assert one == pytest.approx(2.0 * both) and both > 0.0
