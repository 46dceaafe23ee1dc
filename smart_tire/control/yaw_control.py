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

"""Yaw control of a robot at the limit of friction: less force on the side that pushes more."""

from __future__ import annotations

from dataclasses import dataclass
import math

DEAD_SHARE = 0.5   # of the commanded yaw rate, within which a deviation is slip in a turn
INTEGRAL = 0.25    # integral gain over proportional gain and bandwidth: critically damped
MIN_SHARE = 0.2    # of the force that remains on a side
DEAD_FORCE = 0.02  # of the force of a side, a difference that is left as it is
RELIEF, MAX_RELIEF = 0.3, 0.06  # of the other side, which may slide: it then loses no force
MIN_DELAY = 0.01   # s, of the estimates and of the wheels
MIN_FORCE = 1.0    # N, of a side; lower limit in the denominator of the gain


@dataclass
class YawControl:
    """
    PI control of the yaw rate with the difference of the forces of both sides.

    ``arm`` [m/(kg m2)] is half the track over the yaw inertia. The plant is an integrator with the
    delay of the estimates: the bandwidth is ``1 / (2 delay)`` (internal model control).
    """

    arm: float
    heading: float = 0.0  # rad, integral of the deviation since the begin of the limit

    def reset(self) -> None:
        """Begin at the present heading."""
        self.heading = 0.0

    def shares(self, deviation: float, period: float, delay: float, force: float,
               direction: int) -> tuple[float, float]:
        """
        Return the shares of the force that the left and the right side may have.

        ``deviation`` [rad/s] is the yaw rate beyond the commanded one, ``force`` [N] that of a
        side at its limit, ``direction`` that of all forces, 1 for driving forward.
        """
        self.heading += deviation * period
        bandwidth = 0.5 / max(delay, MIN_DELAY)
        moment = bandwidth * (deviation + INTEGRAL * bandwidth * self.heading)
        excess = direction * moment / (self.arm * max(force, MIN_FORCE))  # of the right side
        return _share(-excess), _share(excess)


def yaw_deviation(yaw_rate: float, commanded: float) -> float:
    """
    Return by how much a yaw rate [rad/s] deviates from a commanded one, less the dead zone.

    >>> yaw_deviation(0.2, 0.0), yaw_deviation(0.3, 0.5), yaw_deviation(0.2, 0.5)
    (0.2, 0.0, -0.05)
    """
    error, dead = yaw_rate - commanded, DEAD_SHARE * abs(commanded)
    return math.copysign(max(abs(error) - dead, 0.0), error) if abs(error) > dead else 0.0


def _share(excess: float) -> float:
    """Return the share of its force that a side may have, for its ``excess`` of force."""
    if excess < -DEAD_FORCE:
        return max(1.0 + RELIEF * (excess + DEAD_FORCE), 1.0 - MAX_RELIEF)
    return min(max(1.0 - excess + DEAD_FORCE, MIN_SHARE), 1.0)
