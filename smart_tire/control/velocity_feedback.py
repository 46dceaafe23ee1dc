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

"""Feedback of the reached velocity: integral control in addition to the feed-forward."""

from __future__ import annotations

from collections import deque
import math

from smart_tire.samples import NS_PER_S

HISTORY_NS = 2 * NS_PER_S  # of wanted velocities, longer than the largest actuation delay
GAIN = 1.0 / math.e        # -, integral gain times delay: critically damped for a pure delay

Velocity = tuple[float, float]  # v_x [m/s], yaw rate [rad/s]


class VelocityFeedback:
    """
    Correction of the wanted velocity by what the body has reached of the earlier ones.

    With the feed-forward the base is a gain near 1 with a delay, for which integral control
    suffices. Times are nanoseconds of the message clock.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin without correction, at rest."""
        self._wanted = deque[tuple[int, Velocity]]()
        self._correction: Velocity = 0.0, 0.0
        self._reached_ns: int | None = None

    def want(self, velocity: Velocity, now_ns: int) -> None:
        """Add the velocity that is commanded now."""
        while self._wanted and not 0 < now_ns - self._wanted[0][0] <= HISTORY_NS:
            self._wanted.popleft()
        self._wanted.append((now_ns, velocity))

    def correction(self, reached: Velocity, reached_ns: int, delay: float,
                   bounds: Velocity) -> Velocity:
        """
        Return what to add to the wanted velocity; at most ``bounds``, where the integral ends.

        ``reached`` is the velocity at ``reached_ns``, ``delay`` [s] that of the base.
        """
        before, self._reached_ns = self._reached_ns, reached_ns
        elapsed = 0.0 if before is None else (reached_ns - before) / NS_PER_S
        share = GAIN * min(max(elapsed / delay, 0.0), 1.0) if delay > 0.0 else GAIN
        wanted = self._wanted_at(reached_ns - round(delay * NS_PER_S))
        v_x, yaw_rate = (
            min(max(last + share * (one - got), -bound), bound)
            for last, one, got, bound in zip(self._correction, wanted, reached, bounds))
        self._correction = v_x, yaw_rate
        return self._correction

    def _wanted_at(self, time_ns: int) -> Velocity:
        """Return the velocity that was commanded then; at rest before the first one."""
        for wanted_ns, velocity in reversed(self._wanted):
            if wanted_ns <= time_ns:
                return velocity
        return 0.0, 0.0
