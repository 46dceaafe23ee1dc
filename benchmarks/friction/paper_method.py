"""
Friction as the paper reads it off two peaks, with nothing held back.

The estimator keeps quiet about what it can not tell; the paper does not. So its errors are those
of the interval between the raw peaks of film 1, turned into friction by Fig. 8, a map and B(22).
"""

from __future__ import annotations

from benchmarks.friction.methods import EXACT_MAP, PRINTED_MAP
from smart_tire.analysis.series import Floats
from smart_tire.models.tire import brush_tire, strain_charge
from smart_tire.parameters import RobotParams

MAPS = {EXACT_MAP: 'exact', PRINTED_MAP: 'printed'}


def ratio_read_off(interval: Floats, speed: Floats, robot: RobotParams, method: str) -> Floats:
    """
    Return the adhesion ratio for intervals [s] between the peaks at |r w| [m/s].

    NaN where the map of ``method`` does not tell.
    """
    patch = robot.tire.contact_length
    return strain_charge.adhesion_length(
        patch - speed * interval, robot.film.length, patch, MAPS[method]) / patch


def friction_read_off(interval: Floats, speed: Floats, total_slip: Floats, load: Floats,
                      robot: RobotParams, method: str) -> Floats:
    """Return mu for these intervals, NaN where the reading tells none."""
    return brush_tire.friction_from_adhesion(
        ratio_read_off(interval, speed, robot, method), total_slip, load,
        robot.tire.longitudinal_stiffness)
