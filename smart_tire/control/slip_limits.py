# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Limits of wheel speeds by slip: bands, bounds for any estimates, tires, yaw control."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.control import constants as c
from smart_tire.models.tire.brush_tire import force_share, normalized_slip_at


def slip_band(speed: float, slip: float, floor: float) -> tuple[float, float]:
    """
    Return the rolling speeds r w [m/s] with at most this slip when braking and when driving.

    ``speed`` [m/s] is that of the wheel center, ``slip`` [-] the limit relative to r w. A sliding
    speed of ``floor`` [m/s] is always within, half of it for braking.

    >>> slip_band(0.8, 0.2, 0.05)
    (0.6666666666666667, 1.0)
    >>> slip_band(-0.8, 0.2, 0.05)
    (-1.0, -0.6666666666666667)
    >>> slip_band(0.0, 0.2, 0.05)
    (-0.05, 0.05)
    """
    if speed < 0.0:
        low, high = slip_band(-speed, slip, floor)
        return -high, -low
    braking = speed - 0.5 * floor  # below zero the sliding speed grows to the floor of a start
    low = min(speed / (1.0 + slip), braking if braking > 0.0 else 2.0 * braking)
    return low, max(speed / (1.0 - slip), speed + floor)


def bounded(set_point: float, command: float, latest: float, step: float) -> float:
    """
    Return the set point of a wheel within its bounds, whatever the estimates are.

    The new set point is between the smallest and the largest of zero, the ``command``, and the
    ``latest`` set point after a ``step`` towards the command if it was beyond it or opposite. So
    it never leaves the commands and ramps to them, and reaches zero after a command of zero. One
    that is not finite is zero.

    >>> bounded(-5.0, 10.0, 8.0, 1.0), bounded(5.0, 0.0, 8.0, 1.0), bounded(9.0, 0.0, 8.0, 1.0)
    (0.0, 5.0, 7.0)
    >>> bounded(9.0, -3.0, 8.0, 1.0), bounded(math.nan, 10.0, 8.0, 1.0)
    (7.0, 0.0)
    """
    if not math.isfinite(set_point):
        return 0.0
    if abs(latest) > abs(command) or latest * command < 0.0:
        latest += math.copysign(min(step, abs(command - latest)), command - latest)
    return min(max(set_point, min(0.0, command, latest)), max(0.0, command, latest))


@dataclass(frozen=True)
class TireLoad:
    """Ground under a wheel, as expected for the end of the control period."""

    speed: float          # rad/s, of the wheel if it rolled without slip
    torque: float         # N m, of the force on a sliding wheel: mu F_z r
    critical_slip: float  # -
    command: float        # rad/s, commanded wheel speed; the feed-forward does not leave it

    def slips(self, speed: float, set_point: float) -> bool:
        """Return whether a wheel at ``speed`` [rad/s] slips, in the direction of a set point."""
        return (speed - self.speed) * (set_point - self.speed) > 0.0

    def torque_at(self, speed: float) -> float:
        """
        Return the torque [N m] of the tire force against a wheel at ``speed`` [rad/s], B(22).

        >>> tire = TireLoad(9.0, torque=0.5, critical_slip=0.2, command=20.0)
        >>> tire.torque_at(10.0)
        0.4375
        """
        return math.copysign(self.torque * self._force_share(speed), speed - self.speed)

    def with_share(self, speed: float, share: float) -> float:
        """
        Return the speed [rad/s] at which a wheel has a ``share`` of its force at ``speed``.

        >>> tire = TireLoad(9.0, torque=0.5, critical_slip=0.2, command=20.0)
        >>> round(tire.torque_at(tire.with_share(10.0, 0.5)) / tire.torque_at(10.0), 9)
        0.5
        """
        if share == 1.0:
            return speed
        slip = self.critical_slip * float(normalized_slip_at(share * self._force_share(speed)))
        return self.speed / (1.0 - math.copysign(slip, (speed - self.speed) * self.speed))

    def slip_share(self, speed: float) -> float:
        """Return the slip of a wheel at ``speed`` [rad/s] over the critical slip, 0 or more."""
        return abs(speed - self.speed) / (
            max(abs(speed), c.STANDSTILL_WHEEL_SPEED) * self.critical_slip)

    def _force_share(self, speed: float) -> float:
        """Return the force over that of a sliding wheel, 0 to 1."""
        return float(force_share(self.slip_share(speed)))


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
        bandwidth = 0.5 / max(delay, 2.0 * c.LINE_DELAY)
        moment = bandwidth * (deviation + 0.25 * bandwidth * self.heading)  # critically damped
        excess = direction * moment / (self.arm * max(force, c.TINY))  # of the right side
        return min(max(1.0 + excess, 0.0), 1.0), min(max(1.0 - excess, 0.0), 1.0)
