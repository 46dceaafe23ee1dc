# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The node ``overhead_localizer``: rendered images to topics and diagnostics, in virtual time."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image
from smart_tire.errors import ParameterError
from smart_tire.nodes.overhead_localizer import OverheadLocalizerNode
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.samples import NS_PER_S
from smart_tire.vision.renderer import Renderer
from support.overhead import RADIUS, SMALL, SMALL_PLACE, START_NS, wheel_samples
from support.virtual_node import virtual

pytestmark = pytest.mark.processes

PARAMETERS = {'overhead__camera_position': list(SMALL.position),
              'overhead__camera_rotation': list(SMALL.rotation), 'overhead__time_offset': 0.0}


def motion(times):
    """Return poses of a robot that drives along x."""
    return np.array([-0.3, 0.1, 0.0]) + np.outer(times, [0.3, 0.0, 0.0])


def stamped(msg, time):
    """Return a message with the stamp of ``time`` [s]."""
    stamp_ns = START_NS + round(time * NS_PER_S)
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
    return msg


def image(renderer, time):
    """Return the Image of ``time`` [s]."""
    width, height = SMALL.size
    return stamped(Image(encoding='mono8', width=width, height=height, step=width,
                         data=renderer.image(time, motion).tobytes()), time)


def test_images_become_pose_and_slip_and_refused_ones_are_in_the_diagnostics(isolated_ros):
    renderer = Renderer(SMALL, OverheadParams(**SMALL_PLACE), RADIUS)
    inner = renderer.camera.intrinsics
    with virtual(OverheadLocalizerNode, **PARAMETERS) as node:
        node.publish('overhead_camera/image_raw', image(renderer, 0.4))
        node.publish('overhead_camera/camera_info', CameraInfo(
            width=320, height=240, k=inner.matrix.ravel().tolist(), d=inner.distortion.tolist(),
            distortion_model=inner.model))
        health = node.health()
        assert (health.values['images'], health.values['images_refused']) == ('1', '1')
        assert '1 images without an estimate, mostly: no camera_info' in health.message
        node.publish('wheel_states', *wheel_samples(
            lambda t: np.full(4, 0.3 / 0.9 / RADIUS), 2.5))
        for k in range(18):
            node.publish('overhead_camera/image_raw', image(renderer, 0.5 + k / 15))
        poses, slips = node.samples('overhead/odom'), node.samples('overhead/wheel_slip')
        assert len(poses) >= 8
        assert [one.stamp_ns for one in poses] == [one.stamp_ns for one in slips]
        for pose in poses:
            time = (pose.stamp_ns - START_NS) / NS_PER_S
            assert pose.position[:2] == pytest.approx(motion([time])[0, :2], abs=0.004)
        assert np.mean([one.ratio for one in slips]) == pytest.approx(0.1, abs=0.05)
        message = node.received['overhead/odom'][0]
        assert (message.header.frame_id, message.child_frame_id) == ('map', 'base_link')


def test_a_damaged_image_is_counted_and_the_next_one_is_used(isolated_ros):
    with virtual(OverheadLocalizerNode, **PARAMETERS) as node:
        node.publish('overhead_camera/camera_info', CameraInfo(
            width=320, height=240, k=[300.0, 0.0, 160.0, 0.0, 300.0, 120.0, 0.0, 0.0, 1.0],
            distortion_model='plumb_bob'))
        node.publish('overhead_camera/image_raw', stamped(Image(encoding='mono8', width=320,
                                                                height=240, step=320), 1.0))
        values = node.health().values
        assert (values['images'], values['images_refused']) == ('1', '1')


def test_images_have_short_queues(isolated_ros):
    with virtual(OverheadLocalizerNode, **PARAMETERS) as node:
        for name in ('image_raw', 'image_raw/compressed'):
            assert node.profiles[f'overhead_camera/{name}'].depth == 5


def test_without_the_place_of_the_camera_the_node_refuses_to_start(isolated_ros):
    with pytest.raises(ParameterError, match='overhead.camera_position is not given'), \
            virtual(OverheadLocalizerNode):
        pass
