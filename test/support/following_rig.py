# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motor driver, wheel and trajectory controller as processes; the odometry is that of the test."""

from __future__ import annotations

import math
from pathlib import Path
import time
from typing import Any

from smart_tire.control.trajectory_control import PathState
from smart_tire.samples import NS_PER_S, PlannedPath
from support.ideal_robot import odometry, straight_path
from support.robot_rig import RobotRig

RADIUS = 0.087   # m
LENGTH = 30.0    # m, of a path
DRIVEN = 0.5     # m/s, below max_speed of trajectory_controller
PATIENCE = 0.5   # s, after which a path is sent again if it is not followed
VARIANCE = 1e-4  # of odom


class FollowingRig(RobotRig):
    """
    The robot follows a path straight ahead; it has no slip.

    ``command`` publishes ``odom`` for each of the ``wheel_states``, with the speed of the wheels
    or ``odom_speed`` [m/s], so that everything of ``RobotRig`` that commands works.
    """

    def __init__(self, folder: Path, **parameters: Any) -> None:
        super().__init__(folder)
        self._parameters = parameters
        self.x = 0.0  # m, shown by odom
        self.odom_speed: float | None = None
        self._stamp_ns, self._ordered = 0, -math.inf  # s, when a path was sent

    def __enter__(self) -> FollowingRig:
        super().__enter__()
        self.graph.subscribe('path_progress')
        self.start('trajectory_controller', **self._parameters)
        self.graph.until(self._is_ready, self.command)
        return self

    def _is_ready(self) -> bool:
        log = self.processes['trajectory_controller'].output
        return (bool(self.graph.received['path_progress'])
                and all(f'receiving {name}' in log for name in ('odom', 'wheel_states')))

    def command(self, v_x: float = 0.0, stamp_ns: int | None = None) -> None:
        """Publish ``odom`` for new ``wheel_states``."""
        samples = self.graph.samples('wheel_states')
        if not samples or samples[-1].stamp_ns == self._stamp_ns:
            return
        for sample in samples:
            rolling = RADIUS * sum(sample.velocity) / 4.0
            speed = rolling if self.odom_speed is None else self.odom_speed
            self.x += speed * min((sample.stamp_ns - self._stamp_ns) / NS_PER_S, 0.5)
            self._stamp_ns = sample.stamp_ns
        self.graph.received['wheel_states'][:] = self.graph.received['wheel_states'][-1:]
        self.graph.publish(
            'odom', odometry(self._stamp_ns, self.x, v_x=speed, variance=VARIANCE))

    def path(self, length: float = LENGTH) -> PlannedPath:
        """Return a path straight ahead of ``length`` [m]."""
        return straight_path(time.time_ns(), self.x, length)

    def drive(self, v_x: float = DRIVEN) -> None:
        """Follow a path until the wheels turn at ``v_x``."""
        self.graph.until(lambda: min(self.rig.state().speeds) > v_x / RADIUS, self.follow)

    def follow(self, length: float = LENGTH) -> None:
        """Publish ``odom``, and a path if none is followed: odom may have been late."""
        self.command()
        if self.state() != PathState.FOLLOWING and time.monotonic() > self._ordered + PATIENCE:
            self._ordered = time.monotonic()
            self.graph.publish('path', self.path(length))

    def state(self) -> int:
        """Return the latest state of the trajectory controller."""
        return int(self.graph.samples('path_progress')[-1].state)
