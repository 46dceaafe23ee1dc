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

"""Inverse kinematics against the kinematics of the skid-steer model."""

from __future__ import annotations

import pytest

from smart_tire.control.wheel_control import wheel_speeds
from smart_tire.models.vehicle.skid_steer import wheel_velocities
from smart_tire.samples import VelocityCommand

RADIUS, TRACK, WHEELBASE = 0.087, 0.38, 0.26


@pytest.mark.parametrize(('v_x', 'yaw_rate'), [(0.7, 0.4), (-0.2, 1.0), (0.0, -2.0), (0.5, 0.0)])
def test_without_slip_the_wheel_centers_move_at_the_commanded_velocity(v_x, yaw_rate):
    speeds = wheel_speeds(VelocityCommand(0, v_x, yaw_rate), radius=RADIUS, effective_track=TRACK)
    expected, _ = wheel_velocities(v_x, 0.0, yaw_rate, WHEELBASE, TRACK)
    assert [RADIUS * speed for speed in speeds] == pytest.approx(list(expected), abs=1e-12)
