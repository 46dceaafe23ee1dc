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

"""Timestamps for a periodic stream without device time, such as ASCII output of an IMU."""

from __future__ import annotations

import math
import statistics

from smart_tire.drivers.clock_sync import ClockSync

PERIOD_FIT_ARRIVALS = 32       # arrivals from which the period is first estimated
PERIOD_SIGMA = 0.01            # -, relative standard deviation of that estimate
# Consecutive messages, all late by more than half a period, that indicate an undetected loss. With
# an exponential delay the probability of a false alarm is below e^-25.
MIN_LATE_MESSAGES, MAX_LATE_MESSAGES = 8, 64
LATE_MESSAGES_PER_JITTER = 50  # messages per period of mean delay


class ArrivalTimestamps:
    """
    Synchronizes the message count, used as the device clock, with the host clock.

    The first ``PERIOD_FIT_ARRIVALS`` messages get their arrival times, all others regular
    timestamps from the fitted period; the constant delay of the link remains in them. Known losses
    are passed as ``missed``; unknown losses are detected by consecutive late messages.
    """

    def __init__(self) -> None:
        self._clock = ClockSync(PERIOD_SIGMA)
        self._arrivals: list[tuple[int, int]] = []  # count, host time
        self._count = 0
        self._period_ns = 0.0
        self._late: list[float] = []
        self._last_ns = 0

    @property
    def period(self) -> float:
        """Return the period [s] by the host clock, 0 before it is estimated."""
        return self._period_ns * 1e-9 * (1.0 + self._clock.drift)

    def update(self, receive_ns: int, missed: int = 0) -> int:
        """Return the timestamp of a message received at ``receive_ns``; timestamps ascend."""
        self._count += 1 + missed
        stamp_ns = self._regular(receive_ns) if self._period_ns else self._fit(receive_ns)
        self._last_ns = max(stamp_ns, self._last_ns + 1)
        return self._last_ns

    def _fit(self, receive_ns: int) -> int:
        self._arrivals.append((self._count, receive_ns))
        if len(self._arrivals) == PERIOD_FIT_ARRIVALS:
            counts, times = zip(*self._arrivals)
            start = times[0]
            self._period_ns = statistics.linear_regression(
                counts, [time - start for time in times]).slope
            for count, time in self._arrivals:
                self._clock.update(round(count * self._period_ns), time)
        return receive_ns

    def _regular(self, receive_ns: int) -> int:
        excess = self._clock.excess_delay(round(self._count * self._period_ns), receive_ns)
        period = self._period_ns * 1e-9
        needed = math.ceil(LATE_MESSAGES_PER_JITTER * self._clock.jitter / period)
        needed = min(max(needed, MIN_LATE_MESSAGES), MAX_LATE_MESSAGES)
        self._late = [*self._late, excess][-needed:]
        periods = round(min(self._late) / period)
        if periods < 0 or len(self._late) == needed and periods > 0:
            self._count = max(self._count + periods, 1)
            self._late.clear()
        return self._clock.update(round(self._count * self._period_ns), receive_ns)
