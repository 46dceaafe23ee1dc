"""
A device's own clock told by the host's, in spite of a link that delays every message anew.

A message takes a constant time and, on top of it, one that varies and is never negative: so the
quickest messages lie on a line, host time against device time, and all others above it. The
lower envelope of the arrivals is that line. Its height contains the constant delay, which can
not be observed: ``latency`` everywhere means that constant, the least time from the instant on
the device's clock to the arrival of the last byte.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

NS = 1e-9
WINDOW = 60.0            # s that are remembered: a crystal's drift changes within minutes
MAX_BINS = 64            # points that the envelope is drawn through
DRIFT_SIGMA = 50e-6      # crystals of wheel units and IMUs are within some tens of ppm
LEAST_JITTER = 20e-6     # s, keeps the weights finite on a link that does not jitter at all
MAX_SLEW = 0.1           # of elapsed time: how quickly corrections reach the stamps
FUTURE = 0.05            # s after the reception: jitter puts no stamp there, a held up start does
LEAST_RATE = 0.1         # of elapsed time that stamps still advance while the future waits
MAX_EARLY = 0.1          # s: earlier than the envelope by more is no message of this clock
MAX_LATE = 5.0           # s: later by more is none either
JUMP = 0.1               # s: one of the clocks was set if a row of messages is later by more
JUMP_MESSAGES = 50       # in a row
CLIP = 5.0               # mean jitters: what is later counts as that, for a pause is no jitter
BELIEVED_SIGMAS = 2.0    # a drift beyond is punished no harder, so that it is found in seconds


@dataclass
class _Bin:
    """Neighbouring messages, relative to the origin [s]."""

    count: int
    sum_time: float
    sum_lag: float
    low_time: float  # of the quickest message, seen along the present drift
    low_lag: float

    def merge(self, other: _Bin, drift: float) -> bool:
        """Take in ``other``; return whether its quickest message is the quicker one."""
        self.count += other.count
        self.sum_time += other.sum_time
        self.sum_lag += other.sum_lag
        quicker = other.low_lag - self.low_lag < drift * (other.low_time - self.low_time)
        if quicker:
            self.low_time, self.low_lag = other.low_time, other.low_lag
        return quicker


class ClockSync:
    """
    Map from a device's clock to the host's: fitted line, continuous and monotonic stamps.

    The line is the most probable one for delays that are exponentially distributed and a drift
    that is normally distributed: the drift starts at zero and is believed as far as the arrivals
    insist. What a new message teaches reaches the stamps at ``MAX_SLEW`` at most, so they have
    no steps.
    """

    def __init__(self, drift_sigma: float = DRIFT_SIGMA) -> None:
        self._drift_sigma = drift_sigma
        self.restarts = 0  # not counting those that were asked for
        self._restart(0, 0)

    def _restart(self, device_ns: int, receive_ns: int) -> None:
        self._origin = (device_ns, receive_ns)
        self._bins: list[_Bin] = []
        self._per_bin = 1         # messages
        self.drift = 0.0          # of the device's clock: host seconds per device second, minus 1
        self._floor = 0.0         # s, lag of the line at the origin
        self._jitter = LEAST_JITTER
        self._late_row = 0
        self._anchors = ((device_ns, receive_ns), (device_ns, receive_ns))

    def reset(self) -> None:
        """Forget everything: the device has started anew."""
        self._bins.clear()

    def update(self, device_ns: int, receive_ns: int) -> int:
        """
        Learn that a message of ``device_ns`` came at ``receive_ns``; return its host time.

        ``device_ns`` must not wrap. The fit starts anew with a message that can not be of this
        clock: it is older than the one before, came earlier than it could or much too late.
        """
        if self._bins and device_ns == self._anchors[1][0]:
            return self._anchors[1][1]
        if not self.fits(device_ns, receive_ns):
            self.restarts += bool(self._bins)
            self._restart(device_ns, receive_ns)
        late = self.excess(device_ns, receive_ns) > JUMP
        self._late_row = self._late_row + 1 if late else 0
        self._learn(device_ns, receive_ns)
        self._advance(device_ns, receive_ns)
        return self._anchors[1][1]

    def fits(self, device_ns: int, receive_ns: int) -> bool:
        """Return whether a message can be one of the clock that is known so far."""
        if not self._bins or device_ns < self._anchors[1][0]:
            return False
        excess = self.excess(device_ns, receive_ns)
        return -MAX_EARLY < excess < (JUMP if self._late_row >= JUMP_MESSAGES else MAX_LATE)

    def host_ns(self, device_ns: int) -> int:
        """Return the host's time at ``device_ns``, on the line between the last two messages."""
        (device_0, host_0), (device_1, host_1) = self._anchors
        rate = (host_1 - host_0) / (device_1 - device_0) if device_1 > device_0 else 1.0
        return host_1 + round((device_ns - device_1) * rate)

    @property
    def jitter(self) -> float:
        """Return the mean delay above the constant one [s]."""
        return self._jitter

    def _relative(self, device_ns: int, receive_ns: int) -> tuple[float, float]:
        elapsed = device_ns - self._origin[0]
        return elapsed * NS, (receive_ns - self._origin[1] - elapsed) * NS

    def excess(self, device_ns: int, receive_ns: int) -> float:
        """Return how much later than the quickest possible one a message is [s]."""
        time, lag = self._relative(device_ns, receive_ns)
        return lag - self._floor - self.drift * time

    def _learn(self, device_ns: int, receive_ns: int) -> None:
        time, lag = self._relative(device_ns, receive_ns)
        most = self._floor + self.drift * time + CLIP * self._jitter
        message = _Bin(1, time, min(lag, most), time, lag)
        if self._bins and self._bins[-1].count < self._per_bin:
            if not self._bins[-1].merge(message, self.drift):
                return
        else:
            self._bins.append(message)
            self._forget(time - WINDOW)
        self._fit()

    def _forget(self, before: float) -> None:
        """Drop what is too old, and join neighbours where there are too many bins."""
        while self._bins[0].low_time < before:
            del self._bins[0]
        if len(self._bins) > MAX_BINS:
            for bin_, following in zip(self._bins[::2], self._bins[1::2]):
                bin_.merge(following, self.drift)
            self._bins = self._bins[::2]
            self._per_bin *= 2

    def _fit(self) -> None:
        count = sum(one.count for one in self._bins)
        mean_time = sum(one.sum_time for one in self._bins) / count
        mean_lag = sum(one.sum_lag for one in self._bins) / count
        corners = lower_hull([(one.low_time, one.low_lag) for one in self._bins])
        weight = count / self._jitter * self._drift_sigma**2
        self.drift, (time, lag) = _best_slope(
            corners, mean_time, weight, BELIEVED_SIGMAS * self._drift_sigma)
        envelope = lag - self.drift * time
        above = mean_lag - self.drift * mean_time - envelope
        self._jitter = max(above, LEAST_JITTER)
        # The quickest of n messages is still late, by the mean delay / n on average.
        self._floor = envelope - above / count

    def _advance(self, device_ns: int, receive_ns: int) -> None:
        """
        Move the stamps on towards the line, without a step.

        Only where they would lie well after the reception they wait: what was held up before
        the first reading came all at once, and nobody could know then how old it was.
        """
        device_0, host_0 = self._anchors[1]
        time = (device_ns - self._origin[0]) * NS
        wanted = self._origin[1] + (device_ns - self._origin[0]) + round(
            (self._floor + self.drift * time) / NS)
        step = device_ns - device_0
        if step > 0:
            slack = round(MAX_SLEW * step)
            least = host_0 + step - slack
            latest = receive_ns + round(FUTURE / NS)
            if least > latest:
                least = max(host_0 + round(LEAST_RATE * step), latest)
            wanted = min(max(wanted, least), host_0 + step + slack)
            self._anchors = (self._anchors[1], (device_ns, wanted))


def lower_hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the corners of the lower convex hull of ``points``, which ascend in x."""
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
    Return slope and corner of the most probable line below all points.

    It minimises ``count * (mean height above the line) / jitter + slope**2 / (2 sigma**2)``,
    convex in the slope; ``weight`` is ``count * sigma**2 / jitter``. A slope beyond ``limit``
    costs no more than linearly, so that a poor oscillator is believed as well. A line touches a
    corner for the slopes between those of the two edges that meet there.
    """
    least = -math.inf
    for corner, following in zip(corners, corners[1:]):
        most = _slope(corner, following)
        best = weight * (mean_time - corner[0])
        if abs(best) > limit:
            best = math.copysign(math.inf, best)
        if best <= most:
            return max(best, least), corner
        least = most
    best = min(max(weight * (mean_time - corners[-1][0]), -limit), limit)
    return max(best, least), corners[-1]
