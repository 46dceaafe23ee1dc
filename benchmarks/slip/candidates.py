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

"""The slip estimator under test: online filter and RTS smoother."""

from __future__ import annotations

from collections.abc import Iterable
import time

from benchmarks.slip.series import as_estimate, EstimateSeries, Statistic
import numpy as np
from smart_tire.analysis.smoothing import SmoothedSlip
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.samples import ImuSample, NS_PER_S, Odometry, Sample, WheelSample

NIS_PERIOD = 0.1  # s, between two values of the innovation statistic


def live_estimate(samples: Iterable[Sample], params: SlipEstimatorParams) -> EstimateSeries:
    """Return the online estimates from ``samples`` in order of reception."""
    estimator, records = SlipEstimator(params), list[Sample]()
    statistic: list[tuple[int, float]] = []  # timestamp [ns] and value
    spent, steps, next_ns = 0.0, 0, 0
    for sample in samples:
        if not isinstance(sample, (ImuSample, WheelSample)):
            continue
        begin = time.thread_time()
        estimates = estimator.update(sample)
        spent += time.thread_time() - begin
        records += estimates
        for estimate in estimates:
            steps += isinstance(estimate, Odometry)
        if estimates and estimates[0].stamp_ns >= next_ns:
            next_ns = estimates[0].stamp_ns + round(NIS_PERIOD * NS_PER_S)
            nis = float(estimator.status()['normalized_innovation_squared'])
            statistic.append((estimates[0].stamp_ns, nis))
    innovations = Statistic(np.array([stamp for stamp, _ in statistic], np.int64),
                            np.array([nis for _, nis in statistic]))
    return as_estimate(records, innovations, 1e6 * spent / max(steps, 1))


def smoothed_estimate(samples: Iterable[Sample], params: SlipEstimatorParams) -> EstimateSeries:
    """Return the smoothed estimates from ``samples``."""
    slip = SmoothedSlip(params)
    try:
        for sample in samples:
            if isinstance(sample, (ImuSample, WheelSample)):
                slip.update(sample)
        return as_estimate(record for records in slip.smoothed() for record in records)
    finally:
        slip.close()
