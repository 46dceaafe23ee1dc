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

"""A node that drives the robot by wheel speeds, then along paths."""

from __future__ import annotations

import math

from smart_tire.nodes.pilot import Pilot

COMMAND_PERIOD = 0.1   # s


class DemoDriver(Pilot):
    """
    Publishes ``cmd_vel`` at 10 Hz until ``release``; otherwise a ``Pilot``.

    Publishes ``cmd_vel``, ``path`` and ``/diagnostics``. Parameters: those of
    ``wheel_controller``.
    """

    def __init__(self) -> None:
        super().__init__('demo_driver')
        self._command: tuple[float, float] | None = (0.0, 0.0)
        self.create_steady_timer(COMMAND_PERIOD, self._on_timer)

    def drive(self, left_rpm: float, right_rpm: float) -> None:
        """Set the ``cmd_vel`` that yields these wheel speeds [rev/min] of the two sides."""
        left, right = (rpm * 2.0 * math.pi / 60.0 * self.params.robot.wheel_radius
                       for rpm in (left_rpm, right_rpm))
        self._command = 0.5 * (left + right), (right - left) / self.params.effective_track

    def release(self) -> None:
        """Command standstill and end the publisher of ``cmd_vel``, so that others may drive."""
        self._command = None
        super().release()

    def _on_timer(self) -> None:
        if self._command is not None:
            self.command(*self._command)
