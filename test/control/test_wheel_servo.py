# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Control of one wheel: PID feedback, and the reference with the expected speed."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control.slip_limits import TireLoad
from smart_tire.control.wheel_servo import DriveModel, Pid, SpeedReference
from smart_tire.parameters.control import PidParams
from smart_tire.samples import NS_PER_S

DT = 1.0 / 16.0
FREE = PidParams(rate_limit=1e6)
LIMITS = (20.0, 40.0)  # rad/s2, of acceleration and deceleration
STEP = 0.05
STEP_NS = round(STEP * NS_PER_S)
EXACT = DriveModel(speed_gain=0.05, friction=0.0, time_constant=0.1, acceleration=1.0,
                   wheel_time_constant=0.02, stall_torque=4.0, free_gain=0.05)
SLOW = replace(EXACT, acceleration=0.0)


def with_gains(proportional=0.0, integral=0.0, derivative=0.0, params=FREE):
    """Return ``params`` with these gains."""
    return replace(params, proportional=proportional, integral=integral, derivative=derivative)


def made(*gains, **changes):
    """Return a controller with these gains and the limits of ``params``."""
    return Pid(with_gains(*gains, **changes))


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


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize(('feed_forward', 'error'), [(0.9, 30.0), (1.01, 0.1)])
def test_while_the_duty_is_at_its_limit_the_integral_does_not_grow(sign, feed_forward, error):
    pid = made(integral=0.5)
    for _ in range(20):
        assert pid.duty(sign * feed_forward, sign * error, 0.0, DT) == sign
    assert pid.duty(0.0, 0.0, 0.0, DT) == 0.0


def test_at_the_limit_an_error_that_leads_back_is_integrated():
    pid = made(integral=0.5)
    pid.duty(0.0, 1.0, 0.0, 1.0)  # integral 0.5
    assert pid.duty(0.9, -0.2, 0.0, 1.0) == 1.0
    assert pid.duty(0.0, 0.0, 0.0, DT) == pytest.approx(0.1)  # of 0.4 what the limit leaves


def test_an_integral_is_at_most_what_the_limit_leaves():
    pid = made(integral=1.0)
    pid.duty(0.0, 0.8, 0.0, 1.0)  # integral 0.8
    assert pid.duty(0.6, 0.0, 0.0, DT) == 1.0
    assert pid.duty(0.0, 0.0, 0.0, DT) == pytest.approx(0.4)


def test_the_limit_does_not_reverse_an_integral_that_is_not_the_cause_of_an_excess():
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


@pytest.mark.parametrize('gains', [(0.2, 0.4, 0.0), (0.0, 0.1, 0.002), (0.04, 3.0, 0.01)])
def test_a_change_of_the_gains_does_not_move_the_output(gains):
    pid = made(0.04, 0.4, 0.001)
    for _ in range(5):
        before = pid.duty(0.1, 2.0, 5.0, DT)
    pid.set_params(with_gains(*gains))
    after = pid.duty(0.1, 2.0, 5.0, DT)
    assert after - before == pytest.approx(gains[1] * 2.0 * DT)
    assert before > 0.2


def test_a_change_of_the_feed_forward_is_compensated_by_the_integral():
    pid = made(0.04, 0.4)
    before = pid.duty(0.3, 0.5, 0.0, DT)
    pid.compensate(0.1)
    assert pid.duty(0.4, 0.5, 0.0, DT) == pytest.approx(before + 0.4 * 0.5 * DT)


def test_a_lower_limit_acts_at_once():
    pid = made(0.04, 0.4)
    assert pid.duty(0.9, 0.0, 0.0, DT) == 0.9
    pid.set_params(with_gains(0.04, 0.4, params=replace(FREE, limit=0.3)))
    assert pid.duty(0.9, 0.0, 0.0, DT) == 0.3


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
    pid.set_params(with_gains(0.5, 0.1, 0.1))
    assert pid.duty(0.0, 0.0, 0.0, STEP) == 0.0


def driven(set_points, start=0.0, model=EXACT):
    """Return the reference after steps of 50 ms, and its speeds."""
    reference, speeds = SpeedReference(start, 0), []
    for index, set_point in enumerate(set_points):
        reference.advance(set_point, STEP, index * STEP_NS, model, LIMITS)
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


def test_the_reference_begins_at_the_measured_speed():
    reference, speeds = driven([5.0], start=5.0)
    assert speeds == [5.0]
    assert reference.mean(-STEP_NS, 0) == 5.0


def test_the_direction_is_that_of_the_reference():
    assert [SpeedReference(speed, 0).direction for speed in (2.0, 0.0, -0.1)] == [1.0, 0.0, -1.0]


def test_with_the_whole_acceleration_the_expected_speed_is_at_the_reference():
    reference, _ = driven([3.0] * 4)
    reference.advance(3.0, STEP, 4 * STEP_NS, EXACT, LIMITS)
    assert reference.mean(3 * STEP_NS, 4 * STEP_NS) == pytest.approx(3.0)
    # exponential within a period, with the initial slope of a longer approach: mean above half
    final = 1.0 / -math.expm1(-STEP / 0.1)
    assert reference.mean(0, STEP_NS) == pytest.approx(final - 0.1 / STEP)


def test_the_expected_speed_lags_by_the_time_constant_without_acceleration():
    reference, _ = driven([1.0] * 40, model=SLOW)
    reference.advance(1.0, STEP, 40 * STEP_NS, SLOW, LIMITS)
    total = reference.mean(0, 40 * STEP_NS) * 40 * STEP
    assert 40 * STEP - total == pytest.approx(0.1, rel=1e-3)  # the area between is the lag


def test_the_mean_may_begin_and_end_within_periods():
    reference, _ = driven([3.0] * 8)
    parts = [reference.mean(quarter * STEP_NS // 4, (quarter + 1) * STEP_NS // 4)
             for quarter in range(20)]
    assert sum(parts) / 20 == pytest.approx(reference.mean(0, 5 * STEP_NS))
    assert parts == pytest.approx(sorted(parts))
    assert parts[0] < parts[4] < parts[8]


def test_the_speed_before_the_first_step_is_that_of_the_begin():
    reference, _ = driven([6.0] * 4, start=2.0)
    assert reference.mean(-3 * STEP_NS, 0) == pytest.approx(2.0)
    assert reference.mean(-STEP_NS, STEP_NS) == pytest.approx(
        0.5 * (2.0 + reference.mean(0, STEP_NS)))


LIGHT = replace(EXACT, acceleration=0.6)


def test_a_wheel_at_the_limit_of_slip_gets_the_torque_of_its_tire_and_its_own_inertia():
    reference = SpeedReference(10.0, 0)
    tire = TireLoad(speed=10.0, torque=0.5, critical_slip=0.3, command=20.0)
    applied = reference.advance(11.0, STEP, 0, LIGHT, LIMITS, tire)
    assert reference.velocity == pytest.approx(11.0)
    load = tire.torque_at(11.0) / (4.0 * 0.05)
    assert applied == pytest.approx(load + 10.0 + 1.0 / -math.expm1(-STEP / 0.02))
    reference.limit_input(applied)
    reference.advance(11.0, STEP, STEP_NS, LIGHT, LIMITS, tire)
    assert reference.velocity == 11.0
    reference.advance(11.0, STEP, 2 * STEP_NS, LIGHT, LIMITS, tire)
    assert reference.mean(STEP_NS, 2 * STEP_NS) == pytest.approx(11.0)


@pytest.mark.parametrize('torque, speed', [(0.65, 2.0), (0.63, -0.6)])
def test_a_slipping_wheel_brakes_faster_unless_the_limit_is_that_of_the_robot(torque, speed):
    """The tire slows the robot with torque / (4 N m * 0.05 s/rad * 0.08 s): 40 rad/s2."""
    reference = SpeedReference(4.0, 0)
    reference.advance(-1.0, STEP, 0, LIGHT, LIMITS, TireLoad(3.5, torque, 0.3, 0.0))
    assert reference.velocity == pytest.approx(speed)


def test_a_wheel_that_does_not_slip_yet_accelerates_with_the_robot():
    tire = TireLoad(speed=12.0, torque=0.5, critical_slip=0.3, command=20.0)
    with_tire, without = SpeedReference(10.0, 0), SpeedReference(10.0, 0)
    assert with_tire.advance(14.0, STEP, 0, LIGHT, LIMITS, tire) == without.advance(
        14.0, STEP, 0, LIGHT, LIMITS)


def test_a_step_at_the_same_time_does_not_advance_the_expected_speed():
    reference, _ = driven([3.0] * 2)
    before = reference.mean(0, STEP_NS)
    reference.advance(3.0, STEP, STEP_NS, EXACT, LIMITS)
    assert reference.mean(0, STEP_NS) == before


def test_only_the_latest_seconds_are_kept():
    reference, _ = driven([3.0] * 1000)
    assert len(reference._turned.times) <= 3.0 / STEP + 3
    assert reference.mean(997 * STEP_NS, 999 * STEP_NS) == pytest.approx(3.0)
