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

"""One run of the path tracking benchmark: simulated, scored, and recorded for the figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from benchmarks.control.closed_loop import run_closed_loop
from benchmarks.control.other_plant import OtherPlant
from benchmarks.control.robot_stack import RobotStack
from benchmarks.control.scenarios import MAX_DURATION, OWN, TrackingCase
from benchmarks.control.scoring import path_errors, score_tracking, TrackingScore
import numpy as np

from smart_tire.analysis.series import Floats
from smart_tire.control.trajectory_control import State
from smart_tire.models.tire.brush_tire import brush_force
from smart_tire.samples import NS_PER_S, Odometry
from smart_tire.simulation.plant import Plant

WATCH_STEPS = 50  # steps of the plant between two rows of a trace: 20 Hz


@dataclass(frozen=True)
class Trace:
    """Course of one run from the start of following, n rows."""

    time: Floats       # (n,) s
    position: Floats   # (n, 2) m, true
    followed: Floats   # (m, 2) m, pose that was followed
    error: Floats      # (n,) m, true position from the wanted path
    slip: Floats       # (n, 4), magnitude of the true slip vector of the wheels
    used: Floats       # (n, 4), tire force over friction coefficient times load


@dataclass(frozen=True)
class TrackingResult:
    """Result of one run; the trace of the drawn seed only."""

    case: TrackingCase
    seed: int
    score: TrackingScore
    reason: str  # why following has ended without arrival
    trace: Trace | None


def run_tracking(case: TrackingCase, seed: int, traced: bool) -> TrackingResult:
    """Simulate ``case`` and return its score."""
    stack, params = RobotStack(case.stack(), case.wanted()), case.simulator(seed)
    watch = _Watch(params.robot.wheel_radius)
    events = run_closed_loop(params, stack, MAX_DURATION, watch=watch,
                             plant=Plant if case.plant == OWN else OtherPlant)
    truth = [sample for _, topic, sample in events
             if topic == 'ground_truth/odom' and isinstance(sample, Odometry)]
    end_ns = stack.ended_ns or truth[-1].stamp_ns
    followed = [pose for pose in stack.poses if stack.start_ns <= pose.stamp_ns <= end_ns]
    score = score_tracking(
        case.wanted(), truth, followed, start_ns=stack.start_ns, end_ns=end_ns,
        arrived=stack.trajectory.state == State.ARRIVED)
    begin = (stack.start_ns - truth[0].stamp_ns) / NS_PER_S
    trace = watch.trace(case, followed, begin, begin + score.duration) if traced else None
    return TrackingResult(case, seed, score, stack.trajectory.reason, trace)


class _Watch:
    """Records the true motion, slip and friction used."""

    def __init__(self, radius: float) -> None:
        self._radius, self._rows = radius, list[tuple[float, ...]]()

    def __call__(self, plant: Plant) -> None:
        if plant.steps % WATCH_STEPS:
            return
        slips, used = [], []
        for i, speed in enumerate(plant.wheel_speed):
            slip = _slip(plant, i, self._radius * speed)
            surface = plant.surface[i]
            force, _ = brush_force(slip, 0.0, surface.friction, plant.load[i], surface.stiffness)
            slips.append(slip)
            used.append(float(force) / max(surface.friction * plant.load[i], 1e-6))
        self._rows.append((plant.time_ns / NS_PER_S, plant.x, plant.y, *slips, *used))

    def trace(self, case: TrackingCase, followed: Sequence[Odometry], begin: float,
              end: float) -> Trace:
        """Return the rows between ``begin`` and ``end`` [s]."""
        table = np.array(self._rows)
        table = table[(table[:, 0] >= begin) & (table[:, 0] <= end)]
        position = table[:, 1:3]
        return Trace(table[:, 0] - begin, position,
                     np.array([pose.position[:2] for pose in followed[::10]]),
                     path_errors(case.wanted(), position), table[:, 3:7], table[:, 7:11])


def _slip(plant: Plant, i: int, rolling: float) -> float:
    """Return the magnitude of the slip vector of wheel ``i``, at least with ``slip_floor``."""
    return (math.hypot(rolling - plant.wheel_v_x[i], plant.wheel_v_y[i])
            / max(abs(rolling), plant.slip_floor))
