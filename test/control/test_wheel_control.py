"""Wheel speeds to duties, and everything that makes the robot stop."""

from __future__ import annotations

from dataclasses import replace

import pytest

from smart_tire.control.wheel_control import WheelControl
from smart_tire.parameters.tuning import PidParams, WheelControllerParams
from smart_tire.samples import NS_PER_S

PARAMS = WheelControllerParams(cmd_vel_timeout=0.5, wheel_states_timeout=0.5)
PERIOD_NS = NS_PER_S // 16
RADIUS = PARAMS.robot.wheel_radius
NOTHING = (0.0, 0.0, 0.0, 0.0)
AHEAD = (0.5 / RADIUS,) * 4  # rad/s, at 0.5 m/s


def started(params=PARAMS, velocity=(1.0, 1.0, 1.0, 1.0)):
    """Return a control that has a command and wheel speeds at time zero."""
    control = WheelControl(params)
    control.command(AHEAD, 0)
    control.measure(velocity, 0)
    return control


def test_wheels_that_shall_turn_alike_get_the_same_duty():
    wanted, duty = started().step(0)
    assert wanted == pytest.approx((0.5 / RADIUS,) * 4)
    assert len(set(duty)) == 1
    assert duty[0] > 0.0


def test_a_command_that_is_too_fast_is_slowed_on_the_same_curve():
    control = started(replace(PARAMS, max_wheel_speed=10.0))
    control.command((10.0, 25.0, 10.0, 25.0), 0)
    wanted, _ = control.step(0)
    assert wanted == pytest.approx((4.0, 10.0, 4.0, 10.0))


def test_without_new_commands_the_set_points_become_zero():
    control = started()
    duties = []
    for tick in range(16):
        now_ns = tick * PERIOD_NS
        control.measure((5.0,) * 4, now_ns)
        wanted, duty = control.step(now_ns)
        assert (wanted != NOTHING) == (now_ns <= 0.5 * NS_PER_S)
        duties.append(duty[0])
    assert duties[8] > 0.0 > duties[15]  # it brakes


def test_without_wheel_speeds_there_is_no_duty():
    control = started()
    control.command(AHEAD, NS_PER_S)
    wanted, duty = control.step(NS_PER_S)
    assert wanted[0] > 0.0
    assert duty == NOTHING


def test_the_emergency_stop_holds_until_released_and_forgets_the_command():
    control = started()
    control.step(0)
    control.emergency_stop(True)
    control.command(AHEAD, PERIOD_NS)
    assert control.step(PERIOD_NS) == (NOTHING, NOTHING)
    control.emergency_stop(False)
    assert control.step(2 * PERIOD_NS)[0] == NOTHING
    control.command(AHEAD, 3 * PERIOD_NS)
    assert control.step(3 * PERIOD_NS)[0] != NOTHING


def test_wheels_that_stand_and_shall_stand_get_no_duty():
    control = started(velocity=NOTHING)
    for tick in range(8):
        control.measure(NOTHING, tick * PERIOD_NS)
        control.step(tick * PERIOD_NS)
    control.command(NOTHING, 8 * PERIOD_NS)
    assert control.step(8 * PERIOD_NS)[1] == NOTHING


def test_a_long_pause_between_two_steps_does_not_throw_the_integral():
    control = started(replace(PARAMS, pid=PidParams(proportional=0.0, feed_forward=0.0,
                                                    rate_limit=1e6)))
    control.step(0)
    control.command(AHEAD, 100 * NS_PER_S)
    control.measure((1.0,) * 4, 100 * NS_PER_S)
    _, duty = control.step(100 * NS_PER_S)
    error = 0.5 / RADIUS - 1.0
    assert duty[0] == pytest.approx(PARAMS.pid.integral * error * 5 / 16)


def test_gains_change_while_running():
    control = started()
    control.retune(replace(PARAMS, pid=PidParams(limit=0.1)))
    assert max(control.step(0)[1]) <= 0.1
