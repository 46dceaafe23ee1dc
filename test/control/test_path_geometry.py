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

"""Geometry of segments, and the paths of the library."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.control.path_geometry import GRID_STEP, moving_average, Segment
from smart_tire.control.path_library import figure_eight, lane_change, line, square
from smart_tire.control.path_plan import plan_path


def circle(radius, count, angle=math.tau):
    """Return a segment along a circle to the left that begins at the origin along +x."""
    a = np.linspace(0.0, angle, count)
    return Segment(radius * np.sin(a), radius - radius * np.cos(a))


@pytest.mark.parametrize('count', [60, 3000])
def test_a_polygon_on_a_circle_has_its_curvature(count):
    segment = circle(0.5, count)
    assert segment.length == pytest.approx(math.pi, abs=2e-3)
    assert segment.curvature[20:-20] == pytest.approx(2.0, abs=0.02)
    assert segment.heading[20:-20] == pytest.approx(segment.distance[20:-20] / 0.5, abs=0.02)
    assert np.diff(segment.distance) == pytest.approx(segment.distance[1])
    assert 0.5 * GRID_STEP < segment.distance[1] <= GRID_STEP


def test_headings_continue_beyond_pi():
    assert circle(0.3, 500, 2.0 * math.tau).heading[-1] == pytest.approx(2.0 * math.tau, abs=0.06)


def test_the_curvature_of_a_kink_is_spread_and_turns_by_its_angle():
    segment = Segment(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.0, 0.5]))
    angle = math.atan2(0.5, 1.0)
    assert segment.curvature.sum() * segment.distance[1] == pytest.approx(angle, rel=1e-3)
    assert segment.heading[[0, -1]] == pytest.approx([0.0, angle])
    assert 2.0 < segment.curvature.max() < 5.0
    assert segment.curvature_rate.max() > 5.0


@pytest.mark.parametrize(('x', 'y', 'along', 'lateral'), [
    (0.5, 0.1, 0.0, 0.1), (0.5, -0.2, 0.0, -0.2), (-0.3, 0.1, -0.3, 0.1), (1.4, 0.0, 0.4, 0.0)])
def test_a_position_is_left_or_right_of_a_line_and_before_or_beyond_it(x, y, along, lateral):
    point = Segment(np.array([0.0, 1.0]), np.array([0.0, 0.0])).project(x, y, 0.0, 1.0)
    assert point.distance == pytest.approx(min(max(x, 0.0), 1.0))
    assert (point.along, point.lateral) == pytest.approx((along, lateral), abs=1e-12)
    assert point.offset() == pytest.approx(math.hypot(along, lateral))


def test_left_and_right_are_seen_along_the_direction_of_travel():
    point = Segment(np.array([0.0, -1.0]), np.array([0.0, 0.0])).project(-0.5, 0.1, 0.0, 1.0)
    assert point.lateral == pytest.approx(-0.1)
    assert abs(point.heading) == pytest.approx(math.pi)


@pytest.mark.parametrize('low', [0.0, 0.31, 0.6001])
def test_a_projection_stays_within_its_window(low):
    segment = Segment(np.array([0.0, 1.0]), np.array([0.0, 0.0]))
    assert segment.project(-1.0, 0.0, low, low + 0.2).distance == low
    assert segment.project(2.0, 0.0, low, low + 0.2).distance == low + 0.2
    assert segment.project(low + 0.1, 0.3, low, low + 0.2).distance == pytest.approx(low + 0.1)


def test_a_window_excludes_the_other_branch_of_a_crossing():
    poses = np.array(figure_eight(0.5).poses)
    segment = Segment(poses[:, 0], poses[:, 1])
    middle = 0.5 * segment.length
    for distance in np.arange(middle - 0.3, middle + 0.3, 0.01).tolist():
        x, y = (float(np.interp(distance, segment.distance, values))
                for values in (segment.x, segment.y))
        point = segment.project(x, y, distance - 0.1, distance + 0.2)
        assert point.distance == pytest.approx(distance, abs=1e-3)


def test_a_short_segment_has_two_points():
    segment = Segment(np.array([0.0, 0.005]), np.array([0.0, 0.0]))
    assert segment.distance.tolist() == [0.0, 0.005]
    assert segment.end == (0.005, 0.0)
    assert segment.project(0.002, 0.001, 0.0, 1.0).lateral == pytest.approx(0.001)


def test_a_moving_average_is_symmetric_and_shorter_near_the_ends():
    assert moving_average(np.array([0.0, 3.0, 0.0, 0.0, 6.0]), 1).tolist() == [0, 1, 1, 2, 6]
    line = np.arange(9.0)
    assert moving_average(line, 3) == pytest.approx(line)


def segment(planned):
    x, y = np.array(planned.poses)[:, :2].T
    return Segment(x, y)


@pytest.mark.parametrize('planned', [figure_eight(0.5), lane_change(2.0, 0.6), line(1.0),
                                     square(1.0)])
def test_paths_begin_at_the_origin_along_x(planned):
    assert planned.poses[0][:2] == pytest.approx((0.0, 0.0), abs=1e-12)
    x, y = planned.poses[1][:2]
    assert math.atan2(y, x) == pytest.approx(0.0, abs=0.01)
    assert planned.frame == 'odom'
    assert all(math.isnan(yaw) for _, _, yaw in planned.poses)


@pytest.mark.parametrize('radius', [0.3, 0.5, 2.0])
def test_a_figure_eight_has_the_radius_and_closes(radius):
    eight = segment(figure_eight(radius))
    assert eight.end == pytest.approx((0.0, 0.0), abs=1e-9)
    assert np.abs(eight.curvature).max() == pytest.approx(1.0 / radius, rel=0.03)
    assert eight.length == pytest.approx(15.732 * radius, rel=2e-3)
    assert eight.heading[-1] == pytest.approx(0.0, abs=0.05)
    half = eight.distance.size // 2
    assert (eight.curvature[5:half - 5] > 0.0).all()
    assert (eight.curvature[half + 5:-5] < 0.0).all()
    assert np.abs(eight.curvature_rate).max() < 1.0 / radius ** 2 + 0.2
    assert np.hypot(eight.x, eight.y).max() == pytest.approx(3.0 * radius, rel=1e-3)


def test_a_square_turns_left_at_its_corners():
    assert [one.end for one in plan_path(square(2.0).poses, 0.8)] == [
        (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 0.0)]


def test_a_lane_change_is_straight_before_and_after_it():
    x, y, _ = np.array(lane_change(2.0, -0.6).poses).T
    assert (x[0], x[-1], y[-1]) == pytest.approx((0.0, 3.0, -0.6))
    assert (np.diff(x) > 0.0).all()
    assert (y[x <= 0.5] == 0.0).all()
    assert y[x >= 2.5] == pytest.approx(-0.6)
    assert y[np.argmin(np.abs(x - 1.5))] == pytest.approx(-0.3)
    assert np.abs(np.gradient(y, x)).max() == pytest.approx(1.875 * 0.3, rel=1e-2)


def test_a_negative_line_is_driven_in_reverse():
    assert plan_path(line(-1.0).poses, 0.8)[0].direction == -1
    assert plan_path(line(1.0).poses, 0.8)[0].direction == 1
    assert line(-1.0).poses[-1] == (-1.0, 0.0, 0.0)


@pytest.mark.parametrize('planned', [figure_eight(0.5), figure_eight(2.0)])
def test_curves_have_poses_every_two_centimeters(planned):
    x, y, _ = np.array(planned.poses).T
    spacing = np.hypot(np.diff(x), np.diff(y))
    assert spacing.mean() == pytest.approx(0.02, rel=0.01)
    assert spacing.max() < 0.03
