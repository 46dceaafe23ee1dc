# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""``smart_tire calibrate camera``: a rendered recording to a parameter file, and refusals."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from smart_tire.cli.main import main
from smart_tire.parameters import load_node
from smart_tire.parameters.overhead import ImageParams, OverheadParams
from smart_tire.vision.renderer import Renderer
from support.overhead import imu_samples, RADIUS, wheel_samples, write_bag

IMAGE = ImageParams(size=(640, 480), focal_length=500.0, position=(0.1, 0.0, 2.2),
                    rotation=(math.pi - 0.1, 0.05, 0.3), noise=1.0, shadow=0.0)
TRUE = OverheadParams(
    tag_position=(0.05, -0.03, 0.15), tag_yaw=(0.5,), floor_ids=(10, 11, 12),
    floor_position=(0.9, 0.55, -0.8, 0.5, 0.2, -0.75))
PARAMS = """/**:
  ros__parameters:
    overhead:
      floor_ids: [10, 11, 12]
      floor_position: [0.9, 0.55, -0.8, 0.5, 0.2, -0.75]
      floor_position_sigma: 0.0005
"""


def pose(times):
    """Return x, y, yaw: forward and back, then a turn to each side."""
    way, left, right = (np.clip(times, *span) - span[0] for span in ((1, 3), (4, 6), (6, 8)))
    back = np.clip(times, 3, 4) - 3
    return np.column_stack([0.2 * way - 0.2 * back, 0.0 * way, 0.8 * left - 0.8 * right])


def speeds(time):
    """Return the wheel speeds [rad/s], without slip."""
    x, _, yaw = (pose(np.array([time + 1e-4])) - pose(np.array([time - 1e-4])))[0] / 2e-4
    return (x + 0.19 * yaw * np.array([-1.0, 1.0, -1.0, 1.0])) / RADIUS


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    """Return a bag with images, wheels and gyroscope, and a file with the markers."""
    folder = tmp_path_factory.mktemp('calibration')
    samples = [('wheel_states', one) for one in wheel_samples(speeds, 9.0)]
    samples += [('imu/data', one) for one in imu_samples(
        lambda time: 0.8 * ((4 < time < 6) - (6 < time < 8.0)), 9.0)]
    file = folder / 'markers.yaml'
    file.write_text(PARAMS, encoding='utf-8')
    return write_bag(folder / 'bag', Renderer(IMAGE, TRUE, RADIUS), pose,
                     np.arange(0.5, 8.5, 0.1), samples), file


def test_a_recording_gives_the_places_and_a_file_that_overhead_reads(
        recording, tmp_path, capsys):
    bag, file = recording
    words = ['calibrate', 'camera', str(bag), '--params', str(file), '--out', str(tmp_path)]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert [line.split('  ')[0] for line in printed.splitlines()[:9]] == [
        'camera x', 'camera y', 'camera z', 'camera roll', 'camera pitch', 'camera yaw',
        'tag 0 x', 'tag 0 y', 'tag 0 yaw']
    written = tmp_path / 'overhead.yaml'
    found = load_node([file, written], 'overhead_localizer').overhead
    for name in ('position', 'rotation'):
        error = np.subtract(getattr(found, f'camera_{name}'), getattr(IMAGE, name))
        assert (np.abs(error) < 4.0 * np.array(getattr(found, f'camera_{name}_sigma'))).all()
        assert np.abs(error).max() < 0.02
    assert found.tag_yaw[0] == pytest.approx(0.5, abs=4.0 * found.tag_yaw_sigma)
    assert found.tag_position == pytest.approx((0.05, -0.03, 0.15), abs=0.004)
    assert found.tag_position_sigma == pytest.approx(0.2 * 0.26, rel=0.01)  # of icr_x
    assert main(words) == 2
    assert 'overhead.yaml exists' in capsys.readouterr().err
    assert main(['overhead', str(bag), '--params', str(file), '--params', str(written), '--out',
                 str(tmp_path / 'out')]) == 0
    used = re.search(r'(\d+) of 80 images used', capsys.readouterr().out)
    assert int(used[1]) > 75


def test_without_markers_or_a_recording_the_reason_is_said(recording, tmp_path, capsys):
    bag, _ = recording
    assert main(['calibrate', 'camera', str(bag), '--out', str(tmp_path)]) == 1
    assert 'the place of the camera is not known' in capsys.readouterr().out
    assert main(['calibrate', 'camera', '--out', str(tmp_path)]) == 2
    assert 'a recording is needed' in capsys.readouterr().err
    file = tmp_path / 'one.yaml'
    file.write_text(PARAMS.replace('10, 11, 12', '10, 1, 2'), encoding='utf-8')
    assert main(['calibrate', 'camera', str(bag), '--params', str(file), '--out',
                 str(tmp_path)]) == 1
    assert '1 of the markers [10, 1, 2] are in the images' in capsys.readouterr().out
    assert not (tmp_path / 'overhead.yaml').exists()
