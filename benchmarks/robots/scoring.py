# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Scores of the estimators on drawn robots.

Errors of mu are relative, of the fused coefficient from the revolution ``COUNTED_FROM`` on the
present ground; slips count while steady (``benchmarks.motion``), speeds at all times of motion
after ``SETTLING_TIME``. Errors of the pose, aligned at the start, are those of the estimate and of
dead reckoning with the same nominal robot.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import time

from benchmarks.events import inputs_of, truth_of
from benchmarks.friction.crossings import (
    COUNTED_FROM, FUSED, match_rows, relative_errors, revolutions_on_ground, true_crossings)
from benchmarks.motion import (
    as_estimate, as_truth, Estimate, in_motion, path_errors, SETTLING_TIME, slip_errors,
    speed_errors, steady_sides)
from benchmarks.robots.draws import Draw
from benchmarks.scoring import Errors, pooled, Run
from smart_tire.analysis.dead_reckoning import baselines, GYRO_WHEELS
from smart_tire.analysis.pipeline import Pipeline
from smart_tire.parameters import RobotParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import Friction, NS_PER_S, Sample

MU, SLIP, SPEED, LATERAL = QUANTITIES = 'mu', 'slip', 'u', 'v_y'
POSITION, HEADING = 'position', 'heading'  # of ``path_errors``
OURS = 'estimate'
GROUND = ('stiffness',)  # true quantity that differs between grounds; mu falls with the slip, too


def run_robot(one: Draw) -> Run:
    """Return the results of the estimators for a drawn robot, and CPU time over its duration."""
    events = one.events()
    inputs, truth = inputs_of(events), truth_of(events)
    begin = time.thread_time()
    estimates = estimates_of(one, inputs)
    spent = time.thread_time() - begin
    duration = (events[-1][0] - events[0][0]) / NS_PER_S
    poses = score_poses(estimates, SampleArrays(inputs), truth, one)
    better = poses[f'{POSITION}, {OURS}'].figures['rms'] < poses[
        f'{POSITION}, {GYRO_WHEELS}'].figures['rms']
    return Run(one.row, one.seed, score_robot(estimates, truth, one.true) | poses,
               {'load': spent / duration, 'better': float(better)})


def estimates_of(one: Draw, inputs: Iterable[Sample]) -> list[Sample]:
    """Return the estimates of the complete pipeline."""
    pipeline = Pipeline(one.params)
    estimates: list[Sample] = [estimate for sample in inputs
                               for estimate in pipeline.update(sample)]
    return [*estimates, *pipeline.finish()]


def score_poses(estimates: Iterable[Sample], inputs: SampleArrays, truth: Iterable[Sample],
                one: Draw) -> dict[str, Errors]:
    """Return the errors of position [m] and heading [rad] by quantity and method."""
    motion, own = as_truth(truth, one.true), as_estimate(estimates)
    methods = {OURS: own, **{name: Estimate(poses, own.slips)
                             for name, poses in baselines(inputs, one.robot).items()}}
    return {f'{name}, {method}': errors for method, estimate in methods.items()
            for name, errors in path_errors(estimate, motion)[0].items()}


def score_robot(estimates: Sequence[Sample], truth: Sequence[Sample], robot: RobotParams
                ) -> dict[str, Errors]:
    """Return the errors of ``estimates``; ``robot`` is the true one."""
    motion, series = as_truth(truth, robot), as_estimate(estimates)
    crossings = [sample for sample in estimates if isinstance(sample, Friction)]
    wheels = [_friction_errors(crossings, truth, robot, wheel) for wheel in robot.film.wheels]
    steady, (error, sigma) = steady_sides(motion), slip_errors(series, motion)
    age = (motion.stamp_ns - motion.stamp_ns[0]) / NS_PER_S
    moving = in_motion(motion) & (age > SETTLING_TIME)
    return {MU: pooled(wheels), SLIP: Errors(error[steady], sigma[steady]),
            **{name: speed_errors(series, motion, axis, moving)
               for axis, name in enumerate((SPEED, LATERAL))}}


def _friction_errors(estimates: Sequence[Friction], truth: Sequence[Sample], robot: RobotParams,
                     wheel: str) -> Errors:
    """Return the relative errors of the fused mu of ``wheel``."""
    rows = match_rows(true_crossings(truth, robot, wheel), estimates, wheel)
    counts = revolutions_on_ground(rows, GROUND) >= COUNTED_FROM
    return relative_errors(rows, FUSED, counts)
