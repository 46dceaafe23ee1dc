# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Measured wheel speeds with the periods that they are the means of."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
import math

from smart_tire.control import constants as c
from smart_tire.samples import Four, four, NS_PER_S, STOPPED


@dataclass(frozen=True)
class WheelReading:
    """Wheel speeds and angles at one time."""

    velocity: Four         # rad/s
    arrived_ns: int
    stamp_ns: int          # of any clock
    time_ns: int           # by the timestamps, on the steady clock but for a constant delay
    angle: Four            # rad, since the first reading
    position: Four | None  # rad, as measured


class WheelFeedback:
    """
    Latest readings of the wheel speeds; times are nanoseconds of one steady clock.

    A reading of ``wheel_states`` belongs to its timestamp, which may be that of another clock: it
    can arrive late by more than a period. The earliest of the latest arrivals relates both clocks.
    Without plausible timestamps it belongs to its arrival. Mean speeds are those over at least
    ``window`` [s], so that the errors of all timestamps but the first and the last cancel.
    """

    def __init__(self, window: float) -> None:
        self._window_ns = round(window * NS_PER_S)
        self._gaps: deque[int] = deque(maxlen=c.PERIODS)
        self.period: float | None = None  # s, of the readings, from the second one on
        self._lateness: deque[int] = deque(maxlen=c.ARRIVALS)  # ns, of arrivals after ``time_ns``
        self._readings: deque[WheelReading] = deque()

    def add_reading(self, velocity: Four, now_ns: int, stamp_ns: int = 0,
                    position: Four | None = None) -> None:
        """
        Add wheel speeds [rad/s] that arrived at ``now_ns``; ``stamp_ns`` is their timestamp.

        ``position`` are the angles [rad] at that time; without them a speed is the mean since the
        reading before. Speeds that are not finite or not possible are ignored.
        """
        if not all(abs(speed) <= c.MAX_READING for speed in velocity):  # false for NaN, too
            return
        before, gap_ns = self.latest, 0
        if before is not None:
            gap_ns = _gap(before, now_ns, stamp_ns)
            if gap_ns <= 0:
                return  # repeated
            self._gaps.append(gap_ns)
            from statistics import median  # nodes start without
            usual_ns = median(self._gaps)
            self.period = usual_ns / NS_PER_S
            if position is None and gap_ns > c.MAX_GAP_RATIO * usual_ns:
                before = None  # others are missing in between
        if before is None:
            before, gap_ns = self._begin(velocity, now_ns)
        time_ns = before.time_ns + gap_ns
        late_ns = now_ns - time_ns
        if late_ns > min(self._lateness, default=late_ns) + c.MAX_LATENESS_NS:
            self._lateness.clear()
        self._lateness.append(late_ns)
        readings = self._readings
        readings.append(WheelReading(velocity, now_ns, stamp_ns, time_ns,
                                     _angle(before, velocity, position, gap_ns), position))
        while len(readings) > 2 and time_ns - readings[1].time_ns >= self._window_ns:
            readings.popleft()

    def _begin(self, velocity: Four, now_ns: int) -> tuple[WheelReading, int]:
        """Begin a period [ns] before the first reading, 0 if it is not known; return both."""
        period_ns = round((self.period or 0.0) * NS_PER_S)
        begin_ns = now_ns - period_ns
        first = WheelReading(velocity, begin_ns, 0, begin_ns, STOPPED, None)
        self._lateness.clear()
        self._readings = deque([first] if period_ns else [])
        return first, period_ns

    def discard(self) -> None:
        """Discard all readings; their period remains known."""
        self._readings.clear()

    @property
    def latest(self) -> WheelReading | None:
        """Return the latest reading, None if there is none."""
        return self._readings[-1] if self._readings else None

    def mean(self, wheel: int) -> tuple[float, int, int] | None:
        """
        Return the mean speed [rad/s] of a wheel over the window, and begin and end of the latter.

        None before the second reading.
        """
        if len(self._readings) < 2:
            return None
        first, last = self._readings[0], self._readings[-1]
        duration_ns = last.time_ns - first.time_ns
        end_ns = last.time_ns + min(self._lateness) - round(c.LINE_DELAY * NS_PER_S)
        turned = last.angle[wheel] - first.angle[wheel]
        return turned * NS_PER_S / duration_ns, end_ns - duration_ns, end_ns

    def slope(self, wheel: int) -> float:
        """Return the acceleration of a wheel [rad/s2] over the window, 0 without two readings."""
        if len(self._readings) < 2:
            return 0.0
        first, last = self._readings[0], self._readings[-1]
        return ((last.velocity[wheel] - first.velocity[wheel])
                * NS_PER_S / (last.time_ns - first.time_ns))

    def is_current(self, now_ns: int) -> bool:
        """Return whether the latest reading is not older than it should be."""
        if self.latest is None or self.period is None:
            return False
        most_ns = (c.MAX_AGE_PERIODS * self.period * NS_PER_S
                   + max(self._lateness) - min(self._lateness))
        return now_ns - self.latest.arrived_ns <= most_ns

    def delay(self, control_period: float) -> float:
        """
        Return the mean delay of the control loop [s] for a period of the controller [s].

        Half of the time of which a reading is the mean, half a period until the next one, half a
        period until the next duty, and the mean lateness of the arrivals.
        """
        period = self.period or math.inf
        window = max(self._window_ns / NS_PER_S, period)
        lateness = self._lateness or (0,)
        late = math.fsum(lateness) / len(lateness) - min(lateness)
        return 0.5 * (window + period + control_period) + c.LINE_DELAY + late / NS_PER_S


def _gap(before: WheelReading, now_ns: int, stamp_ns: int) -> int:
    """Return the time [ns] since the reading ``before``, by timestamps if they are plausible."""
    gap_ns = stamp_ns - before.stamp_ns
    plausible = c.MIN_PERIOD_NS <= gap_ns <= c.MAX_PERIOD_NS
    return gap_ns if plausible else now_ns - before.arrived_ns


def _angle(before: WheelReading, velocity: Four, position: Four | None, gap_ns: int) -> Four:
    """Return the angles [rad] ``gap_ns`` after ``before``; by the speeds without positions."""
    elapsed = gap_ns / NS_PER_S
    turned = [speed * elapsed for speed in velocity]
    if position is not None and before.position is not None:
        measured = [new - old for old, new in zip(before.position, position)]
        if all(abs(angle) <= c.MAX_READING * elapsed for angle in measured):  # else restarted, NaN
            turned = measured
    return four(old + angle for old, angle in zip(before.angle, turned))
