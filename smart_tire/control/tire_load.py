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

"""Torque of the tire force on a wheel near critical slip, for the feed-forward."""

from __future__ import annotations

from dataclasses import dataclass
import math

MIN_SPEED = 0.2  # rad/s, lower limit in the denominator of the slip


@dataclass(frozen=True)
class TireLoad:
    """Ground under a wheel, as expected for the end of the control period."""

    speed: float          # rad/s, of the wheel if it rolled without slip
    torque: float         # N m, of the force on a sliding wheel: mu F_z r
    critical_slip: float  # -
    speed_sigma: float    # rad/s, standard deviation of ``speed``
    command: float        # rad/s, commanded wheel speed; the feed-forward does not leave it

    def slips(self, speed: float, set_point: float) -> bool:
        """Return whether a wheel at ``speed`` [rad/s] slips, in the direction of a set point."""
        return (speed - self.speed) * (set_point - self.speed) > 0.0

    def torque_at(self, speed: float) -> float:
        """
        Return the torque [N m] of the tire force against a wheel at ``speed`` [rad/s], B(22).

        >>> tire = TireLoad(9.0, torque=0.5, critical_slip=0.2, speed_sigma=0.0, command=20.0)
        >>> tire.torque_at(10.0)
        0.4375
        """
        return math.copysign(self.torque * self._force_share(speed), speed - self.speed)

    def with_share(self, speed: float, share: float) -> float:
        """
        Return the speed [rad/s] at which a wheel has a ``share`` of its force at ``speed``.

        >>> tire = TireLoad(9.0, torque=0.5, critical_slip=0.2, speed_sigma=0.1, command=20.0)
        >>> round(tire.torque_at(tire.with_share(10.0, 0.5)) / tire.torque_at(10.0), 9)
        0.5
        """
        if share == 1.0:
            return speed
        slip = self.critical_slip * (1.0 - (1.0 - share * self._force_share(speed)) ** (1.0 / 3.0))
        return self.speed / (1.0 - math.copysign(slip, (speed - self.speed) * self.speed))

    def slip_share(self, speed: float) -> float:
        """Return the slip of a wheel at ``speed`` [rad/s] over the critical slip, 0 or more."""
        return abs(speed - self.speed) / (
            max(abs(speed), MIN_SPEED) * self.critical_slip + self.speed_sigma)

    def _force_share(self, speed: float) -> float:
        """Return the force over that of a sliding wheel, 0 to 1."""
        return 1.0 - max(1.0 - self.slip_share(speed), 0.0) ** 3
