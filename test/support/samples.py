# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A sample of each kind, with and without its optional parts."""

from __future__ import annotations

import math

from smart_tire.samples import (
    BatterySample, FilmCharge, FilmDeflection, FilmTemperature, Friction, FRICTION_QUANTITIES,
    FrictionGrid, GoalPose, GroundState, Icr, ImuSample, MotorCommand, NAN, Odometry, PathProgress,
    PlannedPath, TireSample, VelocityCommand, WheelCommand, WheelSample, WheelSlip)
from smart_tire.uncertain import Uncertain

STAMP = 1_700_000_000_123_456_789
FOUR = (1.5, -2.25, 3.0, 0.125)
COVARIANCE = tuple(0.5 * number for number in range(36))
SAMPLES = [
    ImuSample(STAMP, (0.1, -0.2, 9.81), (0.01, 0.02, -0.5), (0.0, 0.6, 0.0, 0.8)),
    ImuSample(STAMP, (0.1, -0.2, 9.81), (0.01, 0.02, -0.5)),
    WheelSample(STAMP, FOUR, (10.0, 20.0, 30.0, 40.0), (0.5, -0.5, 1.0, 0.0)),
    WheelSample(STAMP, FOUR),
    TireSample(STAMP, 'rear_left', (1.65, 2.5)),
    TireSample(STAMP, 'front_right', (0.0,)),
    BatterySample(STAMP, 'front_left', 3.75),
    VelocityCommand(STAMP, 0.8, -0.25),
    WheelCommand(STAMP, FOUR),
    MotorCommand(STAMP, (0.5, -0.25, 1.0, -1.0)),
    Odometry(STAMP, (1.0, 2.0, 0.0), (0.0, 0.0, 0.6, 0.8), (0.5, 0.0, 0.0), (0.0, 0.0, 0.25),
             COVARIANCE, COVARIANCE[::-1]),
    WheelSlip(STAMP, (0.1, -1.0, 0.0, 1.0), FOUR, (0.01, 0.02, 1.0, math.inf)),
    Icr(STAMP, 0.02, -1.5),
    GroundState(STAMP, Uncertain(25.0, 1.5), Uncertain(0.05, math.inf),
                *(Uncertain(0.1 * k, 0.01) for k in range(9)), -0.9, 0.04, 1.5, math.inf),
    Friction(STAMP, 'rear_right', **dict.fromkeys(FRICTION_QUANTITIES, Uncertain(0.5, math.inf))),
    FilmCharge(STAMP, -2.5e-9),
    FilmCharge(STAMP, 5e-8, saturated=True, discharged=True),
    FilmTemperature(STAMP, 21.5, 0.25),
    FilmTemperature(STAMP, -10.0),
    FilmDeflection(STAMP, Uncertain(0.002, 0.00025)),
    FrictionGrid(STAMP, 'odom', 0.125, (-1.5, 2.25), 3, bytes([0, 47, 100, 255, 255, 9])),
    PlannedPath(STAMP, 'odom', ((1.0, -2.5, 0.0), (1.5, 0.25, NAN))),
    GoalPose(STAMP, 'odom', (1.0, -2.5, 0.0)),
    PathProgress(STAMP, 2.5, -0.125, 1),
]
