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
Simulated recordings of the calibration benchmark, with true values.

``demo`` is the route of ``smart_tire demo``: turns on concrete, then on sand. ``guided`` is the
sequence that ``smart_tire calibrate --drive`` drives, on one ground, in one recording per step;
latency, jitter and stiffness differ between seeds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate
import math

import numpy as np

from smart_tire.parameters import build, SimulatorParams
from smart_tire.rotation import matrix
from smart_tire.samples import ImuSample, NS_PER_S, Odometry, Sample, WheelSample, WheelSlip
from smart_tire.simulation.offline import EPOCH_NS, Event, simulate
from smart_tire.simulation.robot import Robot

Leg = tuple[float, float, float]  # duration [s], rpm left, rpm right

TRUTH_STREAM = 7          # of random numbers: differs from those of the simulator
SAND_DISTANCE = 6.2       # m in x or y, where the demo begins to turn on the sand
MAX_TRANSFER = 12.0       # s
TURNS: tuple[Leg, ...] = ((9.0, 120.0, 60.0), (9.0, 60.0, 120.0))
