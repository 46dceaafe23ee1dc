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

"""
Friction from two peaks by the method of paper B, without rejection.

Unlike the estimator, the method of the paper always returns a value. It is computed from the
interval between the raw peaks of film 1 by Fig. 8, a map and B(22).
"""

from __future__ import annotations

from benchmarks.friction.methods import EXACT_MAP, PRINTED_MAP
from smart_tire.analysis.series import Floats
from smart_tire.models.tire import brush_tire, strain_charge
from smart_tire.parameters import RobotParams

MAPS = {EXACT_MAP: 'exact', PRINTED_MAP: 'printed'}


def adhesion_ratio_from_peaks(interval: Floats, speed: Floats, robot: RobotParams,
                              method: str) -> Floats:
    """
    Return the adhesion ratio for intervals [s] between the peaks at |r w| [m/s].

    NaN outside the range of the map of ``method``.
    """
    patch = robot.tire.contact_length
    return strain_charge.adhesion_length(
        patch - speed * interval, robot.film.length, patch, MAPS[method]) / patch


def friction_from_peaks(interval: Floats, speed: Floats, total_slip: Floats, load: Floats,
                        robot: RobotParams, method: str) -> Floats:
    """Return mu for intervals [s] between the peaks; NaN without adhesion ratio."""
    return brush_tire.friction_from_adhesion(
        adhesion_ratio_from_peaks(interval, speed, robot, method), total_slip, load,
        robot.tire.longitudinal_stiffness)
