# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Values of the latest seconds by their times."""

from __future__ import annotations

from bisect import bisect

from smart_tire.control import constants as c
from smart_tire.samples import NS_PER_S


class History:
    """Numbers at increasing times [ns] that span the latest ``HISTORY_NS``; at least two."""

    def __init__(self) -> None:
        self.times: list[int] = []
        self.values: list[tuple[float, ...]] = []  # that are kept, by their times

    def clear(self) -> None:
        """Forget all values."""
        self.times.clear()
        self.values.clear()

    def add(self, time_ns: int, *values: float) -> None:
        """Add the values at a time; discard all others if it is before the latest one."""
        if self.times and time_ns < self.times[-1]:
            self.clear()
        self.times.append(time_ns)
        self.values.append(values)
        old = min(bisect(self.times, time_ns - c.HISTORY_NS) - 1, len(self.times) - 2)
        if old > 0:
            del self.times[:old], self.values[:old]

    @property
    def latest(self) -> tuple[float, ...]:
        """Return the latest values; there must be some."""
        return self.values[-1]

    def held(self, time_ns: int, max_age_ns: int = c.HISTORY_NS) -> tuple[float, ...] | None:
        """Return the latest values up to a time, None if there are none or if they are older."""
        after = bisect(self.times, time_ns)
        recent = after and time_ns - self.times[after - 1] <= max_age_ns
        return self.values[after - 1] if recent else None

    def at(self, time_ns: int) -> tuple[float, ...]:
        """Return values on the line through those before and after a time; two are needed."""
        after = min(max(bisect(self.times, time_ns), 1), len(self.times) - 1)
        begin_ns = self.times[after - 1]
        share = (time_ns - begin_ns) / max(self.times[after] - begin_ns, 1)
        return tuple([one + share * (two - one) for one, two in zip(
            self.values[after - 1], self.values[after])])


def time_step(now_ns: int, before_ns: int | None, rate: float) -> float:
    """Return the time [s] of a controller's step since the one before; a period for the first."""
    if before_ns is None or now_ns <= before_ns:
        return 1.0 / rate
    return min((now_ns - before_ns) / NS_PER_S, c.MAX_STEP_PERIODS / rate)
