# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire overhead``: bags with rendered images to estimates and a summary."""

from __future__ import annotations

import json
from pathlib import Path

from matplotlib.image import imread as plt_image
import numpy as np
import pytest
from smart_tire.analysis.drawing import save
from smart_tire.analysis.overhead import frame_figure, frame_panel, locate, overhead_params
from smart_tire.bags import Bag
from smart_tire.cli.main import main
from smart_tire.errors import EstimatorError
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.samples import NS_PER_S
from smart_tire.vision.detection import TagDetector
from smart_tire.vision.overhead import OverheadLocalizer
from smart_tire.vision.renderer import Renderer
from support.overhead import (
    imu_samples, RADIUS, SMALL, SMALL_PLACE, START_NS, wheel_samples, write_bag)

SPEED = 0.3  # m/s
TIMES = 0.5 + np.arange(24) / 15
PARAMETERS = f"""/**:
  ros__parameters:
    overhead:
      camera_position: {list(SMALL.position)}
      camera_rotation: {list(SMALL.rotation)}
      tag_yaw: 0
"""


def motion(times):
    """Return poses of a robot that drives along x, and not through the edge of the shadow."""
    return np.array([-0.45, 0.1, 0.0]) + np.outer(times, [SPEED, 0.0, 0.0])


@pytest.fixture(scope='module')
def recorded(tmp_path_factory) -> tuple[Path, Path]:
    """Return a bag with images, IMU and wheels, and a parameter file."""
    folder = tmp_path_factory.mktemp('overhead')
    rolling = np.full(4, SPEED / 0.9 / RADIUS)
    samples = [*(('imu/data', one) for one in imu_samples(lambda t: 0.0, 3.0)),
               *(('wheel_states', one) for one in wheel_samples(lambda t: rolling, 3.0))]
    renderer = Renderer(SMALL, OverheadParams(**SMALL_PLACE), RADIUS)
    bag = write_bag(folder / 'bag', renderer, motion, TIMES, samples)
    params = folder / 'overhead.yaml'
    params.write_text(PARAMETERS, encoding='utf-8')
    return bag, params


def test_pose_and_slip_are_written_with_a_summary(recorded, tmp_path, capsys):
    bag, params = recorded
    out = tmp_path / 'out'
    assert main(['overhead', str(bag), '--params', str(params), '--out', str(out)]) == 0
    said = capsys.readouterr().out
    assert '24 of 24 images used' in said and 'time offset 0.0000 +- 0.0500 s' in said
    with Bag(out / 'estimates') as found:
        assert found.types == {'/overhead/odom': 'nav_msgs/msg/Odometry',
                               '/overhead/wheel_slip': 'sensor_msgs/msg/JointState'}
        recording = found.recording(['overhead/odom', 'overhead/wheel_slip'])
        (_, _, data), *_ = found.raw({'/overhead/odom'})
    assert b'map\0' in data and b'base_link\0' in data
    poses, slips = recording.poses(), recording.slips()
    times = (poses.stamp_ns - START_NS) / NS_PER_S
    assert times == pytest.approx(TIMES, abs=1e-6)
    assert np.abs(poses.pose[:, :2] - motion(times)[:, :2]).max() < 0.004
    assert np.abs(poses.twist[4:-4, 0] - SPEED).max() < 0.02
    assert len(slips.ratio) == 24 and np.abs(slips.ratio[4:-4] - 0.1).max() < 0.06
    assert np.abs((slips.ratio - 0.1) / slips.sigma).max() < 5.0
    summary = json.loads((out / 'summary.json').read_text(encoding='utf-8'))
    assert (summary['frames'], summary['detections'], summary['used']) == (24, 24, 24)
    assert summary['gaps'] == [] and summary['refused'] == {}
    assert summary['time_offset']['value_s'] == 0.0
    assert 0.01 < summary['pixel_noise'] < 0.3
    assert summary['estimates'] == {'overhead/odom': 24, 'overhead/wheel_slip': 24}


def test_the_path_is_drawn_into_the_first_image_with_the_robot(recorded, tmp_path):
    bag, files = recorded
    with Bag(bag) as opened:
        params = overhead_params(opened, [files])
        result = locate(opened, params)
    panel = frame_panel(result, params)
    path, start = panel.marks
    assert panel.image.shape == SMALL.size[::-1]
    middle = np.mean(TagDetector('36h11').tags(panel.image)[0][0], axis=0)
    assert [start.curve.x[0], start.curve.y[0]] == pytest.approx(middle, abs=0.5)
    assert len(path.curve.x) == 25 and np.isnan(path.curve.x[-1])  # 24 images, then a gap
    height = SMALL.position[2] - RADIUS - 0.15
    assert np.ptp(path.curve.x[:-1]) == pytest.approx(
        SMALL.focal_length * SPEED * np.ptp(TIMES) / height, abs=1.0)
    assert np.ptp(path.curve.y[:-1]) < 1.0
    picture = tmp_path / 'camera.png'
    save(frame_figure(result, params), picture)
    drawn = plt_image(picture)
    orange = (drawn[..., 0] > 0.8) & (drawn[..., 2] < 0.3)
    assert orange.sum() > 500


def test_without_any_pose_there_is_no_picture(recorded):
    bag, files = recorded
    with Bag(bag) as opened:
        params = overhead_params(opened, [files])
        result = OverheadLocalizer(params).result(opened.recording(()))
    with pytest.raises(EstimatorError, match='in no image'):
        frame_panel(result, params)


def test_a_given_time_offset_is_removed_from_the_stamps(recorded, tmp_path):
    bag, params = recorded
    out = tmp_path / 'out'
    assert main(['overhead', str(bag), '--params', str(params), '--out', str(out),
                 '--time-offset', '0.02']) == 0
    with Bag(out / 'estimates') as found:
        stamps = found.recording(['overhead/odom']).poses().stamp_ns
    assert (stamps[0] - START_NS) / NS_PER_S == pytest.approx(TIMES[0] - 0.02, abs=1e-6)
    summary = json.loads((out / 'summary.json').read_text(encoding='utf-8'))
    assert summary['time_offset'] == {'value_s': 0.02, 'sigma_s': 0.0, 'source': 'given'}


def test_results_are_replaced_with_force_only(recorded, tmp_path, capsys):
    bag, params = recorded
    arguments = ['overhead', str(bag), '--params', str(params), '--out', str(tmp_path)]
    (tmp_path / 'summary.json').write_text('{}', encoding='utf-8')
    assert main(arguments) == 2
    assert 'summary.json exists' in capsys.readouterr().err
    (tmp_path / 'camera.png').write_bytes(b'old')
    assert main([*arguments, '--force']) == 0
    assert (tmp_path / 'camera.png').read_bytes().startswith(b'\x89PNG')
    assert json.loads((tmp_path / 'summary.json').read_text(encoding='utf-8'))['frames'] == 24


def test_without_the_place_of_the_camera_it_is_an_error_of_use(recorded, tmp_path, capsys):
    bag, _ = recorded
    assert main(['overhead', str(bag), '--out', str(tmp_path / 'out')]) == 2
    assert 'overhead.camera_position is not given' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


def test_a_bag_without_camera_info_gives_one_line_and_exit_status_1(recorded, tmp_path, capsys):
    _, params = recorded
    renderer = Renderer(SMALL, OverheadParams(**SMALL_PLACE), RADIUS)
    bag = write_bag(tmp_path / 'bag', renderer, motion, TIMES[:3], compressed=False, info=False)
    out = tmp_path / 'out'
    assert main(['overhead', str(bag), '--params', str(params), '--out', str(out)]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == (
        f'{bag}: nothing can be estimated: 0 of 3 images used: 3 no camera_info')
    summary = json.loads((out / 'summary.json').read_text(encoding='utf-8'))
    assert summary['refused'] == {'no camera_info': 3} and summary['time_offset'] is None
    assert not (out / 'estimates').exists() and not (out / 'camera.png').exists()
