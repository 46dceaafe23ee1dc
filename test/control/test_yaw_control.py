# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Yaw control at the limit of friction: which side may have how much of its force."""

from __future__ import annotations

import math

import pytest
from smart_tire.control.slip_limits import YawControl

ARM, FORCE, DELAY, PERIOD = 0.5, 10.0, 0.1, 0.01  # m/(kg m2), N, s, s


def shares(deviation, direction=1, *, delay=DELAY, force=FORCE, control=None):
    return (control or YawControl(ARM)).shares(deviation, PERIOD, delay, force, direction)


@pytest.mark.parametrize('direction', [1, -1])
@pytest.mark.parametrize('deviation', [0.2, -0.2])
def test_the_side_that_turns_the_robot_gets_less_force(deviation, direction):
    left, right = shares(deviation, direction)
    less, other = (right, left) if deviation * direction > 0.0 else (left, right)
    # bandwidth 5 rad/s: 5 * 0.2 rad/s2, and 6.25 /s2 of 0.002 rad, over 5 rad/s2
    assert less == pytest.approx(1.0 - (5.0 * 0.2 + 0.25 * 5.0 ** 2 * 0.002) / 5.0)
    assert other == 1.0


def test_a_side_is_not_driven_backward():
    assert shares(10.0) == (1.0, 0.0)
    assert shares(-10.0) == (0.0, 1.0)


def test_the_heading_is_restored_and_forgotten_at_the_end_of_the_limit():
    control = YawControl(ARM)
    for _ in range(100):
        shares(0.1, control=control)
    assert control.heading == pytest.approx(0.1)
    assert shares(0.0, control=control)[1] < 0.9
    control.reset()
    assert shares(0.0, control=control) == (1.0, 1.0)


def test_the_gain_decreases_with_the_delay_and_is_finite_without_one():
    assert shares(0.1, delay=0.2)[1] > shares(0.1, delay=0.1)[1]
    assert shares(0.001, delay=0.0) == shares(0.001, delay=0.01)
    assert shares(0.01, force=0.0) == shares(10.0)


@pytest.mark.parametrize('track_error', [0.7, 1.0, 1.3])
def test_the_loop_of_a_yawing_robot_with_a_delay_is_damped(track_error):
    """The moment of ground with 20 % less force on the left is balanced by a turn of 12 deg."""
    control, rate, heading, history = YawControl(ARM), 0.0, 0.0, [0.0] * 10
    rates = []
    for _ in range(400):
        left, right = shares(history[-10], control=control)
        rate += PERIOD * track_error * ARM * FORCE * (right * 1.0 - left * 0.8)
        heading += PERIOD * rate
        history.append(rate)
        rates.append(rate)
    assert max(rates) < 0.3
    assert abs(rates[-1]) < 0.01
    assert min(rates) > -0.01
    assert math.degrees(heading) < 13.0
