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

import pytest

from smart_tire.drivers.wheel_encoder import MotionCheck, WheelEncoder
from smart_tire.protocol.roboclaw import COUNT_WRAP

DT = 1.0 / 16.0
RESOLUTION = math.tau / 2000


def test_counts_become_angles_across_the_wrap():
    encoder = WheelEncoder(1, 2000)
    assert encoder.resolution == RESOLUTION
    encoder.update(COUNT_WRAP - 100, 0.1)
    assert (encoder.position, encoder.step, encoder.jumped) == (0.0, 0.0, False)
    encoder.update(100, 0.1)
    assert encoder.step == pytest.approx(200 * RESOLUTION)
    encoder.update(50, 0.1)
    assert encoder.step == pytest.approx(-50 * RESOLUTION)
    assert encoder.position == pytest.approx(150 * RESOLUTION)


def test_a_negative_sign_reverses_the_counts():
    encoder = WheelEncoder(-1, 2000)
    encoder.update(0, 0.0)
    encoder.update(100, 0.1)
    assert encoder.position == pytest.approx(-100 * RESOLUTION)


def test_a_step_without_elapsed_time_is_ignored():
    encoder = WheelEncoder(1, 2000)
    encoder.update(0, 0.0)
    encoder.update(100, 0.0)
    assert encoder.position == 0.0
    encoder.update(110, 0.1)
    assert encoder.position == pytest.approx(10 * RESOLUTION)


@pytest.mark.parametrize(('counts', 'jumped'), [(3183, False), (3184, True), (-3184, True)])
def test_a_step_beyond_the_maximum_speed_is_a_jump_and_is_ignored(counts, jumped):
    encoder = WheelEncoder(1, 2000)  # 100 rad/s are 3183.1 counts in 0.1 s
    encoder.update(0, 0.0)
    encoder.update(counts % COUNT_WRAP, 0.1)
    assert encoder.jumped == jumped
    assert (encoder.position == 0.0) == jumped
    encoder.update((counts + 10) % COUNT_WRAP, 0.1)
    assert not encoder.jumped
    assert encoder.step == pytest.approx(10 * RESOLUTION)


@pytest.fixture
def check():
    return MotionCheck(RESOLUTION, 20.0, 0.3, 0.2)


def run(check, duty, speed, seconds):
    """Return the fault found within ``seconds`` and its time [s]."""
    for tick in range(1, round(seconds / DT) + 1):
        if problem := check.update(duty, speed * DT, DT):
            return problem, tick * DT
    return '', seconds


def found(check, duty, speed, seconds=1.0):
    return run(check, duty, speed, seconds)[0]


def test_a_wheel_that_follows_its_duty_is_not_a_fault(check):
    for duty in (0.05, 0.3, 1.0, -0.3, -1.0):
        assert found(check, duty, 20.0 * duty) == ''


def test_without_duty_any_motion_is_accepted(check):
    for speed in (0.0, 5.0, -5.0, 0.0):
        assert found(check, 0.0, speed) == ''


@pytest.mark.parametrize('sign', [1, -1])
def test_a_rolling_wheel_that_stops_under_duty_is_a_fault(check, sign):
    run(check, sign * 0.05, sign * 1.0, 0.5)
    problem, after = run(check, sign * 0.05, 0.0, 1.0)
    assert 'no encoder counts' in problem
    assert f'{sign * 0.05:.2f}' in problem
    assert 0.2 <= after < 0.27


def test_a_rolling_wheel_may_stop_below_the_driving_duty(check):
    run(check, 0.1, 2.0, 0.5)
    assert found(check, 0.049, 0.0) == ''
    assert found(check, 0.29, 0.0) == ''  # after the stop only the stall duty counts


def test_a_stationary_wheel_must_start_at_the_stall_duty(check):
    assert found(check, 0.299, 0.0, 10.0) == ''
    problem, after = run(check, 0.3, 0.0, 1.0)
    assert 'no encoder counts' in problem
    assert 0.2 <= after < 0.27


def test_a_single_count_resets_the_stall_timer(check):
    run(check, 0.5, 0.0, 0.19)
    assert check.update(0.5, RESOLUTION, DT) == ''
    assert run(check, 0.5, 0.0, 1.0)[1] >= 0.2


def test_a_wheel_below_the_rolling_speed_may_stop(check):
    run(check, 0.2, 0.4, 0.5)
    assert found(check, 0.2, 0.0) == ''


def test_a_coarse_encoder_may_pause_between_two_counts():
    coarse = MotionCheck(math.tau / 48, 20.0, 0.3, 0.2)
    assert coarse.update(0.2, math.tau / 48, DT) == ''  # 2.1 rad/s on average
    assert found(coarse, 0.2, 0.0) == ''
    run(coarse, 0.2, 4.0, 0.5)
    assert found(coarse, 0.2, 0.0) != ''


def test_a_wheel_may_stop_before_it_reverses(check):
    run(check, 0.2, 4.0, 0.5)
    assert found(check, -0.2, 0.0) == ''  # static friction may hold it


@pytest.mark.parametrize('sign', [1, -1])
def test_rotation_against_the_duty_without_slowing_down_is_a_fault(check, sign):
    problem, after = run(check, sign * 0.5, sign * -6.0, 1.0)
    assert 'reversed' in problem
    assert 0.2 < after < 0.33


def test_a_wheel_that_accelerates_against_its_duty_is_a_fault(check):
    problem, total = '', 0.0
    for tick in range(16):
        duty, speed = min(0.1 * tick, 1.0), -2.0 * tick
        problem, total = check.update(duty, speed * DT, DT), tick * DT
        if problem:
            break
    assert 'reversed' in problem
    assert total <= 0.5


def test_a_braking_wheel_that_slows_down_is_not_a_fault(check):
    speed = 12.0
    while speed > 0.1:
        assert check.update(-0.5, speed * DT, DT) == ''
        speed *= 0.84 ** (DT / 0.2)
        speed -= 0.1


def test_rotation_against_a_small_torque_is_not_a_fault(check):
    assert found(check, -0.25, 4.9, 5.0) == ''  # 0.25 + 4.9 / 20 of the stall torque
    assert found(check, -0.25, 5.1, 5.0) != ''


def test_slow_rotation_against_the_duty_is_not_a_fault(check):
    assert found(check, -1.0, 0.49, 5.0) == ''
    assert found(check, -1.0, 0.51, 5.0) != ''


def test_reset_clears_all_timers(check):
    run(check, 0.5, 0.0, 0.19)
    run(check, -0.5, 8.0, 0.19)
    check.reset()
    assert run(check, 0.5, 0.0, 1.0)[1] >= 0.2
    check.reset()
    assert run(check, -0.5, 8.0, 1.0)[1] > 0.2
    run(check, 0.5, 8.0, 0.5)
    check.reset()
    assert found(check, 0.2, 0.0) == ''
