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

"""Measured wheel speeds with the periods that they are the means of."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
import math
from statistics import median

from smart_tire.samples import Four, NS_PER_S

MAX_SPEED = 100.0        # rad/s; a larger one is no measurement
PERIODS = 5              # gaps between readings whose median is their period
MAX_GAP_RATIO = 1.5      # gap over period, above which a reading was lost
MIN_PERIOD_NS, MAX_PERIOD_NS = 1_000_000, 2 * NS_PER_S  # between plausible timestamps
MAX_AGE_PERIODS = 2.0    # age of a reading that still advances integrals
LINE_DELAY = 0.005       # s, of a duty to the motors and of a reading from the encoders; assumed


@dataclass(frozen=True)
class Reading:
    """Wheel speeds, each the mean over ``duration`` before their arrival."""

    velocity: Four     # rad/s
    arrived_ns: int
    stamp_ns: int      # of any clock
    duration_ns: int   # 0 if unknown


class WheelFeedback:
    """
    Latest readings of the wheel speeds; times are nanoseconds of one steady clock.

    A reading of ``wheel_states`` is the mean since the reading before it, by their timestamps,
    which may be those of another clock; without plausible ones, by their arrivals. Readings are
    averaged over at least ``window`` [s]: weighted with their durations, the errors of all
    timestamps but the first and the last cancel.
    """

    def __init__(self, window: float) -> None:
        self._window_ns = round(window * NS_PER_S)
        self._gaps: deque[int] = deque(maxlen=PERIODS)
        self._readings: deque[Reading] = deque()
        self._slope: Four = (0.0, 0.0, 0.0, 0.0)

    def add(self, velocity: Four, now_ns: int, stamp_ns: int = 0) -> None:
        """
        Add wheel speeds [rad/s] that arrived at ``now_ns``; ``stamp_ns`` is their timestamp.

        Speeds that are not finite or not possible are ignored.
        """
        if not all(abs(speed) <= MAX_SPEED for speed in velocity):  # false for NaN, too
            return
        before, duration_ns = self.latest, round((self.period or 0.0) * NS_PER_S)
        if before is not None:
            gap_ns = _gap(before, now_ns, stamp_ns)
            if gap_ns <= 0:  # another one of the same time
                self._readings[-1] = Reading(velocity, now_ns, stamp_ns, before.duration_ns)
                return
            duration_ns = self._duration(gap_ns)
            self._slope = _slope(before.velocity, velocity, gap_ns)
        self._readings.append(Reading(velocity, now_ns, stamp_ns, duration_ns))
        while sum(one.duration_ns for one in list(self._readings)[1:]) >= max(self._window_ns, 1):
            self._readings.popleft()

    def _duration(self, gap_ns: int) -> int:
        """Return the time [ns] of which a reading is the mean, ``gap_ns`` after the latest one."""
        self._gaps.append(gap_ns)
        period_ns = round(median(self._gaps))
        if gap_ns > MAX_GAP_RATIO * period_ns:  # others are missing in between
            self._readings.clear()
            return period_ns
        return gap_ns

    def discard(self) -> None:
        """Discard all readings; their period remains known."""
        self._readings.clear()
        self._slope = (0.0, 0.0, 0.0, 0.0)

    @property
    def latest(self) -> Reading | None:
        """Return the latest reading, None if there is none."""
        return self._readings[-1] if self._readings else None

    @property
    def period(self) -> float | None:
        """Return the period of the readings [s], None before the second one."""
        return median(self._gaps) / NS_PER_S if self._gaps else None

    def mean(self, wheel: int) -> tuple[float, int, int] | None:
        """
        Return the mean speed [rad/s] of a wheel over the window, and begin and end of the latter.

        None if the duration of no reading is known.
        """
        known = [reading for reading in self._readings if reading.duration_ns]
        if not known:
            return None
        total_ns = sum(reading.duration_ns for reading in known)
        speed = sum(reading.velocity[wheel] * reading.duration_ns for reading in known) / total_ns
        end_ns = known[-1].arrived_ns - round(LINE_DELAY * NS_PER_S)
        return speed, end_ns - total_ns, end_ns

    def slope(self, wheel: int) -> float:
        """Return the acceleration of a wheel [rad/s2] between the two latest readings."""
        return self._slope[wheel]

    def is_current(self, now_ns: int) -> bool:
        """Return whether the latest reading is not older than it should be."""
        return self.latest is not None and self.period is not None and (
            now_ns - self.latest.arrived_ns <= MAX_AGE_PERIODS * self.period * NS_PER_S)

    def delay(self, control_period: float) -> float:
        """
        Return the mean delay of the control loop [s] for a period of the controller [s].

        Half of the time of which a reading is the mean, half a period until the next one, and
        half a period until the next duty.
        """
        period = self.period or math.inf
        window = max(self._window_ns / NS_PER_S, period)
        return 0.5 * (window + period + control_period) + LINE_DELAY


def _gap(before: Reading, now_ns: int, stamp_ns: int) -> int:
    """Return the time [ns] since the reading ``before``, by timestamps if they are plausible."""
    gap_ns = stamp_ns - before.stamp_ns
    plausible = MIN_PERIOD_NS <= gap_ns <= MAX_PERIOD_NS
    return gap_ns if plausible else now_ns - before.arrived_ns


def _slope(before: Four, after: Four, gap_ns: int) -> Four:
    a, b, c, d = ((new - old) * NS_PER_S / gap_ns for old, new in zip(before, after))
    return a, b, c, d
