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

"""Friction that the robot itself shows: forces of its tires over its weight."""

from __future__ import annotations

import math

from smart_tire.control.ground_knowledge import MAX_FRICTION
from smart_tire.models.constants import GRAVITY
from smart_tire.models.vehicle.drive import traction_force
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import NS_PER_S, WHEELS, WheelSample

MAX_RESISTANCE = 0.2   # -, rolling resistance and slope over the weight
RESISTANCE_TIME = 0.3  # s, in which the resistance is learned; several readings at 16 Hz
MIN_SPEED = 0.1        # m/s, at which the resistance is learned
MAX_VALUE = 1e3        # N m and rad/s, of plausible torques and wheel speeds
MAX_GAP = 0.5          # s, between readings of the wheels whose difference is an acceleration
# Share of the largest force that tires at the aimed slip still have on ground half as stiff as
# that of the calibration (brush model); less is a lower friction.
SOFT_SHARE = 0.8
HOLD_TIME, DROP_TIME = 1.0, 0.1  # s, in which the largest force is forgotten, and a lower one held


class ShownFriction:
    """
    Friction coefficient that the robot shows at the limit of slip.

    It is the largest force of late over the weight: that of the body's acceleration and of its
    resistance, by which the motor torques exceed the acceleration. A start from standstill shows
    the friction first, as the wheels slip fully, and then a slip limit may be too low to do so.
    """

    def __init__(self, robot: RobotParams, value: float) -> None:
        """Begin with the friction ``value`` of unknown ground."""
        self._robot, self.value, self._least = robot, value, value
        self._resistance = 0.0            # -, against the motion
        self._wheels: WheelSample | None = None
        self._force: float | None = None  # N, of all tires on the robot, positive forward

    def update_wheels(self, wheels: WheelSample) -> None:
        """Add wheel speeds with motor torques; without torques there is no resistance."""
        before, self._wheels, self._force = self._wheels, wheels, None
        gap = 0.0 if before is None else (wheels.stamp_ns - before.stamp_ns) / NS_PER_S
        if before is None or wheels.effort is None or not 0.0 < gap <= MAX_GAP:
            return
        if not all(abs(one) < MAX_VALUE for one in (*wheels.effort, *wheels.velocity,
                                                    *before.velocity)):  # false for NaN, too
            return
        robot, change = self._robot, zip(wheels.velocity, before.velocity)
        self._force = float(traction_force(
            wheels.effort, wheels.velocity, [(new - old) / gap for new, old in change],
            robot.mass * GRAVITY / len(WHEELS), robot.motor, robot.wheel_radius).sum())

    def begin(self, expected: float) -> None:
        """Begin an acceleration at the limit, on ground of the ``expected`` friction."""
        self.value = min(expected, MAX_FRICTION)

    def update_resistance(self, acceleration: float, v_x: float, period: float) -> None:
        """Learn the resistance at an acceleration [m/s2] and a speed [m/s]."""
        if self._force is None or abs(v_x) < MIN_SPEED:
            return
        excess = self._force / (self._robot.mass * GRAVITY) - acceleration / GRAVITY
        excess = math.copysign(1.0, v_x) * min(max(excess, -MAX_RESISTANCE), MAX_RESISTANCE)
        self._resistance += period / (period + RESISTANCE_TIME) * (excess - self._resistance)

    def update(self, acceleration: float, v_x: float, period: float) -> None:
        """Use the measured acceleration [m/s2] at the limit, ``period`` [s] after the last one."""
        resistance = self._resistance * math.copysign(1.0, acceleration * v_x)
        used = max(abs(acceleration) / GRAVITY + resistance, 0.0)
        time = HOLD_TIME if used > SOFT_SHARE * self.value else DROP_TIME
        held = used + math.exp(-period / time) * (self.value - used)
        self.value = min(max(used, held, self._least), MAX_FRICTION)
