# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Crossings with the slip of a slip estimator; all errors are drawn from their sigmas."""

from __future__ import annotations

import math

import numpy as np
from smart_tire.calibration.film_crossings import CrossingWithSlip
from smart_tire.estimation.contact.records import TrajectoryErrors
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S
from smart_tire.uncertain import Uncertain
from support.crossings import crossing_samples, WHEEL

TURNS = (0.1, -0.12, 0.06, 0.15, -0.07)  # -, slips
CRITICAL = 0.55   # -, critical slip of the ground
SUSTAINED = 0.6   # share of the slip's sigma that lasts through a turn
NEW = 0.3         # share that is new in every crossing
CROSSING_PERIOD, TURN_PERIOD = 1.0, 10.0  # s
SCALE_SIGMA = 0.004  # relative, of the distances in a crossing
ANGLE = 4.5       # rad, of film 1


def recording(rng: np.random.Generator, true: RobotParams, *, turns=TURNS, each=4,
              slip_sigma=0.006, radius_error=0.0, wheel=WHEEL, rpm=60.0,
              films=(0, 1)) -> list[CrossingWithSlip]:
    """
    Return the crossings of a wheel in ``turns`` with their slips, ``each`` per turn.

    ``radius_error`` is the relative error of the wheel radius in the distances.
    """
    found, time = [], 0.0
    for slip in turns:
        time += TURN_PERIOD
        sustained = SUSTAINED * rng.standard_normal()
        for _ in range(each):
            time += CROSSING_PERIOD
            estimated = slip + slip_sigma * (sustained + NEW * rng.standard_normal())
            scale = SCALE_SIGMA * rng.standard_normal()
            samples = crossing_samples(
                rng, true, slip=slip, normalized_slip=max(1.2 * abs(slip), 0.02) / CRITICAL,
                rpm=rpm, films=films, gain_error=0.0, scale=scale - radius_error,
                errors=TrajectoryErrors(SCALE_SIGMA))
            found.append(CrossingWithSlip(
                wheel, round(time * NS_PER_S), 1, rpm * math.tau / 60.0 * true.wheel_radius,
                samples, Uncertain(estimated, slip_sigma), 0.0002, Uncertain(0.0, 0.001), ANGLE))
    return found
