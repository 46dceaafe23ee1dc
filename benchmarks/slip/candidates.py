"""The slip estimator under test: as the node runs it, and smoothed afterwards."""

from __future__ import annotations

from collections.abc import Iterable
import time

from benchmarks.slip.series import as_estimate, EstimateSeries, Statistic
from smart_tire.analysis.series import Table
from smart_tire.analysis.smoothing import SmoothedSlip
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.samples import ImuSample, NS_PER_S, Odometry, Sample, WheelSample

STATUS_EVERY = 0.1  # s, between two readings of the innovation statistic


def live_estimate(samples: Iterable[Sample], params: SlipEstimatorParams) -> EstimateSeries:
    """Return what the estimator tells while ``samples`` come in, in the order of reception."""
    estimator, records, statistic = SlipEstimator(params), list[Sample](), Table(1)
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
            next_ns = estimates[0].stamp_ns + round(STATUS_EVERY * NS_PER_S)
            nis = float(estimator.status()['normalised_innovation_squared'])
            statistic.add(estimates[0].stamp_ns, (nis,))
    stamps, values = statistic.arrays()
    return as_estimate(records, Statistic(stamps, values[:, 0]), 1e6 * spent / max(steps, 1))


def smoothed_estimate(samples: Iterable[Sample], params: SlipEstimatorParams) -> EstimateSeries:
    """Return what the smoother tells when all ``samples`` are in."""
    slip = SmoothedSlip(params)
    try:
        for sample in samples:
            if isinstance(sample, (ImuSample, WheelSample)):
                slip.update(sample)
        return as_estimate(record for records in slip.smoothed() for record in records)
    finally:
        slip.close()
