# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Software of the robot in a closed loop offline: estimators, trajectory and wheel control."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

from benchmarks.control.wrong_estimates import Fault
from smart_tire.analysis.pipeline import EstimatorParams, Pipeline
from smart_tire.control.trajectory_control import PathState, TrajectoryControl
from smart_tire.control.wheel_control import WheelControl
from smart_tire.parameters.control import TrajectoryControllerParams, WheelControllerParams
from smart_tire.samples import (
    Four, GroundState, NS_PER_S, Odometry, PlannedPath, Sample, VelocityCommand,
    WheelSample, WheelSlip)

STANDSTILL = 3.0   # s, before the path is set, in which the estimators settle
STOPPING = 1.0     # s, after arrival, until the run ends
ENDED = (PathState.ARRIVED, PathState.STOPPED, PathState.REFUSED)


class RobotStack:
    """
    Estimators and wheel controller; a subclass gives the commands.

    Estimates reach the controllers when the last of their inputs is received, as live. Without
    ``estimated``, motion and slip are the true ones. ``fault`` changes the estimates, or the true
    motion and slip that are given in their place.
    """

    def __init__(self, estimators: EstimatorParams, wheels: WheelControllerParams, *,
                 estimated: bool = True, fault: Fault = iter) -> None:
        self._pipeline, self._fault = Pipeline(estimators), fault
        self._wheels, self._estimated = WheelControl(wheels), estimated

    def receive(self, topic: str, sample: Sample, now_ns: int) -> None:
        """Process a message received at ``now_ns``."""
        true = topic.startswith('ground_truth/')
        if isinstance(sample, WheelSample):
            self._wheels.add_reading(sample.velocity, now_ns, sample.stamp_ns, sample.position,
                                     sample.effort)
        if true != self._estimated:
            for estimate in self._fault([sample] if true else self._pipeline.update(sample)):
                self._distribute(estimate, now_ns)

    def _distribute(self, estimate: Sample, now_ns: int) -> None:
        if isinstance(estimate, Odometry):
            self._wheels.traction.add_odometry(estimate)
        elif isinstance(estimate, GroundState):
            self._wheels.traction.set_ground(estimate)


@dataclass(frozen=True)
class StackParams:
    """Parameters of all parts."""

    estimators: EstimatorParams
    trajectory: TrajectoryControllerParams
    wheels: WheelControllerParams
    estimated: bool
    control: type[TrajectoryControl] = TrajectoryControl
    fault: Fault = iter         # of what the controllers are given
    command_delay: float = 0.0  # s, of the commands to the wheel controller


class PathStack(RobotStack):
    """
    Controller for ``run_closed_loop`` that follows ``path`` after ``STANDSTILL``.

    It begins where the robot is then, which rolls down slopes while it waits.
    """

    def __init__(self, params: StackParams, path: PlannedPath) -> None:
        super().__init__(params.estimators, params.wheels, estimated=params.estimated,
                         fault=params.fault)
        self.path, self._timeout = path, params.wheels.cmd_vel_timeout
        self._delay_ns = round(params.command_delay * NS_PER_S)
        self.trajectory = params.control(params.trajectory)
        self._period_ns = round(NS_PER_S / params.trajectory.rate)
        self._start_ns: int | None = None   # of the path
        self._due_ns = 0                    # next step of the trajectory controller
        self._commands = deque[tuple[int, VelocityCommand]]()  # and when they are received
        self._ended_ns: int | None = None
        self.truth: list[Odometry] = []     # poses of the robot
        self.poses: list[Odometry] = []     # of the trajectory controller
        self.commands: list[VelocityCommand] = []

    @property
    def start_ns(self) -> int:
        """Return when the path was set."""
        return self._start_ns or 0

    @property
    def ended_ns(self) -> int | None:
        """Return when following ended; None if it has not."""
        return self._ended_ns

    def drive(self) -> tuple[list[Odometry], list[Odometry]]:
        """Return the true poses, and those of the controller, from start to end of following."""
        end_ns = self.ended_ns or self.truth[-1].stamp_ns
        true, followed = ([pose for pose in poses if self.start_ns <= pose.stamp_ns <= end_ns]
                          for poses in (self.truth, self.poses))
        return true, followed

    def receive(self, topic: str, sample: Sample, now_ns: int) -> None:
        """Process a message received at ``now_ns``."""
        if isinstance(sample, WheelSample):
            self.trajectory.add_wheels(sample)
        elif topic == 'ground_truth/odom' and isinstance(sample, Odometry):
            self.truth.append(sample)
        super().receive(topic, sample, now_ns)
        self._follow(now_ns)

    def _distribute(self, estimate: Sample, now_ns: int) -> None:
        super()._distribute(estimate, now_ns)
        if isinstance(estimate, Odometry):
            self.poses.append(estimate)
            self.trajectory.add_odometry(estimate, now_ns)
        elif isinstance(estimate, WheelSlip):
            self.trajectory.add_slip(estimate)
        elif isinstance(estimate, GroundState):
            self.trajectory.set_ground(estimate)

    def _follow(self, now_ns: int) -> None:
        """Step the trajectory controller when it is due."""
        if self._start_ns is None:
            self._start_ns = now_ns + round(STANDSTILL * NS_PER_S)
            self._due_ns = self._start_ns
        if now_ns < self._due_ns:
            return
        if self._due_ns == self._start_ns:
            x, y, _ = self.truth[-1].position
            self.path = replace(self.path, poses=tuple(
                (x + p_x, y + p_y, yaw) for p_x, p_y, yaw in self.path.poses))
            self.trajectory.follow(self.path, now_ns)
        self._due_ns += self._period_ns
        command = self.trajectory.step(now_ns)
        if command is not None:
            self._commands.append((now_ns + self._delay_ns, command))
            self.commands.append(command)
        if self._ended_ns is None and self.trajectory.state in ENDED:
            self._ended_ns = now_ns

    def duty(self, now_ns: int) -> Four:
        """Return the duties of the wheel controller."""
        while len(self._commands) > 1 and self._commands[1][0] <= now_ns:
            self._commands.popleft()
        command = next((command for received_ns, command in self._commands if (
            0 <= now_ns - received_ns <= self._timeout * NS_PER_S)), None)
        return self._wheels.follow(command, now_ns, now_ns)[1]

    def finished(self, now_ns: int) -> bool:
        """Return whether following has ended ``STOPPING`` ago."""
        return (self._ended_ns is not None
                and now_ns - self._ended_ns > round(STOPPING * NS_PER_S))
