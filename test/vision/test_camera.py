# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Points of the floor to pixels and back, and the CameraInfo that they come from."""

from __future__ import annotations

import math

import numpy as np
import pytest
from smart_tire.errors import MessageError
from smart_tire.vision.camera import Intrinsics
from support.overhead import camera, info_msg, PLACE

MODELS = [((), 'plumb_bob'), ((-0.25, 0.08, 0.001, -0.002, 0.01), 'plumb_bob'),
          ((0.3, -0.1, 0.001, 0.0, 0.05, 0.6, -0.2, 0.02), 'rational_polynomial'),
          ((-0.01, 0.02, -0.01, 0.002), 'equidistant'), ((), 'equidistant')]


@pytest.mark.parametrize(('distortion', 'model'), MODELS)
def test_pixels_of_points_on_a_plane_lead_back_to_them(distortion, model):
    one = camera(distortion, model)
    x, y = np.meshgrid(np.linspace(-0.9, 1.2, 5), np.linspace(-0.7, 0.6, 4))
    points = np.stack([x, y, np.full_like(x, 0.24)], -1)
    pixels = one.pixels(points)
    assert pixels.shape == (4, 5, 2)
    assert np.abs(one.floor(pixels, 0.24) - points[..., :2]).max() < 1e-6


def test_a_point_below_the_camera_is_at_its_principal_point():
    one = camera(place=(0.5, 0.3, 2.0), angles=(math.pi, 0.0, 0.0))
    assert one.pixels(np.array([0.5, 0.3, 0.0])) == pytest.approx([640.0, 360.0])
    # looks down: x of the image is x of map, y of the image is -y of map
    assert one.pixels(np.array([0.7, 0.4, 0.0])) == pytest.approx(
        [640.0 + 0.2 / 2.0 * 900.0, 360.0 - 0.1 / 2.0 * 905.0])


def test_the_rotation_is_roll_then_pitch_then_yaw():
    one = camera(place=(0.0, 0.0, 2.0), angles=(math.pi, 0.0, 0.5 * math.pi))
    assert one.pixels(np.array([0.0, 0.2, 0.0]))[0] == pytest.approx(640.0 + 90.0)


def test_a_ray_above_the_horizon_meets_no_floor():
    one = camera(angles=(0.0, 0.0, 0.0))  # looks up
    assert np.isnan(one.floor(np.array([[640.0, 360.0]]), 0.0)).all()
    assert np.isfinite(one.floor(np.array([[640.0, 360.0]]), PLACE[2] + 1.0)).all()


def test_a_window_and_binning_move_the_principal_point():
    given = camera((0.1, 0.0, 0.0, 0.0, 0.0)).intrinsics
    msg = info_msg(given)
    same = Intrinsics.from_msg(msg)
    assert same.size == (1280, 720) and not same.differs(given)
    msg.roi.x_offset, msg.roi.y_offset, msg.roi.width, msg.roi.height = 100, 40, 640, 480
    window = Intrinsics.from_msg(msg)
    assert window.size == (640, 480) and window.differs(given)
    assert window.matrix[:2, 2] == pytest.approx([540.0, 320.0])
    msg.binning_x = msg.binning_y = 2
    binned = Intrinsics.from_msg(msg)
    assert binned.size == (320, 240)
    assert binned.matrix[0] == pytest.approx([450.0, 0.0, 0.5 * 540.5 - 0.5])


@pytest.mark.parametrize(('changes', 'said'), [
    ({'k': np.zeros(9)}, 'not calibrated'), ({'k': np.full(9, np.nan)}, 'not calibrated'),
    ({'distortion_model': 'fisheye42'}, 'fisheye42'), ({'d': np.zeros(3)}, '3 coefficients'),
    ({'d': np.full(5, np.inf)}, 'coefficients'), ({'width': 0}, '0 x 720')])
def test_an_invalid_camera_info_is_refused_with_the_reason(changes, said):
    with pytest.raises(MessageError, match=said):
        Intrinsics.from_msg(info_msg(camera().intrinsics, **changes))
