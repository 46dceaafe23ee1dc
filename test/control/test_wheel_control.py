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

"""Wheel speeds to duties, and all conditions that stop the robot."""

from __future__ import annotations

from dataclasses import replace

import pytest

from smart_tire.control.wheel_control import WheelControl
from smart_tire.parameters.control import PidParams, WheelControllerParams
from smart_tire.samples import NS_PER_S, VelocityCommand

PARAMS = WheelControllerParams(wheel_states_timeout=0.5)
PERIOD_NS = NS_PER_S // 16
RADIUS = PARAMS.robot.wheel_radius
STOPPED = (0.0, 0.0, 0.0, 0.0)
AHEAD = (0.5 / RADIUS,) * 4  # rad/s, at 0.5 m/s


def started(params=PARAMS, velocity=(1.0, 1.0, 1.0, 1.0)):
    """Return a controller with wheel speeds measured at time zero."""
    control = WheelControl(params)
    control.update_measurement(velocity, 0)
    return control


def test_equal_set_points_give_equal_duties():
    set_points, duty = started().step(AHEAD, 0)
    assert set_points == pytest.approx(AHEAD)
    assert len(set(duty)) == 1
    assert duty[0] > 0.0


def test_a_body_velocity_becomes_wheel_speeds_of_the_effective_track():
    control = started(replace(PARAMS, effective_track=0.5))
    set_points, duty = control.follow(VelocityCommand(0, 0.5, 1.0), 0)
    assert set_points == pytest.approx([0.25 / RADIUS, 0.75 / RADIUS] * 2)
    assert duty[1] > duty[0] > 0.0
    assert control.follow(None, 1) == (STOPPED, STOPPED)


def test_each_wheel_has_its_own_controller():
    _, duty = started().step((1.0, 2.0, -3.0, 0.0), 0)
    assert duty[2] < 0.0 < duty[0] < duty[1]
    assert duty[3] < 0.0  # it rotates with a set point of zero


def test_a_command_that_is_too_fast_is_scaled_down_on_the_same_curve():
    control = started(replace(PARAMS, max_wheel_speed=10.0))
    assert control.step((10.0, 25.0, 10.0, 25.0), 0)[0] == pytest.approx((4.0, 10.0, 4.0, 10.0))
    assert control.step((4.0, -25.0, 4.0, 2.0), 1)[0] == pytest.approx((1.6, -10.0, 1.6, 0.8))
    assert control.step((4.0, 10.0, 4.0, 2.0), 2)[0] == (4.0, 10.0, 4.0, 2.0)


def test_without_a_command_the_duty_is_zero_at_any_wheel_speed():
    control = started()
    control.step(AHEAD, 0)
    for tick in range(1, 16):
        control.update_measurement((5.0,) * 4, tick * PERIOD_NS)
        assert control.step(None, tick * PERIOD_NS) == (STOPPED, STOPPED)


def test_a_command_of_zero_brakes():
    control = started(velocity=(5.0,) * 4)
    set_points, duty = control.step(STOPPED, 0)
    assert set_points == STOPPED
    assert max(duty) < 0.0


def test_without_wheel_speeds_the_duty_is_zero():
    control = started()
    assert control.has_measurement(NS_PER_S // 2)
    assert control.step(AHEAD, NS_PER_S // 2)[1] != STOPPED
    assert not control.has_measurement(NS_PER_S // 2 + 1)
    set_points, duty = control.step(AHEAD, NS_PER_S // 2 + 1)
    assert set_points == pytest.approx(AHEAD)
    assert duty == STOPPED
    assert WheelControl(PARAMS).step(AHEAD, 0)[1] == STOPPED


def test_measured_wheel_speeds_can_be_discarded():
    control = started()
    control.discard_measurement()
    assert not control.has_measurement(0)
    assert control.step(AHEAD, 0)[1] == STOPPED
    control.update_measurement(STOPPED, 1)
    assert control.step(AHEAD, 1)[1] != STOPPED


def test_during_an_emergency_stop_set_points_and_duty_are_zero():
    control = started()
    control.emergency_stop = True
    assert control.step(AHEAD, 0) == (STOPPED, STOPPED)
    control.emergency_stop = False
    assert control.step(AHEAD, 1)[1] != STOPPED


@pytest.mark.parametrize('pause', ['no command', 'stopped', 'no speeds'])
def test_controllers_are_reset_after_any_pause(pause):
    control = started()
    first = control.step(AHEAD, 0)
    for tick in range(1, 5):
        control.update_measurement((1.0,) * 4, tick * PERIOD_NS)
        control.step(AHEAD, tick * PERIOD_NS)
    control.emergency_stop = pause == 'stopped'
    if pause == 'no speeds':
        control.discard_measurement()
    assert control.step(None if pause == 'no command' else AHEAD, 5 * PERIOD_NS)[1] == STOPPED
    control.emergency_stop = False
    control.update_measurement((1.0,) * 4, 6 * PERIOD_NS)
    assert control.step(AHEAD, 6 * PERIOD_NS) == first


def test_while_motors_are_disabled_the_duty_does_not_wind_up_and_is_not_zero():
    control = started()
    control.motors_enabled = False
    duties = []
    for tick in range(32):
        control.update_measurement(STOPPED, tick * PERIOD_NS)
        duties.append(control.step(AHEAD, tick * PERIOD_NS)[1])
    assert set(duties) == {duties[0]}
    assert 0.0 < duties[0][0] <= PARAMS.pid.rate_limit / 16
    control.motors_enabled = True
    control.update_measurement(STOPPED, 32 * PERIOD_NS)
    after = control.step(AHEAD, 32 * PERIOD_NS)[1]
    assert after[0] <= 2.0 * PARAMS.pid.rate_limit / 16


def test_stationary_wheels_with_zero_set_points_get_zero_duty():
    control = started(velocity=(0.09, -0.09, 0.0, 0.11))
    for tick in range(8):
        control.update_measurement((0.09, -0.09, 0.0, 0.11), tick * PERIOD_NS)
        _, duty = control.step(STOPPED, tick * PERIOD_NS)
    assert duty[:3] == (0.0, 0.0, 0.0)
    assert duty[3] < 0.0


def test_a_long_pause_between_two_steps_has_a_bounded_effect_on_the_integral():
    control = started(replace(PARAMS, pid=PidParams(proportional=0.0, feed_forward=0.0,
                                                    rate_limit=1e6)))
    control.step(AHEAD, 0)
    control.update_measurement((1.0,) * 4, 100 * NS_PER_S)
    _, duty = control.step(AHEAD, 100 * NS_PER_S)
    error = 0.5 / RADIUS - 1.0
    assert duty[0] == pytest.approx(PARAMS.pid.integral * error * 5 / 16)


def test_the_integral_uses_the_elapsed_time():
    control = started(replace(PARAMS, pid=PidParams(proportional=0.0, feed_forward=0.0,
                                                    rate_limit=1e6)))
    control.step(AHEAD, 0)
    _, duty = control.step(AHEAD, PERIOD_NS // 2)
    error = 0.5 / RADIUS - 1.0
    assert duty[0] == pytest.approx(PARAMS.pid.integral * error * 1.5 / 16)
    assert control.step(AHEAD, PERIOD_NS // 2)[1][0] == pytest.approx(
        PARAMS.pid.integral * error * 2.5 / 16)  # no elapsed time: counted as one period


def test_parameters_can_change_while_running():
    control = started()
    control.set_params(replace(PARAMS, pid=PidParams(limit=0.1)))
    assert max(control.step(AHEAD, 0)[1]) <= 0.1
