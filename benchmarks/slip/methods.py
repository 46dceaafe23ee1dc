# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Estimates of one run by the estimator under test and by the methods for comparison."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math
import time

from benchmarks.events import has_efforts, without_efforts
from benchmarks.motion import as_estimate, Estimate
from benchmarks.scoring import mean
from smart_tire.analysis.dead_reckoning import (
    as_inputs, gyro_odometry, GYRO_WHEELS, wheel_odometry, WHEELS_ONLY)
from smart_tire.analysis.pipeline import SmoothedSlip
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import ImuSample, NS_PER_S, Odometry, Sample, WheelSample

NIS_PERIOD = 0.1  # s, between two values of the innovation statistic
LIVE, SMOOTHED = 'live', 'smoothed'
LIVE_TORQUE, SMOOTHED_TORQUE = 'live_torque', 'smoothed_torque'  # only if torques were measured
METHODS = {
    LIVE: 'live', SMOOTHED: 'smoothed',
    LIVE_TORQUE: 'live, with torque', SMOOTHED_TORQUE: 'smoothed, with torque',
    'wheels': WHEELS_ONLY, 'gyro': GYRO_WHEELS}


def compare_methods(samples: Sequence[Sample], params: SlipEstimatorParams
                    ) -> dict[str, Estimate]:
    """Return the estimates of ``METHODS`` from ``samples`` in order of reception."""
    inputs = as_inputs(SampleArrays(samples), params.robot)
    plain = without_efforts(samples)
    return {
        LIVE: live_estimate(plain, params), SMOOTHED: smoothed_estimate(plain, params),
        **({LIVE_TORQUE: live_estimate(samples, params),
            SMOOTHED_TORQUE: smoothed_estimate(samples, params)} if has_efforts(samples) else {}),
        'wheels': Estimate(*wheel_odometry(inputs)), 'gyro': Estimate(*gyro_odometry(inputs))}


def live_estimate(samples: Iterable[Sample], params: SlipEstimatorParams) -> Estimate:
    """Return the online estimates from ``samples`` in order of reception."""
    estimator, records, innovations = SlipEstimator(params), list[Sample](), list[float]()
    spent, next_ns = 0.0, -math.inf
    for sample in samples:
        if not isinstance(sample, (ImuSample, WheelSample)):
            continue
        begin = time.thread_time()
        estimates = estimator.update(sample)
        spent += time.thread_time() - begin
        records += estimates
        if estimates and estimates[0].stamp_ns >= next_ns:
            next_ns = estimates[0].stamp_ns + NIS_PERIOD * NS_PER_S
            innovations.append(float(estimator.status()['normalized_innovation_squared']))
    steps = sum(isinstance(record, Odometry) for record in records)
    return as_estimate(records, mean(innovations), 1e6 * spent / max(steps, 1))


def smoothed_estimate(samples: Iterable[Sample], params: SlipEstimatorParams) -> Estimate:
    """Return the smoothed estimates from ``samples``."""
    slip = SmoothedSlip(params)
    try:
        for sample in samples:
            if isinstance(sample, (ImuSample, WheelSample)):
                slip.update(sample)
        return as_estimate(record for records in slip.smoothed() for record in records)
    finally:
        slip.close()
