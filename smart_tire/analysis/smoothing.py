"""The slip estimator forward over samples, and its smoother back over the same way."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from smart_tire.analysis.series import Series
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.lag_compensation import compensate_lag
from smart_tire.estimation.slip.output import EstimateRecord, SlipOutputBuilder
from smart_tire.estimation.slip.rts_smoother import RtsSmoother
from smart_tire.estimation.slip.state import N
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.samples import Friction, ImuSample, Sample, WheelSample


class SmoothedSlip:
    """A slip estimator whose estimates can be had again in the light of the whole run."""

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._smoother = RtsSmoother(N)
        self._estimator = SlipEstimator(params, self._smoother)
        self._output = SlipOutputBuilder(params)

    def update(self, sample: ImuSample | WheelSample | Friction) -> list[EstimateRecord]:
        """Take a sample in; return the filter's estimates of the instants that it closes."""
        return self._estimator.update(sample)

    @property
    def late(self) -> Counter[str]:
        """Return topic -> samples that came too late."""
        return self._estimator.late

    def smoothed(self) -> Iterator[list[EstimateRecord]]:
        """Yield the smoothed estimates of one instant after the other: those of ``update``."""
        for state in compensate_lag(self._smoother.states()):
            yield self._output.build(state.context, state.x, state.P)

    def close(self) -> None:
        """Give the memory of the way back."""
        self._smoother.close()


@dataclass(frozen=True)
class BothWays:
    """The estimates of a run."""

    filtered: Series
    smoothed: Series


def smooth(params: SlipEstimatorParams, samples: Iterable[Sample]) -> BothWays:
    """
    Return what filter and smoother make of ``samples`` in the order of reception.

    Samples that are neither of the IMU nor of the wheels are passed over.
    """
    both, slip = BothWays(Series(), Series()), SmoothedSlip(params)
    for sample in samples:
        if isinstance(sample, (ImuSample, WheelSample)):
            for estimate in slip.update(sample):
                both.filtered.add(estimate)
    for estimates in slip.smoothed():
        for estimate in estimates:
            both.smoothed.add(estimate)
    slip.close()
    return both
