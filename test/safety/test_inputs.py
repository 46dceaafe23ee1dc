# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Several inputs of velocity commands, with their own priorities and time-outs."""

from __future__ import annotations

import time

import pytest
from support.robot_rig import RobotRig

pytestmark = pytest.mark.safety


def test_the_input_of_higher_priority_is_used_until_it_expires(tmp_path, isolated_ros):
    with RobotRig(tmp_path, controller=False) as robot:
        robot.start('wheel_controller', cmd_vel_inputs='[teleop/cmd_vel, nav/cmd_vel]',
                    cmd_vel_priorities='[10, 5]', cmd_vel_timeouts='[0.5, 0.2]')
        graph = robot.graph

        def both(teleop, nav):
            if teleop is not None:
                graph.publish_as('teleop/cmd_vel', 'cmd_vel', robot.velocity(teleop))
            graph.publish_as('nav/cmd_vel', 'cmd_vel', robot.velocity(nav))

        graph.until(lambda: min(robot.rig.state().speeds) > 3.0, lambda: both(None, 0.5))
        graph.until(lambda: max(robot.rig.state().speeds) < -3.0, lambda: both(-0.5, 0.5))
        ended = time.monotonic()
        graph.until(lambda: min(robot.rig.state().speeds) > 3.0, lambda: both(None, 0.5))
        assert time.monotonic() - ended > 0.5
        ended = time.monotonic()
        assert robot.until_stopped(ended, lambda: None) < 0.2 + 0.1
