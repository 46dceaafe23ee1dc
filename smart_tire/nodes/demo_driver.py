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

"""A node that drives the robot by wheel speeds and keeps its latest estimates."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.qos import subscriber_qos
from smart_tire.parameters import WheelControllerParams
from smart_tire.samples import Friction, Odometry, VelocityCommand, WHEELS, WheelSample, WheelSlip

COMMAND_PERIOD = 0.1   # s


class DemoDriver(SmartTireNode[WheelControllerParams]):
    """
    Publishes ``cmd_vel`` at 10 Hz; attributes hold the latest samples received.

    Publishes ``cmd_vel`` and ``/diagnostics``; subscribes to ``odom``, ``wheel_states``,
    ``wheel_slip``, ``tire_friction`` and ``/diagnostics``. Parameters: those of
    ``wheel_controller``.
    """

    def __init__(self) -> None:
        super().__init__('demo_driver', WheelControllerParams)
        self.odometry: Odometry | None = None
        self.wheels: WheelSample | None = None
        self.slip: WheelSlip | None = None
        self.friction: dict[str, Friction] = {}      # wheel -> latest estimate
        self.crossings: dict[str, int] = {}           # wheel -> number of patch crossings
        self.health: dict[str, dict[str, str]] = {}  # node -> its diagnostics
        self._command = (0.0, 0.0)
        self._publish = self.make_publisher('cmd_vel')
        for name, field in (('odom', 'odometry'), ('wheel_states', 'wheels'),
                            ('wheel_slip', 'slip')):
            self.subscribe(name, self._store_in(field))
        self.subscribe('tire_friction', self._on_friction, wheels=len(WHEELS))
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics,
                                 subscriber_qos('/diagnostics'))
        self.create_steady_timer(COMMAND_PERIOD, self._on_timer)

    def drive(self, left_rpm: float, right_rpm: float) -> None:
        """Set the ``cmd_vel`` that yields these wheel speeds [rev/min] of the two sides."""
        left, right = (rpm * 2.0 * math.pi / 60.0 * self.params.robot.wheel_radius
                       for rpm in (left_rpm, right_rpm))
        self._command = 0.5 * (left + right), (right - left) / self.params.effective_track

    def _on_timer(self) -> None:
        self._publish(VelocityCommand(self.now_ns(), *self._command))

    def _store_in(self, field: str) -> Callable[[Any], None]:
        return lambda sample: setattr(self, field, sample)

    def _on_friction(self, friction: Friction) -> None:
        self.friction[friction.wheel] = friction
        self.crossings[friction.wheel] = self.crossings.get(friction.wheel, 0) + 1

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            self.health[status.name.rsplit('/', 1)[-1]] = {
                item.key: item.value for item in status.values}
