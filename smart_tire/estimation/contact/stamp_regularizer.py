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
Regularizes the timestamps of one sensor node.

A sensor node samples at a constant rate, but each batch of timestamps has an error of its own
from the unknown part of the radio delay: 0.5 ms between two batches is half a millimeter of
travel within one crossing, more than the effect of friction.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

AVERAGING_SAMPLES = 200  # over which timestamp errors average out
RESET_STEP_NS = 3_000_000  # deviation from the regular timestamp that means a reset of the node


class StampRegularizer:
    """Tracks timestamps [ns] with a nominally constant period."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._last: float | None = None  # regularized timestamp of the newest sample
        self._count = 0

    def regularize(self, stamps: Sequence[int]) -> NDArray[np.int64]:
        """Return ``stamps``, which continue those of earlier calls, regularized."""
        period, last, count = self._period_ns, self._last, self._count
        half, max_error, out = period / 2, min(RESET_STEP_NS, period), []
        for stamp in stamps:
            if last is not None:
                regular = last + period
                error = stamp - regular
                if not -half < error < half:
                    regular = last + period * max(round((stamp - last) / period), 1)
                    error = stamp - regular
            if last is None or not -max_error < error < max_error:
                last, count = float(stamp), 1
            else:
                if count < AVERAGING_SAMPLES:
                    count += 1
                last = regular + error / count
            out.append(last)
        self._last, self._count = last, count
        return np.rint(out).astype(np.int64)
