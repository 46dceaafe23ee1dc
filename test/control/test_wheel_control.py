"""Wheel speeds to duties, and everything that makes the robot stop."""

from __future__ import annotations

from dataclasses import replace

import pytest

from smart_tire.control.wheel_control import WheelControl
from smart_tire.parameters.tuning import PidParams, WheelControllerParams
from smart_tire.samples import NS_PER_S

PARAMS = WheelControllerParams(wheel_states_timeout=0.5)
PERIOD_NS = NS_PER_S // 16
RADIUS = PARAMS.robot.wheel_radius
NOTHING = (0.0, 0.0, 0.0, 0.0)
AHEAD = (0.5 / RADIUS,) * 4  # rad/s, at 0.5 m/s


def started(params=PARAMS, velocity=(1.0, 1.0, 1.0, 1.0)):
    """Return a control that has wheel speeds at time zero."""
    control = WheelControl(params)
    control.measure(velocity, 0)
    return control


def test_wheels_that_shall_turn_alike_get_the_same_duty():
    wanted, duty = started().step(AHEAD, 0)
    assert wanted == pytest.approx(AHEAD)
    assert len(set(duty)) == 1
    assert duty[0] > 0.0


def test_each_wheel_has_its_own_controller():
    _, duty = started().step((1.0, 2.0, -3.0, 0.0), 0)
    assert duty[2] < 0.0 < duty[0] < duty[1]
    assert duty[3] < 0.0  # it turns and shall stand


def test_a_command_that_is_too_fast_is_slowed_on_the_same_curve():
    control = started(replace(PARAMS, max_wheel_speed=10.0))
    assert control.step((10.0, 25.0, 10.0, 25.0), 0)[0] == pytest.approx((4.0, 10.0, 4.0, 10.0))
    assert control.step((4.0, -25.0, 4.0, 2.0), 1)[0] == pytest.approx((1.6, -10.0, 1.6, 0.8))
    assert control.step((4.0, 10.0, 4.0, 2.0), 2)[0] == (4.0, 10.0, 4.0, 2.0)


def test_without_a_command_there_is_no_duty_whatever_the_wheels_do():
    control = started()
    control.step(AHEAD, 0)
    for tick in range(1, 16):
        control.measure((5.0,) * 4, tick * PERIOD_NS)
        assert control.step(None, tick * PERIOD_NS) == (NOTHING, NOTHING)


def test_a_command_of_zero_brakes():
    control = started(velocity=(5.0,) * 4)
    wanted, duty = control.step(NOTHING, 0)
    assert wanted == NOTHING
    assert max(duty) < 0.0


def test_without_wheel_speeds_there_is_no_duty():
    control = started()
    assert control.measured(NS_PER_S // 2)
    assert control.step(AHEAD, NS_PER_S // 2)[1] != NOTHING
    assert not control.measured(NS_PER_S // 2 + 1)
    wanted, duty = control.step(AHEAD, NS_PER_S // 2 + 1)
    assert wanted == pytest.approx(AHEAD)
    assert duty == NOTHING
    assert WheelControl(PARAMS).step(AHEAD, 0)[1] == NOTHING


def test_wheel_speeds_can_be_forgotten():
    control = started()
    control.forget_measurement()
    assert not control.measured(0)
    assert control.step(AHEAD, 0)[1] == NOTHING
    control.measure(NOTHING, 1)
    assert control.step(AHEAD, 1)[1] != NOTHING


def test_while_stopped_there_are_no_set_points_and_no_duty():
    control = started()
    control.stopped = True
    assert control.step(AHEAD, 0) == (NOTHING, NOTHING)
    control.stopped = False
    assert control.step(AHEAD, 1)[1] != NOTHING


@pytest.mark.parametrize('pause', ['no command', 'stopped', 'no speeds'])
def test_after_any_pause_the_controllers_start_over(pause):
    control = started()
    first = control.step(AHEAD, 0)
    for tick in range(1, 5):
        control.measure((1.0,) * 4, tick * PERIOD_NS)
        control.step(AHEAD, tick * PERIOD_NS)
    control.stopped = pause == 'stopped'
    if pause == 'no speeds':
        control.forget_measurement()
    assert control.step(None if pause == 'no command' else AHEAD, 5 * PERIOD_NS)[1] == NOTHING
    control.stopped = False
    control.measure((1.0,) * 4, 6 * PERIOD_NS)
    assert control.step(AHEAD, 6 * PERIOD_NS) == first


def test_duties_that_are_not_applied_wind_nothing_up_and_are_not_zero():
    control = started()
    control.applied = False
    duties = []
    for tick in range(32):
        control.measure(NOTHING, tick * PERIOD_NS)
        duties.append(control.step(AHEAD, tick * PERIOD_NS)[1])
    assert set(duties) == {duties[0]}
    assert 0.0 < duties[0][0] <= PARAMS.pid.rate_limit / 16
    control.applied = True
    control.measure(NOTHING, 32 * PERIOD_NS)
    after = control.step(AHEAD, 32 * PERIOD_NS)[1]
    assert after[0] <= 2.0 * PARAMS.pid.rate_limit / 16


def test_wheels_that_stand_and_shall_stand_get_no_duty():
    control = started(velocity=(0.09, -0.09, 0.0, 0.11))
    for tick in range(8):
        control.measure((0.09, -0.09, 0.0, 0.11), tick * PERIOD_NS)
        _, duty = control.step(NOTHING, tick * PERIOD_NS)
    assert duty[:3] == (0.0, 0.0, 0.0)
    assert duty[3] < 0.0


def test_a_long_pause_between_two_steps_does_not_throw_the_integral():
    control = started(replace(PARAMS, pid=PidParams(proportional=0.0, feed_forward=0.0,
                                                    rate_limit=1e6)))
    control.step(AHEAD, 0)
    control.measure((1.0,) * 4, 100 * NS_PER_S)
    _, duty = control.step(AHEAD, 100 * NS_PER_S)
    error = 0.5 / RADIUS - 1.0
    assert duty[0] == pytest.approx(PARAMS.pid.integral * error * 5 / 16)


def test_the_integral_goes_by_the_time_that_passed():
    control = started(replace(PARAMS, pid=PidParams(proportional=0.0, feed_forward=0.0,
                                                    rate_limit=1e6)))
    control.step(AHEAD, 0)
    _, duty = control.step(AHEAD, PERIOD_NS // 2)
    error = 0.5 / RADIUS - 1.0
    assert duty[0] == pytest.approx(PARAMS.pid.integral * error * 1.5 / 16)
    assert control.step(AHEAD, PERIOD_NS // 2)[1][0] == pytest.approx(
        PARAMS.pid.integral * error * 2.5 / 16)  # no time: counted as a period


def test_gains_change_while_running():
    control = started()
    control.retune(replace(PARAMS, pid=PidParams(limit=0.1)))
    assert max(control.step(AHEAD, 0)[1]) <= 0.1
