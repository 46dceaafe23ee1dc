# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Filter of the instantaneous centers of rotation, the reference of path tracking."""

import math

from benchmarks.control.icr_kinematics import IcrKinematics
import pytest
from smart_tire.control.ground_motion import Motion
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.samples import WheelSlip

PARAMS = TrajectoryControllerParams()
PERIOD_NS = 10_000_000
LEFT, RIGHT, AHEAD = 0.30, -0.36, 0.05  # m, true centers


@pytest.mark.parametrize('v_x', [0.4, -0.4])
def test_the_command_moves_a_body_with_these_centers_as_wanted(v_x):
    kinematics, half = IcrKinematics(PARAMS), 0.5 * PARAMS.robot.track_width
    for step in range(400):
        yaw_rate, now_ns = math.sin(0.02 * step), step * PERIOD_NS
        kinematics.add_motion(
            Motion(0.0, 0.0, 0.0, v_x, -AHEAD * yaw_rate, yaw_rate), now_ns)
        left, right = (half - LEFT) * yaw_rate, (-half - RIGHT) * yaw_rate
        kinematics.add_slip(WheelSlip(
            now_ns, (0.1,) * 4, (left, right, left, right), (0.01,) * 4))
    speed, rate = kinematics.command(v_x, 0.8, 0, 0.15, PARAMS)
    assert speed - half * rate == pytest.approx(v_x - 0.8 * LEFT, abs=0.01)
    assert speed + half * rate == pytest.approx(v_x - 0.8 * RIGHT, abs=0.01)
    assert kinematics.lateral_speed(v_x, 0.8, 0.0) == pytest.approx(
        -AHEAD * 0.8, abs=0.004)
