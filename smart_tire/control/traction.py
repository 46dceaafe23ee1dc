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

"""Traction control: wheel speeds that keep the slip of each wheel below critical."""

from __future__ import annotations

from smart_tire.parameters.control import TractionParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import Four, Friction, Odometry, WheelSlip


class TractionControl:
    """
    Limits set points of the wheel speeds; all times are nanoseconds of the message clock.

    Without recent estimates of the motion of the robot set points are not changed.
    """

    def __init__(self, params: TractionParams, robot: RobotParams) -> None:
        self.params = params  # may be replaced at run time
        self._robot = robot

    def update_odometry(self, odometry: Odometry) -> None:
        """Add an estimate of the motion of the robot."""

    def update_slip(self, slip: WheelSlip) -> None:
        """Add estimated slips with their standard deviations."""

    def update_friction(self, friction: Friction) -> None:
        """Add the friction of one patch crossing."""

    def limit(self, set_points: Four, now_ns: int) -> Four:
        """Return ``set_points`` [rad/s], limited at time ``now_ns``."""
        return set_points
