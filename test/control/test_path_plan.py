# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Poses to maneuvers: corners, cusps, direction of travel, turns in place."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.control.constants import MIN_SPACING
from smart_tire.control.ground_motion import Motion
from smart_tire.control.path_geometry import FORWARD, REVERSE, Segment, Spin
from smart_tire.control.path_library import figure_eight, square
from smart_tire.control.path_plan import _distinct, plan_goal, plan_path
from smart_tire.parameters.path_following import ArrivalParams
from smart_tire.samples import NAN

CORNER = 0.8


def plan(*points, corner=CORNER):
    """Return each maneuver as (end x, end y, direction) or ('spin', yaw)."""
    return described(plan_path([(*one, NAN)[:3] for one in points], corner))


def described(maneuvers):
    return [('spin', round(one.yaw, 6)) if isinstance(one, Spin) else
            (*(round(value, 6) + 0.0 for value in one.end), one.direction) for one in maneuvers]


def with_yaw(poses, offset=0.0):
    """Return poses with the yaw of the path."""
    x, y = np.array(poses)[:, :2].T
    yaw = np.arctan2(np.gradient(y), np.gradient(x)) + offset
    return list(zip(x.tolist(), y.tolist(), yaw.tolist()))


def test_sharp_corners_separate_segments():
    assert plan((0, 0), (1, 0), (1, 1), (0, 1)) == [(1, 0, 1), (1, 1, 1), (0, 1, 1)]


@pytest.mark.parametrize(('angle', 'segments'), [(0.75, 1), (0.85, 2), (-0.75, 1), (-0.85, 2)])
def test_a_corner_above_the_angle_is_turned_in_place(angle, segments):
    assert len(plan((0, 0), (1, 0), (1 + math.cos(angle), math.sin(angle)))) == segments


@pytest.mark.parametrize('spacing', [0.0013, 0.004, 0.011, 0.05, 1.0])
def test_corners_are_found_at_any_spacing(spacing):
    side = np.arange(0.0, 2.0 + 0.5 * spacing, spacing)
    points = [(s, 0.0) for s in side] + [(side[-1], s) for s in side[1:]]
    maneuvers = plan_path([(*one, NAN) for one in points], CORNER)
    assert len(maneuvers) == 2
    assert maneuvers[0].end == pytest.approx((side[-1], 0.0), abs=MIN_SPACING)
    assert maneuvers[1].end == pytest.approx((side[-1], side[-1]))


def test_a_dense_small_circle_has_no_corners():
    angle = np.linspace(0.0, math.tau, 1000)
    points = zip((0.1 * np.sin(angle)).tolist(), (0.1 - 0.1 * np.cos(angle)).tolist())
    assert len(plan(*points)) == 1


def test_a_path_back_is_a_cusp_driven_after_a_turn():
    assert plan((0, 0), (1, 0), (0.5, 0)) == [(1, 0, FORWARD), (0.5, 0, FORWARD)]


def test_given_orientations_make_the_robot_reverse():
    assert plan((0, 0, 0.0), (1, 0, 0.0), (0, 0.2, -0.2)) == [
        (1, 0, FORWARD), (0, 0.2, REVERSE), ('spin', -0.2)]


@pytest.mark.parametrize(('offset', 'direction'), [(0.0, FORWARD), (math.pi, REVERSE),
                                                   (0.4, FORWARD), (math.pi - 0.4, REVERSE)])
def test_the_direction_is_that_of_the_orientations(offset, direction):
    poses = with_yaw(figure_eight(0.5).poses, offset)
    segment, spin = plan_path(poses, CORNER)
    assert segment.direction == direction
    assert spin.yaw == pytest.approx(poses[-1][2])


@pytest.mark.parametrize('offset', [0.6, 1.5, -0.6, math.pi + 0.6])
def test_orientations_that_contradict_the_path_are_ignored(offset):
    segment, = plan_path(with_yaw(figure_eight(0.5).poses, offset), CORNER)
    assert segment.direction == FORWARD


@pytest.mark.parametrize('yaw', [0.0, NAN])
def test_the_same_yaw_everywhere_on_a_curve_is_not_an_orientation(yaw):
    poses = [(x, y, yaw) for x, y, _ in figure_eight(0.5).poses]
    assert [type(one) for one in plan_path(poses, CORNER)] == [Segment]
    long = [(0, 0, yaw), (10, 0, yaw), (10, 0.5, yaw), (0, 0.5, yaw)]  # agrees on most of it
    assert plan(*long) == [(10, 0, 1), (10, 0.5, 1), (0, 0.5, 1)]


def test_a_cusp_found_twice_or_noise_at_an_end_is_not_a_segment():
    forward = [(0.01 * i, 0.0, 0.0) for i in range(101)]
    back = [(1.0 - 0.01 * i, 0.01 * i, -0.7) for i in range(1, 101)]
    late = [(1.004, 0.003, 0.0), (1.003, 0.006, 0.0)]  # forward still, after a corner
    maneuvers = plan_path([*forward, *late, *back], CORNER)
    assert [one.direction for one in maneuvers[:-1]] == [FORWARD, REVERSE]
    assert plan((0, 0), (1, 0), (1, 0.029)) == [(1, 0.029, FORWARD)]
    assert plan((0, 0), (1, 0), (1, 0.031)) == [(1, 0, FORWARD), (1, 0.031, FORWARD)]
    assert plan((0, 0), (0, 0.029), (1, 0.029)) == [(1, 0.029, FORWARD)]


def test_a_few_wrong_orientations_do_not_count():
    poses = with_yaw(figure_eight(0.5).poses, math.pi)
    poses[30:40] = [(x, y, yaw + 1.5) for x, y, yaw in poses[30:40]]
    assert plan_path(poses, CORNER)[0].direction == REVERSE
    assert len(plan_path(poses, CORNER)) == 2


def test_the_first_known_direction_counts_for_poses_before_it():
    poses = [(0, 0, 1.2), (0.1, 0, 1.2), (1, 0, math.pi), (2, 0, math.pi)]
    assert plan(*poses)[0] == (2, 0, REVERSE)


@pytest.mark.parametrize('agreeing, direction', [(6, FORWARD), (8, REVERSE)])
def test_orientations_count_if_they_agree_on_three_quarters_of_the_path(agreeing, direction):
    poses = [(float(k), 0.0, math.pi if k < agreeing else 0.5 * math.pi) for k in range(11)]
    assert plan_path(poses, CORNER)[0].direction == direction


def test_a_reversal_of_the_orientation_separates_segments():
    assert plan((0, 0, 0.0), (1, 0, 0.0), (2, 0, math.pi), (3, 0, math.pi)) == [
        (2, 0, FORWARD), (3, 0, REVERSE), ('spin', 3.141593)]


def test_two_poses_at_one_position_are_a_turn_in_place():
    assert plan((0, 0, 0.0), (0, 0, 1.0), (0, 0, math.pi / 2), (0, 1, math.pi / 2),
                (0, 1, 0.0), (1, 1, 0.0), (1, 1, 3.0)) == [
        ('spin', 1.570796), (0, 1, 1), ('spin', 0.0), (1, 1, 1), ('spin', 3.0)]
    assert plan((0, 0, 0.0), (0, 0, 0.17), (1, 0, 0.0)) == [(1, 0, 1), ('spin', 0.0)]
    assert plan((0, 0, 0.0), (0, 0, 0.18), (1, 0, 0.0)) == [
        ('spin', 0.18), (1, 0, 1), ('spin', 0.0)]
    assert plan((0, 0, 0.0), (1, 0, 0.0), (1.001, 0.001, 1.0)) == [(1, 0, 1), ('spin', 1.0)]
    assert plan((0, 0, 1.0), (0, 0, 1.0), (1, 0, 0.0)) == plan((0, 0, 1.0), (1, 0, 0.0))


def test_of_several_turns_at_one_position_the_last_given_orientation_is_kept():
    distinct, spins = _distinct([(0, 0, 0.0), (0, 0, 1.0), (0, 0, math.nan), (1, 0, 0.0)])
    assert len(distinct) == 2 and spins == {0: 1.0}
    assert _distinct([(0, 0, 0.0), (0, 0, 1.0), (0, 0, 0.1), (1, 0, 0.0)])[1] == {0: 0.1}


def test_turns_are_ignored_with_the_orientations():
    assert plan((0, 0), (1, 0), (1, 0, 1.0), (2, 0)) == [(2, 0, 1)]


def test_repeated_positions_change_nothing():
    points = [one for one in square(1.0).poses for _ in range(3)]
    assert plan(*points) == [(1, 0, 1), (1, 1, 1), (0, 1, 1), (0, 0, 1)]


def test_a_path_ends_exactly_at_its_last_pose():
    assert plan((0, 0), (1, 0), (1.0015, 0.0)) == [(1.0015, 0, 1)]


@pytest.mark.parametrize(('goal', 'expected'), [
    ((2.0, 1.0, 0.5), [(2, 1, FORWARD), ('spin', 0.5)]),
    ((2.0, 1.0, NAN), [(2, 1, FORWARD)]),
    ((0.6, 1.0, NAN), [(0.6, 1, REVERSE)]),    # behind, near
    ((0.6, 1.1, NAN), [(0.6, 1.1, REVERSE)]),
    ((0.6, 0.8, NAN), [(0.6, 0.8, REVERSE)]),
    ((0.3, 1.0, 0.0), [(0.3, 1, FORWARD), ('spin', 0.0)]),  # behind, far
    ((1.0, 1.4, NAN), [(1, 1.4, FORWARD)]),    # to the side
    ((1.03, 1.0, 2.0), [('spin', 2.0)]),
    ((1.03, 1.0, NAN), []),
])
def test_a_goal_is_reached_straight_and_short_distances_behind_in_reverse(goal, expected):
    start = Motion(1.0, 1.0, 0.1, 0.0, 0.0, 0.0)
    arrival = ArrivalParams(xy_tolerance=0.05, reverse_distance=0.6)
    assert described(plan_goal(start, goal, arrival)) == expected
