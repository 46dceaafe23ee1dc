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

"""
Friction, stiffness and motion from the same run without and with motor torque.

Both are the estimates of the complete pipeline with the default parameters; without torque, the
efforts are removed from the same messages.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math
import time

from benchmarks.efforts import without_efforts
from benchmarks.friction.counting import counted, COUNTED_FROM, excited
from benchmarks.friction.methods import Event, ground_truth
from benchmarks.friction.records import Mask, match_rows, Rows, true_crossings
from benchmarks.friction.scoring import Change, changes
from benchmarks.slip.scoring import MIN_ROLLING_SPEED, slip_errors, steady_sides
from benchmarks.slip.series import as_estimate, as_truth, EstimateSeries, Truth
import numpy as np
from smart_tire.analysis.pipeline import EstimatorParams, Pipeline
from smart_tire.analysis.series import at, Floats
from smart_tire.parameters import FrictionEstimatorParams, RobotParams, SlipEstimatorParams
from smart_tire.samples import Friction, NS_PER_S, Sample

NO_TORQUE, TORQUE = 'no_torque', 'torque'
VARIANTS = {NO_TORQUE: 'no torque', TORQUE: 'torque'}
MAX_STRAIGHT_RATE = 0.02  # rad/s, yaw rate while cruising straight

Errors = tuple[Floats, Floats]  # errors and sigmas


@dataclass(frozen=True)
class Motion:
    """Errors and sigmas of slip [-] and lateral speed [m/s]; slips are (n, 2), left and right."""

    steady: tuple[Errors, Errors]       # left, right
    all_times: tuple[Errors, Errors]
    straight: Errors                    # of the mean of both sides, cruising straight
    lateral: Errors                     # while moving, from the fifth revolution


@dataclass(frozen=True)
class WheelPart:
    """Crossings of one film's wheel."""

    rows: Rows
    counted: Mask
    excited: Mask  # after 5 s of motion with a turn, start or stop
    surfaces: list[Change]


@dataclass(frozen=True)
class Variant:
    """Results of a run by one variant of the inputs."""

    wheels: dict[str, WheelPart]
    motion: Motion
    speedup: float  # duration of the run over CPU time of both estimators


@dataclass(frozen=True)
class ForceResult:
    """Results of one run."""

    run: str
    seed: int
    variants: dict[str, Variant]


def run_forces(name: str, seed: int, events: Sequence[Event], robot: RobotParams,
               first: int = COUNTED_FROM) -> ForceResult:
    """Return the results of a run; crossings count from the revolution ``first``."""
    records = ground_truth(events)
    truth = as_truth(records, robot)
    variants: dict[str, Variant] = {}
    for variant in VARIANTS:
        begin = time.thread_time()
        estimates = _estimates(inputs_of(events, variant), robot)
        spent = time.thread_time() - begin
        found = [one for one in estimates if isinstance(one, Friction)]
        wheels = {wheel: _part(match_rows(true_crossings(records, robot, wheel), found, wheel),
                               truth, first)
                  for wheel in robot.film.wheels}
        duration = (events[-1][0] - events[0][0]) / NS_PER_S
        variants[variant] = Variant(wheels, _motion(as_estimate(estimates), truth, first),
                                    duration / spent)
    return ForceResult(name, seed, variants)


def inputs_of(events: Iterable[Event], variant: str) -> list[Sample]:
    """Return the inputs of the estimators, without efforts of the wheels if without torque."""
    samples = [sample for _, topic, sample in events if not topic.startswith('ground_truth/')]
    return samples if variant == TORQUE else without_efforts(samples)


def _estimates(samples: Iterable[Sample], robot: RobotParams) -> list[Sample]:
    pipeline = Pipeline(EstimatorParams(
        SlipEstimatorParams(robot=robot), FrictionEstimatorParams(robot=robot)))
    found = [estimate for sample in samples for estimate in pipeline.update(sample)]
    return [*found, *pipeline.finish()]


def _part(rows: Rows, truth: Truth, first: int) -> WheelPart:
    return WheelPart(rows, counted(rows, first), excited(rows, truth), changes(rows))


def _motion(estimate: EstimateSeries, truth: Truth, first: int) -> Motion:
    steady = steady_sides(truth)
    error, sigma = slip_errors(estimate, truth)
    rolled = _rolled_distance(truth) > math.tau * truth.radius * first
    moving = rolled & (np.abs(truth.rolling).max(axis=1) > MIN_ROLLING_SPEED)
    straight = rolled & steady.all(axis=1) & (
        np.abs(truth.poses.twist[:, 2]) < MAX_STRAIGHT_RATE)
    left, right = ((error[steady[:, side], side], sigma[steady[:, side], side])
                   for side in (0, 1))
    whole_left, whole_right = ((error[:, side], sigma[:, side]) for side in (0, 1))
    poses = estimate.poses
    lateral = at(truth.stamp_ns, poses.stamp_ns, poses.twist[:, 1]) - truth.poses.twist[:, 1]
    variance = at(truth.stamp_ns, poses.stamp_ns, poses.twist_variance[:, 1])
    return Motion((left, right), (whole_left, whole_right),
                  (error[straight].mean(axis=1), sigma[straight].mean(axis=1)),
                  (lateral[moving], np.sqrt(variance[moving])))


def _rolled_distance(truth: Truth) -> Floats:
    """Return the mean distance [m] rolled by the wheels in either direction."""
    speed = np.abs(truth.rolling).mean(axis=1)
    steps = speed[1:] * np.diff(truth.stamp_ns) / NS_PER_S
    return np.concatenate([[0.0], np.cumsum(steps)])
