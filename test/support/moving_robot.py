# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A robot that moves as ``cmd_vel`` says, to try trajectory_controller, over DDS or without."""

from __future__ import annotations

from collections.abc import Callable
import time

from smart_tire.control.trajectory_control import PathState
from smart_tire.messages import TOPICS
from smart_tire.samples import (
    NAN, NS_PER_S, PathProgress, PlannedPath, WheelSample, WheelSlip)
from support.graph import Graph
from support.ideal_robot import odometry, straight_path
from support.virtual_node import VirtualNode

RADIUS = 0.087  # m
VARIANCE = 1e-4  # of odom
SHORT, LONG = 0.3, 10.0  # m


class Robot:
    """
    A robot without slip that publishes ``odom`` and moves along x as ``cmd_vel`` says.

    ``graph`` is that of the test, or a node in virtual time; ``rate`` [Hz] is that of ``odom``.
    """

    def __init__(self, graph: Graph | VirtualNode, rate: float = 50.0) -> None:
        self.graph, self._period_ns = graph, round(NS_PER_S / rate)
        self.x = 0.0
        self.is_silent = self.has_wheels = False
        self.odom_speed: float | None = None  # m/s, None: that of the robot
        self.shown_x = 0.0
        self.log: Callable[[], str] = lambda: self.node.output
        self.sent_ns = 0  # stamp of the latest odom
        if isinstance(graph, Graph):
            graph.subscribe('cmd_vel', 'path_progress')

    def step(self) -> None:
        """Move and publish, if it is time."""
        now_ns = time.time_ns()
        if self.is_silent or now_ns - self.sent_ns < self._period_ns:
            return
        passed = min(now_ns - self.sent_ns, 2 * self._period_ns) / NS_PER_S
        self.sent_ns = now_ns
        self.x += self.speed * passed
        self.shown_x = self.x if self.odom_speed is None else (
            self.shown_x + self.odom_speed * passed)
        if self.has_wheels:
            self.graph.publish('wheel_states', WheelSample(now_ns, (self.speed / RADIUS,) * 4))
        self.graph.publish(
            'odom', odometry(now_ns, self.shown_x, v_x=self.speed, variance=VARIANCE))
        self.graph.publish('wheel_slip', WheelSlip(
            now_ns, (0.0,) * 4, (0.0,) * 4, (0.01,) * 4))

    @property
    def commands(self) -> list[tuple[float, float]]:
        """Return speed and yaw rate of all commands."""
        return [(sample.v_x, sample.yaw_rate) for sample in self.graph.samples('cmd_vel')]

    @property
    def speed(self) -> float:
        """Return the latest speed commanded."""
        sent = self.graph.received['cmd_vel']
        return TOPICS['cmd_vel'].from_msg(sent[-1]).v_x if sent else 0.0

    @property
    def progress(self) -> PathProgress:
        """Return the latest progress."""
        if sent := self.graph.received['path_progress']:
            return TOPICS['path_progress'].from_msg(sent[-1])
        return PathProgress(0, NAN, NAN, -1)

    def until(self, condition: Callable[[], object],
              do: Callable[[], object] = lambda: None) -> None:
        """Drive, and do something, until ``condition``."""
        self.graph.until(condition, lambda: (self.step(), do()))

    def until_state(self, state: PathState) -> None:
        """Drive until the progress has ``state``."""
        self.until(lambda: self.progress.state == state)

    def until_more_progress(self) -> None:
        """Drive until two more messages of the progress."""
        count = len(self.graph.received['path_progress'])
        self.until(lambda: len(self.graph.received['path_progress']) == count + 2)

    def until_more_health(self, node: str) -> None:
        """Drive until two more diagnostics of a node: the first may have been on its way."""
        for _ in range(2):
            self.graph.health.pop(node, None)
            self.until(lambda: node in self.graph.health)

    def path(self, length: float = LONG, stamp_ns: int | None = None,
             frame: str = 'odom') -> PlannedPath:
        """Return a path straight ahead of ``length`` [m], by default with the present time."""
        return straight_path(
            time.time_ns() if stamp_ns is None else stamp_ns, self.x, length, frame)

    def follow(self, path: PlannedPath | None = None) -> None:
        """Publish a path, by default a long one."""
        self.graph.publish('path', path or self.path())

    def drive(self) -> None:
        """Publish a long path; return when the robot moves."""
        self.follow(self.path())
        self.until(lambda: self.speed > 0.1)

    def assert_stopped(self, state: PathState, reason: str) -> None:
        """Assert that one command of zero is sent, that ``state`` remains and why is logged."""
        self.until_state(state)
        self.until(lambda: self.speed == 0.0)
        count = len(self.commands)
        self.until(lambda: f'{state.name.lower()}: ' in self.log())
        assert reason in self.log()
        self.until_more_progress()
        assert self.progress.state == state
        assert len(self.commands) == count
