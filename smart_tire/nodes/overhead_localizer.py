# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""ROS node: pose, velocity and slip from the images of a camera above the floor."""

from __future__ import annotations

from collections.abc import Callable
import sys
from typing import Any

from smart_tire.messages import IMAGES
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.diagnostics import InputCounter, Status
from smart_tire.nodes.qos import subscriber_qos
from smart_tire.nodes.runner import run
from smart_tire.parameters import OverheadLocalizerParams
from smart_tire.samples import Odometry, WheelSlip
from smart_tire.vision.overhead import LiveLocalizer


class OverheadLocalizerNode(SmartTireNode[OverheadLocalizerParams]):
    """
    Finds the tags of the robot in images; an estimate is ``overhead.lag`` behind the images.

    Subscribes to ``overhead_camera/image_raw`` and ``overhead_camera/image_raw/compressed``,
    ``overhead_camera/camera_info``, ``imu/data`` and ``wheel_states``; publishes
    ``overhead/odom``, ``overhead/wheel_slip`` and ``/diagnostics``.

    Parameters: ``overhead.*``, ``reliability``, and those of the robot.
    """

    def __init__(self) -> None:
        super().__init__('overhead_localizer', OverheadLocalizerParams)
        self.localizer = LiveLocalizer(self.params)
        self._publish: dict[type, Callable[[Any], None]] = {
            Odometry: self.make_publisher('overhead/odom'),
            WheelSlip: self.make_publisher('overhead/wheel_slip')}
        for name in ('imu/data', 'wheel_states'):
            self.subscribe(name, self.localizer.add_sample, reliability=self.params.reliability)
        self._subscribe_camera('sensor_msgs/msg/CameraInfo', 'overhead_camera/camera_info',
                               self.localizer.add_camera_info)
        for name in ('overhead_camera/image_raw', 'overhead_camera/image_raw/compressed'):
            self._subscribe_camera(IMAGES[name], name, self._on_image)

    def _subscribe_camera(self, kind: str, name: str, handle: Callable[[Any], None]) -> None:
        counter = self.inputs[name] = InputCounter()
        self.create_subscription(
            message_class(kind), name,
            lambda msg: self.guarded(name, counter, lambda: handle(msg)),
            subscriber_qos(name, reliability=self.params.reliability))

    def _on_image(self, msg: Any) -> None:
        for estimate in self.localizer.estimates(msg):
            self._publish[type(estimate)](estimate)

    def fill_status(self, status: Status) -> None:
        """Add the counts of the images, and why images were not used."""
        super().fill_status(status)
        localizer = self.localizer
        status.values['images'] = localizer.images
        status.values['time_offset'] = localizer.offset.value
        refused = localizer.refused
        status.values['images_refused'] = total = sum(refused.values())
        if new := status.new('refused', total):
            reason, _ = refused.most_common(1)[0]
            status.warn(f'{new} images without an estimate, mostly: {reason}')


def main() -> int:
    """Run the node."""
    return run(OverheadLocalizerNode, images=True)


if __name__ == '__main__':
    sys.exit(main())
