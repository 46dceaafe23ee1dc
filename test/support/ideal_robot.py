# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Ideal differential drive with lag and delay, and a run of the trajectory controller on it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
import math

import numpy as np
from smart_tire.control.trajectory_control import PathState, TrajectoryControl
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.rotation import quaternion
from smart_tire.samples import NAN, NS_PER_S, Odometry, PlannedPath

IDEAL = TrajectoryControllerParams(slip_compensation=False)


def odometry(stamp_ns, x=0.0, y=0.0, yaw=0.0, v_x=0.0, yaw_rate=0.0, *, v_y=0.0,
             variance=0.0):
    """Return odometry with the same ``variance`` of all components."""
    covariance = tuple(variance if i % 7 == 0 else 0.0 for i in range(36))
    return Odometry(stamp_ns, (x, y, 0.0), quaternion(0.0, 0.0, yaw), (v_x, v_y, 0.0),
                    (0.0, 0.0, yaw_rate), covariance, covariance)


def path(*points, frame='odom'):
    """Return a path through points (x, y) or (x, y, yaw)."""
    return PlannedPath(0, frame, tuple((*one, NAN)[:3] for one in points))


def straight_path(stamp_ns, x, length, frame='odom'):
    """Return a path along x from ``x`` [m], with a pose every 0.05 m."""
    return PlannedPath(stamp_ns, frame, tuple(
        (x + 0.05 * index, 0.0, 0.0) for index in range(round(length / 0.05) + 1)))


@dataclass
class IdealRobot:
    """Differential drive with first-order lag of speed and yaw rate, and dead time."""

    lag: float = 0.1          # s
    dead_time: int = 0        # steps
    yaw_gain: float = 1.0     # yaw rate over the commanded one
    pivot: float = 0.0        # m, center of rotation ahead of base_link
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    v_x: float = 0.0
    yaw_rate: float = 0.0
    queue: deque = field(default_factory=deque)

    def drive(self, v_x, yaw_rate, dt):
        """Move for ``dt`` with a command."""
        self.queue.append((v_x, yaw_rate))
        v_x, yaw_rate = self.queue.popleft() if len(self.queue) > self.dead_time else (0.0, 0.0)
        for _ in range(4):
            step = 0.25 * dt
            self.v_x += (v_x - self.v_x) * step / self.lag
            self.yaw_rate += (self.yaw_gain * yaw_rate - self.yaw_rate) * step / self.lag
            middle = self.yaw + 0.5 * self.yaw_rate * step
            v_y = -self.pivot * self.yaw_rate
            self.x += (self.v_x * math.cos(middle) - v_y * math.sin(middle)) * step
            self.y += (self.v_x * math.sin(middle) + v_y * math.cos(middle)) * step
            self.yaw += self.yaw_rate * step

    def odometry(self, now_ns):
        """Return the true odometry."""
        return odometry(now_ns, self.x, self.y, self.yaw, self.v_x, self.yaw_rate,
                        v_y=-self.pivot * self.yaw_rate)


class Run:
    """Controller and robot; ``log`` holds t, x, y, yaw, v_x, yaw_rate, commands (n, 8)."""

    def __init__(self, params=IDEAL, rate=20.0, **robot):
        self.params = replace(params, rate=rate)
        self.control, self.robot = TrajectoryControl(self.params), IdealRobot(**robot)
        self.now_ns, self.period_ns = NS_PER_S, round(NS_PER_S / rate)
        self.rows, self.progress = [], []
        self.observe()

    @property
    def log(self):
        return np.array(self.rows)

    def observe(self):
        """Give the true odometry to the controller."""
        self.control.add_odometry(self.robot.odometry(self.now_ns), self.now_ns)

    def start(self, target):
        """Give a path or goal to the controller."""
        self.control.follow(target, self.now_ns)
        return self

    def step(self):
        """Advance by one period; return the command."""
        self.observe()
        command = self.control.step(self.now_ns)
        v_x, yaw_rate = (command.v_x, command.yaw_rate) if command else (0.0, 0.0)
        robot = self.robot
        self.rows.append((self.now_ns / NS_PER_S, robot.x, robot.y, robot.yaw, robot.v_x,
                          robot.yaw_rate, v_x, yaw_rate))
        self.progress.append(self.control.progress(self.now_ns))
        robot.drive(v_x, yaw_rate, self.period_ns / NS_PER_S)
        self.now_ns += self.period_ns
        return command

    def until_end(self, seconds=120.0):
        """Advance until the path has ended; return this."""
        for _ in range(round(seconds * self.params.rate)):
            self.step()
            if self.control.state != PathState.FOLLOWING:
                break
        return self

    def for_seconds(self, seconds):
        """Advance for a time; return this."""
        for _ in range(round(seconds * self.params.rate)):
            self.step()
        return self


def distances(planned, log):
    """Return the distance of each position in ``log`` from the polygon of a path, shape (n,)."""
    points = np.array(planned.poses)[:, :2]
    start, edge = points[:-1], np.diff(points, axis=0)
    squared = np.maximum((edge ** 2).sum(axis=1), 1e-12)
    away = log[:, None, 1:3] - start
    share = np.clip((away * edge).sum(axis=2) / squared, 0.0, 1.0)
    return np.linalg.norm(away - share[..., None] * edge, axis=2).min(axis=1)
