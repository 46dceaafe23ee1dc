# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pose of the robot from exact, noisy and wrong corners."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest
from smart_tire.vision.localization import (
    MAX_INSET_ERROR, NOT_SQUARE, PoseFit, TILTED, WRONG_SIZE)
from support.overhead import ANGLES, camera, corners, PARAMS, PLACE, RADIUS

TWO = replace(PARAMS, tag_ids=(0, 7), tag_position=(0.1, 0.02, 0.15, -0.1, -0.03, 0.25),
              tag_yaw=(0.3, -2.0))
POSES = [(0.1, -0.2, 0.0), (0.7, 0.3, 2.5), (-0.5, 0.1, -3.1)]
WIDE = camera((-0.25, 0.08, 0.001, -0.002, 0.01))


@pytest.mark.parametrize('pose', POSES)
@pytest.mark.parametrize('params', [PARAMS, TWO])
def test_the_pose_of_exact_corners_is_exact(pose, params):
    fix = PoseFit(WIDE, params, RADIUS).fix(5, corners(WIDE, params, pose))
    assert fix.stamp_ns == 5
    assert fix.pose[:2] == pytest.approx(pose[:2], abs=1e-4)
    assert math.remainder(fix.pose[2] - pose[2], math.tau) == pytest.approx(0.0, abs=1e-4)
    assert fix.inset == pytest.approx(0.0, abs=0.02)
    assert fix.freedom == 8 * len(params.tag_ids) - 4
    assert fix.squares < 5e-3


def test_one_of_two_tags_is_enough():
    found = corners(WIDE, TWO, POSES[0])
    for tag in TWO.tag_ids:
        fix = PoseFit(WIDE, TWO, RADIUS).fix(1, {tag: found[tag]})
        assert fix.pose == pytest.approx(POSES[0], abs=1e-4)


def test_errors_are_those_of_the_covariance_and_of_the_residuals():
    rng, fit, exact = np.random.default_rng(1), PoseFit(WIDE, TWO, RADIUS), corners(
        WIDE, TWO, POSES[1])
    normalized, variances = [], []
    for _ in range(300):
        fix = fit.fix(1, {tag: one + 0.2 * rng.standard_normal((4, 2))
                          for tag, one in exact.items()})
        error = fix.pose - POSES[1]
        normalized.append(error @ np.linalg.solve(0.2 ** 2 * fix.shape, error) / 3.0)
        variances.append(fix.squares / fix.freedom)
    assert np.mean(normalized) == pytest.approx(1.0, abs=0.15)
    assert math.sqrt(np.mean(variances)) == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize(('size', 'used'), [(0.15, False), (0.158, True), (0.17, False)])
def test_a_wrong_size_is_refused(size, used):
    found = corners(WIDE, PARAMS, POSES[0])
    fix = PoseFit(WIDE, replace(PARAMS, tag_size=size), RADIUS).fix(1, found)
    assert (fix != WRONG_SIZE) == used
    if used:
        assert fix.pose == pytest.approx(POSES[0], abs=1e-3)
        assert 0.05 < abs(fix.inset) < MAX_INSET_ERROR


def test_residuals_of_a_tilted_tag_are_explained_by_its_tilt():
    fit, half = PoseFit(WIDE, PARAMS, RADIUS), 0.08
    flat = np.array([[-half, half], [half, half], [half, -half], [-half, -half]])
    tilted = np.column_stack([0.8 + flat[:, 0] * math.cos(0.4), 0.3 + flat[:, 1],
                              0.3 + flat[:, 0] * math.sin(0.4)])
    fix = fit.fix(1, {0: WIDE.pixels(tilted)})
    assert fix == TILTED


def test_a_corner_that_is_hidden_is_no_square():
    found = corners(WIDE, PARAMS, POSES[0])
    found[0][2] += (4.0, -5.0)
    fix = PoseFit(WIDE, PARAMS, RADIUS).fix(1, found)
    assert fix.reason == NOT_SQUARE and not fix.fits(0.1)
    assert fix.variance(0.1) > 1.0  # pixels^2: its residuals count


def test_the_calibration_is_a_covariance_of_its_own():
    sure = PoseFit(WIDE, TWO, RADIUS).fix(1, corners(WIDE, TWO, POSES[0]))
    assert not sure.calibration.any()
    moved = replace(PARAMS, camera_position_sigma=(0.01, 0.0, 0.0),
                    camera_rotation_sigma=(0.0, 0.0, 0.02))
    fix = PoseFit(WIDE, moved, RADIUS).fix(1, corners(WIDE, PARAMS, POSES[0]))
    # a camera that stands wrong by dx moves all poses by dx; turned, it turns them about itself
    x, y = POSES[0][0] - PLACE[0], POSES[0][1] - PLACE[1]
    assert fix.calibration[0, 0] == pytest.approx(0.01 ** 2 + (0.02 * y) ** 2, rel=0.05)
    assert fix.calibration[1, 1] == pytest.approx((0.02 * x) ** 2, rel=0.05)
    assert fix.calibration[2, 2] == pytest.approx(0.02 ** 2, rel=0.05)
    assert fix.shape == pytest.approx(
        PoseFit(WIDE, PARAMS, RADIUS).fix(1, corners(WIDE, PARAMS, POSES[0])).shape)


def test_the_errors_of_the_tag_turn_with_the_robot():
    params = replace(PARAMS, tag_position=(0.2, 0.0, 0.15), tag_yaw_sigma=0.01)
    pose = (0.1, 0.1, 0.5 * math.pi)
    fix = PoseFit(WIDE, params, RADIUS).fix(1, corners(WIDE, params, pose))
    # the tag is 0.2 m in front, along y of map: an error of its yaw moves the robot along x
    assert np.sqrt(np.diag(fix.calibration)) == pytest.approx([0.002, 0.0, 0.01], abs=1e-4)


def test_a_camera_that_looks_up_sees_no_floor():
    up = camera(angles=(ANGLES[0] - math.pi, *ANGLES[1:]))
    fix = PoseFit(up, PARAMS, RADIUS).fix(1, corners(WIDE, PARAMS, POSES[0]))
    assert fix == 'tag outside of the floor that the camera sees'
