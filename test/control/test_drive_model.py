# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Models of a wheel: feed-forward and limits of the gains, and the force of its tire."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control.slip_limits import TireLoad
from smart_tire.control.wheel_servo import drive_model, DriveModel
from smart_tire.models.tire.brush_tire import brush_force
from smart_tire.parameters import build, RobotParams
from smart_tire.parameters.control import PidParams

MODEL = DriveModel(speed_gain=0.05, friction=0.03, time_constant=0.1, acceleration=1.0,
                   wheel_time_constant=0.02, stall_torque=4.0, free_gain=0.05)
FORWARD = TireLoad(speed=10.0, torque=0.5, critical_slip=0.3, command=20.0)
REVERSE = TireLoad(speed=-10.0, torque=0.5, critical_slip=0.3, command=20.0)


def test_the_model_follows_from_motor_and_mass():
    robot = build(RobotParams, {
        'motor.coulomb_friction': 0.2, 'motor.axle_friction': 0.02, 'motor.inertia': 0.01,
        'motor.viscous_friction': 0.04, 'mass': 8.0, 'wheel_radius': 0.1})
    model = drive_model(PidParams(feed_forward=0.05, stall_torque=4.0, acceleration=0.7), robot)
    assert model.speed_gain == pytest.approx(0.05 + 0.04 / 4.0)
    assert model.friction == pytest.approx((0.2 + 0.02 * 0.1 * 2.0 * 9.80665) / 4.0)
    assert model.time_constant == pytest.approx((0.01 + 2.0 * 0.1 ** 2) / (4.0 * 0.06))
    assert model.acceleration == 0.7
    assert model.wheel_time_constant == pytest.approx(0.01 / (4.0 * 0.06))
    assert model.stall_torque == 4.0
    assert model.free_gain == 0.05
    assert model.inertia == pytest.approx(0.01 + 2.0 * 0.1 ** 2)
    assert model.load_speed(0.48) == pytest.approx(2.0)
    assert model.slipping() == replace(
        model, time_constant=model.wheel_time_constant, acceleration=1.0)


def test_a_deceleration_above_that_of_the_robot_is_higher_for_a_slipping_wheel():
    of_robot = 0.8 / (4.0 * MODEL.speed_gain * (MODEL.time_constant - 0.02))
    assert MODEL.slipping_deceleration(1.01 * of_robot, 0.8) == pytest.approx(
        1.01 * of_robot * MODEL.time_constant / 0.02)
    assert MODEL.slipping_deceleration(0.99 * of_robot, 0.8) == 0.99 * of_robot


def test_the_duty_has_a_part_for_the_speed_and_one_for_the_friction():
    assert [MODEL.duty(4.0, direction) for direction in (1.0, 0.0, -1.0)] == pytest.approx(
        [0.23, 0.2, 0.17])


@pytest.mark.parametrize('dt', [0.005, 0.0625, 0.5])
def test_with_the_whole_acceleration_the_wheel_reaches_the_reference_in_time(dt):
    input_speed = MODEL.input_speed(2.0, 5.0, dt)
    after = input_speed + (2.0 - input_speed) * math.exp(-dt / 0.1)
    assert after == pytest.approx(5.0)


def test_without_acceleration_the_input_is_the_reference():
    model = replace(MODEL, acceleration=0.0)
    assert model.input_speed(2.0, 5.0, 0.01) == 5.0
    half = replace(MODEL, acceleration=0.5).input_speed(2.0, 5.0, 0.01)
    assert half == pytest.approx(0.5 * (5.0 + MODEL.input_speed(2.0, 5.0, 0.01)))


PID = PidParams(proportional=0.04, integral=0.4, derivative=0.0002)


def gains(pid):
    return pid.proportional, pid.integral, pid.derivative


@pytest.mark.parametrize(('changes', 'delay', 'expected'), [
    ({}, 0.0625, (0.04, 0.4, 2e-4)),  # as configured
    # one factor for all: integral gain 0.05 / (2 delay), proportional 0.1 times that
    ({}, 0.125, (0.02, 0.2, 1e-4)), ({}, 0.25, (0.01, 0.1, 5e-5)),
    ({'proportional': 0.4}, 0.0625, (0.04, 0.04, 2e-5)),
    ({'integral': 0.0}, 0.125, (0.02, 0.0, 1e-4)),
    ({'proportional': 0.0}, 0.125, (0.0, 0.2, 1e-4)),
    # that of the motor: above it a lifted wheel, whose lag is shorter, would oscillate
    ({'proportional': 1.0, 'integral': 0.0}, 1e-3, (MODEL.speed_gain, 0.0, 1e-5)),
    # a quarter of wheel time constant times speed gain, which is inertia over stall torque
    *(({'derivative': 10.0}, delay, (0.04 * factor, 0.4 * factor, 0.25 * 0.02 * 0.05))
      for delay, factor in ((1e-3, 1.0), (0.0625, 1.0), (0.25, 0.25)))])
def test_gains_are_limited_by_delay_and_motor(changes, delay, expected):
    assert gains(MODEL.limited(replace(PID, **changes), delay)) == pytest.approx(expected)


def test_without_a_known_delay_there_is_no_feedback():
    assert gains(MODEL.limited(PID, math.inf)) == (0.0, 0.0, 0.0)


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
    assert TireLoad(0.0, 0.5, 0.3, 20.0).torque_at(0.0) == 0.0


def test_near_standstill_the_slip_refers_to_a_minimum_speed():
    assert TireLoad(0.0, 0.5, 0.3, 20.0).slip_share(0.015) == pytest.approx(0.5)


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
