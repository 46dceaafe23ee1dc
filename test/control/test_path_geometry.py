# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Geometry of segments."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.control.constants import GRID_STEP
from smart_tire.control.path_geometry import moving_average, Segment, without_stairs
from smart_tire.control.path_library import figure_eight


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


def on_grid(x, y, cell):
    """Return the centers of the cells that a curve of dense points crosses, eight-connected."""
    cells = np.round(np.column_stack([x, y]) / cell)
    cells = cells[np.append(True, np.any(np.diff(cells, axis=0) != 0.0, axis=1))]
    kept, index = [cells[0]], 1
    while index < len(cells):
        offset = index + 1 < len(cells) and np.abs(cells[index + 1] - kept[-1]).max() == 1.0
        index += int(offset)
        kept.append(cells[index])
        index += 1
    return cell * np.array(kept).T


@pytest.mark.parametrize('cell', [0.025, 0.05, 0.1])
@pytest.mark.parametrize('heading', [0.05, 0.17, 0.4, -2.0])
def test_the_stairs_of_a_grid_are_no_curves(cell, heading):
    s = np.linspace(0.0, 3.0, 2001)
    x, y = on_grid(s * math.cos(heading), s * math.sin(heading), cell)
    segment = Segment(x, y)
    ends = segment.x[[0, -1]], segment.y[[0, -1]]
    assert ends == (pytest.approx(x[[0, -1]]), pytest.approx(y[[0, -1]]))
    offset = segment.y * math.cos(heading) - segment.x * math.sin(heading)
    assert np.abs(offset).max() < 0.8 * cell
    assert np.abs(segment.curvature).max() < 0.2 / cell


def test_a_curve_on_a_grid_keeps_its_shape():
    angle = np.linspace(0.0, math.pi, 2001)
    segment = Segment(*on_grid(np.sin(angle), 1.0 - np.cos(angle), 0.05))
    radius = np.hypot(segment.x, segment.y - 1.0)
    assert np.abs(radius - 1.0).max() < 0.05
    assert np.median(segment.curvature) == pytest.approx(1.0, rel=0.1)


def test_points_that_are_on_no_grid_or_on_a_coarse_one_are_not_averaged():
    s = np.linspace(0.0, 3.0, 61)
    for x, y in ((s, 0.1 * np.sin(s)), (np.array([0.0, 1.0, 2.0, 3.0]), np.array(
            [0.0, 0.0, 1.0, 1.0]))):
        assert without_stairs(x, y) == (x, y)
    stairs = np.arange(12.0) * 0.05, np.floor(np.arange(12.0) / 4.0) * 0.05
    assert not np.array_equal(without_stairs(*stairs)[1], stairs[1])
    # the robot and its goal are not on the grid of the others
    off = (stairs[0] + 0.01 * (np.arange(12) == 0) - 0.02 * (np.arange(12) == 11), stairs[1])
    assert not np.array_equal(without_stairs(*off)[1], off[1])
