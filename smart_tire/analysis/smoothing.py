# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Slip estimator followed by the RTS smoother."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from smart_tire.estimation.ground.unknowns import LENGTH
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.estimator import EstimateRecord, SlipOutputBuilder
from smart_tire.estimation.slip.rts_smoother import RtsSmoother
from smart_tire.estimation.slip.state import ESTIMATED
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.recording import Recording
from smart_tire.samples import GroundState, ImuSample, NS_PER_S, Sample, WheelSample

HOLD_NS = 2 * NS_PER_S  # of inputs, until the ground of their time is known


class SmoothedSlip:
    """
    Slip estimator that also yields RTS-smoothed estimates.

    The smoother has a filter of its own, in which each state of the ground takes effect in the
    middle of the window that it was estimated from.
    """

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._smoother = RtsSmoother(ESTIMATED)
        self._estimator = SlipEstimator(params)
        self._recorded = SlipEstimator(params, self._smoother)
        self._ahead_ns = round((0.5 * LENGTH + params.ground_delay) * NS_PER_S)
        self._waiting: deque[ImuSample | WheelSample] = deque()
        self._output = SlipOutputBuilder(params)

    def update(self, sample: ImuSample | WheelSample | GroundState) -> list[EstimateRecord]:
        """Process a sample; return the filter estimates that it completes."""
        if isinstance(sample, GroundState):
            self._recorded.update(replace(sample, stamp_ns=sample.stamp_ns - self._ahead_ns))
        else:
            self._waiting.append(sample)
            while self._waiting[0].stamp_ns < sample.stamp_ns - HOLD_NS:
                self._recorded.update(self._waiting.popleft())
        return self._estimator.update(sample)

    @property
    def late(self) -> Counter[str]:
        """Return topic -> number of late samples."""
        return self._estimator.late

    def smoothed(self) -> Iterator[list[EstimateRecord]]:
        """Yield the smoothed estimates for the instants of ``update``, in the same order."""
        while self._waiting:
            self._recorded.update(self._waiting.popleft())
        for state in self._smoother.states():
            yield self._output.build(state.context, state.x, state.P)

    def close(self) -> None:
        """Release the recorded filter states."""
        self._smoother.close()


@dataclass(frozen=True)
class FilteredAndSmoothed:
    """Estimates of the filter and of the smoother."""

    filtered: Recording
    smoothed: Recording


def smooth(params: SlipEstimatorParams, samples: Iterable[Sample]) -> FilteredAndSmoothed:
    """
    Return filtered and smoothed estimates from ``samples`` in order of reception.

    Samples other than those of IMU, wheels and ground are ignored.
    """
    both, slip = FilteredAndSmoothed(Recording(), Recording()), SmoothedSlip(params)
    for sample in samples:
        if isinstance(sample, (ImuSample, WheelSample, GroundState)):
            for estimate in slip.update(sample):
                both.filtered.add_sample(estimate)
    for estimates in slip.smoothed():
        for estimate in estimates:
            both.smoothed.add_sample(estimate)
    slip.close()
    return both
