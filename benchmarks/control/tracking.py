# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One run of the path tracking benchmark: distances from the wanted path, time, yaw rate."""

from __future__ import annotations

from collections.abc import Sequence
import math

from benchmarks.control.closed_loop import run_closed_loop
from benchmarks.control.other_plant import OtherPlant
from benchmarks.control.robot_stack import PathStack
from benchmarks.control.scenarios import MAX_DURATION, OWN, TrackingCase
from benchmarks.scoring import Errors, Figures, Run
import numpy as np
from scipy.ndimage import minimum_filter1d
from smart_tire.arrays import Array
from smart_tire.control.trajectory_control import PathState
from smart_tire.samples import NS_PER_S, Odometry, PlannedPath
from smart_tire.simulation.plant import Plant

SPACING = 0.001        # m, of the points of the wanted path
# m along the path, between the projections of two positions beyond what the robot moved: twice the
# distance from a cusp at which it turns back
REACH = 0.1
POSE_PERIOD = 0.05     # s, the period of the trajectory controller
MATCH_NS = 5_000_000   # from an estimated to the true pose at the same time


def run_tracking(case: TrackingCase, seed: int) -> Run:
    """Simulate ``case``; return its scores by kinematics."""
    stack = PathStack(case.stack(), case.wanted())
    run_closed_loop(case.simulator(seed), stack, MAX_DURATION,
                    plant=Plant if case.plant == OWN else OtherPlant)
    errors, values = score_drive(stack)
    return Run(case.name, seed, {f'{case.kinematics}.{name}': one for name, one in errors.items()},
               {f'{case.kinematics}.{name}': value for name, value in values.items()})


def score_drive(stack: PathStack) -> tuple[dict[str, Errors], Figures]:
    """Return the errors of a drive; their rms, time [s], length of the path [m] and arrival."""
    true, followed = stack.drive()
    errors = score_tracking(stack.path, true, followed)
    return errors, {
        **{f'{name}_rms': one.figures['rms'] for name, one in errors.items()},
        'duration': (true[-1].stamp_ns - stack.start_ns) / NS_PER_S,
        'length': SPACING * (len(dense_points(stack.path)) - 1),
        'arrived': float(stack.trajectory.state == PathState.ARRIVED)}


def score_tracking(wanted: PlannedPath, truth: Sequence[Odometry], followed: Sequence[Odometry]
                   ) -> dict[str, Errors]:
    """
    Return the errors of a run.

    Control and true are the distances [m] of ``followed``, the pose that the controller was given,
    and of ``truth`` from the path, localization is that between both, yaw the acceleration
    [rad/s2] over steps of ``POSE_PERIOD``.
    """
    control, true = (path_errors(wanted, np.array([
        one.position[:2] for one in sampled(poses)])) for poses in (followed, truth))
    return {'control': Errors.without_sigma(control), 'true': Errors.without_sigma(true),
            'localization': Errors.without_sigma(_localization(truth, followed)),
            'yaw': Errors.without_sigma(_yaw_accelerations(truth))}


def path_errors(wanted: PlannedPath, position: Array) -> Array:
    """
    Return the distances [m] of positions (n, 2), in order, from the path.

    Each is projected near the projection before it, so that parts of the path that cross, or meet
    at a cusp, are not mixed up: of all such sequences, the one with the least sum of squares.
    """
    points = dense_points(wanted)
    moved = np.hypot(*np.diff(position, axis=0, prepend=position[:1]).T)
    reaches = np.round((REACH + moved) / SPACING).astype(int).tolist()
    distances = np.empty((len(position), len(points)), np.float32)
    sums = np.empty_like(distances)
    least = np.where(np.arange(len(points)) == 0, 0.0, np.inf)  # it begins at the begin
    for n, reach in enumerate(reaches):
        distances[n] = np.hypot(*(points - position[n]).T)
        sums[n] = least = distances[n] ** 2 + minimum_filter1d(
            least, 2 * reach + 1, mode='constant', cval=np.inf)
    index, errors = int(sums[-1].argmin()), np.empty(len(position))
    for n in range(len(position) - 1, -1, -1):
        errors[n] = distances[n, index]
        first = max(index - reaches[n], 0)
        index = first + int(sums[n - 1, first:index + reaches[n] + 1].argmin())
    return errors


def dense_points(wanted: PlannedPath) -> Array:
    """Return points (n, 2) on the path, ``SPACING`` apart."""
    corners = np.array([pose[:2] for pose in wanted.poses])
    steps = np.hypot(*np.diff(corners, axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, arc[-1], max(math.ceil(arc[-1] / SPACING), 1) + 1)
    points: Array = np.column_stack([np.interp(at, arc, corners[:, i]) for i in (0, 1)])
    return points


def sampled(poses: Sequence[Odometry]) -> list[Odometry]:
    """Return the first of the poses in each ``POSE_PERIOD``."""
    steps = [round(one.stamp_ns / (POSE_PERIOD * NS_PER_S)) for one in poses]
    return [one for one, step, last in zip(poses, steps, [-1, *steps]) if step != last]


def _yaw_accelerations(truth: Sequence[Odometry]) -> Array:
    """Return the changes of the mean yaw rate [rad/s2]."""
    time = np.array([one.stamp_ns for one in truth], dtype=np.float64) / NS_PER_S
    step = ((time - time[0]) / POSE_PERIOD).astype(int)
    count = np.maximum(np.bincount(step), 1)
    mean = np.bincount(step, [one.angular[2] for one in truth]) / count
    changes: Array = np.diff(mean) / POSE_PERIOD
    return changes


def _localization(truth: Sequence[Odometry], followed: Sequence[Odometry]) -> Array:
    """Return the distances [m] of ``followed`` from the true position at the same time."""
    stamps = np.array([one.stamp_ns for one in truth])
    known = [one for one in followed
             if stamps[0] - MATCH_NS <= one.stamp_ns <= stamps[-1] + MATCH_NS]
    at = np.array([one.stamp_ns for one in known])
    error = [np.interp(at, stamps, [one.position[i] for one in truth])
             - [one.position[i] for one in known] for i in (0, 1)]
    return np.hypot(*error)
