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
from dataclasses import dataclass
import time

from smart_tire.estimation import streams
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.parameters import FrictionEstimatorParams, RobotParams
from smart_tire.samples import Friction, Odometry, Sample, WheelSlip

WAVEFORM, EXACT_MAP, PRINTED_MAP = 'waveform', 'two_peaks_exact', 'two_peaks_printed'
METHODS = {WAVEFORM: 'waveform', EXACT_MAP: 'two peaks, exact map',
           PRINTED_MAP: 'two peaks, printed map'}

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


def inputs(events: Iterable[Event]) -> list[Sample]:
    """Return the inputs of the friction estimator in ``events``."""
    return [sample for _, topic, sample in events
            if streams.FRICTION.inputs.get(type(sample)) == topic]


def run_estimator(samples: Sequence[Sample], params: FrictionEstimatorParams) -> EstimatorRun:
    """Return the estimates from ``samples`` in the given order."""
    estimator = FrictionEstimator(params)
    begin = time.thread_time()
    estimates = [*(one for sample in samples for one in estimator.update(sample)),
                 *estimator.finish()]
    found = [one for one in estimates if isinstance(one, Friction)]
    return EstimatorRun(found, 1e3 * (time.thread_time() - begin) / max(len(found), 1))


def ground_truth(events: Iterable[Event]) -> list[Sample]:
    """Return the ground truth in ``events``."""
    return [sample for _, topic, sample in events if topic.startswith('ground_truth/')
            and isinstance(sample, (Odometry, WheelSlip, Friction))]
