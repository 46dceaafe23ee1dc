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

"""Feedback of one wheel: limits, anti-windup, and changes of gains without a jump."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control.drive_model import Gains
from smart_tire.control.wheel_servo import Pid
from smart_tire.parameters.control import PidParams

DT = 1.0 / 16.0
FREE = PidParams(rate_limit=1e6, tracking_time=0.5)


def made(proportional=0.0, integral=0.0, derivative=0.0, params=FREE):
    """Return a controller with these gains and the limits of ``params``."""
    return Pid(replace(params, proportional=proportional, integral=integral,
                       derivative=derivative))


def test_the_output_is_the_sum_of_feed_forward_and_terms():
    pid = made(proportional=0.1, integral=0.5, derivative=0.01)
    assert pid.duty(0.2, 1.0, -3.0, 0.25) == pytest.approx(0.2 + 0.1 + 0.125 + 0.03)


def test_the_integral_grows_with_error_and_time():
    pid = made(integral=0.5)
    assert pid.duty(0.0, 1.0, 0.0, 0.25) == pytest.approx(0.125)
    assert pid.duty(0.0, 1.0, 0.0, 0.5) == pytest.approx(0.375)
    assert pid.duty(0.0, -1.0, 0.0, 0.75) == pytest.approx(0.0)


def test_an_error_that_is_not_current_is_not_integrated():
    pid = made(proportional=0.1, integral=0.5)
    pid.duty(0.0, 1.0, 0.0, 1.0)
    for _ in range(3):
        assert pid.duty(0.0, 1.0, 0.0, 1.0, current=False) == pytest.approx(0.6)


def test_the_duty_never_leaves_its_limits():
    pid = made(0.04, 0.4, 0.001, PidParams(limit=0.6, rate_limit=2.0))
    last, seen = 0.0, []
    for step in range(400):
        sign = math.copysign(1.0, math.sin(0.05 * step))
        seen.append(pid.duty(0.9 * sign, 20.0 * sign, 0.0, DT))
        assert abs(seen[-1] - last) <= 2.0 * DT + 1e-12
        last = seen[-1]
    assert (min(seen), max(seen)) == (-0.6, 0.6)


def test_while_the_duty_is_at_its_limit_the_integral_does_not_grow():
    for sign in (1.0, -1.0):
        pid = made(integral=0.5)
        for _ in range(300):
            assert pid.duty(sign * 0.9, sign * 30.0, 0.0, DT) == sign
        assert sign * pid.duty(0.0, 0.0, 0.0, DT) <= 0.1


def test_at_the_limit_an_error_that_leads_back_is_integrated():
    pid = made(integral=0.5, params=replace(FREE, tracking_time=1e9))
    pid.duty(0.0, 1.0, 0.0, 1.0)  # integral 0.5
    assert pid.duty(0.9, -0.5, 0.0, 1.0) == 1.0
    assert pid.duty(0.0, 0.0, 0.0, DT) == pytest.approx(0.25)


def test_an_integral_beyond_the_limit_decays_with_the_tracking_time():
    pid = made(integral=1.0)
    pid.duty(0.0, 0.8, 0.0, 1.0)  # integral 0.8
    for _ in range(8):  # excess 0.4, 0.35, ...
        pid.duty(0.6, 0.0, 0.0, DT)
    assert pid.duty(0.0, 0.0, 0.0, DT) == pytest.approx(0.4 + 0.4 * (1.0 - DT / 0.5) ** 8)


def test_back_calculation_does_not_reverse_an_integral_that_is_not_the_cause():
    pid = made(proportional=1.0, integral=0.1)
    for sign in (1.0, -1.0):
        pid.reset()
        pid.duty(0.0, sign * 0.5, 0.0, 1.0)  # integral 0.05
        for _ in range(300):
            pid.duty(0.0, sign * 30.0, 0.0, DT)
        assert pid.duty(0.0, 0.0, 0.0, DT) == pytest.approx(0.0, abs=1e-12)
        pid.duty(0.0, -sign * 0.5, 0.0, 1.0)
        for _ in range(300):  # the integral reduces the excess
            pid.duty(0.0, sign * 30.0, 0.0, DT)
        assert pid.duty(0.0, 0.0, 0.0, DT) == pytest.approx(-sign * 0.05)


def test_the_rate_limit_causes_no_windup():
    pid = made(0.04, 0.4, params=PidParams(rate_limit=0.1))
    for _ in range(50):
        pid.duty(0.5, 10.0, 0.0, DT)
    for _ in range(40):
        duty = pid.duty(0.5, 0.0, 0.0, DT)
    assert duty == pytest.approx(0.5, abs=1e-9)


def test_after_a_reset_the_output_is_that_of_a_new_controller():
    pid = made(0.04, 0.4)
    first = pid.duty(0.1, 2.0, 0.0, DT)
    pid.duty(0.5, 4.0, 0.0, DT)
    pid.reset()
    assert pid.duty(0.1, 2.0, 0.0, DT) == first


@pytest.mark.parametrize('gains', [Gains(0.2, 0.4, 0.0), Gains(0.0, 0.1, 0.002),
                                   Gains(0.04, 3.0, 0.01)])
def test_a_change_of_the_gains_does_not_move_the_output(gains):
    pid = made(0.04, 0.4, 0.001)
    for _ in range(5):
        before = pid.duty(0.1, 2.0, 5.0, DT)
    pid.set_gains(FREE, gains)
    after = pid.duty(0.1, 2.0, 5.0, DT)
    assert after - before == pytest.approx(gains.integral * 2.0 * DT)
    assert before > 0.2


def test_a_change_of_the_feed_forward_is_compensated_by_the_integral():
    pid = made(0.04, 0.4)
    before = pid.duty(0.3, 0.5, 0.0, DT)
    pid.compensate(0.1)
    assert pid.duty(0.4, 0.5, 0.0, DT) == pytest.approx(before + 0.4 * 0.5 * DT)


def test_a_lower_limit_acts_at_once():
    pid = made(0.04, 0.4)
    assert pid.duty(0.9, 0.0, 0.0, DT) == 0.9
    pid.set_gains(replace(FREE, limit=0.3), Gains(0.04, 0.4, 0.0))
    assert pid.duty(0.9, 0.0, 0.0, DT) == 0.3


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_small_excess_with_a_small_error_is_not_integrated_either(sign):
    pid = made(integral=0.5, params=replace(FREE, tracking_time=1e9))
    for _ in range(20):
        assert pid.duty(sign * 1.01, sign * 0.1, 0.0, DT) == sign
    assert pid.duty(0.0, 0.0, 0.0, DT) == 0.0


def test_in_one_step_an_integral_decays_by_the_excess_at_most():
    pid = made(integral=1.0)
    pid.duty(0.0, 0.8, 0.0, 1.0)  # integral 0.8
    pid.duty(0.6, 0.0, 0.0, 5.0)  # ten tracking times
    assert pid.duty(0.0, 0.0, 0.0, DT) == pytest.approx(0.4)


def test_what_the_limits_cut_off_is_the_excess():
    pid = made(params=PidParams(limit=0.5, rate_limit=4.0))
    assert (pid.duty(0.9, 0.0, 0.0, DT), pid.excess) == (0.25, pytest.approx(0.65))
    pid.duty(0.9, 0.0, 0.0, DT)
    assert (pid.duty(0.9, 0.0, 0.0, DT), pid.excess) == (0.5, pytest.approx(0.4))
    assert (pid.duty(0.4, 0.0, 0.0, DT), pid.excess) == (0.4, 0.0)
    pid.duty(0.9, 0.0, 0.0, DT)
    pid.reset()
    assert pid.excess == 0.0


def test_gains_changed_after_a_reset_leave_the_integral_at_zero():
    pid = made(proportional=0.1, derivative=0.01)
    pid.duty(0.0, 2.0, 3.0, DT)
    pid.reset()
    pid.set_gains(FREE, Gains(0.5, 0.1, 0.1))
    assert pid.duty(0.0, 0.0, 0.0, DT) == 0.0
