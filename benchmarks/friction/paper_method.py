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
