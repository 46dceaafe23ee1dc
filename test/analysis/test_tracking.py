# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tracking errors: sign, crossing paths, corners, standstill, incomplete tracks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.analysis import driven_paths
from smart_tire.analysis.driven_paths import path_length, resampled, track, tracking_score

STRAIGHT = np.array([[0.0, 0.0], [2.0, 0.0]])


def eight(count=400):
    """Return a figure-eight that starts at its crossing."""
    angle = np.linspace(0.0, math.tau, count)
    return np.column_stack([2.0 * np.sin(angle), 1.0 * np.sin(2.0 * angle)])


def offset_to_the_left(path, distance):
    step = np.gradient(path, axis=0)
    normal = np.column_stack([-step[:, 1], step[:, 0]])
    return path + distance * normal / np.linalg.norm(normal, axis=1)[:, None]


@pytest.mark.parametrize('side', [0.07, -0.07])
def test_the_error_is_positive_to_the_left(side):
    result = track(STRAIGHT, np.column_stack([np.linspace(0.0, 2.0, 50), np.full(50, side)]))
    assert result.error == pytest.approx(side)
    score = tracking_score(STRAIGHT, np.column_stack([np.linspace(0, 2, 50), np.full(50, side)]))
    assert (score.rms_m, score.max_m, score.end_m) == pytest.approx((0.07,) * 3)
    assert score.completed == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize('side', [0.15, -0.15])
def test_the_crossing_of_a_figure_eight_is_no_shortcut(side):
    path = eight()
    result = track(path, offset_to_the_left(path, side))
    assert result.error == pytest.approx(side, abs=0.01)
    assert np.all(np.diff(result.progress) >= 0.0)
    # progress grows as the driven distance does, also at the crossing
    assert result.progress / result.progress[-1] == pytest.approx(
        result.driven / result.driven[-1], abs=0.08)


def test_progress_of_half_a_track_is_half_and_the_second_lobe_driven_first_is_an_error():
    path = eight()
    assert tracking_score(path, (path * [-1.0, 1.0])[::-1]).max_m > 1.0
    score = tracking_score(path, path[:200])
    assert score.completed == pytest.approx(0.5, abs=0.01)
    assert score.rms_m < 1e-3
    assert score.path_length_m == pytest.approx(path_length(path))
    assert score.driven_m == pytest.approx(0.5 * score.path_length_m, rel=0.02)


def test_standstill_has_no_weight():
    moving = np.column_stack([np.linspace(0.0, 2.0, 201), np.linspace(0.0, 0.1, 201)])
    waiting = np.vstack([moving, np.repeat(moving[-1:], 1000, axis=0)])
    assert tracking_score(STRAIGHT, waiting).rms_m == pytest.approx(
        tracking_score(STRAIGHT, moving).rms_m)
    assert tracking_score(STRAIGHT, moving).rms_m == pytest.approx(0.1 / math.sqrt(3.0), rel=0.02)


def test_a_path_driven_back_and_forth_is_followed_in_order():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    there = np.linspace(0.0, 1.0, 101)
    driven = np.column_stack([np.append(there, there[::-1]), np.full(202, 0.05)])
    result = track(path, driven)
    assert result.error[20] == pytest.approx(0.05) and result.error[-20] == pytest.approx(-0.05)
    assert result.progress[-1] == pytest.approx(2.0, abs=0.02)


def test_the_error_beyond_the_end_is_the_distance_from_the_end():
    driven = np.column_stack([np.linspace(0.0, 2.3, 231), np.zeros(231)])
    score = tracking_score(STRAIGHT, driven)
    assert score.max_m == pytest.approx(0.3, abs=0.011) and score.completed == 1.0
    assert score.end_m == pytest.approx(0.3)


def test_resampling_keeps_corners_and_ignores_repeated_points():
    corner = np.array([[0.0, 0.0], [0.995, 0.0], [0.995, 0.0], [0.995, 1.0]])
    points, along = resampled(corner, 0.01)
    assert [0.995, 0.0] in points.tolist()
    assert np.max(np.diff(along)) <= 0.01 + 1e-12 and np.all(np.diff(along) > 0.0)
    assert along[-1] == pytest.approx(1.995)


def test_a_long_track_is_compared_at_a_larger_spacing():
    path = np.array([[0.0, 0.0], [300.0, 0.0]])
    driven = np.column_stack([np.linspace(0.0, 300.0, 20_000), np.full(20_000, 0.2)])
    result = track(path, driven)
    assert len(result.error) <= driven_paths.MAX_POINTS + 1
    assert result.error == pytest.approx(0.2)


def test_nothing_is_compared_without_a_track_or_a_length():
    assert track(STRAIGHT, np.empty((0, 2))) is None
    assert tracking_score(np.array([[1.0, 2.0]]), STRAIGHT) is None
    assert tracking_score(np.array([[1.0, 2.0]] * 2), STRAIGHT) is None
