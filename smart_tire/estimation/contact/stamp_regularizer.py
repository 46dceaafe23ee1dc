"""
Stamps of one wheel unit as regular as its conversions.

A unit converts on its own steady timer, but each batch of stamps is off by what the receiver did
not know of the radio's delay: 0.5 ms between two batches is half a millimetre of travel within
one contact, more than the friction shows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

MEMORY = 200         # samples, over which the stamps' errors average out
STEP_NS = 3_000_000  # of a stamp beyond the regular one, after which the unit was reset


class StampRegularizer:
    """Follows stamps [ns] that should be multiples of a period apart."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._last: float | None = None  # regular stamp of the newest sample
        self._count = 0

    def regular(self, stamps: Sequence[int]) -> NDArray[np.int64]:
        """Return ``stamps``, which follow those of earlier calls, made regular."""
        period, last, count = self._period_ns, self._last, self._count
        half, farthest, out = period / 2, min(STEP_NS, period), []
        for stamp in stamps:
            if last is not None:
                regular = last + period
                off = stamp - regular
                if not -half < off < half:
                    regular = last + period * max(round((stamp - last) / period), 1)
                    off = stamp - regular
            if last is None or not -farthest < off < farthest:
                last, count = float(stamp), 1
            else:
                if count < MEMORY:
                    count += 1
                last = regular + off / count
            out.append(last)
        self._last, self._count = last, count
        return np.rint(out).astype(np.int64)
