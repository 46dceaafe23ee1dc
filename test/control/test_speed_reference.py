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

"""Reference of a wheel speed: limits of acceleration, expected speed and its means."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest
from smart_tire.control.drive_model import DriveModel, TireLoad
from smart_tire.control.wheel_servo import SpeedReference
from smart_tire.samples import NS_PER_S

LIMITS = (20.0, 40.0)  # rad/s2, of acceleration and deceleration
DT = 0.05
DT_NS = round(DT * NS_PER_S)
EXACT = DriveModel(speed_gain=0.05, friction=0.0, time_constant=0.1, acceleration=1.0,
                   wheel_time_constant=0.02, stall_torque=4.0)
SLOW = replace(EXACT, acceleration=0.0)


def driven(set_points, start=0.0, model=EXACT):
    """Return the reference after steps of 50 ms, and its speeds."""
    reference, speeds = SpeedReference(start, 0), []
    for index, set_point in enumerate(set_points):
        reference.advance(set_point, DT, index * DT_NS, model, LIMITS)
        speeds.append(reference.velocity)
    return reference, speeds


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_the_reference_accelerates_and_brakes_within_its_limits(sign):
    _, speeds = driven([sign * 3.2] * 5 + [sign * 0.5] * 3)
    assert speeds == pytest.approx([sign * speed for speed in (
        1.0, 2.0, 3.0, 3.2, 3.2, 1.2, 0.5, 0.5)])


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_reversal_brakes_and_accelerates_each_at_its_rate(sign):
    """From 3 rad/s: 2 of 50 ms at 40 rad/s2, then in the other direction at 20 rad/s2."""
    _, speeds = driven([-sign * 9.0] * 4, start=sign * 3.0)
    assert speeds == pytest.approx([sign * speed for speed in (1.0, -0.5, -1.5, -2.5)])


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_slow_wheels_accelerate_within_the_same_limit(sign):
    reference = SpeedReference(sign * 0.1, 0)
    reference.advance(sign * 0.9, 0.01, 0, EXACT, LIMITS)
    assert reference.velocity == pytest.approx(sign * 0.3)


def test_the_reference_begins_at_the_measured_speed():
    reference, speeds = driven([5.0], start=5.0)
    assert speeds == [5.0]
    assert reference.mean(-DT_NS, 0) == 5.0


def test_the_direction_is_that_of_the_reference():
    assert [SpeedReference(speed, 0).direction for speed in (2.0, 0.0, -0.1)] == [1.0, 0.0, -1.0]


def test_with_the_whole_acceleration_the_expected_speed_is_at_the_reference():
    reference, _ = driven([3.0] * 3)
    reference.advance(3.0, DT, 3 * DT_NS, EXACT, LIMITS)
    assert reference.mean(3 * DT_NS, 4 * DT_NS) == pytest.approx(3.0)
    # exponential within a period, with the initial slope of a longer approach: mean above half
    final = 1.0 / -math.expm1(-DT / 0.1)
    assert reference.mean(0, DT_NS) == pytest.approx(final - 0.1 / DT)


def test_the_expected_speed_lags_by_the_time_constant_without_acceleration():
    reference, _ = driven([1.0] * 40, model=SLOW)
    reference.advance(1.0, DT, 40 * DT_NS, SLOW, LIMITS)
    total = reference.mean(0, 40 * DT_NS) * 40 * DT
    assert 40 * DT - total == pytest.approx(0.1, rel=1e-3)  # the area between is the lag


def test_the_mean_may_begin_and_end_within_periods():
    reference, _ = driven([3.0] * 8)
    parts = [reference.mean(quarter * DT_NS // 4, (quarter + 1) * DT_NS // 4)
             for quarter in range(20)]
    assert sum(parts) / 20 == pytest.approx(reference.mean(0, 5 * DT_NS))
    assert parts == pytest.approx(sorted(parts))
    assert parts[0] < parts[4] < parts[8]


def test_the_speed_before_the_first_step_is_that_of_the_begin():
    reference, _ = driven([6.0] * 4, start=2.0)
    assert reference.mean(-3 * DT_NS, 0) == pytest.approx(2.0)
    assert reference.mean(-DT_NS, DT_NS) == pytest.approx(
        0.5 * (2.0 + reference.mean(0, DT_NS)))


LIGHT = replace(EXACT, acceleration=0.6)


def test_a_wheel_at_the_limit_of_slip_gets_the_torque_of_its_tire_and_its_own_inertia():
    reference = SpeedReference(10.0, 0)
    tire = TireLoad(speed=10.0, torque=0.5, critical_slip=0.3, speed_sigma=0.0, command=20.0)
    applied = reference.advance(11.0, DT, 0, LIGHT, LIMITS, tire)
    assert reference.velocity == pytest.approx(11.0)
    load = tire.torque_at(11.0) / (4.0 * 0.05)
    assert applied == pytest.approx(load + 10.0 + 1.0 / -math.expm1(-DT / 0.02))
    reference.limit_input(applied)
    reference.advance(11.0, DT, DT_NS, LIGHT, LIMITS, tire)
    assert reference.velocity == 11.0
    reference.advance(11.0, DT, 2 * DT_NS, LIGHT, LIMITS, tire)
    assert reference.mean(DT_NS, 2 * DT_NS) == pytest.approx(11.0)


@pytest.mark.parametrize('torque, speed', [(0.65, 2.0), (0.63, -0.6)])
def test_a_slipping_wheel_brakes_faster_unless_the_limit_is_that_of_the_robot(torque, speed):
    """The tire slows the robot with torque / (4 N m * 0.05 s/rad * 0.08 s): 40 rad/s2."""
    reference = SpeedReference(4.0, 0)
    reference.advance(-1.0, DT, 0, LIGHT, LIMITS, TireLoad(3.5, torque, 0.3, 0.0, 0.0))
    assert reference.velocity == pytest.approx(speed)


def test_a_wheel_that_does_not_slip_yet_accelerates_with_the_robot():
    tire = TireLoad(speed=12.0, torque=0.5, critical_slip=0.3, speed_sigma=0.0, command=20.0)
    with_tire, without = SpeedReference(10.0, 0), SpeedReference(10.0, 0)
    assert with_tire.advance(14.0, DT, 0, LIGHT, LIMITS, tire) == without.advance(
        14.0, DT, 0, LIGHT, LIMITS)


def test_a_step_at_the_same_time_does_not_advance_the_expected_speed():
    reference, _ = driven([3.0] * 2)
    before = reference.mean(0, DT_NS)
    reference.advance(3.0, DT, DT_NS, EXACT, LIMITS)
    assert reference.mean(0, DT_NS) == before


def test_only_the_latest_seconds_are_kept():
    reference, _ = driven([3.0] * 1000)
    assert len(reference._history) <= 3.0 / DT + 3
    assert reference.mean(997 * DT_NS, 999 * DT_NS) == pytest.approx(3.0)
