# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A robot that follows a path: wrong odometry, conflicting orders, arrival on a slope."""

from __future__ import annotations

import time

import pytest
from smart_tire.control.trajectory_control import State
from support.following_rig import FollowingRig
from support.robot_rig import Stranger

pytestmark = pytest.mark.safety

SLOPE_LOAD = 0.323  # N m per wheel: 10.9 kg on 8 degrees, a radius of 0.087 m
LENGTH = 0.4        # m


@pytest.fixture
def robot(tmp_path, isolated_ros):
    with FollowingRig(tmp_path, hold_on_arrival=True) as started:
        yield started


@pytest.mark.parametrize('speed', [0.0, 0.025], ids=['stands', 'creeps'])
def test_odometry_that_contradicts_the_wheels_stops_them_within_1_s(robot, speed):
    robot.drive()
    robot.odom_speed, began = speed, time.monotonic()
    assert robot.until_stopped(began) < 1.0
    assert 'stopped: odom: ' in robot.processes['trajectory_controller'].output
    robot.stay_stopped(0.5)
    robot.odom_speed = None
    robot.drive()


def test_a_second_publisher_of_paths_stops_the_wheels_and_both_are_named(robot, tmp_path):
    with Stranger(tmp_path, 'path') as stranger:
        robot.drive()
        began = time.monotonic()
        stranger.publish(robot.path())
        assert robot.until_stopped(began) < 0.5
        robot.stay_stopped(0.5, lambda: (robot.command(), stranger.publish(robot.path())))
        robot.graph.until(
            lambda: 'refused: 2 publishers on path: /stranger, /test'  # once both are discovered
            in robot.processes['trajectory_controller'].output or stranger.publish(robot.path()))


def arrive(robot):
    """Follow a path to its end, on the slope."""
    robot.rig.fail(load=SLOPE_LOAD)
    robot.graph.until(lambda: robot.state() == State.ARRIVED, lambda: robot.follow(LENGTH))


def test_on_a_slope_the_robot_holds_after_arrival_until_the_emergency_stop(robot):
    arrive(robot)
    arrived = robot.x
    robot.hold(3.0, robot.command)
    assert abs(robot.x - arrived) < 0.03
    state, x = robot.rig.state(), robot.x
    assert 0.02 < min(state.duty) <= max(state.duty) < 0.1
    robot.hold(1.0, robot.command)
    assert robot.x == pytest.approx(x, abs=0.002)
    assert 'blocked' not in robot.processes['motor_driver'].output
    assert robot.emergency_stop(True).success
    robot.hold(1.2, robot.command)  # longer than release_hold_off
    assert robot.rig.state().still
    assert robot.emergency_stop(False).success
    robot.stay_stopped(0.5)  # the hold has ended: a new path is needed
    robot.rig.fail()
    robot.drive(0.3)


def test_without_the_hold_the_robot_rolls_away(tmp_path, isolated_ros):
    with FollowingRig(tmp_path) as robot:
        arrive(robot)
        arrived = robot.x
        robot.hold(2.0, robot.command)
        assert robot.rig.state().still
        assert robot.x < arrived - 0.06
