# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A robot in the ROS graph that moves as ``cmd_vel`` says, to try trajectory_controller."""

from __future__ import annotations

from collections.abc import Callable
import time

from smart_tire.control.trajectory_control import State
from smart_tire.rotation import quaternion
from smart_tire.samples import (
    NAN, NS_PER_S, Odometry, PathProgress, PlannedPath, WheelSample, WheelSlip)
from support.graph import Graph

RADIUS = 0.087  # m
PERIOD_NS = 20_000_000  # of the odometry
COVARIANCE = tuple(1e-4 * (index % 7 == 0) for index in range(36))
SHORT, LONG = 0.3, 10.0  # m


class Robot:
    """A robot without slip that publishes ``odom`` and moves along x as ``cmd_vel`` says."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.x = 0.0
        self.is_silent = self.has_wheels = False
        self.odom_speed: float | None = None  # m/s, None: that of the robot
        self.shown_x = 0.0
        self.log: Callable[[], str] = lambda: self.node.output
        self._sent_ns = 0
        graph.subscribe('cmd_vel', 'path_progress')

    def step(self) -> None:
        """Move and publish, if it is time."""
        now_ns = time.time_ns()
        if self.is_silent or now_ns - self._sent_ns < PERIOD_NS:
            return
        passed = min(now_ns - self._sent_ns, 2 * PERIOD_NS) / NS_PER_S
        self._sent_ns = now_ns
        self.x += self.speed * passed
        self.shown_x = self.x if self.odom_speed is None else (
            self.shown_x + self.odom_speed * passed)
        if self.has_wheels:
            self.graph.publish('wheel_states', WheelSample(now_ns, (self.speed / RADIUS,) * 4))
        self.graph.publish('odom', Odometry(
            now_ns, (self.shown_x, 0.0, 0.0), quaternion(0.0, 0.0, 0.0), (self.speed, 0.0, 0.0),
            (0.0, 0.0, 0.0), COVARIANCE, COVARIANCE))
        self.graph.publish('wheel_slip', WheelSlip(
            now_ns, (0.0,) * 4, (0.0,) * 4, (0.01,) * 4))

    @property
    def commands(self) -> list[tuple[float, float]]:
        """Return speed and yaw rate of all commands."""
        return [(sample.v_x, sample.yaw_rate) for sample in self.graph.samples('cmd_vel')]

    @property
    def speed(self) -> float:
        """Return the latest speed commanded."""
        return self.commands[-1][0] if self.commands else 0.0

    @property
    def progress(self) -> PathProgress:
        """Return the latest progress."""
        progress = self.graph.samples('path_progress')
        return progress[-1] if progress else PathProgress(0, NAN, NAN, -1)

    def until(self, condition: Callable[[], object]) -> None:
        """Drive until ``condition``."""
        self.graph.until(condition, self.step)

    def until_state(self, state: State) -> None:
        """Drive until the progress has ``state``."""
        self.until(lambda: self.progress.state == state)

    def until_more_progress(self) -> None:
        """Drive until two more messages of the progress."""
        count = len(self.graph.received['path_progress'])
        self.until(lambda: len(self.graph.received['path_progress']) == count + 2)

    def path(self, length: float = LONG, stamp_ns: int | None = None,
             frame: str = 'odom') -> PlannedPath:
        """Return a path straight ahead of ``length`` [m], by default with the present time."""
        return PlannedPath(time.time_ns() if stamp_ns is None else stamp_ns, frame, tuple(
            (self.x + 0.05 * index, 0.0, 0.0) for index in range(round(length / 0.05) + 1)))

    def follow(self, path: PlannedPath) -> None:
        """Publish a path."""
        self.graph.publish('path', path)

    def drive(self) -> None:
        """Publish a long path; return when the robot moves."""
        self.follow(self.path())
        self.until(lambda: self.speed > 0.1)

    def assert_stopped(self, state: State, reason: str) -> None:
        """Assert that one command of zero is sent, that ``state`` remains and why is logged."""
        self.until_state(state)
        self.until(lambda: self.speed == 0.0)
        count = len(self.commands)
        self.until(lambda: f'{state.name.lower()}: ' in self.log())
        assert reason in self.log()
        self.until_more_progress()
        assert self.progress.state == state
        assert len(self.commands) == count
