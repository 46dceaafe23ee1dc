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

"""Speed controller of one wheel: limits, feed-forward, anti-windup."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control.pid import Pid
from smart_tire.parameters.control import PidParams

DT = 1.0 / 16.0
PURE = PidParams(feed_forward=0.0, proportional=0.0, integral=0.0, derivative=0.0,
                 rate_limit=1e6)


def test_feed_forward_alone_is_proportional_to_the_set_point():
    pid = Pid(replace(PURE, feed_forward=0.05))
    assert [pid.update(set_point, 0.0, DT) for set_point in (4.0, -8.0, 0.0)] == [0.2, -0.4, 0.0]


def test_the_integral_grows_with_error_and_time():
    pid = Pid(replace(PURE, integral=0.5))
    assert pid.update(1.0, 0.0, 0.25) == pytest.approx(0.125)
    assert pid.update(1.0, 0.0, 0.5) == pytest.approx(0.375)
    assert pid.update(0.0, 1.0, 0.75) == pytest.approx(0.0)


def test_the_derivative_brakes_a_rising_speed_and_ignores_the_set_point():
    pid = Pid(replace(PURE, derivative=0.01))
    assert pid.update(0.0, 1.0, DT) == 0.0
    assert pid.update(100.0, 1.0, DT) == 0.0
    assert pid.update(100.0, 2.0, DT) == pytest.approx(-0.01 / DT)


def test_the_duty_never_leaves_its_limits():
    pid = Pid(PidParams(limit=0.6, rate_limit=2.0))
    last = 0.0
    for step in range(400):
        duty = pid.update(20.0 * math.copysign(1.0, math.sin(0.05 * step)), 0.0, DT)
        assert abs(duty) <= 0.6
        assert abs(duty - last) <= 2.0 * DT + 1e-12
        last = duty


def test_recovery_from_saturation_does_not_depend_on_its_duration():
    responses = []
    for steps in (3, 300):
        pid = Pid(PidParams(rate_limit=1e6))
        for _ in range(steps):
            assert pid.update(30.0, 0.0, DT) == 1.0
        responses.append([pid.update(5.0, 6.0, DT) for _ in range(3)])
    assert responses[0] == responses[1]


def test_the_rate_limit_causes_no_windup():
    pid = Pid(PidParams(rate_limit=0.1))
    for _ in range(50):
        pid.update(10.0, 0.0, DT)
    rising = pid.update(10.0, 10.0, DT)
    assert rising <= 51 * 0.1 * DT + 1e-9


def test_after_a_reset_the_output_is_that_of_a_new_controller():
    pid = Pid(PidParams())
    first = pid.update(3.0, 1.0, DT)
    pid.update(9.0, 4.0, DT)
    pid.reset()
    assert pid.update(3.0, 1.0, DT) == first


@pytest.mark.parametrize('set_point', [-12.0, 0.5, 6.3, 12.6])
@pytest.mark.parametrize('load', [0.0, 0.6])
def test_a_geared_motor_reaches_its_set_point_and_settles(set_point, load):
    """A motor of 4 N m and 20 rad/s whose speed is measured as the mean over the last period."""
    pid, speed, duty, measured = Pid(PidParams()), 0.0, 0.0, 0.0
    history = []
    for _ in range(80):
        before, travelled = speed, 0.0
        for _ in range(62):
            torque = 4.0 * (duty - speed / 20.0) - math.copysign(load, set_point)
            speed += torque / 0.04 * DT / 62
            travelled += speed * DT / 62
        duty = pid.update(set_point, measured, DT)  # one period late, as over a bus
        measured = travelled / DT
        history.append(before)
    assert history[-20:] == [pytest.approx(set_point, rel=0.02, abs=0.05)] * 20
    overshoot = max(speed * math.copysign(1.0, set_point) for speed in history) - abs(set_point)
    assert overshoot < 0.3 * abs(set_point) + 0.3
