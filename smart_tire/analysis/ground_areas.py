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

"""Patches of the simulated ground, for figures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from smart_tire.analysis.metrics import rotated
from smart_tire.analysis.series import Floats
from smart_tire.parameters import build, known_names, load_files, NODE_PARAMS, specs
from smart_tire.parameters.simulation import SimulatorParams

SIMULATOR = 'robot_simulator'


@dataclass(frozen=True)
class GroundArea:
    """A patch of one surface."""

    surface: str
    corners: Floats  # (4, 2) m, in odom


@dataclass(frozen=True)
class Grounds:
    """The simulated ground: patches, and the surface around them."""

    base: str
    areas: tuple[GroundArea, ...]


def load_grounds(files: Iterable[Path]) -> Grounds:
    """Return the ground in the parameter files of a simulation; raise ParameterError."""
    values = load_files(files, SIMULATOR, known_names(NODE_PARAMS.values()),
                        specs(NODE_PARAMS[SIMULATOR]))
    return grounds_of(build(SimulatorParams, values))


def grounds_of(params: SimulatorParams) -> Grounds:
    """Return the ground of a simulation, in the frame in which the robot starts."""
    x, y, yaw = params.start
    return Grounds(params.ground.base, tuple(
        GroundArea(patch.surface, rotated(np.array(
            [(patch.x[i] - x, patch.y[j] - y) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]),
            -yaw)) for patch in params.ground.patches))
