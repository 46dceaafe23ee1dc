# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Follower: pursuit, curvature, rest after a segment, turns in place, progress."""

from __future__ import annotations

from dataclasses import replace
import math
from unittest.mock import Mock

import numpy as np
import pytest

from smart_tire.control.constants import HOLD_ANGLE, MAX_HOLD_SPEED, STANDSTILL_SPEED
from smart_tire.control.ground_motion import Motion
from smart_tire.control.motion_limits import MotionLimits
from smart_tire.control.path_follower import (
    Conditions, no_lateral_speed, PathFollower, SpinControl)
from smart_tire.control.path_geometry import FORWARD, REVERSE, Segment, Spin
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.parameters.path_following import ArrivalParams, FollowerParams

LIMITS = MotionLimits(speed=1.0, acceleration=0.5, deceleration=0.5, lateral=1.0, yaw_rate=3.0,
                      yaw_acceleration=100.0)
PARAMS = TrajectoryControllerParams(
    follower=FollowerParams(min_look_ahead=0.2, look_ahead_time=0.5, max_look_ahead=0.4,
                            align_angle=0.6),
    arrival=ArrivalParams(approach_speed=0.05, yaw_tolerance=0.1))
DT, DELAY = 0.1, 0.15
SPIN_LIMITS = MotionLimits(speed=1.0, acceleration=0.5, deceleration=0.4, lateral=1.0,
                           yaw_rate=0.9, yaw_acceleration=0.5)
SPIN_PARAMS = TrajectoryControllerParams(
    slip_compensation=False, follower=FollowerParams(spin_rate=0.8, min_spin_rate=0.2),
    arrival=ArrivalParams(yaw_tolerance=0.1))


def line(length=5.0, direction=FORWARD, heading=0.0):
    return Segment(np.array([0.0, length * math.cos(heading)]),
                   np.array([0.0, length * math.sin(heading)]), direction)


def at(x=0.0, y=0.0, yaw=0.0, v_x=0.0, yaw_rate=0.0, lateral=no_lateral_speed):
    return Conditions(Motion(x, y, yaw, v_x, 0.0, yaw_rate), DT, LIMITS, PARAMS, lateral, DELAY)


@pytest.mark.parametrize(('v_x', 'look_ahead'), [(0.2, 0.2), (0.6, 0.3), (0.95, 0.4)])
@pytest.mark.parametrize(('y', 'yaw'), [(0.02, 0.0), (-0.05, 0.0), (0.0, 0.1), (0.03, -0.1)])
def test_the_curvature_is_that_of_pursuit_on_the_tangent(v_x, look_ahead, y, yaw):
    speed, rate = PathFollower((line(),), v_x, 0.0).step(at(1.0, y, yaw))
    assert speed == pytest.approx(v_x + 0.05)
    x_body = look_ahead * math.cos(yaw) - y * math.sin(yaw)
    y_body = -y * math.cos(yaw) - look_ahead * math.sin(yaw)
    assert rate / speed == pytest.approx(2.0 * y_body / (x_body ** 2 + y_body ** 2), rel=1e-6)


@pytest.mark.parametrize('direction', [FORWARD, REVERSE])
@pytest.mark.parametrize('v_x, speed, curvature', [
    (0.0, STANDSTILL_SPEED, 0.1), (0.6, 0.6, 0.15), (0.95, 0.95, 0.2)])
def test_the_drift_is_that_of_the_path_half_a_look_ahead_on(direction, v_x, speed, curvature):
    s = np.linspace(0.0, 2.0, 401)  # its curvature is its length, in 1/m^2
    step = 0.5 * (s[1:] + s[:-1])
    x, y = (np.append(0.0, np.cumsum(part(0.5 * step ** 2) * s[1]))
            for part in (np.cos, np.sin))
    lateral = Mock(return_value=0.0)
    yaw = 0.0 if direction == FORWARD else math.pi
    PathFollower((Segment(x, y, direction),), direction * v_x, 0.0).step(at(
        yaw=yaw, lateral=lateral))
    assert lateral.call_args.args == (
        direction * speed, pytest.approx(speed * curvature, rel=0.1), yaw)


def test_on_a_circle_the_curvature_is_that_of_the_path():
    angle = np.linspace(0.0, math.pi, 400)
    circle = Segment(np.sin(angle), 1.0 - np.cos(angle))
    follower = PathFollower((circle,), 0.3, 0.0)
    follower._distance = 0.9
    speed, rate = follower.step(at(math.sin(1.0), 1.0 - math.cos(1.0), 1.0))
    assert rate / speed == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(('v_x', 'error', 'turns'), [
    (0.0, 0.59, False), (0.0, 0.61, True), (0.0, -0.61, True), (0.0, -0.59, False),
    (0.3, 1.19, False), (0.3, 1.21, True)])
def test_a_large_error_is_corrected_by_a_turn_in_place(v_x, error, turns):
    speed, rate = PathFollower((line(),), v_x, 0.0).step(at(1.0, 0.0, error))
    assert (speed < v_x or speed == 0.0) == turns
    if not turns:
        assert math.copysign(1.0, rate) == -math.copysign(1.0, error)


def settled(**motion):
    """Return the steps until the end of a segment is left, with a motion of the robot there."""
    follower = PathFollower((line(1.0), Spin(1.0)), 0.0, 0.0)
    assert follower.step(at(1.0)) == (0.0, 0.0)
    for count in range(1, 30):
        follower.step(at(1.0, **motion))
        if follower.advance().number == 1:
            return count
    return None


@pytest.mark.parametrize(('motion', 'steps'), [
    ({}, 1), ({'v_x': 0.019}, 1), ({'v_x': -0.021}, 11), ({'yaw_rate': 0.049}, 1),
    ({'yaw_rate': -0.051}, 11)])
def test_after_a_segment_the_robot_comes_to_rest_for_up_to_a_second(motion, steps):
    assert settled(**motion) == steps


def test_a_segment_ends_half_a_step_before_its_end():
    for x, ends in ((0.9970, False), (0.9976, True), (1.1, True)):
        follower = PathFollower((line(1.0),), 0.0, 0.0)
        follower.step(at(0.95))
        assert (follower.step(at(x))[0] == 0.0) == ends


def test_beyond_the_end_the_path_is_straight():
    """The robot behind the end of a path that turned, where the end is its nearest point."""
    follower = PathFollower((line(1.0),), 0.05, 0.0)
    follower._distance = 1.0
    speed, rate = follower.step(at(0.99, 0.0))
    assert (speed, rate) == (pytest.approx(0.05), 0.0)


def test_a_turn_that_misses_its_yaw_is_repeated():
    follower = PathFollower((Spin(1.0),), 0.0, 0.0)
    follower.step(at(yaw=0.97))
    follower.step(at(yaw=1.2))
    assert not follower.finished
    assert follower.step(at(yaw=1.2))[1] < 0.0
    follower.step(at(yaw=0.97))
    follower.step(at(yaw=0.95))
    for _ in range(3):
        follower.step(at(yaw=0.95))
    assert follower.finished
    assert follower.step(at(yaw=0.95)) == (0.0, 0.0)


@pytest.mark.parametrize('direction', [FORWARD, REVERSE])
def test_the_direction_of_travel_is_that_of_the_path(direction):
    yaw = (0.0 if direction == FORWARD else math.pi) - 0.1
    follower = PathFollower((line(direction=direction),), direction * 0.3, 0.0)
    assert follower.step(at(
        1.0, 0.0, yaw, lateral=lambda v_x, *_: math.tan(0.1) * v_x))[1] == pytest.approx(0.0)


def test_a_turn_in_place_waits_for_a_slow_robot():
    follower = PathFollower((Spin(1.0),), 0.3, 0.0)
    assert follower.step(at(v_x=0.3)) == (pytest.approx(0.25), 0.0)
    assert PathFollower((Spin(1.0),), 0.09, 0.0).step(at())[1] > 0.0


def test_the_end_is_that_of_the_last_segment_with_the_yaw_of_a_turn_after_it():
    *position, yaw = PathFollower((line(1.0), Spin(2.0), line(2.0)), 0.0, 0.0).end
    assert (position, math.isnan(yaw)) == ([2.0, 0.0], True)
    assert PathFollower((line(1.0), Spin(2.0)), 0.0, 0.0).end == (1.0, 0.0, 2.0)


def test_numbers_of_progress():
    follower = PathFollower((line(1.0), line(2.0), Spin(2.0)), 0.0, 0.0)
    assert follower.remaining_distance() == 3.0
    follower.step(at(-0.2))
    assert follower.advance() == (0, pytest.approx(-3.2), -math.inf)
    follower.step(at(0.1))
    assert follower.remaining_distance() == pytest.approx(2.9)
    assert follower.advance() == (0, pytest.approx(-2.9), -math.inf)
    turning = PathFollower((Spin(2.0),), 0.0, 0.0)
    turning.step(at(yaw=0.5))
    assert turning.advance() == (0, 0.0, -1.5)


def test_the_projection_advances_within_its_window():
    follower = PathFollower((line(5.0),), 0.0, 0.0)
    follower.step(at(0.0, 0.3))
    follower.step(at(4.0, v_x=1.0))
    assert follower.point.distance == pytest.approx(0.2 + 2.0 * 1.0 * DT)
    follower.step(at(0.1))
    assert follower.point.distance == pytest.approx(0.4)  # never back
    started = PathFollower((line(5.0),), 0.0, 0.0)
    started.step(at(0.6))
    assert started.point.distance == pytest.approx(0.6)


def rate(error, *, spin=None, limits=SPIN_LIMITS):
    """Return the rate commanded for a yaw error."""
    return (spin or SpinControl((0.0, 0.0))).step(error, spinning(limits, SPIN_PARAMS))


def spinning(limits, params):
    return replace(at(), limits=limits, params=params)


@pytest.mark.parametrize(('error', 'expected'), [
    (2.0, 0.8), (-2.0, -0.8), (0.4, math.sqrt(2.0 * 0.85 * 0.5 * 0.4)), (0.06, 0.2255),
    (-0.3, -math.sqrt(2.0 * 0.85 * 0.5 * 0.3))])
def test_the_rate_decreases_towards_the_end(error, expected):
    assert rate(error) == pytest.approx(expected, rel=2e-3)


def test_the_rate_has_a_minimum_and_the_limit_of_the_robot():
    slow = MotionLimits(1.0, 0.5, 0.4, 1.0, 0.5, 1e-3)
    assert rate(0.06, limits=slow) == 0.2
    fast = MotionLimits(1.0, 0.5, 0.4, 1.0, 0.5, 10.0)
    assert rate(2.0, limits=fast) == 0.5


def test_with_slip_compensation_the_rate_ends_the_turn_no_sooner_than_its_delay():
    fast = MotionLimits(1.0, 0.5, 0.4, 1.0, 0.5, 10.0)
    spin = SpinControl((0.0, 0.0))
    params = replace(SPIN_PARAMS, slip_compensation=True)
    now = spinning(fast, params)
    assert spin.step(0.06, now) == pytest.approx(0.4)  # 0.06 rad in 0.15 s
    assert spin.step(0.06, replace(now, delay=0.24)) == pytest.approx(0.25)
    assert spin.step(0.06, replace(now, delay=0.0)) == pytest.approx(0.5)  # limit


@pytest.mark.parametrize(('error', 'done'), [(0.049, True), (-0.049, True), (0.051, False)])
def test_a_turn_is_done_within_half_the_tolerance_and_remains_so(error, done):
    spin = SpinControl((0.0, 0.0))
    assert (rate(error, spin=spin) == 0.0) == done
    assert spin.done == done
    assert spin.error == error
    rate(0.3, spin=spin)
    assert spin.done == done


def test_a_turn_keeps_its_side_at_half_a_revolution():
    spin = SpinControl((0.0, 0.0))
    assert rate(3.1, spin=spin) > 0.0
    assert rate(-3.1, spin=spin) > 0.0
    assert spin.error == pytest.approx(math.tau - 3.1)
    spin = SpinControl((0.0, 0.0))
    assert rate(-3.1, spin=spin) < 0.0
    assert rate(3.1, spin=spin) < 0.0


def turning(error=1.5, x=0.0, y=0.0, yaw=0.0, yaw_rate=0.5, v_x=0.0, v_y=0.0, lateral=0.0):
    """Return a turn that holds (2, 1) and a robot off it, with a lateral speed over the rate."""
    spin = SpinControl((2.0, 1.0))
    spin.error = error
    return spin, replace(spinning(SPIN_LIMITS, SPIN_PARAMS), motion=Motion(
        2.0 + x, 1.0 + y, yaw, v_x, v_y, yaw_rate), dt=10.0, lateral_speed=(
            lambda _, rate, yaws: lateral * rate * np.ones_like(yaws)))


def simulated(side, pivot, slide, *, held, **start):
    """Return where a turn by 90 degrees ends [m] relative to the position to hold."""
    spin, now = turning(1.5708 * side, yaw_rate=0.5 * side, **start)
    x, y, yaw, rest, dt = now.motion.x, now.motion.y, 0.0, 0.5 * math.pi, 0.01
    while rest > 0.0:
        spin.error = side * rest

        def lateral(_, rate, yaws):
            return -pivot * rate + abs(rate) * (slide[1] * np.cos(yaws) - slide[0] * np.sin(yaws))

        now = replace(now, motion=replace(now.motion, x=x, y=y, yaw=yaw), lateral_speed=lateral)
        v_x = spin.holding_speed(0.0, now) if held else 0.0
        v_y = lateral(0.0, 0.5 * side, yaw)
        x += dt * (v_x * math.cos(yaw) - v_y * math.sin(yaw))
        y += dt * (v_x * math.sin(yaw) + v_y * math.cos(yaw))
        yaw, rest = yaw + side * 0.5 * dt, rest - 0.5 * dt
    return math.hypot(x - 2.0, y - 1.0)


@pytest.mark.parametrize('side', [1.0, -1.0])
@pytest.mark.parametrize(('start', 'pivot', 'slide', 'share'), [
    ({'x': 0.05}, 0.0, (0.0, 0.0), 0.45), ({'y': 0.05}, 0.0, (0.0, 0.0), 0.45),
    ({}, 0.03, (0.0, 0.0), 0.55), ({}, -0.03, (0.0, 0.0), 0.55),
    ({}, 0.0, (0.03, 0.0), 0.55), ({}, 0.0, (0.0, -0.03), 0.55)])
def test_a_turn_ends_nearer_to_its_position_with_the_speed_that_holds_it(
        side, start, pivot, slide, share):
    held, left = (simulated(side, pivot, slide, held=held, **start) for held in (True, False))
    assert held < share * left


def test_the_position_is_led_to_before_a_known_slide_takes_the_robot_off_it():
    for side in (1.0, -1.0):  # outward, and so behind of the yaw at the end
        spin, now = turning(1.5 * side, yaw_rate=0.5 * side, lateral=-0.1)
        assert spin.holding_speed(0.0, now) < -0.02
    assert spin.holding_speed(0.0, replace(now, lateral_speed=no_lateral_speed)) == (
        pytest.approx(0.0))


@pytest.mark.parametrize(('x', 'y', 'yaw', 'sign'), [
    (0.02, 0.0, 0.0, -1.0), (-0.02, 0.0, 0.0, 1.0), (0.0, 0.02, 0.5 * math.pi, -1.0),
    (0.02, 0.0, math.pi, 1.0)])
def test_at_the_end_of_a_turn_the_speed_is_that_of_the_distance_ahead(x, y, yaw, sign):
    spin, now = turning(1e-3, x, y, yaw, yaw_rate=0.6)
    assert spin.holding_speed(0.0, now) == pytest.approx(
        sign * 0.02 * 0.6 / HOLD_ANGLE, rel=0.01)
    assert spin.holding_speed(0.0, replace(now, dt=1e-3)) == pytest.approx(sign * 0.4e-3)


@pytest.mark.parametrize('ahead', [1.0, -1.0])
def test_wheels_do_not_drive_a_robot_that_slides_away_faster_than_they_could(ahead):
    spin, now = turning(1e-3, x=-ahead)
    assert spin.holding_speed(0.0, now) == pytest.approx(ahead * MAX_HOLD_SPEED)
    for motion in ({'v_x': -ahead * 0.21}, {'v_y': 0.21}):
        sliding = replace(now, motion=replace(now.motion, **motion))
        assert spin.holding_speed(0.0, sliding) == 0.0
