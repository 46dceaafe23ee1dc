# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A robot that contradicts the models of the software: tires, mass and center of mass."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
from smart_tire.arrays import Array, ArrayLike
from smart_tire.parameters.robot import RobotParams
from smart_tire.simulation.plant import Plant

SHAPE = 1.65          # -, C of the Magic Formula: beyond its peak the force falls to 0.52 of it
LATERAL_SHARE = 0.6   # -, lateral over longitudinal stiffness
MASS = 15.0           # kg
CENTER_OF_MASS = 0.02, -0.01  # m, in base_link


class OtherPlant(Plant):
    """
    The robot on tires of the Magic Formula, ``F = D sin(C atan(B s))``, with C_y = 0.6 C_x.

    D is mu F_z, and B that of the stiffness of the surface: B C D = C_x. The force is largest at
    a slip of ``1.40 / B = 2.3 mu F_z / C_x``.
    """

    lateral_share = LATERAL_SHARE

    @staticmethod
    def tire_slope(total_slip: float, mu: float, load: float, stiffness: float) -> float:
        """Return the force divided by the slip [N]."""
        peak = mu * load
        if total_slip <= 0.0 or peak <= 0.0:
            return stiffness if peak > 0.0 else 0.0
        return peak * math.sin(SHAPE * math.atan(stiffness * total_slip / (SHAPE * peak))) / (
            total_slip)


def peak_slip(mu: ArrayLike, load: ArrayLike, stiffness: ArrayLike) -> Array:
    """
    Return the slip [-] of the largest force, beyond which a wheel slides.

    >>> print(peak_slip(0.47, 26.7, 52.7).round(3))
    0.552
    """
    return (SHAPE * math.tan(0.5 * math.pi / SHAPE) * np.asarray(mu, dtype=float)
            * np.asarray(load, dtype=float) / np.asarray(stiffness, dtype=float))


def other_robot(robot: RobotParams) -> RobotParams:
    """Return the true robot behind ``robot``, as the software describes it: heavier and uneven."""
    return replace(robot, mass=MASS, yaw_inertia=robot.yaw_inertia * MASS / robot.mass,
                   center_of_mass=(*CENTER_OF_MASS, robot.center_of_mass[2]))
