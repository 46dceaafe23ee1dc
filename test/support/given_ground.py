# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""States of the ground as the window would estimate them, from the truth of a simulated run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import math

import numpy as np

from smart_tire.parameters.simulation import GroundParams
from smart_tire.samples import GroundState, Odometry
from smart_tire.uncertain import Uncertain

PERIOD_NS = 500_000_000
STIFFNESS_SIGMA, FRICTION_SIGMA, RESISTANCE_SIGMA = 0.10, 0.08, 0.10  # relative
DELAY_NS = 100_000_000  # after which a state is published


def surface_at(ground: GroundParams, x: float, y: float) -> int:
    """Return the index of the surface at a point [m]; later patches are above earlier ones."""
    for patch in reversed(ground.patches):
        if patch.x[0] <= x < patch.x[1] and patch.y[0] <= y < patch.y[1]:
            return ground.names.index(patch.surface)
    return ground.names.index(ground.base)


def ground_states(ground: GroundParams, truth: Iterable[Odometry], seed: int,
                  until: float = math.inf) -> Iterator[GroundState]:
    """Yield states with errors drawn with ``seed``, up to ``until`` [s] after the first pose."""
    stiffness_error, friction_error, resistance_error = np.random.default_rng(
        seed).standard_normal(3) * (STIFFNESS_SIGMA, FRICTION_SIGMA, RESISTANCE_SIGMA)
    begin_ns, next_ns = None, 0
    for pose in truth:
        begin_ns = pose.stamp_ns if begin_ns is None else begin_ns
        if pose.stamp_ns < next_ns or (pose.stamp_ns - begin_ns) * 1e-9 > until:
            continue
        next_ns = (pose.stamp_ns // PERIOD_NS + 1) * PERIOD_NS
        k = surface_at(ground, *pose.position[:2])
        stiffness = ground.stiffness[k] * math.exp(stiffness_error)
        friction = ground.friction[k] * math.exp(friction_error)
        resistance = ground.drag[k] * (1.0 + resistance_error)
        yield GroundState(
            pose.stamp_ns, Uncertain(stiffness, STIFFNESS_SIGMA * stiffness),
            Uncertain(friction, FRICTION_SIGMA * friction),
            Uncertain(resistance, RESISTANCE_SIGMA * resistance), Uncertain(0.5, 0.3),
            Uncertain(1.0, 0.03), Uncertain(0.0, 0.003), Uncertain(0.0, 0.003))
