# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Node ``overhead_camera_simulator``: images of the simulated robot as a camera above sees it."""

from __future__ import annotations

from array import array
from collections import deque
from itertools import pairwise
import sys
from typing import Any

import numpy as np

from smart_tire.messages.header import set_header
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.qos import publisher_qos
from smart_tire.nodes.runner import run
from smart_tire.parameters.overhead import OverheadCameraSimulatorParams
from smart_tire.rotation import yaw_of
from smart_tire.samples import NS_PER_S, Odometry
from smart_tire.vision.detection import fill_image, jpeg
from smart_tire.vision.renderer import between, Renderer

FRAME = 'overhead_camera_optical_frame'
MAX_GAP_NS = NS_PER_S // 20  # between poses; a longer path is not known well enough
MAX_AGE_NS = NS_PER_S // 4  # of the robot's pose; images of older ones are skipped, to catch up


class OverheadCameraSimulator(SmartTireNode[OverheadCameraSimulatorParams]):
    """
    Renders an image at each multiple of the period, once the pose is known until its last row.

    Subscribes to ``ground_truth/odom``; publishes ``overhead_camera/camera_info``,
    ``overhead_camera/image_raw``, or with ``image.jpeg_quality``
    ``overhead_camera/image_raw/compressed`` instead, and ``/diagnostics``.

    Parameters: ``seed``, ``image.*``, ``overhead.*`` (the tags), and those of the robot.
    """

    def __init__(self) -> None:
        super().__init__('overhead_camera_simulator', OverheadCameraSimulatorParams)
        params, image = self.params, self.params.image
        self._renderer = Renderer(image, params.overhead, params.robot.wheel_radius, params.seed)
        self._period_ns = round(NS_PER_S / image.rate)
        self._before_ns = round(0.5 * image.exposure * NS_PER_S)
        self._after_ns = self._before_ns + round(image.readout * NS_PER_S)
        self._truth: deque[tuple[int, float, float, float]] = deque()  # stamp [ns], x, y, yaw
        self._image_ns = 0  # stamp of the latest image
        self.images = self.skipped = 0
        self._info = self._renderer.camera.intrinsics.fill(
            message_class('sensor_msgs/msg/CameraInfo')())
        self._publish_info = self._publisher('CameraInfo', 'camera_info')
        self._publish_image = (
            self._publisher('CompressedImage', 'image_raw/compressed') if image.jpeg_quality
            else self._publisher('Image', 'image_raw'))
        self.subscribe('ground_truth/odom', self._on_truth, required=True)

    def _publisher(self, kind: str, name: str) -> Any:
        topic = f'overhead_camera/{name}'
        return self.make_guarded_publisher(
            message_class(f'sensor_msgs/msg/{kind}'), topic, publisher_qos(topic))

    def _on_truth(self, odometry: Odometry) -> None:
        stamp_ns, truth = odometry.stamp_ns, self._truth
        if truth and stamp_ns <= truth[-1][0]:  # a clock that was set back
            truth.clear()
            self._image_ns = 0
        truth.append((stamp_ns, *odometry.position[:2], yaw_of(odometry.orientation)))
        due_ns = (stamp_ns - self._after_ns) // self._period_ns * self._period_ns
        if due_ns == self._image_ns or truth[0][0] > due_ns - self._before_ns:
            return
        while len(truth) > 1 and truth[1][0] <= due_ns - self._before_ns:
            truth.popleft()
        if self._image_ns:
            self.skipped += (due_ns - self._image_ns) // self._period_ns - 1
        self._image_ns = due_ns
        longest_ns = max(b[0] - a[0] for a, b in pairwise(truth)) if len(truth) > 1 else 0
        if self.now_ns() - stamp_ns > MAX_AGE_NS or longest_ns > MAX_GAP_NS:
            self.skipped += 1
        else:
            self._publish(due_ns)

    def _publish(self, stamp_ns: int) -> None:
        """Publish the image and the CameraInfo of an instant."""
        stamps, *poses = zip(*self._truth)
        pixels, image = self._renderer.image(0.0, between(
            np.subtract(stamps, stamp_ns) / NS_PER_S, np.transpose(poses))), self.params.image
        if image.jpeg_quality:
            msg = message_class('sensor_msgs/msg/CompressedImage')(
                format='jpeg', data=array('B', jpeg(pixels, image.jpeg_quality)))
        else:
            msg = fill_image(message_class('sensor_msgs/msg/Image')(), pixels)
        for one, publish in ((self._info, self._publish_info), (msg, self._publish_image)):
            set_header(one, stamp_ns, FRAME)
            publish(one)
        self.images += 1

    def fill_status(self, status: Status) -> None:
        """Add the counts of images, and a warning if images are skipped."""
        super().fill_status(status)
        status.values['images'], status.values['images_skipped'] = self.images, self.skipped
        if new := status.new('skipped', self.skipped):
            status.warn(f'{new} images skipped: poses are late or missing', by_host=True)


def main() -> int:
    """Run the node."""
    return run(OverheadCameraSimulator, images=True)


if __name__ == '__main__':
    sys.exit(main())
