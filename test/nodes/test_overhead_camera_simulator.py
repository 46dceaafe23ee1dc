# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The node ``overhead_camera_simulator``: true poses to images, in virtual time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from smart_tire.nodes.overhead_camera_simulator import OverheadCameraSimulator
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.rotation import quaternion
from smart_tire.samples import NS_PER_S, Odometry
from smart_tire.vision.camera import Camera, Intrinsics
from smart_tire.vision.detection import gray_image, TagDetector
from smart_tire.vision.localization import PoseFit
from support.overhead import RADIUS, SMALL, SMALL_PLACE
from support.virtual_node import EPOCH_NS, virtual

pytestmark = pytest.mark.processes

PARAMETERS = {
    'image__size': list(SMALL.size), 'image__focal_length': SMALL.focal_length,
    'image__position': list(SMALL.position), 'image__rate': 10.0, 'image__exposure': 0.01,
    'overhead__tag_yaw': [0.4], 'overhead__tag_position': [0.03, -0.02, 0.15]}
SPEED, YAW = 0.4, 2.99  # m/s along x; rad, which wraps around in the exposure at 0.3 s
IMAGES = 'overhead_camera/image_raw'
INFO = 'overhead_camera/camera_info'


def pose(time):
    """Return x, y, yaw at a time [s] after the start."""
    return np.array([-0.2 + SPEED * time, 0.1, YAW + 0.5 * time])


def drive(node, begin, end, *, age=0.0):
    """Publish the true poses of 100 Hz between two times [s], ``age`` [s] late."""
    for k in range(round(100 * begin), round(100 * end)):
        x, y, yaw = pose(0.01 * k)
        node.elapsed_ns = k * 10_000_000 + round(age * NS_PER_S)
        node.publish('ground_truth/odom', Odometry(
            EPOCH_NS + k * 10_000_000, (x, y, RADIUS), quaternion(0.0, 0.0, yaw),
            (SPEED, 0.0, 0.0), (0.0, 0.0, 0.5), (0.0,) * 36, (0.0,) * 36))


def stamp(msg):
    """Return the stamp [s] after the start."""
    return (msg.header.stamp.sec * NS_PER_S + msg.header.stamp.nanosec - EPOCH_NS) / NS_PER_S


@pytest.mark.parametrize('quality', [0, 95])
def test_images_show_the_robot_at_their_stamps(quality, isolated_ros):
    with virtual(OverheadCameraSimulator, image__jpeg_quality=quality, **PARAMETERS) as node:
        drive(node, 0.0, 1.0)
        images = node.received[IMAGES + '/compressed' * (quality > 0)]
        assert [stamp(one) for one in images] == pytest.approx([0.1 * k for k in range(1, 10)])
        assert [stamp(one) for one in node.received[INFO]] == [stamp(one) for one in images]
        assert {one.header.frame_id for one in images} == {'overhead_camera_optical_frame'}
        # an image is published with the first pose behind its exposure
        assert node.times[INFO] == pytest.approx([0.1 * k + 0.01 for k in range(1, 10)])
        camera = Camera(Intrinsics.from_msg(node.received[INFO][-1]), *SMALL_PLACE.values())
        fit = PoseFit(camera, OverheadParams(
            **SMALL_PLACE, tag_yaw=(0.4,), tag_position=(0.03, -0.02, 0.15)), RADIUS)
        for one in images:
            tags, _ = TagDetector('36h11').tags(gray_image(one))
            error = fit.fix(1, tags).pose - pose(stamp(one))
            assert np.abs(error[:2]).max() < 0.003  # in 10 ms the robot drives 4 mm
            assert abs(math.remainder(error[2], math.tau)) < 0.03
        assert node.health().values['images'] == '9'


@pytest.mark.parametrize('parameters, known', [
    ({'image__readout': 0.03}, 0.14), ({'image__exposure': 0.03}, 0.12)])
def test_the_end_of_the_exposure_of_the_last_row_is_awaited(parameters, known, isolated_ros):
    with virtual(OverheadCameraSimulator, **{**PARAMETERS, **parameters}) as node:
        drive(node, 0.0, known)
        assert not node.received[IMAGES]
        drive(node, known, known + 0.01)
        assert [stamp(one) for one in node.received[IMAGES]] == pytest.approx([0.1])


def test_images_of_old_poses_are_skipped_and_counted(isolated_ros):
    with virtual(OverheadCameraSimulator, **PARAMETERS) as node:
        drive(node, 0.0, 0.5)
        drive(node, 0.5, 0.8, age=0.3)
        health = node.health()
        assert 'images skipped' in health.message and health.values['images_skipped'] == '3'
        drive(node, 0.8, 0.92, age=0.2)
        drive(node, 1.2, 1.4)  # there are no poses for images at 1.0, 1.1 and 1.2 s
        assert [stamp(one) for one in node.received[IMAGES]] == pytest.approx(
            [0.1, 0.2, 0.3, 0.4, 0.8, 0.9, 1.3])
        values = node.health().values
        assert (values['images'], values['images_skipped']) == ('7', '6')


def test_images_continue_after_the_clock_was_set_back(isolated_ros):
    with virtual(OverheadCameraSimulator, **PARAMETERS) as node:
        drive(node, 5.0, 5.25)
        drive(node, 0.0, 0.25)
        assert [stamp(one) for one in node.received[IMAGES]] == pytest.approx([5.1, 5.2, 0.1, 0.2])


@pytest.mark.parametrize('exposure', [0.0, 0.01])
def test_the_first_pose_gives_no_image_of_a_time_before_it(exposure, isolated_ros):
    parameters = {**PARAMETERS, 'image__exposure': exposure}
    with virtual(OverheadCameraSimulator, **parameters) as node:
        drive(node, 0.0, 0.05)
        assert len(node.received[IMAGES]) == (exposure == 0.0)
