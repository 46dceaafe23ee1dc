# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A node that watches a calibration, and drives the robot if it is asked to."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.qos import latched
from smart_tire.parameters import WheelControllerParams
from smart_tire.samples import Sample, VelocityCommand
from std_msgs.msg import Bool

COMMAND_PERIOD = 0.05    # s: several commands within the time-out of wheel_controller
WATCHED = ('imu/data', 'wheel_states')


class CalibrationDriver(SmartTireNode[WheelControllerParams]):
    """
    Calls ``on_sample`` with the samples of IMU and wheels; publishes commands after ``enable``.

    Publishes ``cmd_vel`` (only after ``enable``) and ``/diagnostics``; subscribes to ``imu/data``,
    ``wheel_states`` and ``emergency_stop_active``, which ends all driving until the next
    ``enable``. Parameters: those of ``wheel_controller``.
    """

    def __init__(self, on_sample: Callable[[Sample], None]) -> None:
        super().__init__('calibration_driver', WheelControllerParams)
        self.emergency_stop = False
        self._command: tuple[float, float] | None = None
        self._publish: Callable[[Any], None] | None = None
        for name in WATCHED:
            self.subscribe(name, on_sample)
        self.create_subscription(Bool, 'emergency_stop_active', self._on_emergency_stop, latched())
        self.create_steady_timer(COMMAND_PERIOD, self._on_timer)

    def enable(self) -> None:
        """Create the publisher of ``cmd_vel``: without it this node cannot drive."""
        if self._publish is None:
            self._publish = self.make_publisher('cmd_vel')

    def controlled(self) -> bool:
        """Return whether a node listens to ``cmd_vel``."""
        return self.count_subscribers('cmd_vel') > 0

    def drive(self, left_rpm: float, right_rpm: float) -> None:
        """Set the command that yields these wheel speeds [rev/min] of the two sides."""
        if self.emergency_stop:
            return
        left, right = (rpm * math.tau / 60.0 * self.params.robot.wheel_radius
                       for rpm in (left_rpm, right_rpm))
        self._command = 0.5 * (left + right), (right - left) / self.params.effective_track

    def halt(self) -> None:
        """Command standstill once, and nothing after."""
        if self._publish is not None and self._command is not None:
            self._publish(VelocityCommand(self.now_ns(), 0.0, 0.0))
        self._command = None

    def stop(self) -> None:
        """Command standstill."""
        self.halt()

    def _on_timer(self) -> None:
        if self._publish is not None and self._command is not None:
            self._publish(VelocityCommand(self.now_ns(), *self._command))

    def _on_emergency_stop(self, msg: Any) -> None:
        self.emergency_stop = bool(msg.data)
        if self.emergency_stop:
            self.halt()
