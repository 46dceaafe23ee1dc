# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motor torques that drive wheels with given traction forces."""

from __future__ import annotations

import numpy as np

from smart_tire.models.vehicle.drive import friction_torque
from smart_tire.parameters import RobotParams


def required_torque(force, speed, acceleration, load, robot: RobotParams) -> np.ndarray:
    """Return the torque [N m] for a force [N]; speed in rad/s, acceleration in rad/s2."""
    friction = friction_torque(speed, load, robot.motor, robot.wheel_radius)
    return np.asarray(robot.wheel_radius * np.asarray(force) + friction
                      + robot.motor.inertia * np.asarray(acceleration))
