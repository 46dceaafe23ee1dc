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

"""Effective rolling radius, estimated online while the wheels roll freely."""

from __future__ import annotations

from smart_tire.parameters import RobotParams

SLIP_CORRELATION_TIME = 5.0  # s, of the slip of freely rolling wheels


class RadiusEstimator:
    """
    Effective rolling radius: speed over ground per wheel speed of freely rolling wheels.

    At any single instant a radius error and slip are indistinguishable. However, the radius is
    constant over surfaces and speeds, while the slip of freely rolling wheels on firm ground is
    near zero, and after each start from standstill the speed is observable for a while. Samples on
    soft ground or in turns have no weight; a radius with zero sigma is never changed.
    """

    def __init__(self, robot: RobotParams) -> None:
        self._nominal = robot.wheel_radius
        self.scale = 1.0  # estimated over nominal radius
        self.variance = robot.wheel_radius_sigma ** 2  # of the scale

    @property
    def radius(self) -> float:
        """Return the estimated radius [m]."""
        return self.scale * self._nominal

    def update(self, slip: float, variance: float, weight: float, duration: float) -> None:
        """
        Add an apparent ``slip`` ratio with ``variance`` over ``duration`` [s].

        ``weight``, 0 to 1, is the probability that the wheels roll freely, on firm ground.
        """
        information = weight * duration / SLIP_CORRELATION_TIME / variance
        gain = self.variance * information / (1.0 + self.variance * information)
        self.scale *= 1.0 - gain * slip
        self.variance *= 1.0 - gain
