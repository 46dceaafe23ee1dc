# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What rendered images show."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.vision.detection import TagDetector
from smart_tire.vision.localization import PoseFit
from smart_tire.vision.renderer import Renderer
from support.overhead import RADIUS, SMALL, SMALL_PLACE

PARAMS = OverheadParams(**SMALL_PLACE, tag_position=(0.03, -0.02, 0.15), tag_yaw=(0.4,))
POSE = np.array([0.15, 0.1, -2.0])
FINE = replace(SMALL, noise=0.0, lens_blur=0.0, exposure=0.0, shadow=0.0)


def at(pose, velocity=(0.0, 0.0, 0.0)):
    """Return the motion through ``pose`` at time 0."""
    return lambda times: np.asarray(pose) + np.outer(times, velocity)


def seen(image_params, motion, params=PARAMS, time=0.0):
    """Return the pose in a rendered image, and the image."""
    renderer = Renderer(image_params, params, RADIUS)
    image = renderer.image(time, motion)
    tags, _ = TagDetector(params.tag_family).tags(image)
    if not tags:
        return None, image
    return PoseFit(renderer.camera, params, RADIUS).fix(1, tags), image


@pytest.mark.parametrize('changes', [
    {}, {'rotation': (math.pi - 0.2, 0.15, 1.0)},
    {'distortion': (-0.2, 0.05, 0.001, -0.001, 0.0)}])
def test_the_pose_in_an_image_is_that_of_the_robot(changes):
    one = replace(SMALL, **changes)
    params = replace(PARAMS, camera_rotation=one.rotation)
    fix, image = seen(one, at(POSE), params)
    assert image.shape == (240, 320) and image.dtype == np.uint8
    assert fix.pose == pytest.approx(POSE, abs=0.006)
    assert fix.pose[:2] == pytest.approx(POSE[:2], abs=0.002)  # a pixel is 6 mm
    assert fix.fits(0.15)


def test_two_tags_are_where_the_parameters_place_them():
    params = replace(PARAMS, tag_ids=(4, 11), tag_size=0.12, tag_yaw=(0.0, 0.5 * math.pi),
                     tag_position=(0.09, 0.0, 0.15, -0.08, 0.0, 0.15))
    fix, _ = seen(FINE, at(POSE), params)
    assert fix.freedom == 12
    assert fix.pose == pytest.approx(POSE, abs=0.005)


def test_the_exposure_is_centered_and_blurs_along_the_motion():
    moving = at(POSE, (1.0, 0.0, 0.0))
    sharp, clear = seen(FINE, moving)
    fix, image = seen(replace(FINE, exposure=0.012), moving)
    assert fix.pose[:2] == pytest.approx(sharp.pose[:2], abs=0.002)
    changes = [np.abs(np.diff(one.astype(float), axis=axis)).max()
               for one in (clear, image) for axis in (0, 1)]
    assert changes[3] < 0.8 * changes[1]  # along x of map, which is that of the image
    assert changes[2] > 0.9 * changes[0]


def test_the_rows_of_a_rolling_shutter_are_later_downward():
    moving = at(POSE, (1.0, 0.0, 0.0))
    sharp, _ = seen(FINE, moving)
    rolling, _ = seen(replace(FINE, readout=0.03), moving)
    row = 119.5 - (POSE[1] - 0.03) * 300.0 / (2.0 - 0.237)
    assert rolling.pose[0] - sharp.pose[0] == pytest.approx(0.03 * row / 240, abs=0.004)


def test_light_noise_and_shadow_are_those_of_the_parameters():
    _, dark = seen(replace(FINE, brightness=0.3), at(POSE))
    _, bright = seen(replace(FINE, brightness=3.0), at(POSE))
    _, shaded = seen(replace(FINE, shadow=0.8), at(POSE))
    _, plain = seen(FINE, at(POSE))
    _, noisy = seen(replace(FINE, noise=5.0), at(POSE))
    assert dark.max() < 90 and np.mean(bright == 255) > 0.3
    assert shaded[:60].mean() < 0.8 * plain[:60].mean()
    assert np.std(noisy.astype(float) - plain) == pytest.approx(5.0, rel=0.2)


@pytest.mark.parametrize('share', [0.4, 0.7])
def test_a_tag_that_is_partly_hidden_gives_no_wrong_pose(share):
    fix, _ = seen(replace(SMALL, occlusion=share), at(POSE))
    assert fix is None or isinstance(fix, str) or not fix.fits(0.15) or (
        np.abs(fix.pose - POSE).max() < 0.01)


def test_the_same_seed_gives_the_same_image():
    images = [Renderer(SMALL, PARAMS, RADIUS, seed).image(0.0, at(POSE)) for seed in (3, 3, 4)]
    assert np.array_equal(images[0], images[1])
    assert not np.array_equal(images[0], images[2])
