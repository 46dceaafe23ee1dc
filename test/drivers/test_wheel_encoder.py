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

"""Encoder counts to angles, and the check of wheel motion against duty."""

from __future__ import annotations

import math

from hypothesis import given, strategies as st
import pytest

from smart_tire.drivers.wheel_encoder import MotionCheck, Reading, WheelEncoder
from smart_tire.parameters import MotorDriverParams
from smart_tire.protocol.roboclaw import COUNT_WRAP

DT = 1.0 / 16.0
RESOLUTION = math.tau / 2000
STALL_TORQUE = 5.0  # N m


@given(st.sampled_from([-1, 1]), st.integers(0, COUNT_WRAP - 1),
       st.lists(st.integers(-3000, 3000), max_size=20))
def test_counts_become_angles_across_the_wrap(sign, count, steps):
    encoder = WheelEncoder(sign, 2000)
    for step in (0, *steps):
        count = (count + step) % COUNT_WRAP
        encoder.add_count(count, 0.1)
        assert not encoder.jumped
    assert encoder.position == pytest.approx(sign * sum(steps) * RESOLUTION)


@pytest.mark.parametrize('elapsed', [0.0, -0.1])
def test_a_step_without_elapsed_time_is_ignored(elapsed):
    encoder = WheelEncoder(1, 2000)
    for count, seconds in ((0, 0.0), (100, elapsed), (110, 0.1)):
        encoder.add_count(count, seconds)
    assert encoder.position == pytest.approx(10 * RESOLUTION)


@pytest.mark.parametrize(('counts', 'jumped'), [
    (3183, False), (-3183, False), (3184, True), (-3184, True)])
def test_a_step_beyond_the_maximum_speed_is_a_jump_and_is_ignored(counts, jumped):
    encoder = WheelEncoder(1, 2000)  # 100 rad/s are 3183.1 counts in 0.1 s
    encoder.add_count(0, 0.0)
    encoder.add_count(counts % COUNT_WRAP, 0.1)
    assert encoder.jumped == jumped
    encoder.add_count((counts + 10) % COUNT_WRAP, 0.1)
    assert not encoder.jumped
    assert encoder.position == pytest.approx((10 if jumped else counts + 10) * RESOLUTION)


@pytest.fixture
def check():
    return MotionCheck(MotorDriverParams(), RESOLUTION)


class Motor:
    """Readings of a wheel whose encoder and motor are given."""

    def __init__(self, check):
        self.check, self.time, self.position = check, 0.0, 0.0

    def run(self, duty, speed, seconds, load=math.nan):
        """Return the fault found within ``seconds`` and its time [s]; ``load`` is a duty."""
        for tick in range(1, round(seconds / DT) + 1):
            self.time += DT
            self.position += speed * DT
            torque = load * STALL_TORQUE
            reading = Reading(self.time, self.position, duty, torque)
            if problem := self.check.check_reading(reading):
                return problem, tick * DT
        return '', seconds


@pytest.fixture
def motor(check):
    return Motor(check)


@pytest.mark.parametrize('duty', [0.05, 0.3, 1.0, -0.3, -1.0])
@pytest.mark.parametrize('load', [math.nan, 0.01])
def test_a_wheel_that_follows_its_duty_is_not_a_fault(motor, duty, load):
    assert motor.run(duty, 22.0 * (duty - math.copysign(0.01, duty)), 2.0, load)[0] == ''


def test_without_duty_any_motion_is_accepted(motor):
    for speed in (0.0, 5.0, -5.0, RESOLUTION / DT, 0.0):
        assert motor.run(0.0, speed, 1.0, 0.0)[0] == ''


def test_a_duty_that_has_ended_is_no_fault(motor):
    assert motor.run(0.5, 0.0, 0.2)[0] == ''
    assert motor.run(0.0, 0.0, 1.0)[0] == ''


def test_a_duty_below_the_gear_friction_need_not_move_the_wheel(motor):
    assert motor.run(0.045, 0.0, 2.0, 0.0)[0] == ''


@pytest.mark.parametrize('sign', [1, -1])
@pytest.mark.parametrize('load', [math.nan, 0.04])
def test_a_rolling_wheel_that_stops_while_its_duty_continues_is_a_fault(motor, sign, load):
    motor.run(sign * 0.07, sign * 0.6, 1.0, load)
    problem, after = motor.run(sign * 0.07, 0.0, 1.0, load)
    assert 'no encoder counts' in problem
    assert f'{sign * 0.07:.2f}' in problem
    assert 0.2 <= after < 0.27


def test_a_rolling_wheel_may_stop_if_its_duty_is_reduced(motor):
    motor.run(0.12, 1.2, 1.0)
    assert motor.run(0.1, 0.0, 2.0)[0] == ''
    motor.run(0.12, 1.2, 1.0)
    motor.run(-0.02, 0.6, DT)
    assert motor.run(0.12, 0.0, 2.0)[0] == ''  # it was braked, and may be held now


def test_a_rolling_wheel_may_stop_below_the_driving_duty(motor):
    motor.run(0.049, 1.0, 1.0)
    assert motor.run(0.049, 0.0, 1.0)[0] == ''


def test_a_wheel_that_coasted_may_be_started_slowly(motor):
    motor.run(0.0, 2.0, 1.0)
    assert motor.run(0.1, 0.0, 2.0)[0] == ''


def test_a_slow_wheel_may_stop(motor):
    motor.run(0.1, 0.4, 1.0)
    assert motor.run(0.1, 0.0, 1.0)[0] == ''


def test_a_stationary_wheel_must_start_at_the_stall_duty(motor):
    assert motor.run(0.299, 0.0, 10.0, 0.299)[0] == ''
    motor.check.reset()
    problem, after = motor.run(0.301, 0.0, 1.0, 0.301)
    assert 'no encoder counts' in problem
    assert 0.2 <= after < 0.32


@pytest.mark.parametrize('duty', [0.07, 0.29])
def test_a_wheel_held_by_its_load_is_not_a_fault(motor, duty):
    assert motor.run(duty, 0.0, 5.0, duty)[0] == ''


@pytest.mark.parametrize('duty', [0.15, -0.15])
def test_an_encoder_without_counts_is_a_fault_if_the_current_does_not_explain_it(motor, duty):
    problem, after = motor.run(duty, 0.0, 1.0, 0.04)
    assert 'no encoder counts' in problem
    assert after < 0.32


@pytest.mark.parametrize('duty', [0.4, -0.4])
def test_an_encoder_that_toggles_by_one_count_is_a_fault(check, duty):
    for tick in range(10):
        position = (tick // 4 % 2) * RESOLUTION
        if check.check_reading(Reading(tick * DT, position, duty, math.nan)):
            break
    assert 0.2 <= tick * DT < 0.3


def test_an_encoder_that_loses_counts_is_a_fault(motor):
    assert motor.run(0.6, 22.0 * 0.55, 1.0, 0.05)[0] == ''
    problem, after = motor.run(0.6, 0.2 * 22.0 * 0.55, 1.0, 0.05)
    assert 'too slowly' in problem
    assert after < 0.3


def test_a_motor_that_differs_by_its_tolerance_is_not_a_fault(motor):
    load = 0.2  # true: the measured one is too low by the errors of both constants
    assert motor.run(0.6, 0.8 * 22.0 * (0.6 - load), 2.0, 0.8 / 1.2 * load)[0] == ''


@pytest.mark.parametrize('sign', [1, -1])
@pytest.mark.parametrize('load', [math.nan, 0.05])
def test_rotation_against_the_duty_is_a_fault_if_no_load_explains_it(motor, sign, load):
    problem, after = motor.run(sign * 0.5, sign * -6.0, 1.0, load)
    assert 'reversed' in problem
    assert 0.2 < after < 0.33


def test_rotation_against_a_measured_torque_is_not_a_fault(motor):
    assert motor.run(-0.5, 6.0, 5.0, 0.5 + 6.0 / 22.0)[0] == ''


@pytest.mark.parametrize('load', [math.nan, 0.0])
def test_a_braking_wheel_is_not_a_fault_even_if_the_board_measures_no_braking(motor, load):
    motor.run(0.6, 12.0, 1.0, 0.05)
    speed = 12.0
    while speed > 0.5:
        assert motor.run(-0.2, speed, DT, load)[0] == ''
        speed -= STALL_TORQUE * (0.2 + speed / 22.0) / 0.0286 * DT


def test_a_reset_discards_the_readings_from_before(motor):
    motor.run(0.5, 0.0, 0.2)
    motor.check.reset()
    assert motor.run(0.5, 0.0, 1.0)[1] > 0.2
