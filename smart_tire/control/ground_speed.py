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

"""Motion of the robot over ground, extrapolated from delayed estimates to the present."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.samples import MAX_ANGULAR_RATE, MAX_SPEED, NS_PER_S, Odometry

MIN_INTERVAL_NS = 4_000_000    # between estimates whose difference is an acceleration
MAX_INTERVAL_NS = 200_000_000  # larger gaps restart the acceleration
MAX_SHIFT = 0.2                # s, between an estimate and a speed that is derived from it
STANDSTILL_SPEED = 0.03        # m/s, of estimates at standstill, at most
EXTRAPOLATION_SIGMA = 0.02  # m/s, of a speed: 0.2 m/s2 for 0.1 s, the age of odom and a period
CLOCK_JUMP_NS = NS_PER_S       # timestamps that go back by more are those of a new clock


@dataclass(frozen=True)
class Motion:
    """Motion of ``base_link`` at one time."""

    v_x: float           # m/s, forward
    v_y: float           # m/s, to the left
    yaw_rate: float      # rad/s
    acceleration: float  # m/s2, forward; that expected at an onset until estimates show it
    v_x_sigma: float     # m/s
    measured: float      # m/s2, acceleration that estimates show
    unseen: float        # -, weight of the acceleration expected at an onset, 1 to 0


@dataclass(frozen=True)
class Onset:
    """Begin of an acceleration that estimates do not show yet."""

    time_ns: int = 0
    acceleration: float = 0.0  # m/s2, expected
    settling: float = 0.1      # s, time constant until the measured acceleration counts


class GroundSpeed:
    """Latest motion with its filtered acceleration; times are nanoseconds of the message clock."""

    def __init__(self) -> None:
        self.distance = 0.0  # m, traveled
        self._latest: Odometry | None = None
        self._acceleration = 0.0
        self._anchor: Odometry | None = None  # estimate of the latest difference

    @property
    def stamp_ns(self) -> int | None:
        """Return the timestamp of the latest estimate, None without any."""
        return None if self._latest is None else self._latest.stamp_ns

    @property
    def v_x(self) -> float:
        """Return the latest forward speed [m/s], 0 without an estimate."""
        return 0.0 if self._latest is None else self._latest.linear[0]

    def update(self, odometry: Odometry, time_constant: float) -> bool:
        """
        Add an estimate; return whether it is plausible and newer than those before.

        ``time_constant`` [s] is that of the low-pass filter of the acceleration.
        """
        if not (all(abs(speed) <= MAX_SPEED for speed in odometry.linear)  # false for NaN, too
                and all(abs(rate) <= MAX_ANGULAR_RATE for rate in odometry.angular)):
            return False
        latest = self._latest
        if latest is not None and odometry.stamp_ns <= latest.stamp_ns:
            if latest.stamp_ns - odometry.stamp_ns <= CLOCK_JUMP_NS:
                return False
            latest = self._anchor = None
        if latest is not None:
            elapsed = (odometry.stamp_ns - latest.stamp_ns) / NS_PER_S
            self.distance += abs(odometry.linear[0]) * elapsed
        self._latest = odometry
        self._differentiate(odometry, time_constant)
        return True

    def _differentiate(self, odometry: Odometry, time_constant: float) -> None:
        anchor = self._anchor
        gap_ns = MAX_INTERVAL_NS + 1 if anchor is None else odometry.stamp_ns - anchor.stamp_ns
        if anchor is None or gap_ns > MAX_INTERVAL_NS:
            self._acceleration, self._anchor = 0.0, odometry
        elif gap_ns >= MIN_INTERVAL_NS:
            elapsed = gap_ns / NS_PER_S
            slope = (odometry.linear[0] - anchor.linear[0]) / elapsed
            gain = elapsed / (elapsed + time_constant)
            self._acceleration += gain * (slope - self._acceleration)
            self._anchor = odometry

    def distance_at(self, stamp_ns: int) -> float:
        """Return the distance traveled [m] until a recent time."""
        if self._latest is None:
            return self.distance
        elapsed = (self._latest.stamp_ns - stamp_ns) / NS_PER_S
        return self.distance - abs(self._latest.linear[0]) * max(elapsed, 0.0)

    def speed_at(self, stamp_ns: int) -> float:
        """Return the forward speed [m/s] at a recent time, 0 without an estimate."""
        later = (stamp_ns - (self.stamp_ns or stamp_ns)) / NS_PER_S
        return self.v_x + self._acceleration * min(max(later, -MAX_SHIFT), MAX_SHIFT)

    def age(self, now_ns: int) -> float:
        """Return the age [s] of the latest estimate, infinite without any."""
        return math.inf if self._latest is None else (now_ns - self._latest.stamp_ns) / NS_PER_S

    def predicted(self, now_ns: int, lead: float, onset: Onset, bound: float) -> Motion | None:
        """
        Return the motion ``lead`` [s] after ``now_ns``, None without an estimate.

        The acceleration is the measured one, at most ``bound`` [m/s2], and that expected from the
        ``onset`` of a change until an estimate can show it; braking ends at standstill.
        """
        if self._latest is None:
            return None
        v_x, v_y, _ = self._latest.linear
        measured = min(max(self._acceleration, -bound), bound)
        horizon = max(self.age(now_ns) + lead, 0.0)
        since = (self._latest.stamp_ns - onset.time_ns) / NS_PER_S
        weight = math.exp(-max(since, 0.0) / onset.settling)
        expected_time = min(max(horizon + min(since, 0.0), 0.0), horizon)
        acceleration = weight * onset.acceleration + (1.0 - weight) * measured
        change = (acceleration * expected_time + measured * (horizon - expected_time))
        later = v_x + change
        if later * v_x < 0.0 and abs(v_x) > STANDSTILL_SPEED:
            later = 0.0
        variance = self._latest.twist_covariance[0]
        sigma = math.sqrt(variance) if 0.0 <= variance < math.inf else 0.0
        return Motion(later, v_y, self._latest.angular[2], acceleration,
                      math.hypot(sigma, EXTRAPOLATION_SIGMA), measured, weight)
