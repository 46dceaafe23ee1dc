# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Check of odometry, and prediction of the pose."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control.ground_motion import Motion, MotionMonitor, wrap
from smart_tire.parameters.path_following import PathCheckParams
from smart_tire.samples import NS_PER_S
from support.ideal_robot import odometry

PARAMS = PathCheckParams(odom_jump=0.2)


def monitor(*samples):
    made = MotionMonitor()
    for sample in samples:
        made.add_odometry(sample, PARAMS)
    return made


def test_a_pose_is_predicted_on_a_circle():
    motion = Motion(1.0, 2.0, 0.5, 0.4, 0.0, 1.0).after(0.2)
    chord, middle = 2.0 * 0.4 * math.sin(0.1), 0.6
    assert (motion.x, motion.y) == pytest.approx(
        (1.0 + chord * math.cos(middle), 2.0 + chord * math.sin(middle)), abs=2e-4)
    assert motion.yaw == pytest.approx(0.7)
    assert (motion.v_x, motion.yaw_rate) == (0.4, 1.0)


def test_lateral_velocity_is_to_the_left():
    motion = Motion(0.0, 0.0, math.pi / 2, 0.0, 0.3, 0.0).after(1.0)
    assert (motion.x, motion.y) == pytest.approx((-0.3, 0.0))
    assert motion.speed() == 0.3


def test_the_age_of_a_pose_is_counted_from_its_stamp():
    made = monitor(odometry(NS_PER_S, v_x=0.5))
    assert made.age(NS_PER_S + NS_PER_S // 5) == pytest.approx(0.2)
    assert made.motion.x == 0.0
    assert not made.fault
    assert made.initialized


def circle(seconds, rate=20.0, v_x=0.5, yaw_rate=0.4, twist=lambda v_x, yaw_rate: (v_x, yaw_rate),
           jump=lambda time: 0.0):
    """Return a monitor after a drive on a circle, whose ``twist`` and pose may be wrong."""
    made = MotionMonitor()
    for step in range(round(seconds * rate) + 1):
        time = step / rate
        motion = Motion(0.0, 0.0, 0.0, v_x, 0.0, yaw_rate).after(0.0)
        for _ in range(step):
            motion = motion.after(1.0 / rate)
        made.add_odometry(odometry(
            NS_PER_S + round(time * NS_PER_S), motion.x + jump(time), motion.y, motion.yaw,
            *twist(v_x, yaw_rate)), replace(PARAMS, odom_jump=10.0))
    return made


@pytest.mark.parametrize('rate', [4.0, 20.0, 100.0])
@pytest.mark.parametrize('twist', [
    lambda v_x, yaw_rate: (0.0, 0.0), lambda v_x, yaw_rate: (-v_x, yaw_rate),
    lambda v_x, yaw_rate: (v_x, math.degrees(yaw_rate)), lambda v_x, yaw_rate: (3.0 * v_x, 0.0)])
def test_a_twist_that_contradicts_the_poses_is_named_and_replaced_within_a_second(rate, twist):
    made = circle(1.0, rate, twist=twist)
    assert (made.motion.v_x, made.motion.yaw_rate) == pytest.approx((0.5, 0.4), rel=0.01)
    given = twist(0.5, 0.4)
    assert f'twist of {given[0]:.2f} m/s and {given[1]:.2f} rad/s contradicts' in made.twist.fault
    assert 'move by 0.50 m/s and 0.40 rad/s' in made.twist.fault


@pytest.mark.parametrize(('twist', 'speeds'), [
    (lambda v_x, yaw_rate: (v_x, yaw_rate), (0.5, 0.4)),
    (lambda v_x, yaw_rate: (0.8 * v_x, 1.3 * yaw_rate), (0.4, 0.52))])
def test_a_twist_that_agrees_roughly_is_used(twist, speeds):
    made = circle(3.0, twist=twist)
    assert (made.motion.v_x, made.motion.yaw_rate) == pytest.approx(speeds)
    assert not made.twist.fault


def test_half_of_a_window_or_a_jump_of_the_pose_contradicts_no_twist():
    assert not circle(0.75, twist=lambda *_: (0.0, 0.0)).twist.fault
    for end in (1.0, 1.3, 1.7):  # the jump in the one or the other half, or gone
        made = circle(end, v_x=0.0, yaw_rate=0.0, jump=lambda time: 0.15 * (time > 0.9))
        assert not made.twist.fault and made.motion.v_x == 0.0
        made = circle(end, v_x=0.0, yaw_rate=0.0,  # to and fro
                      jump=lambda time: 0.15 * (0.7 < time < 1.1))
        assert not made.twist.fault and made.motion.v_x == 0.0


def test_the_twist_is_used_again_after_a_gap_and_when_it_agrees():
    made = circle(1.0, twist=lambda *_: (0.0, 0.0))
    assert made.twist.fault
    last = made.motion
    made.add_odometry(odometry(made.stamp_ns + 2 * NS_PER_S, last.x, last.y, last.yaw), PARAMS)
    assert not made.twist.fault and made.motion.v_x == 0.0


def test_without_odometry_its_age_is_infinite():
    assert monitor().age(0) == math.inf
    assert not monitor().initialized


@pytest.mark.parametrize(('x', 'speed', 'fault'), [
    (0.19, 0.0, False), (0.21, 0.0, True), (-0.21, 0.0, True),
    (0.69, 0.5, False), (0.71, 0.5, True), (0.69, -0.5, False)])
def test_a_position_that_the_speed_does_not_explain_is_a_jump(x, speed, fault):
    made = monitor(odometry(0))
    moved = made.add_odometry(odometry(NS_PER_S, x=x, v_x=speed), PARAMS)
    assert ('position jumped' in made.fault) == fault
    assert moved == pytest.approx(0.0 if fault else abs(x))


@pytest.mark.parametrize(('before', 'after', 'rate', 'fault'), [
    (0.0, 0.49, 0.0, False), (0.0, 0.51, 0.0, True), (0.0, -0.51, 0.0, True),
    (0.0, 1.4, 1.0, False), (0.0, 1.6, -1.0, True), (3.1, -3.1, 0.0, False)])
def test_a_yaw_that_the_rate_does_not_explain_is_a_jump(before, after, rate, fault):
    made = monitor(odometry(0, yaw=before), odometry(NS_PER_S, yaw=after, yaw_rate=rate))
    assert ('yaw jumped' in made.fault) == fault


def test_stamps_that_run_back_are_a_fault():
    assert 'time runs back by 1.000 s' in monitor(odometry(NS_PER_S), odometry(0)).fault
    assert not monitor(odometry(NS_PER_S), odometry(NS_PER_S)).fault


@pytest.mark.parametrize('change', [
    {'position': (math.nan, 0.0, 0.0)}, {'orientation': (0.0, 0.0, math.nan, 1.0)},
    {'linear': (0.0, math.inf, 0.0)}, {'angular': (0.0, 0.0, math.nan)},
    {'linear': (101.0, 0.0, 0.0)}, {'angular': (0.0, 0.0, -101.0)}])
def test_numbers_that_are_not_plausible_are_a_fault_and_not_used(change):
    made = monitor(odometry(0, x=1.0), replace(odometry(NS_PER_S), **change))
    assert 'not plausible' in made.fault
    assert made.motion.x == 1.0
    assert made.age(NS_PER_S) == pytest.approx(1.0)


def test_the_first_fault_remains_until_it_is_cleared():
    made = monitor(odometry(0), odometry(1, x=5.0), odometry(0))
    assert 'position jumped' in made.fault
    made.fault = ''
    made.add_odometry(odometry(2, x=5.0), PARAMS)
    made.add_odometry(odometry(3, x=5.01), PARAMS)
    assert 'position jumped' in made.fault  # from the pose before, which was back at 0


def test_angles_are_wrapped():
    assert wrap(3.5 * math.pi) == pytest.approx(-0.5 * math.pi)
    assert wrap(-1.5 * math.pi) == pytest.approx(0.5 * math.pi)


def test_the_robot_stands_while_it_neither_moves_nor_turns():
    rest = Motion(0.0, 0.0, 0.0, 0.01, -0.01, -0.04)
    assert rest.at_rest()
    assert not replace(rest, v_x=-0.021).at_rest()
    assert not replace(rest, yaw_rate=0.06).at_rest()


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_braking_ends_at_standstill(sign):
    moving = Motion(0.0, 0.0, 0.0, sign * 0.5, 0.0, 0.0)
    slower = moving.after(0.5, -0.5 * sign)
    assert (slower.v_x, slower.x) == pytest.approx((0.25 * sign, 0.1875 * sign))
    assert moving.after(2.0, -0.5 * sign).v_x == 0.0
    assert moving.after(2.0, 0.5 * sign).v_x == pytest.approx(1.5 * sign)
