# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Straight-line driving with acceleration and braking, tires by the brush model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
import math

import numpy as np
from smart_tire.parameters import RobotParams
from support.driving import drive, STEP
from support.identifying import recorded

G = 9.80665  # m/s2


@dataclass(frozen=True)
class Ground:
    """Parameters of a tire-ground pair."""

    stiffness: float  # N, C_x of a wheel
    friction: float
    drag: float       # share of the weight


CONCRETE = Ground(52.7, 0.47, 0.015)
SAND = Ground(30.0, 0.35, 0.15)


def oscillation(time, size=0.35, rate=2.7):
    """Return a wheel surface speed [m/s] that ramps up and then oscillates about 0.7 m/s."""
    return min(max(time - 1.0, 0.0), 0.7) + size * math.sin(rate * max(time - 1.7, 0.0))


@lru_cache
def motion(ground, pace=oscillation, seconds=20.0, mass=10.9):
    """
    Return surface speeds of the wheels and speeds over ground [m/s], every millisecond.

    The force balance, integrated in time, with load transfer between the axles.
    """
    robot = RobotParams()
    lever = (robot.center_of_mass[2] + robot.wheel_radius) / robot.wheelbase
    rolling, over_ground, speed, acceleration = [], [], 0.0, 0.0
    for k in range(round(seconds / STEP)):
        wheel = pace(k * STEP)
        slip = (wheel - speed) / max(abs(wheel), 0.05)
        force = -ground.drag * mass * G * math.tanh(speed / 0.01)
        for side in (-1.0, 1.0):  # front and rear axle
            load = mass * (0.25 * G + side * 0.5 * acceleration * lever)
            share = min(ground.stiffness * abs(slip) / (3.0 * ground.friction * load), 1.0)
            force += math.copysign(2.0 * ground.friction * load * (1.0 - (1.0 - share) ** 3), slip)
        rolling.append(wheel)
        over_ground.append(speed)
        acceleration = force / mass
        speed += acceleration * STEP
    return np.array(rolling), np.array(over_ground)


def straight_run(ground, seed, *, pace=oscillation, seconds=20.0, mass=10.9, **options):
    """Return the recording of a straight drive; ``options`` are those of ``drive``."""
    rolling, over_ground = motion(ground, pace, seconds, mass)
    both = np.ones(2)
    return recorded(drive(np.outer(rolling, both), np.outer(rolling - over_ground, both),
                          icr=0.0, seed=seed, **options))
