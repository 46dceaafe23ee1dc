# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wheel speeds to duties, and all conditions that stop the robot."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control.wheel_control import WheelControl
from smart_tire.control.wheel_servo import drive_model
from smart_tire.parameters.control import PidParams, TractionParams, WheelControllerParams
from smart_tire.samples import NS_PER_S, VelocityCommand

PARAMS = WheelControllerParams(wheel_states_timeout=0.5)
PERIOD_NS = NS_PER_S // 16
RADIUS = PARAMS.robot.wheel_radius
STOPPED = (0.0, 0.0, 0.0, 0.0)
AHEAD = (0.5 / RADIUS,) * 4  # rad/s, at 0.5 m/s


def started(params=PARAMS, velocity=(1.0, 1.0, 1.0, 1.0)):
    """Return a controller with wheel speeds measured at time zero."""
    control = WheelControl(params)
    control.add_reading(velocity, 0)
    return control


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


def test_without_wheel_speeds_the_duty_is_zero():
    control = started()
    assert control.has_measurement(NS_PER_S // 2)
    assert control.step(AHEAD, NS_PER_S // 2)[1] != STOPPED
    assert not control.has_measurement(NS_PER_S // 2 + 1)
    set_points, duty = control.step(AHEAD, NS_PER_S // 2 + 1)
    assert set_points == pytest.approx(AHEAD)
    assert duty == STOPPED
    assert WheelControl(PARAMS).step(AHEAD, 0)[1] == STOPPED


def test_the_rate_of_the_readings_is_that_of_their_arrival():
    control = started()
    assert math.isnan(control.reading_rate)
    control.add_reading(STOPPED, NS_PER_S // 4)
    assert control.reading_rate == pytest.approx(4.0)


@pytest.mark.parametrize('pause', ['no command', 'stopped', 'no speeds'])
def test_controllers_are_reset_after_any_pause(pause):
    control = started()
    first = control.step(AHEAD, 0)
    for tick in range(1, 5):
        control.add_reading((1.0,) * 4, tick * PERIOD_NS)
        control.step(AHEAD, tick * PERIOD_NS)
    control.emergency_stop = pause == 'stopped'
    if pause == 'no speeds':
        control.discard_measurement()
    set_points, duty = control.step(None if pause == 'no command' else AHEAD, 5 * PERIOD_NS)
    assert duty == STOPPED and (set_points == STOPPED) == (pause != 'no speeds')
    control.emergency_stop = False
    control.add_reading((1.0,) * 4, 6 * PERIOD_NS)
    assert control.step(AHEAD, 6 * PERIOD_NS) == first


def test_while_motors_are_disabled_the_duty_does_not_wind_up_and_is_not_zero():
    control = started(velocity=STOPPED)
    control.motors_enabled = False
    duties = []
    for tick in range(32):
        control.add_reading(STOPPED, tick * PERIOD_NS)
        duties.append(control.step(AHEAD, tick * PERIOD_NS)[1])
    assert set(duties) == {duties[0]}
    assert 0.0 < duties[0][0] <= PARAMS.pid.rate_limit / 16
    control.motors_enabled = True
    control.add_reading(STOPPED, 32 * PERIOD_NS)
    after = control.step(AHEAD, 32 * PERIOD_NS)[1]
    assert after[0] <= 2.0 * PARAMS.pid.rate_limit / 16


def test_stationary_wheels_with_zero_set_points_get_zero_duty():
    control = started(velocity=STOPPED)
    for tick in range(8):
        control.add_reading((0.09 * (tick > 3), -0.09, 0.0, 0.11), tick * PERIOD_NS)
        _, duty = control.step(STOPPED, tick * PERIOD_NS)
        assert tick > 3 or duty[0] == 0.0
    assert duty[2] == 0.0
    assert duty[0] < 0.0 < duty[1]  # they creep, and are held
    assert duty[3] < 0.0


ERROR = 0.2  # rad/s
GAIN = 0.1   # 1/rad, below the limit of the delay
ONLY_INTEGRAL = replace(PARAMS, pid=PidParams(proportional=0.0, integral=GAIN))


class Settled:
    """A controller whose wheels have been slower than ``AHEAD`` by ``ERROR`` for 40 periods."""

    def __init__(self, params):
        self.control, self.now_ns = WheelControl(params), 0
        for _ in range(40):
            duty = self.step()
        self.duty = duty

    def step(self, elapsed_ns=PERIOD_NS, *, speed=AHEAD[0] - ERROR, read=True):
        """Return the duty of the front left wheel after a reading and a step."""
        self.now_ns += elapsed_ns
        if read:
            self.control.add_reading((speed,) * 4, self.now_ns)
        return self.control.step(AHEAD, self.now_ns)[1][0]


@pytest.mark.parametrize(('periods', 'counted'), [
    (0.5, 0.5), (1.0, 1.0), (1.4, 1.4), (0.0, 1.0), (4.0, 4.0), (100.0, 4.0)])
def test_the_integral_uses_the_elapsed_time(periods, counted):
    """No elapsed time counts as one period, a long pause as four."""
    settled = Settled(ONLY_INTEGRAL)
    change = settled.step(round(periods * PERIOD_NS)) - settled.duty
    assert change == pytest.approx(GAIN * ERROR * counted / 16, rel=1e-3)


def test_a_reading_that_is_overdue_is_not_integrated_any_longer():
    settled = Settled(ONLY_INTEGRAL)
    duties = [settled.step(read=False) for _ in range(6)]
    assert duties[1] - settled.duty == pytest.approx(GAIN * ERROR * 2 / 16, rel=1e-3)
    assert duties[2:] == [duties[1]] * 4
    assert settled.step() > duties[1]


@pytest.mark.parametrize('changes', [
    {'proportional': 0.2}, {'integral': 0.01}, {'derivative': 0.02}, {'feed_forward': 0.06},
    {'stall_torque': 3.0}, {'acceleration': 0.0}])
def test_a_change_of_a_parameter_does_not_move_the_duty(changes):
    pid = PidParams(proportional=0.02, integral=GAIN, derivative=0.001)
    settled = Settled(replace(PARAMS, pid=pid))
    settled.control.set_params(replace(PARAMS, pid=replace(pid, **changes)))
    assert settled.step() == pytest.approx(settled.duty, abs=1.1 * GAIN * ERROR / 16)


def test_during_an_acceleration_a_change_of_the_feed_forward_does_not_move_the_duty():
    control, twin = started(), started()
    for one in (control, twin):
        one.step((15.0,) * 4, 0)
    control.set_params(replace(PARAMS, pid=replace(PARAMS.pid, feed_forward=0.06)))
    changed, unchanged = (one.step((15.0,) * 4, PERIOD_NS)[1][0] for one in (control, twin))
    assert changed == pytest.approx(unchanged, abs=0.01)


def test_the_duty_is_the_same_after_a_change_that_comes_while_disabled():
    """While the controllers are reset there is nothing to be continued."""
    params = replace(PARAMS, pid=replace(PARAMS.pid, feed_forward=0.06))
    control = started()
    control.step(None, 0)
    control.set_params(params)
    assert control.step(AHEAD, PERIOD_NS) == started(params).step(AHEAD, PERIOD_NS)


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('wheel', range(4))
def test_a_command_that_is_not_finite_is_no_command(bad, wheel):
    control = started()
    control.step(AHEAD, 0)
    velocity = [bad if index == wheel else 5.0 for index in range(4)]
    assert control.step(velocity, PERIOD_NS) == (STOPPED, STOPPED)


@pytest.mark.parametrize('command', [
    VelocityCommand(0, math.nan, 0.0), VelocityCommand(0, 0.0, math.inf),
    VelocityCommand(0, 1.7e308, 0.0)])
def test_a_body_velocity_that_is_not_possible_moves_no_wheel(command):
    assert started().follow(command, 0) == (STOPPED, STOPPED)


@pytest.mark.parametrize('bad', [math.nan, math.inf, 1e9])
def test_measured_speeds_that_are_not_possible_time_out(bad):
    """One wheel without a speed stops all: the robot would turn."""
    control = started()
    duties = []
    for tick in range(1, 12):
        control.add_reading((1.0, 1.0, bad, 1.0), tick * PERIOD_NS)
        duties.append(control.step(AHEAD, tick * PERIOD_NS)[1])
    assert duties[7] != STOPPED and duties[8:] == [STOPPED] * 3
    assert all(math.isfinite(duty) for one in duties for duty in one)


def test_a_rolling_robot_is_taken_over_at_its_speed():
    """Its first duty is that of the speed: it neither brakes nor accelerates."""
    control = started(velocity=AHEAD)
    model = drive_model(PARAMS.pid, PARAMS.robot)
    for tick in range(8):
        _, duty = control.step(AHEAD, tick * PERIOD_NS)
        assert duty == pytest.approx((model.duty(AHEAD[0], 1.0),) * 4, rel=1e-3)
        control.add_reading(AHEAD, (tick + 1) * PERIOD_NS)


def test_set_points_are_published_without_the_limit_of_acceleration():
    control = started(replace(PARAMS, max_wheel_acceleration=1.0), STOPPED)
    set_points, duty = control.step(AHEAD, 0)
    assert set_points == pytest.approx(AHEAD)
    assert 0.0 < duty[0] < 0.1


def test_the_duty_follows_the_set_points_of_the_traction_control():
    params = replace(PARAMS, traction=TractionParams(enabled=True))
    control, slow = started(params, STOPPED), tuple(0.5 * speed for speed in AHEAD)
    seen = []
    control.traction.limit = lambda *given: seen.append(given) or slow
    assert control.step(AHEAD, 0, 77) == (slow, started(velocity=STOPPED).step(slow, 0)[1])
    assert seen == [(pytest.approx(AHEAD), 77, 1.0 / PARAMS.rate)]
    assert control.step(AHEAD, 1)[0] == pytest.approx(AHEAD)
    assert control.step(None, 2, 78) == (STOPPED, STOPPED)
    assert len(seen) == 1


def test_the_derivative_brakes_wheels_that_accelerate():
    pid = PidParams(proportional=0.0, integral=0.0, derivative=0.0003)
    plain, braking = (Settled(replace(PARAMS, pid=one)) for one in (
        replace(pid, derivative=0.0), pid))
    faster = AHEAD[0] + 1.0
    difference = plain.step(speed=faster) - braking.step(speed=faster)
    assert difference == pytest.approx(0.0003 * (1.0 + ERROR) * 16.0)
