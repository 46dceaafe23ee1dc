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

"""Friction that the robot shows by its forces and slips."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control.ground_knowledge import MAX_FRICTION, RAISE_SHARE, ShownFriction
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GRAVITY, NS_PER_S, WheelSample
from support.torques import required_torque

ROBOT, V_X, PERIOD = RobotParams(), 1.0, 0.01
LOAD = ROBOT.mass * GRAVITY / 4.0


def shown(force, slip, *, prior=0.2, drag=0.0, seconds=1.0, aimed=0.2, effort=True):
    """Return the friction after driving with a ``force`` over the weight at a slip."""
    friction, acceleration = ShownFriction(ROBOT, prior), GRAVITY * (force - drag)
    omega = V_X / (1.0 - slip) / ROBOT.wheel_radius
    torque = float(required_torque(
        force * LOAD, omega, acceleration / ROBOT.wheel_radius, LOAD, ROBOT))
    for step in range(round(seconds / PERIOD)):
        friction.add_wheels(WheelSample(round(step * PERIOD * NS_PER_S), (omega,) * 4, None,
                                           (torque,) * 4 if effort else None), V_X, 0.0)
        friction.learn_resistance(acceleration, V_X, PERIOD, 0.05)
        friction.learn_friction(acceleration, V_X, 1, aimed, PERIOD)
    return friction


def test_the_force_in_use_is_a_lower_bound_of_the_friction():
    assert shown(0.4, 0.01).value == pytest.approx(0.4, rel=1e-3)
    assert shown(2.0, 0.01).value == MAX_FRICTION


def test_wheels_that_slip_with_little_force_show_little_friction():
    assert 0.1 <= shown(0.1, 0.25, prior=0.5, seconds=2.0).value < 0.14
    assert shown(0.1, 0.25, prior=0.5, seconds=0.05).value > 0.3  # it takes a moment


def test_wheels_that_lag_behind_the_aimed_slip_are_no_evidence():
    assert shown(0.02, 0.1, aimed=0.2).value == 0.2


def test_only_soft_ground_with_its_rolling_resistance_raises_the_friction():
    assert shown(0.22, 0.2, drag=0.16).value == pytest.approx(0.22 / RAISE_SHARE, rel=0.02)
    assert shown(0.22, 0.2).value == pytest.approx(0.22, rel=0.02)


def test_a_stop_whose_force_builds_up_late_is_no_evidence():
    friction = shown(0.02, -0.3, prior=0.4, seconds=0.01)
    for _ in range(100):
        friction.learn_friction(-0.2, V_X, -1, 0.2, PERIOD)
    assert friction.value == 0.4


def test_slip_against_the_direction_of_the_limit_is_no_evidence():
    assert shown(0.02, -0.2).value == 0.2


@pytest.mark.parametrize('drag', [0.05, 0.15])
def test_the_motor_torques_show_the_resistance_of_the_ground(drag):
    assert shown(0.4, 0.01, drag=drag, seconds=3.0).value == pytest.approx(0.4, rel=0.02)
    assert shown(0.4, 0.01, drag=drag, effort=False).value == pytest.approx(0.4 - drag, rel=1e-3)


@pytest.mark.parametrize('bad', [math.nan, math.inf, 1e9])
def test_readings_that_are_not_plausible_are_ignored(bad):
    friction = shown(0.3, 0.01)
    sample = WheelSample(10 * NS_PER_S, (bad,) * 4, None, (bad,) * 4)
    for one in (sample, replace(sample, velocity=(10.0,) * 4)):
        friction.add_wheels(one, V_X, 0.0)
        friction.learn_resistance(0.0, V_X, PERIOD, 0.05)
        friction.learn_friction(0.0, V_X, 1, 1.0, PERIOD)
    assert friction.value == pytest.approx(0.3, rel=1e-3)
