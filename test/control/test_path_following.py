# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Paths followed by an ideal robot with lag: accuracy, arrival, limits."""

from __future__ import annotations

from dataclasses import replace
import math

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

from smart_tire.control.path_library import figure_eight, lane_change, line, square
from smart_tire.control.trajectory_control import PathState
from smart_tire.parameters.path_following import (
    FrictionLimitParams, MotionLimitParams)
from smart_tire.samples import GoalPose, GroundState, NAN, PlannedPath
from smart_tire.uncertain import Uncertain
from support.ideal_robot import distances, IDEAL, path, Run


def arrived(planned, params=IDEAL, seconds=120.0, **robot):
    """Follow a path to its end; return the log (n, 8)."""
    run = Run(params, **robot).start(planned).until_end(seconds)
    assert run.control.state == PathState.ARRIVED, run.control.reason
    return run.log


def travelled(log):
    return np.hypot(np.diff(log[:, 1]), np.diff(log[:, 2])).sum()


@pytest.mark.parametrize(('planned', 'error'), [
    (figure_eight(0.5), 0.007), (figure_eight(1.0), 0.003), (lane_change(2.0, 0.6), 0.007),
    (square(1.0), 0.006), (line(1.5), 0.001), (line(-1.0), 0.001)])
def test_paths_of_the_library_are_followed(planned, error):
    log = arrived(planned)
    assert distances(planned, log).max() < error
    assert log[-1, 1:3] == pytest.approx(planned.poses[-1][:2], abs=0.008)
    assert travelled(log) == pytest.approx(sum(
        math.dist(one[:2], other[:2]) for one, other in zip(planned.poses, planned.poses[1:])),
        abs=0.05)


@pytest.mark.parametrize(('rate', 'robot', 'error'), [
    (10.0, {}, 0.012), (50.0, {}, 0.007), (20.0, {'lag': 0.2}, 0.012),
    (20.0, {'lag': 0.03}, 0.012), (20.0, {'lag': 0.05, 'dead_time': 2}, 0.01),
    (20.0, {'yaw_gain': 0.8}, 0.03), (20.0, {'yaw_gain': 1.2}, 0.03)])
def test_a_figure_eight_is_followed_with_other_rates_and_plants(rate, robot, error):
    log = arrived(figure_eight(0.5), rate=rate, **robot)
    assert distances(figure_eight(0.5), log).max() < error
    assert travelled(log) == pytest.approx(15.73 * 0.5, abs=0.25)


def test_corners_are_not_cut_at_full_speed():
    """Circles of 0.5 m and 1 m after a straight, at 0.5 m/s."""
    fast = replace(IDEAL, max_speed=0.5, limits=MotionLimitParams(lateral_acceleration=2.0))
    for radius in (0.5, 1.0):
        angle = np.linspace(0.0, math.pi, 80)
        arc = zip((1.0 + radius * np.sin(angle)).tolist(),
                  (radius - radius * np.cos(angle)).tolist())
        planned = path((0.0, 0.0), *arc)
        log = arrived(planned, fast)
        assert log[:, 4].max() == pytest.approx(0.5, abs=0.01)
        assert distances(planned, log).max() < 0.01


def reversed_eight():
    """Return a figure-eight driven in reverse: orientations opposite to the path."""
    x, y = np.array(figure_eight(0.5).poses)[:, :2].T
    yaw = np.arctan2(np.gradient(y), np.gradient(x))
    return path(*zip((-x).tolist(), (-y).tolist(), yaw.tolist()))


def test_a_path_is_followed_in_reverse():
    log = arrived(reversed_eight())
    assert log[:, 6].max() <= 0.0
    assert distances(reversed_eight(), log).max() < 0.006


def test_at_a_cusp_the_robot_stops_and_reverses():
    planned = path((0, 0, 0.0), (1, 0, 0.0), (0, 0.3, -0.29))
    log = arrived(planned)
    assert log[:, 1].max() == pytest.approx(1.0, abs=0.01)
    assert (log[:, 6].max(), log[:, 6].min()) == pytest.approx((0.6, -0.6), abs=0.03)
    assert distances(planned, log).max() < 0.04
    assert log[-1, 1:4] == pytest.approx((0.0, 0.3, -0.29), abs=0.05)


@pytest.mark.parametrize('count', [12, 2000, 4999])
def test_coarse_and_dense_paths_are_followed(count):
    angle = np.linspace(0.0, math.tau, count + 1)
    planned = path(*zip((2.0 * np.sin(angle)).tolist(), (2.0 - 2.0 * np.cos(angle)).tolist()))
    error = distances(path(*planned.poses[::max(count // 2000, 1)]), arrived(planned))
    assert error.max() < (0.03 if count == 12 else 0.002)


def test_noise_of_the_path_is_smoothed():
    rng = np.random.default_rng(3)
    planned = path(*((x + rng.normal(0.0, 0.002), y + rng.normal(0.0, 0.002))
                     for x, y, _ in figure_eight(0.5).poses))
    assert distances(figure_eight(0.5), arrived(planned)).max() < 0.03


@pytest.mark.parametrize(('x', 'y', 'yaw'), [
    (0.0, 0.4, 0.0), (0.0, -0.8, math.pi), (-0.9, 0.0, 0.0), (0.5, 0.3, -1.0), (0.0, 0.0, -3.1)])
def test_a_robot_off_the_path_joins_it(x, y, yaw):
    log = arrived(line(3.0), x=x, y=y, yaw=yaw)
    end = log[log[:, 1] > 2.3]
    assert np.abs(end[:, 2]).max() < 0.005
    assert np.abs(log[:, 2]).max() < abs(y) + 0.05


@pytest.mark.parametrize(('goal', 'start_yaw'), [
    ((1.0, 1.0, 1.0), 0.0), ((-0.4, 0.1, 0.0), 0.0), ((-2.0, 0.0, NAN), 0.0),
    ((0.0, 0.0, 3.1), -3.1), ((0.0, 0.0, -3.1), 0.1), ((0.5, -0.5, -3.0), 3.0),
    ((-1.0, 0.0, 3.0), -3.1)])
def test_goals_are_reached(goal, start_yaw):
    log = arrived(GoalPose(0, 'odom', goal), yaw=start_yaw)
    assert log[-1, 1:3] == pytest.approx(goal[:2], abs=0.017)
    if not math.isnan(goal[2]):
        assert math.remainder(log[-1, 3] - goal[2], math.tau) == pytest.approx(0.0, abs=0.08)
    assert np.abs(np.diff(log[:, 3])).sum() < math.pi + 1.6  # no detour at +-pi


def test_a_goal_within_the_tolerance_is_reached_without_driving():
    run = Run().start(GoalPose(0, 'odom', (0.04, 0.0, NAN)))
    assert run.step().v_x == 0.0
    assert [run.step() for _ in range(20)] == [None] * 20
    assert run.control.state == PathState.ARRIVED


@pytest.mark.parametrize('yaw_gain', [0.25, 0.5])
def test_a_robot_that_turns_slowly_on_soft_ground_reaches_its_yaw(yaw_gain):
    log = arrived(GoalPose(0, 'odom', (0.0, 0.0, 2.0)), yaw_gain=yaw_gain)
    assert log[-1, 3] == pytest.approx(2.0, abs=0.08)
    assert log[-1, 0] - log[0, 0] < 3.5 / yaw_gain
    assert (np.diff(np.sign(log[:, 7])) != 0).sum() <= 2  # no chattering


def within_limits(log, params, friction=math.inf):
    """Check the commands of a run against the parameters."""
    limits, tiny = params.limits, 1e-6
    v_x, rate = log[:, 6], log[:, 7]
    along, turning = np.diff(v_x) / 0.05, np.diff(rate) / 0.05
    speed_change = np.diff(np.abs(v_x)) / 0.05
    assert np.abs(v_x).max() <= params.max_speed + tiny
    assert np.abs(rate).max() <= max(limits.yaw_rate, 0.0) + tiny
    assert speed_change.max() <= limits.acceleration + tiny
    assert speed_change.min() >= -limits.deceleration - tiny
    assert np.abs(turning).max() <= limits.yaw_acceleration + tiny
    lateral = np.abs(v_x * rate)
    assert lateral.max() <= limits.lateral_acceleration + tiny
    assert np.hypot(lateral[1:], along).max() <= friction + tiny


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.floats(0.2, 1.5), st.floats(0.1, 1.0), st.floats(0.1, 1.0), st.floats(0.15, 2.0),
       st.floats(0.3, 2.0), st.sampled_from(['eight', 'square', 'reverse', 'lane']))
def test_commands_keep_all_limits(speed, up, down, lateral, yaw_rate, name):
    planned = {'eight': figure_eight(0.4), 'square': square(0.7), 'reverse': line(-1.0),
               'lane': lane_change(1.0, 0.5)}[name]
    params = replace(IDEAL, max_speed=speed, rate=20.0, limits=MotionLimitParams(
        acceleration=up, deceleration=down, lateral_acceleration=lateral, yaw_rate=yaw_rate))
    run = Run(params).start(planned).for_seconds(12.0)
    assert run.control.state in (PathState.FOLLOWING, PathState.ARRIVED)
    within_limits(run.log, params)


@pytest.mark.parametrize('mu', [0.04, 0.1, 0.4])
def test_accelerations_remain_below_a_share_of_friction(mu):
    params = replace(IDEAL, max_speed=1.5, friction=FrictionLimitParams(
        fade_distance=1e3, fade_time=3600.0, share=0.5, minimum=0.01),
        limits=MotionLimitParams(acceleration=1.0, deceleration=1.0, lateral_acceleration=5.0,
                                 yaw_rate=5.0, yaw_acceleration=20.0))
    run = Run(params)
    run.control.set_ground(GroundState(0, Uncertain(50.0, 1.0), Uncertain(mu, 0.0)))
    log = run.start(figure_eight(0.5)).until_end().log
    assert run.control.state == PathState.ARRIVED, run.control.reason
    within_limits(log[:-1], params, friction=0.5 * (mu + 0.003) * 9.81)  # it fades
    lateral = np.abs(log[:, 6] * log[:, 7]).max()
    assert lateral > 0.7 * 0.8 * 0.5 * mu * 9.81 or log[:, 6].max() > 1.2


def test_a_path_of_two_poses_may_be_short():
    log = arrived(PlannedPath(0, 'odom', ((0.0, 0.0, NAN), (0.03, 0.0, NAN))))
    assert log[-1, 1] == pytest.approx(0.03, abs=0.005)


@pytest.mark.parametrize('dead_time', [4, 7])
@pytest.mark.parametrize('planned', [lane_change(2.0, 0.6), square(1.0)])
def test_a_base_that_answers_late_follows_paths_and_arrives(planned, dead_time):
    """0.2 and 0.35 s, and a lag of 0.1 s, where 0.15 s are given."""
    log = arrived(planned, dead_time=dead_time)
    away = distances(planned, log)
    assert math.sqrt((away ** 2).mean()) < 0.02 and away.max() < 0.06
    assert math.dist(log[-1, 1:3], planned.poses[-1][:2]) < 0.05
