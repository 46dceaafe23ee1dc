"""Stamps for a stream that is regular at its source but tells no time, such as ASCII output."""

from __future__ import annotations

import math
import statistics

from smart_tire.drivers.clock_sync import ClockSync

LEARN = 32            # arrivals that the period is first measured from
PERIOD_SIGMA = 0.01   # relative, of a period measured from so many jittering arrivals
# So many messages in a row, all late by half a period, mean that one was lost before them. Chance
# is ruled out: with an exponential delay they are as many that its likelihood is below e^-25.
LATE_ROW = (8, 64)
LATE_ROW_PER_JITTER = 50  # per period of mean delay


class ArrivalTimestamps:
    """
    Count messages and let the count be the device's clock.

    The first ``LEARN`` are stamped with their arrival; the others with the regular instant that
    lies the link's constant delay, ``latency``, before their smoothed arrival. Messages that are
    known to be lost are given as ``missed``; unknown losses show in a row of late messages.
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
        """Return the period [s] by the host's clock, 0 until it is known."""
        return self._period_ns * 1e-9 * (1.0 + self._clock.drift)

    def update(self, receive_ns: int, missed: int = 0) -> int:
        """Return the stamp of a message that came at ``receive_ns``, later than the last one."""
        self._count += 1 + missed
        stamp_ns = self._regular(receive_ns) if self._period_ns else self._learn(receive_ns)
        self._last_ns = max(stamp_ns, self._last_ns + 1)
        return self._last_ns

    def _learn(self, receive_ns: int) -> int:
        self._arrivals.append((self._count, receive_ns))
        if len(self._arrivals) == LEARN:
            counts, times = zip(*self._arrivals)
            start = times[0]
            self._period_ns = statistics.linear_regression(
                counts, [time - start for time in times]).slope
            for count, time in self._arrivals:
                self._clock.update(round(count * self._period_ns), time)
        return receive_ns

    def _regular(self, receive_ns: int) -> int:
        excess = self._clock.excess(round(self._count * self._period_ns), receive_ns)
        period = self._period_ns * 1e-9
        least, most = LATE_ROW
        row = min(max(math.ceil(LATE_ROW_PER_JITTER * self._clock.jitter / period), least), most)
        self._late = [*self._late, excess][-row:]
        periods = round(min(self._late) / period)
        if periods < 0 or len(self._late) == row and periods > 0:
            self._count = max(self._count + periods, 1)
            self._late.clear()
        return self._clock.update(round(self._count * self._period_ns), receive_ns)
