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

"""Turning in place: yaw rate, end, and position."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control.ground_motion import Motion
from smart_tire.control.motion_limits import MotionLimits
from smart_tire.control.path_follower import SpinControl
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.parameters.path_following import ArrivalParams, FollowerParams

LIMITS = MotionLimits(speed=1.0, acceleration=0.5, deceleration=0.4, lateral=1.0, yaw_rate=0.9,
                      yaw_acceleration=0.5)
PARAMS = TrajectoryControllerParams(
    slip_compensation=False, follower=FollowerParams(spin_rate=0.8, min_spin_rate=0.2),
    arrival=ArrivalParams(yaw_tolerance=0.1))


def rate(error, measured=None, *, spin=None, limits=LIMITS):
    """Return the rate commanded for a yaw error, by default without error of the yaw rate."""
    spin = spin or SpinControl((0.0, 0.0))
    measured = math.copysign(5.0, error) if measured is None else measured
    return spin.step(error, measured, 0.1, limits, PARAMS)


@pytest.mark.parametrize(('error', 'expected'), [
    (2.0, 0.8), (-2.0, -0.8), (0.4, math.sqrt(2.0 * 0.85 * 0.5 * 0.4)), (0.06, 0.2255),
    (-0.3, -math.sqrt(2.0 * 0.85 * 0.5 * 0.3))])
def test_the_rate_decreases_towards_the_end(error, expected):
    assert rate(error) == pytest.approx(expected, rel=2e-3)


def test_the_rate_has_a_minimum_and_the_limit_of_the_robot():
    slow = MotionLimits(1.0, 0.5, 0.4, 1.0, 0.5, 1e-3)
    assert rate(0.06, limits=slow) == 0.2
    fast = MotionLimits(1.0, 0.5, 0.4, 1.0, 0.5, 10.0)
    assert rate(2.0, limits=fast) == 0.5


def test_with_slip_compensation_the_rate_ends_the_turn_no_sooner_than_its_delay():
    fast = MotionLimits(1.0, 0.5, 0.4, 1.0, 0.5, 10.0)
    spin = SpinControl((0.0, 0.0))
    params = replace(PARAMS, slip_compensation=True)
    assert spin.step(0.06, 0.5, 0.1, fast, params) == pytest.approx(0.4)  # 0.06 rad in 0.15 s


@pytest.mark.parametrize(('error', 'done'), [(0.049, True), (-0.049, True), (0.051, False)])
def test_a_turn_is_done_within_half_the_tolerance_and_remains_so(error, done):
    spin = SpinControl((0.0, 0.0))
    assert (rate(error, spin=spin) == 0.0) == done
    assert spin.done == done
    assert spin.error == error
    rate(0.3, spin=spin)
    assert spin.done == done


def test_the_command_grows_while_the_robot_turns_slower():
    spin = SpinControl((0.0, 0.0))
    wanted = rate(0.3)
    first = rate(0.3, 0.0, spin=spin)
    assert first == pytest.approx(wanted + 0.1 * wanted)
    rates = [rate(0.3, 0.0, spin=spin) for _ in range(40)]
    assert rates[-1] == pytest.approx(0.8)
    assert rates == sorted(rates)
    assert rate(0.3, 3.0, spin=spin) < 0.8  # and shrinks while it turns faster
    assert rate(-0.3, 0.0) == pytest.approx(-first)


def test_a_turn_keeps_its_side_at_half_a_revolution():
    spin = SpinControl((0.0, 0.0))
    assert rate(3.1, spin=spin) > 0.0
    assert rate(-3.1, spin=spin) > 0.0
    assert spin.error == pytest.approx(math.tau - 3.1)
    spin = SpinControl((0.0, 0.0))
    assert rate(-3.1, spin=spin) < 0.0
    assert rate(3.1, spin=spin) < 0.0


def test_an_overshoot_is_turned_back():
    spin = SpinControl((0.0, 0.0))
    rate(1.0, spin=spin)
    assert rate(-0.2, spin=spin) < 0.0


@pytest.mark.parametrize(('x', 'y', 'yaw', 'expected'), [
    (0.01, 0.0, 0.0, -0.03), (-0.01, 0.0, 0.0, 0.03), (0.0, 0.01, 0.0, 0.0),
    (0.0, 0.01, math.pi / 2, -0.03), (0.01, 0.0, math.pi, 0.03), (1.0, 0.0, 0.0, -0.1)])
def test_the_speed_returns_the_robot_to_its_position(x, y, yaw, expected):
    spin = SpinControl((2.0, 1.0))
    motion = Motion(2.0 + x, 1.0 + y, yaw, 0.0, 0.0, 0.0)
    assert spin.holding_speed(motion, expected, 0.1, LIMITS) == pytest.approx(expected, abs=1e-12)
    assert spin.holding_speed(motion, 0.0, 1e-3, LIMITS) == pytest.approx(
        math.copysign(min(abs(expected), 0.4e-3), expected), abs=1e-12)
