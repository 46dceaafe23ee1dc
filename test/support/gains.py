"""Passages with what a slip estimator would say of them: all errors drawn as they are told."""

from __future__ import annotations

import math

import numpy as np
from support.passages import passage, WHEEL

from smart_tire.calibration.film.crossing_collector import CrossingWithSlip
from smart_tire.estimation.contact.trajectory_error import TrajectoryErrors
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S

TURNS = (0.1, -0.12, 0.06, 0.15, -0.07)  # -, slips
CRITICAL = 0.55   # -, critical slip of the ground
LASTS = 0.6       # of the slip's sigma, through a turn ...
NEW = 0.3         # ... and in every passage
TURN_S, APART_S = 1.0, 10.0  # s, between passages of a turn, and between turns
COURSE = 0.004    # relative, of the scale of the distances in a passage
ANGLE = 4.5       # rad, of film 1


def recording(rng: np.random.Generator, true: RobotParams, *, turns=TURNS, each=4,
              slip_sigma=0.006, radius_error=0.0, wheel=WHEEL, rpm=60.0,
              films=(0, 1)) -> list[CrossingWithSlip]:
    """
    Return the passages of a wheel in ``turns`` with their slips, ``each`` of so many turns.

    ``radius_error`` is how much larger the wheel is than distances take it for.
    """
    found, time = [], 0.0
    for slip in turns:
        time += APART_S
        lasting = LASTS * rng.standard_normal()
        for _ in range(each):
            time += TURN_S
            told = slip + slip_sigma * (lasting + NEW * rng.standard_normal())
            scale = COURSE * rng.standard_normal()
            seen = passage(
                rng, true, slip=slip, sliding=max(1.2 * abs(slip), 0.02) / CRITICAL, rpm=rpm,
                films=films, gain_error=0.0, scale=scale - radius_error,
                errors=TrajectoryErrors(COURSE))
            found.append(CrossingWithSlip(
                wheel, round(time * NS_PER_S), 1, rpm * math.tau / 60.0 * true.wheel_radius, seen,
                (told, slip_sigma), 0.0002, (0.0, 0.001), ANGLE))
    return found
