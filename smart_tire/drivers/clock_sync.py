# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Clock synchronization over a link with varying delay: maps device time to host time.

The delay of a message is a constant plus a variable part that is never negative. In a plot of host
time against device time, the messages with minimum delay therefore lie on a line, and all others
above it: the line is the lower convex hull of the arrivals. Its offset contains the constant
delay, which is not observable. The parameters named ``latency`` are this constant: the minimum
time from the instant on the device clock to the arrival of the last byte.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

S_PER_NS = 1e-9
FIT_WINDOW = 60.0           # s of arrivals in the fit; crystal drift changes within minutes
MAX_BINS = 64               # bins of arrivals in the fit
DRIFT_SIGMA = 50e-6         # -, crystals of sensor nodes and IMUs: some tens of ppm
MIN_JITTER = 20e-6          # s, keeps the weights finite on a link without jitter
MAX_TIMESTAMP_SLEW = 0.1    # share of elapsed time by which corrections may change timestamps
MAX_TIMESTAMP_LEAD = 0.05   # s after reception; exceeded only if the first messages were delayed
MIN_TIMESTAMP_RATE = 0.1    # share of elapsed time by which timestamps beyond that lead advance
MAX_EARLY_ARRIVAL = 0.1     # s before the line; an earlier message cannot be of this clock
MAX_LATE_ARRIVAL = 5.0      # s after the line; a later message cannot be of this clock
CLOCK_STEP_THRESHOLD = 0.1  # s after the line; exceeded consecutively if a clock was set
CLOCK_STEP_MESSAGES = 50    # consecutive messages that indicate a clock step
DELAY_CLIP_JITTERS = 5.0    # mean delays at which a delay is clipped: a pause is not jitter
DRIFT_HUBER_SIGMAS = 2.0    # sigmas of drift above which the prior is linear, not quadratic
PERIOD_FIT_ARRIVALS = 32       # arrivals from which the period is first estimated
PERIOD_SIGMA = 0.01            # -, relative standard deviation of that estimate
# Consecutive messages, all late by more than half a period, that indicate an undetected loss. With
# an exponential delay the probability of a false alarm is below e^-25.
MIN_LATE_MESSAGES, MAX_LATE_MESSAGES = 8, 64
LATE_MESSAGES_PER_JITTER = 50  # messages per period of mean delay


@dataclass
class _Bin:
    """Consecutive messages; times are relative to the origin [s]."""

    count: int
    sum_time: float
    sum_lag: float
    low_time: float  # of the message with minimum delay at the present drift
    low_lag: float

    def merge(self, other: _Bin, drift: float) -> bool:
        """Merge ``other`` into this bin; return whether it has the message of minimum delay."""
        self.count += other.count
        self.sum_time += other.sum_time
        self.sum_lag += other.sum_lag
        lower = other.low_lag - self.low_lag < drift * (other.low_time - self.low_time)
        if lower:
            self.low_time, self.low_lag = other.low_time, other.low_lag
        return lower


class ClockSync:
    """
    Maps the time of a device clock to host time: fitted line, continuous monotonic timestamps.

    The line is the maximum a posteriori estimate for exponentially distributed delays and a
    normally distributed drift with zero mean. Corrections from new messages change the timestamps
    by at most ``MAX_TIMESTAMP_SLEW``, so they have no steps.
    """

    def __init__(self, drift_sigma: float = DRIFT_SIGMA) -> None:
        self._drift_sigma = drift_sigma
        self._restart(0, 0)

    def _restart(self, device_ns: int, receive_ns: int) -> None:
        self._origin = (device_ns, receive_ns)
        self._bins: list[_Bin] = []
        self._per_bin = 1         # messages
        self.drift = 0.0          # -, host seconds per device second, minus 1
        self._floor = 0.0         # s, lag of the line at the origin
        self.jitter = MIN_JITTER  # s, mean variable delay
        self._late_messages = 0   # consecutive
        self._anchors = ((device_ns, receive_ns), (device_ns, receive_ns))

    def reset(self) -> None:
        """Discard the fit, as after a restart of the device."""
        self._bins.clear()

    def add_arrival(self, device_ns: int, receive_ns: int) -> int:
        """
        Update the fit with a message of ``device_ns`` received at ``receive_ns``.

        Returns the host time of ``device_ns``, which must not wrap. The fit restarts if the
        message is not consistent with the clock: older than the one before, too early or too late.
        """
        if self._bins and device_ns == self._anchors[1][0]:
            return self._anchors[1][1]
        if not self.is_consistent(device_ns, receive_ns):
            self._restart(device_ns, receive_ns)
        late = self.excess_delay(device_ns, receive_ns) > CLOCK_STEP_THRESHOLD
        self._late_messages = self._late_messages + 1 if late else 0
        self._add_to_bins(device_ns, receive_ns)
        self._advance(device_ns, receive_ns)
        return self._anchors[1][1]

    def is_consistent(self, device_ns: int, receive_ns: int) -> bool:
        """Return whether a message is consistent with the present fit."""
        if not self._bins or device_ns < self._anchors[1][0]:
            return False
        excess = self.excess_delay(device_ns, receive_ns)
        stepped = self._late_messages >= CLOCK_STEP_MESSAGES
        return -MAX_EARLY_ARRIVAL < excess < (
            CLOCK_STEP_THRESHOLD if stepped else MAX_LATE_ARRIVAL)

    def host_ns(self, device_ns: int) -> int:
        """Return the host time at ``device_ns``, interpolated between the last two messages."""
        (device_0, host_0), (device_1, host_1) = self._anchors
        rate = (host_1 - host_0) / (device_1 - device_0) if device_1 > device_0 else 1.0
        return host_1 + round((device_ns - device_1) * rate)

    def _relative(self, device_ns: int, receive_ns: int) -> tuple[float, float]:
        elapsed = device_ns - self._origin[0]
        return elapsed * S_PER_NS, (receive_ns - self._origin[1] - elapsed) * S_PER_NS

    def excess_delay(self, device_ns: int, receive_ns: int) -> float:
        """Return the variable delay of a message [s]: its arrival after the fitted line."""
        time, lag = self._relative(device_ns, receive_ns)
        return lag - self._floor - self.drift * time

    def _add_to_bins(self, device_ns: int, receive_ns: int) -> None:
        time, lag = self._relative(device_ns, receive_ns)
        max_lag = self._floor + self.drift * time + DELAY_CLIP_JITTERS * self.jitter
        message = _Bin(1, time, min(lag, max_lag), time, lag)
        if self._bins and self._bins[-1].count < self._per_bin:
            if not self._bins[-1].merge(message, self.drift):
                return
        else:
            self._bins.append(message)
            self._limit_bins(time - FIT_WINDOW)
        self._fit()

    def _limit_bins(self, before: float) -> None:
        """Drop bins older than ``before`` [s]; merge neighbors if there are too many bins."""
        while self._bins[0].low_time < before:
            del self._bins[0]
        if len(self._bins) > MAX_BINS:
            for bin_, following in zip(self._bins[::2], self._bins[1::2]):
                bin_.merge(following, self.drift)
            self._bins = self._bins[::2]
            self._per_bin *= 2

    def _fit(self) -> None:
        count = sum(bin_.count for bin_ in self._bins)
        mean_time = sum(bin_.sum_time for bin_ in self._bins) / count
        mean_lag = sum(bin_.sum_lag for bin_ in self._bins) / count
        corners = lower_hull([(bin_.low_time, bin_.low_lag) for bin_ in self._bins])
        weight = count / self.jitter * self._drift_sigma**2
        self.drift, (time, lag) = _best_slope(
            corners, mean_time, weight, DRIFT_HUBER_SIGMAS * self._drift_sigma)
        envelope = lag - self.drift * time
        above = mean_lag - self.drift * mean_time - envelope
        self.jitter = max(above, MIN_JITTER)
        # The minimum of n exponential delays is the mean delay / n on average.
        self._floor = envelope - above / count

    def _advance(self, device_ns: int, receive_ns: int) -> None:
        """
        Advance the timestamps towards the line at a limited rate.

        They are slowed down further where they would lie well after the reception: messages that
        were delayed before the port was first read arrived all at once, with unknown delays.
        """
        device_0, host_0 = self._anchors[1]
        time = (device_ns - self._origin[0]) * S_PER_NS
        line_ns = self._origin[1] + (device_ns - self._origin[0]) + round(
            (self._floor + self.drift * time) / S_PER_NS)
        step = device_ns - device_0
        if step > 0:
            slack = round(MAX_TIMESTAMP_SLEW * step)
            earliest = host_0 + step - slack
            latest = receive_ns + round(MAX_TIMESTAMP_LEAD / S_PER_NS)
            if earliest > latest:
                earliest = max(host_0 + round(MIN_TIMESTAMP_RATE * step), latest)
            host_ns = min(max(line_ns, earliest), host_0 + step + slack)
            self._anchors = (self._anchors[1], (device_ns, host_ns))


def lower_hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the vertices of the lower convex hull of ``points``, which ascend in x."""
    hull: list[tuple[float, float]] = []
    for x, y in points:
        while len(hull) >= 2 and _slope(hull[-2], hull[-1]) >= _slope(hull[-1], (x, y)):
            hull.pop()
        hull.append((x, y))
    return hull


def _slope(start: tuple[float, float], end: tuple[float, float]) -> float:
    return (end[1] - start[1]) / (end[0] - start[0])


def _best_slope(corners: list[tuple[float, float]], mean_time: float, weight: float,
                limit: float) -> tuple[float, tuple[float, float]]:
    """
    Return slope and supporting vertex of the most probable line below all points.

    It minimizes ``count * (mean height above the line) / jitter + slope**2 / (2 sigma**2)``,
    convex in the slope; ``weight`` is ``count * sigma**2 / jitter``. The prior costs of a slope
    beyond ``limit`` are linear (Huber), so that large drifts are found quickly. A line touches a
    vertex for the slopes between those of its two edges.
    """
    min_slope = -math.inf
    for corner, following in zip(corners, corners[1:]):
        max_slope = _slope(corner, following)
        best = weight * (mean_time - corner[0])
        if abs(best) > limit:
            best = math.copysign(math.inf, best)
        if best <= max_slope:
            return max(best, min_slope), corner
        min_slope = max_slope
    best = min(max(weight * (mean_time - corners[-1][0]), -limit), limit)
    return max(best, min_slope), corners[-1]


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

    def timestamp(self, receive_ns: int, missed: int = 0) -> int:
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
            import statistics  # nodes start without
            self._period_ns = statistics.linear_regression(
                counts, [time - start for time in times]).slope
            for count, time in self._arrivals:
                self._clock.add_arrival(round(count * self._period_ns), time)
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
        return self._clock.add_arrival(round(self._count * self._period_ns), receive_ns)
