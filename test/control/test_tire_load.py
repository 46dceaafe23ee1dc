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

"""Torque of the tire force on a wheel at the limit of slip."""

from __future__ import annotations

import pytest
from smart_tire.control.drive_model import TireLoad
from smart_tire.models.tire.brush_tire import brush_force

FORWARD = TireLoad(speed=10.0, torque=0.5, critical_slip=0.3, speed_sigma=0.0, command=20.0)
REVERSE = TireLoad(speed=-10.0, torque=0.5, critical_slip=0.3, speed_sigma=0.0, command=20.0)


@pytest.mark.parametrize('speed', [4.0, 8.0, 9.9, 10.0, 10.5, 12.0, 14.0, 20.0])
def test_the_torque_is_that_of_the_brush_tire_against_driving_and_braking_wheels(speed):
    mu, load = 0.2, 0.5 / 0.2
    stiffness = 3.0 * mu * load / 0.3
    expected = float(brush_force((speed - 10.0) / speed, 0.0, mu, load, stiffness)[0])
    assert FORWARD.torque_at(speed) == pytest.approx(expected)
    assert REVERSE.torque_at(-speed) == pytest.approx(-expected)


def test_a_locked_wheel_and_one_against_the_motion_slide():
    assert FORWARD.torque_at(0.0) == -0.5
    assert FORWARD.torque_at(-3.0) == -0.5
    assert TireLoad(0.0, 0.5, 0.3, 0.0, 20.0).torque_at(0.0) == 0.0


def test_near_standstill_the_slip_refers_to_a_minimum_speed():
    assert TireLoad(0.0, 0.5, 0.3, 0.0, 20.0).slip_share(0.03) == pytest.approx(0.5)


@pytest.mark.parametrize('tire, speed, set_point, slips', [
    (FORWARD, 10.1, 14.0, True), (FORWARD, 9.9, 14.0, False), (FORWARD, 9.9, 7.0, True),
    (FORWARD, 10.1, 7.0, False), (FORWARD, 10.0, 14.0, False), (REVERSE, -10.1, -14.0, True),
    (REVERSE, -9.9, -14.0, False)])
def test_a_wheel_slips_from_the_ground_speed_on_towards_its_set_point(
        tire, speed, set_point, slips):
    assert tire.slips(speed, set_point) is slips


@pytest.mark.parametrize('tire', [FORWARD, REVERSE])
@pytest.mark.parametrize('factor', [0.0, 0.8, 0.95, 1.0, 1.1, 1.3])
@pytest.mark.parametrize('share', [0.2, 0.5, 0.95])
def test_a_share_of_the_force_is_that_at_the_returned_speed(tire, factor, share):
    speed = factor * tire.speed
    eased = tire.with_share(speed, share)
    assert tire.torque_at(eased) == pytest.approx(share * tire.torque_at(speed))
    assert abs(eased - tire.speed) <= abs(speed - tire.speed)


def test_the_whole_force_does_not_change_the_speed_at_all():
    assert FORWARD.with_share(17.3, 1.0) == 17.3


def test_the_force_is_continuous_and_small_where_the_speed_is_uncertain():
    sure, unsure = (TireLoad(10.0, 2.0, 0.01, sigma, 20.0) for sigma in (0.0, 1.0))
    assert sure.torque_at(10.1) == pytest.approx(2.0, rel=1e-3)
    assert abs(unsure.torque_at(10.1)) < 0.6
    steps = [unsure.torque_at(9.0 + 0.01 * step) for step in range(201)]
    assert all(0.0 < after - before < 0.06 for before, after in zip(steps, steps[1:]))
