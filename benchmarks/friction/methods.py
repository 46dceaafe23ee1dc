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

"""Friction estimation by the compared methods."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
import math
import time

from smart_tire.analysis.pipeline import EstimatorParams, SlipStage
from smart_tire.estimation import streams
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.parameters import FrictionEstimatorParams, RobotParams, SlipEstimatorParams
from smart_tire.samples import Friction, Odometry, Sample, TireSample, WheelSample, WheelSlip

WAVEFORM, EXACT_MAP, PRINTED_MAP = 'waveform', 'two_peaks_exact', 'two_peaks_printed'
METHODS = {WAVEFORM: 'waveform', EXACT_MAP: 'two peaks, exact map',
           PRINTED_MAP: 'two peaks, printed map'}
TRUE, ESTIMATED, AIDED = 'true', 'estimated', 'aided'
SOURCES = {TRUE: 'true slip', ESTIMATED: 'slip of slip_estimator',
           AIDED: 'slip of slip_estimator, aided by the films'}
COMPARED = {TRUE: (WAVEFORM,), ESTIMATED: tuple(METHODS), AIDED: (WAVEFORM,)}  # in simulated runs
TRUE_SLIP_SIGMA = 1e-4  # -, of true slip interpolated between samples at 100 Hz

Event = tuple[int, str, Sample]  # receive time [ns], topic, sample


@dataclass(frozen=True)
class EstimatorRun:
    """Estimates of a run, and CPU time per crossing [ms], including its detection."""

    crossings: list[Friction]
    ms: float


def estimator_params(method: str, robot: RobotParams) -> FrictionEstimatorParams:
    """Return the parameters of the friction estimator for one of ``METHODS``."""
    if method == WAVEFORM:
        return FrictionEstimatorParams(robot=robot)
    return FrictionEstimatorParams(
        method='two_peaks', map='exact' if method == EXACT_MAP else 'printed', robot=robot)


def robot_of(source: str, robot: RobotParams) -> RobotParams:
    """Return the robot parameters of the estimators for one of ``SOURCES``."""
    return replace(robot, slip=replace(robot.slip, film_aided=source == AIDED))


def inputs(events: Iterable[Event], source: str, robot: RobotParams) -> list[Sample]:
    """Return the inputs of the friction estimator with slip and motion of one of ``SOURCES``."""
    if source == TRUE:
        return [_exact(sample) for _, topic, sample in events
                if isinstance(sample, (TireSample, WheelSample))
                or topic in ('ground_truth/odom', 'ground_truth/wheel_slip')]
    params = EstimatorParams(
        SlipEstimatorParams(robot=robot), FrictionEstimatorParams(robot=robot))
    stage = SlipStage(params, SlipEstimator(params.slip))
    return [forwarded for _, topic, sample in events if not topic.startswith('ground_truth/')
            for forwarded in stage.update(sample)
            if type(forwarded) in streams.FRICTION.inputs]


def _exact(sample: Sample) -> Sample:
    """Return a true slip with a small sigma."""
    if not isinstance(sample, WheelSlip):
        return sample
    fl, fr, rl, rr = (1.0 if math.isnan(ratio) else TRUE_SLIP_SIGMA for ratio in sample.ratio)
    return replace(sample, sigma=(fl, fr, rl, rr))


def run_estimator(samples: Sequence[Sample], params: FrictionEstimatorParams) -> EstimatorRun:
    """Return the estimates from ``samples`` in the given order."""
    estimator = FrictionEstimator(params)
    begin = time.thread_time()
    found = [*(crossing for sample in samples for crossing in estimator.update(sample)),
             *estimator.finish()]
    return EstimatorRun(found, 1e3 * (time.thread_time() - begin) / max(len(found), 1))


def ground_truth(events: Iterable[Event]) -> list[Sample]:
    """Return the ground truth in ``events``."""
    return [sample for _, topic, sample in events if topic.startswith('ground_truth/')
            and isinstance(sample, (Odometry, WheelSlip, Friction))]
