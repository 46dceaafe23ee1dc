# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Paths of the library: shape, curvature, begin at the origin along +x."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.control.path_geometry import Segment
from smart_tire.control.path_library import figure_eight, lane_change, line, square
from smart_tire.control.path_plan import plan_path


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
