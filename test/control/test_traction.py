# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Limits of the wheel speeds by the slip that friction permits."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control import constants
from smart_tire.control.slip_limits import slip_band
from smart_tire.control.traction import TractionControl
from smart_tire.control.wheel_control import WheelControl
from smart_tire.parameters.control import TractionParams, WheelControllerParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GRAVITY, GroundState, NS_PER_S, Odometry
from smart_tire.uncertain import fused, Uncertain, UNKNOWN

RADIUS = RobotParams().wheel_radius
ROBOT = RobotParams(center_of_mass=(0.0, 0.0, -RADIUS))  # its wheel loads do not change
LOAD = ROBOT.mass * GRAVITY / 4.0
STIFFNESS = ROBOT.tire.longitudinal_stiffness
PER_FRICTION = 3.0 * LOAD / STIFFNESS  # critical slip
# critical slip 0.4 +- 0.3: a limit of 0.1
PRIOR = Uncertain(0.4 / PER_FRICTION, 0.3 / PER_FRICTION)
PARAMS = TractionParams(enabled=True, sigmas=1.0, floor=0.02, unknown=PRIOR.value, lead=0.0)
EXPECTED = replace(PARAMS, sigmas=0.0)  # the limit is that of the expected friction
NOW_NS = 1_000 * NS_PER_S
NO_COVARIANCE = (0.0,) * 36
FAST, REVERSE, STOPPED = (20.0,) * 4, (-20.0,) * 4, (0.0,) * 4


@pytest.fixture(autouse=True)
def prior(monkeypatch):
    monkeypatch.setattr(constants, 'PRIOR_SIGMA', PRIOR.sigma)


def odometry(v_x=1.0, *, stamp_ns=NOW_NS, yaw_rate=0.0):
    return Odometry(stamp_ns, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (v_x, 0.0, 0.0),
                    (0.0, 0.0, yaw_rate), NO_COVARIANCE, NO_COVARIANCE)


def ground(critical=0.4, sigma=0.016, *, stamp_ns=NOW_NS, stiffness=STIFFNESS):
    """Return ground with the friction of a critical slip of tires of the nominal stiffness."""
    return GroundState(stamp_ns, Uncertain(stiffness, 0.0),
                       Uncertain(critical / PER_FRICTION, sigma / PER_FRICTION))


def limit_of(critical=0.4, sigma=0.016):
    """Return the slip limit on measured ground."""
    mean, spread = fused(PRIOR, Uncertain(critical / PER_FRICTION, sigma / PER_FRICTION))
    return (mean - spread) * PER_FRICTION


def control(*samples, params=PARAMS, v_x=1.0, held=None):
    """Return traction control that has received samples, after wheels turned at ``held``."""
    traction = TractionControl(params, ROBOT)
    traction.add_odometry(odometry(v_x))
    traction.limit((v_x / RADIUS if held is None else held,) * 4, NOW_NS, 0.0)
    for sample in samples:
        (traction.add_odometry if isinstance(sample, Odometry)
         else traction.set_ground)(sample)
    return traction


def rolling(traction, set_points, now_ns=NOW_NS, period=0.0):
    """Return the limited rolling speeds [m/s]."""
    return [RADIUS * speed for speed in traction.limit(set_points, now_ns, period)]


def test_driving_and_braking_slip_have_the_limit_in_both_directions():
    assert rolling(control(), FAST) == pytest.approx([1.0 / 0.9] * 4)
    assert rolling(control(), STOPPED) == pytest.approx([1.0 / 1.1] * 4)
    assert rolling(control(v_x=-1.0), REVERSE) == pytest.approx([-1.0 / 0.9] * 4)
    assert rolling(control(v_x=-1.0), STOPPED) == pytest.approx([-1.0 / 1.1] * 4)


def test_a_command_against_the_motion_brakes_first():
    assert rolling(control(), REVERSE) == pytest.approx([1.0 / 1.1] * 4)
    assert rolling(control(v_x=-1.0), FAST) == pytest.approx([-1.0 / 1.1] * 4)


def test_a_start_is_not_blocked_in_either_direction():
    assert rolling(control(v_x=0.0), FAST) == pytest.approx([0.02] * 4)
    assert rolling(control(v_x=0.0), REVERSE) == pytest.approx([-0.02] * 4)


@pytest.mark.parametrize('floor', [0.02, 0.1])
def test_the_band_is_continuous_through_standstill_and_odd(floor):
    bands = [slip_band(0.001 * step, 0.2, floor) for step in range(-500, 501)]
    for (low, high), (low_after, high_after), mirrored in zip(bands, bands[1:], bands[::-1]):
        assert 0.0 <= low_after - low <= 0.0021
        assert 0.0 <= high_after - high <= 0.0021
        assert (low, high) == (-mirrored[1], -mirrored[0])
        assert high - low >= floor


def test_set_points_within_the_limit_are_not_changed_at_all():
    traction = control()
    assert traction.limit((12.0, 12.1, 12.2, 12.3), NOW_NS, 0.0) == (12.0, 12.1, 12.2, 12.3)
    assert not traction.state.limiting
    assert traction.state.limited_steps == 0
    traction.limit(FAST, NOW_NS, 0.0)
    assert traction.state.limiting
    assert traction.state.limited_steps == 1


def test_the_lower_bound_of_the_friction_of_measured_ground_limits_the_slip():
    traction = control(ground(0.4))
    assert rolling(traction, FAST) == pytest.approx([1.0 / (1.0 - limit_of(0.4))] * 4)
    assert traction.state.slip_limit == pytest.approx(limit_of(0.4))
    assert 0.35 < limit_of(0.4) < 0.39


def test_tires_on_soft_ground_have_more_slip_at_the_same_friction():
    soft = 0.5 * STIFFNESS
    assert rolling(control(ground(0.2, stiffness=soft)), FAST) == pytest.approx(
        [1.0 / (1.0 - 2.0 * limit_of(0.2))] * 4)
    unknown = replace(ground(stiffness=soft), friction_coefficient=UNKNOWN)
    assert rolling(control(unknown), FAST) == pytest.approx([1.0 / 0.8] * 4)


def accelerating(v_x, samples=40):
    """Return odometry that ends now with ``v_x`` [m/s] at 1.25 m/s2."""
    return [odometry(v_x - 0.01 * step, stamp_ns=NOW_NS - 8_000_000 * step)
            for step in range(samples, -1, -1)]


def test_a_wheel_that_acceleration_relieves_gets_less_slip():
    traction = TractionControl(PARAMS, RobotParams())
    for sample in accelerating(1.0):
        traction.add_odometry(sample)
    traction.set_ground(ground(0.3))
    front, front_right, rear, rear_right = rolling(traction, FAST)
    assert front == front_right < 0.98 * rear
    assert rear == rear_right
    friction = traction.state.friction
    assert 1.0 - 1.0 / rear == pytest.approx(
        limit_of(0.3) * (1.0 + friction * 0.11 / 0.26 * 2.0), rel=0.02)


@pytest.mark.parametrize('sigma', [0.06, 0.3, 3.0])
def test_uncertain_friction_is_fused_with_that_of_unknown_ground(sigma):
    traction = control(ground(0.5, sigma))
    traction.limit(FAST, NOW_NS, 0.0)
    assert traction.state.slip_limit == pytest.approx(limit_of(0.5, sigma))


def test_the_limit_is_at_most_the_maximum():
    traction = control(params=replace(EXPECTED, unknown=1.0, max_slip=0.3))
    traction.limit(FAST, NOW_NS, 0.0)
    assert traction.state.slip_limit == 0.3


TRACK = 0.38 + 0.26 ** 2 / 0.38  # m, of wheels that roll freely in a turn


@pytest.mark.parametrize('command', [FAST, STOPPED, REVERSE])
@pytest.mark.parametrize('yaw_rate', [0.2, -0.2])
def test_a_robot_that_yaws_by_a_disturbance_is_steered_back(command, yaw_rate):
    """The side that pushes more gets less slip, relative to its own speed over ground."""
    v_x = -1.0 if command is REVERSE else 1.0
    traction = control(params=replace(EXPECTED, unknown=0.2), v_x=v_x)
    now_ns = NOW_NS + 10_000_000
    for _ in range(2):  # the direction is known from the second step on
        now_ns += 10_000_000
        traction.add_odometry(odometry(v_x, stamp_ns=now_ns, yaw_rate=yaw_rate))
        left, right, *rear = rolling(traction, command, now_ns)
    half = 0.5 * TRACK * yaw_rate
    ground = v_x - half, v_x + half
    slips = [abs(1.0 - v / speed) for v, speed in zip(ground, (left, right))]
    pushing = 1 if (yaw_rate > 0.0) == (command is FAST) else 0
    assert slips[pushing] < 0.6 * slips[1 - pushing]
    assert traction.state.limiting


@pytest.mark.parametrize('stop', [False, True])
def test_the_yaw_rate_of_the_commanded_curve_is_wanted_also_in_a_stop(stop):
    """19 +- 1 rad/s at 1 m/s: 0.188 rad/s on the track of wheels that roll freely."""
    command, wanted = (18.0, 20.0, 18.0, 20.0), 2.0 / 19.0 / TRACK
    torques = []
    for yaw_rate in (0.5 * wanted, wanted, 1.5 * wanted):
        traction = control(params=replace(EXPECTED, unknown=0.2))
        traction.limit(command, NOW_NS, 0.0)
        for step in (1, 2):
            stamp_ns = NOW_NS + step * 10_000_000
            traction.add_odometry(odometry(stamp_ns=stamp_ns, yaw_rate=yaw_rate))
            speeds = traction.limit(STOPPED if stop else command, stamp_ns, 0.01)
        left, right, *_ = (tire.torque_at(v) for tire, v in zip(traction.tires, speeds))
        torques.append(right - left)
    assert torques[0] > 0.1
    assert abs(torques[1]) < 0.02
    assert torques[2] < -0.1


def test_a_steady_turn_of_a_skid_steer_robot_is_not_limited():
    """Its wheels roll without longitudinal force at a larger track than that of the robot."""
    yaw_rate, track = 0.5, 0.38 + 0.26 ** 2 / 0.38
    traction = control(odometry(0.5, stamp_ns=NOW_NS + 1, yaw_rate=yaw_rate))
    set_points = tuple((0.5 + sign * 0.5 * track * yaw_rate) / RADIUS for sign in (-1, 1, -1, 1))
    assert traction.limit(set_points, NOW_NS, 0.0) == set_points


def test_spinning_in_place_is_possible():
    speeds = rolling(control(v_x=0.0), (-10.0, 10.0, -10.0, 10.0))
    assert speeds == pytest.approx([-0.02, 0.02, -0.02, 0.02])


@pytest.mark.parametrize('age, active', [(0.29, True), (0.31, False), (-0.29, True),
                                         (-0.31, False)])
def test_without_recent_odometry_there_is_no_limit(age, active):
    traction = control()
    now_ns = NOW_NS + round(age * NS_PER_S)
    assert (traction.limit(FAST, now_ns, 0.0) != FAST) is active
    assert (not traction.state.reason) is active
    assert TractionControl(PARAMS, ROBOT).limit(FAST, NOW_NS, 0.0) == FAST


def test_the_reason_is_reported():
    traction = TractionControl(PARAMS, ROBOT)
    assert traction.state.reason == 'no odom'
    traction.add_odometry(odometry())
    traction.limit(FAST, NOW_NS + 2 * NS_PER_S, 0.0)
    assert traction.state.reason == 'odom is 2.00 s old'


@pytest.mark.parametrize('bad', [
    odometry(math.nan, stamp_ns=NOW_NS + 1), odometry(math.inf, stamp_ns=NOW_NS + 1),
    odometry(5.0, stamp_ns=NOW_NS + 1, yaw_rate=math.nan),
    odometry(5.0, stamp_ns=NOW_NS), odometry(5.0, stamp_ns=NOW_NS - NS_PER_S)])
def test_odometry_that_is_not_finite_or_late_is_ignored(bad):
    assert rolling(control(bad), FAST) == pytest.approx([1.0 / 0.9] * 4)


def test_a_clock_that_was_set_back_is_followed_and_the_ground_unknown():
    earlier_ns = NOW_NS - 10 * NS_PER_S
    traction = control(ground(0.4), odometry(1.0, stamp_ns=earlier_ns))
    assert rolling(traction, FAST, earlier_ns) == pytest.approx([1.0 / 0.9] * 4)


def test_the_speed_is_extrapolated_with_the_acceleration_of_the_robot():
    params = replace(EXPECTED, lead=0.03, unknown=1.25 / GRAVITY)
    traction, slip = TractionControl(params, ROBOT), 1.25 / GRAVITY * PER_FRICTION
    for sample in accelerating(1.0):
        traction.add_odometry(sample)
    assert rolling(traction, (1.05 / RADIUS,) * 4, NOW_NS + 40_000_000) == (
        pytest.approx([1.05] * 4))  # within the limit: no acceleration is expected
    speeds = rolling(traction, FAST, NOW_NS + 50_000_000, period=0.01)
    # the delay of one period of the controller, too
    assert speeds == pytest.approx(
        [(1.0 + 1.25 * (0.05 + 0.03 + 0.01)) / (1.0 - slip)] * 4, rel=1e-3)


def test_a_start_is_expected_before_estimates_show_it():
    params = replace(PARAMS, unknown=0.2, lead=0.05)
    assert rolling(control(v_x=0.0, params=params), FAST)[0] == pytest.approx(
        0.2 * GRAVITY * 0.05 + 0.02)
    assert rolling(control(v_x=0.0, params=params), REVERSE)[0] == pytest.approx(
        -0.2 * GRAVITY * 0.05 - 0.02)


def test_ground_that_is_reported_late_counts_from_its_place():
    """It was 0.5 s, 0.5 m before the present; the robot then drives another 0.3 m."""
    traction = control(params=replace(PARAMS, fade_distance=0.8, fade_time=1e6))
    driven = [odometry(1.0, stamp_ns=NOW_NS + step * 10_000_000) for step in range(1, 81)]
    for sample in driven[:50]:
        traction.add_odometry(sample)
    traction.set_ground(ground(0.4, stamp_ns=NOW_NS))
    for sample in driven[50:]:
        traction.add_odometry(sample)
    traction.limit(FAST, driven[-1].stamp_ns, 0.0)
    assert traction.state.slip_limit == pytest.approx(
        0.1 + (limit_of(0.4) - 0.1) / math.e, rel=1e-3)


def test_the_acceleration_is_at_most_that_of_gravity():
    """The estimated 20 m/s2 are an error."""
    traction = TractionControl(replace(PARAMS, lead=0.1), ROBOT)
    for step in range(101):
        traction.add_odometry(odometry(0.16 * step, stamp_ns=NOW_NS + 8_000_000 * step))
        traction.limit((300.0,) * 4, NOW_NS + 8_000_000 * step, 0.0)
    rear = rolling(traction, (300.0,) * 4, NOW_NS + 800_000_000)[2]
    assert rear == pytest.approx((16.0 + GRAVITY * 0.1) / 0.9, rel=1e-3)


def test_a_stop_begins_at_the_set_points_from_before_the_limit_was_active():
    traction = TractionControl(PARAMS, ROBOT)
    traction.limit((1.0 / RADIUS,) * 4, NOW_NS, 0.0)
    traction.add_odometry(odometry(1.0))
    assert rolling(traction, STOPPED) == pytest.approx([1.0 / 1.1] * 4)


def test_a_limit_after_a_pause_of_odom_is_a_new_start():
    traction = control(params=replace(PARAMS, unknown=0.2, lead=0.05), v_x=0.0)
    for age in (0, 1):  # s; the second is without limit
        traction.limit(FAST, NOW_NS + age * NS_PER_S, 0.0)
    traction.add_odometry(odometry(0.0, stamp_ns=NOW_NS + 2 * NS_PER_S))
    assert rolling(traction, FAST, NOW_NS + 2 * NS_PER_S)[0] == pytest.approx(
        0.2 * GRAVITY * 0.05 + 0.02)


def test_the_heading_before_a_pause_of_the_limit_is_forgotten():
    found = []
    for yaw_rate in (0.0, 0.3):
        traction, stamp_ns = control(params=replace(EXPECTED, unknown=0.2)), NOW_NS
        for command, rate in [(FAST, yaw_rate)] * 20 + [((1.0 / RADIUS,) * 4, 0.0)] + [
                (FAST, 0.0)] * 2:
            stamp_ns += 10_000_000
            traction.add_odometry(odometry(stamp_ns=stamp_ns, yaw_rate=rate))
            speeds = traction.limit(command, stamp_ns, 0.01)
        found.append(speeds)
    assert found[0] == pytest.approx(found[1])


@pytest.mark.parametrize('noise', [-0.02, 0.02])
def test_an_error_of_the_speed_at_standstill_does_not_delay_a_start(noise):
    params = replace(PARAMS, unknown=0.2, lead=0.05)
    for command, sign in ((FAST, 1.0), (REVERSE, -1.0)):
        assert rolling(control(v_x=noise, held=0.0, params=params), command)[0] == pytest.approx(
            sign * (0.2 * GRAVITY * 0.05 + 0.02) + noise)


def test_the_predicted_speed_of_a_stop_does_not_change_its_sign():
    traction = control(params=replace(PARAMS, unknown=0.2, lead=0.5), v_x=0.1)
    assert rolling(traction, STOPPED) == [0.0] * 4
    assert rolling(traction, REVERSE) == pytest.approx([-0.02] * 4)


def test_a_stop_ends_at_standstill_whatever_the_odometry_is():
    traction, period_ns = control(), NS_PER_S // 100
    speeds = []
    for step in range(1, 301):
        traction.add_odometry(odometry(1.0, stamp_ns=NOW_NS + step * period_ns))
        speeds.append(rolling(traction, STOPPED, NOW_NS + step * period_ns, 0.01)[0])
    assert 0.8 < speeds[3] < speeds[0] == pytest.approx(1.0 / 1.1, rel=0.1)
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] == 0.0
    assert speeds[150] > 0.0


@pytest.mark.parametrize('yaw_rate', [0.5, -0.5])
def test_a_start_is_not_prevented_by_a_yaw_rate(yaw_rate):
    level = replace(ROBOT, track_width=0.001, wheelbase=1e-6)  # rolls at v_x on both sides
    traction = TractionControl(PARAMS, level)
    for step in range(100):
        traction.add_odometry(
            odometry(0.0, stamp_ns=NOW_NS + step * 10_000_000, yaw_rate=yaw_rate))
        speeds = rolling(traction, FAST, NOW_NS + step * 10_000_000)
    assert speeds == pytest.approx([0.02] * 4, abs=1e-3)


def test_wheels_have_the_load_of_their_tires_while_they_are_limited():
    traction = control(params=replace(EXPECTED, unknown=0.2))
    assert traction.tires == (None,) * 4
    traction.limit((1.05 / RADIUS,) * 4, NOW_NS, 0.0)
    assert traction.tires == (None,) * 4  # within the limit from the beginning
    traction.limit(FAST, NOW_NS, 0.0)
    load = traction.tires[2]
    assert (load.speed, load.command) == (pytest.approx(1.0 / RADIUS), 20.0)
    assert load.torque == pytest.approx(0.2 * LOAD * RADIUS)
    assert load.critical_slip == pytest.approx(0.2 * PER_FRICTION)
    traction.limit((1.05 / RADIUS,) * 4, NOW_NS, 0.0)
    assert traction.tires == (None,) * 4


def test_the_feed_forward_is_that_of_the_lower_bound_of_the_friction():
    traction = control()
    traction.limit(FAST, NOW_NS, 0.0)
    assert traction.tires[0].torque == pytest.approx(
        (PRIOR.value - PRIOR.sigma) * LOAD * RADIUS)


def test_it_can_be_switched_at_run_time_in_the_wheel_controller():
    params = WheelControllerParams(traction=replace(PARAMS, enabled=False))
    wheels = WheelControl(params)
    wheels.add_reading(STOPPED, 0)
    wheels.traction.add_odometry(odometry(0.0))
    assert wheels.step((5.0,) * 4, 0, NOW_NS)[0] == (5.0,) * 4
    wheels.set_params(replace(params, traction=PARAMS))
    limited = wheels.step((5.0,) * 4, 1, NOW_NS)[0]
    assert max(limited) < 1.0
    assert None not in wheels.traction.tires
    assert wheels.step((5.0,) * 4, 2)[0] == (5.0,) * 4  # without the time of the message clock
    assert wheels.step(None, 3, NOW_NS)[0] == STOPPED
    wheels.step((5.0,) * 4, 4, NOW_NS)
    wheels.set_params(params)
    assert wheels.step((5.0,) * 4, 5, NOW_NS)[0] == (5.0,) * 4
    assert wheels.traction.tires == (None,) * 4
