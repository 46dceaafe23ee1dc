"""Mean speeds of the sides from positions, or from velocities where there are none."""

from __future__ import annotations

import math

import pytest

from smart_tire.estimation.slip.wheel_odometry import WheelReader
from smart_tire.parameters import RobotParams
from smart_tire.samples import WheelSample

ROBOT = RobotParams()
R = ROBOT.wheel_radius


def sample(velocity, position=None):
    return WheelSample(0, (velocity,) * 4, None if position is None else (position,) * 4)


def test_positions_give_the_mean_over_the_gap_whatever_the_velocity_says():
    reader = WheelReader(ROBOT)
    reader.read(0.0, sample(10.0, 0.0))
    reading = reader.read(0.5, sample(10.4, 5.1))
    assert reading.sides == pytest.approx((10.2 * R, 10.2 * R))
    assert reading.duration == 0.5 and reading.stamped


def test_velocities_describe_one_period_even_after_a_lost_message():
    reader = WheelReader(ROBOT)
    for k in range(20):
        reading = reader.read(0.1 * k, sample(3.0))
    assert reading.duration == pytest.approx(0.1) and not reading.stamped
    reading = reader.read(0.1 * 25, sample(3.0))
    assert reading.duration < 0.2
    assert reading.sides == pytest.approx((3.0 * R, 3.0 * R))


def test_a_counter_that_was_reset_is_noticed():
    reader = WheelReader(ROBOT)
    reader.read(0.0, sample(10.0, 1000.0))
    reading = reader.read(0.1, sample(10.0, 0.0))
    assert reader.jumps == 1
    assert reading.sides == pytest.approx((10.0 * R, 10.0 * R)) and not reading.stamped


def test_an_older_or_equal_sample_is_refused():
    reader = WheelReader(ROBOT)
    reader.read(1.0, sample(1.0))
    assert reader.read(1.0, sample(1.0)) is None
    assert reader.read(0.5, sample(1.0)) is None


def test_a_wheel_that_turns_differently_from_its_side_is_told_apart():
    reader = WheelReader(ROBOT)
    for k in range(30):
        reader.read(0.1 * k, WheelSample(0, (10.0, 5.0, 0.0, 5.0)))
    assert reader.side_speeds == pytest.approx((5.0 * R, 5.0 * R))
    assert reader.beyond_side == pytest.approx((5.0 * R, 0.0, -5.0 * R, 0.0), abs=1e-6)


def test_the_variance_is_that_of_two_counts_over_the_time():
    reader = WheelReader(ROBOT)
    reader.read(0.0, sample(0.0, 0.0))
    count = math.tau / ROBOT.encoder.counts_per_revolution * R
    assert reader.read(0.1, sample(0.0, 0.0)).variance == pytest.approx((count / 0.1) ** 2 / 12.0)
