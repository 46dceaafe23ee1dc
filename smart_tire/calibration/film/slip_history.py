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
Slip of a wheel during a patch crossing, from the estimates of slip_estimator.

Means over an interval keep the standard deviation of one sample: the errors of a filter are
correlated for longer than a crossing and do not average out.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
import math
from operator import attrgetter

import numpy as np

from smart_tire.samples import NS_PER_S, WHEELS, WheelSlip
from smart_tire.uncertain import Uncertain, UNKNOWN

HISTORY_LENGTH = 1024        # samples: 8 s at 125 Hz
MEAN_MARGIN_NS = 50_000_000  # at least, on either side of the interval, for the linear fit
MEAN_POINTS = 5              # in an interval, of which the mean is taken
MIN_SLOPE_SAMPLES = 6
_stamp = attrgetter('stamp_ns')


@dataclass(frozen=True, slots=True)
class CrossingSlip:
    """Mean slip of a wheel in an interval, and its change."""

    slip: Uncertain = UNKNOWN  # -, B(3)'s lambda
    rate: float = 0.0          # 1/s, slope of a linear fit ...
    residual: float = 0.0      # -, ... and its rms residual


class SlipHistory:
    """Recent slips; timestamps must not decrease."""

    def __init__(self) -> None:
        self._slips: list[WheelSlip] = []

    def add(self, sample: WheelSlip) -> None:
        """Add a sample; at twice the history's length, the older half is removed."""
        self._slips.append(sample)
        if len(self._slips) > 2 * HISTORY_LENGTH:
            del self._slips[:HISTORY_LENGTH]

    def mean(self, wheel: str, begin_ns: int, end_ns: int) -> CrossingSlip:
        """Return the mean slip of ``wheel`` between two instants."""
        index = WHEELS.index(wheel)
        # wide enough for the entry of film 1 and the release of the last film
        around_ns = max(MEAN_MARGIN_NS, end_ns - begin_ns)
        low = bisect_left(self._slips, begin_ns - around_ns, key=_stamp)
        high = bisect_right(self._slips, end_ns + around_ns, key=_stamp)
        slips = self._slips[low:high]
        known = [one for one in slips if math.isfinite(one.ratio[index])]
        if not known or len(known) < len(slips):
            return CrossingSlip()
        times = (np.array([one.stamp_ns for one in slips]) - begin_ns) / NS_PER_S
        ratio = np.array([one.ratio[index] for one in slips])
        points = np.linspace(0.0, (end_ns - begin_ns) / NS_PER_S, MEAN_POINTS)
        slip = Uncertain(*(float(np.interp(points, times, column).mean()) for column in (
            ratio, [one.sigma[index] for one in slips])))
        if len(slips) < MIN_SLOPE_SAMPLES:
            return CrossingSlip(slip)
        centered = times - times.mean()
        slope = float(centered @ ratio / (centered @ centered))
        return CrossingSlip(slip, slope, float(np.std(ratio - slope * centered)))
