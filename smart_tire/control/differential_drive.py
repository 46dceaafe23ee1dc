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

"""Inverse kinematics of the equivalent differential drive."""

from __future__ import annotations

from smart_tire.samples import Four, VelocityCommand


def wheel_speeds(command: VelocityCommand, *, radius: float, effective_track: float) -> Four:
    """
    Return the wheel speeds [rad/s] of a body velocity without longitudinal slip, B(1).

    ``effective_track`` [m] is the track of the differential drive with the same yaw rate; a
    skid-steer robot slips while turning, so it is larger than the geometric track.

    >>> command = VelocityCommand(0, v_x=0.5, yaw_rate=1.0)
    >>> wheel_speeds(command, radius=0.1, effective_track=0.4)
    (3.0, 7.0, 3.0, 7.0)
    """
    difference = 0.5 * effective_track * command.yaw_rate
    left, right = (command.v_x - difference) / radius, (command.v_x + difference) / radius
    return left, right, left, right
