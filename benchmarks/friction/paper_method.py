# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Friction from two peaks by the method of paper B, without rejection.

Unlike the estimator, the method of the paper always returns a value. It is computed from the
interval between the raw peaks of film 1 by Fig. 8, a map and B(22).
"""

from __future__ import annotations

from smart_tire.arrays import Array
from smart_tire.models.tire import brush_tire
from smart_tire.papers import printed
from smart_tire.parameters import RobotParams

EXACT_MAP, PRINTED_MAP = MAPS = tuple(printed.MAPS)


def friction_from_peaks(interval: Array, speed: Array, total_slip: Array, load: Array,
                        robot: RobotParams, which: str) -> Array:
    """
    Return mu for intervals [s] between the peaks at |r w| [m/s].

    NaN outside the range of the map ``which``.
    """
    patch = robot.tire.contact_length
    adhesion = printed.MAPS[which](
        patch - speed * interval, robot.film.length, patch) / patch
    return brush_tire.friction_from_adhesion(
        adhesion, total_slip, load, robot.tire.longitudinal_stiffness)
