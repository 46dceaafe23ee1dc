# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulated plants with unmodeled forces."""

from __future__ import annotations

from collections.abc import Callable
import math

from smart_tire.samples import GRAVITY
from smart_tire.simulation.plant import Plant, TIME_STEP


def with_plant(step_body: Callable[[Plant], None] | None = None,
               add_wheels: Callable[[Plant], None] | None = None) -> type[Plant]:
    """Return a plant with a change before each step of the body, or after that of the wheels."""
    class Disturbed(Plant):

        def _step_body(self) -> None:
            forces = self.acceleration
            if step_body:
                step_body(self)
            super()._step_body()
            if getattr(self, 'gravity', False):
                self.acceleration = forces  # the IMU measures specific force

        def _update_wheels(self) -> None:
            super()._update_wheels()
            if add_wheels:
                add_wheels(self)
    return Disturbed


def pushed(force_x: float, force_y: float, begin: float, end: float) -> type[Plant]:
    """Return a plant pushed with a force [N] at the center of mass between two times [s]."""
    def push(plant: Plant) -> None:
        if begin < plant.steps * TIME_STEP < end:
            mass = plant._robot.mass
            plant.acceleration = (plant.acceleration[0] + force_x / mass,
                                  plant.acceleration[1] + force_y / mass)
    return with_plant(push)


def sloped(slope: float) -> type[Plant]:
    """Return a plant on ground that rises by ``slope`` [rad] along x of the world."""
    def gravity(plant: Plant) -> None:
        plant.gravity = True
        down = -GRAVITY * math.sin(slope)
        plant.acceleration = (plant.acceleration[0] + down * math.cos(plant.yaw),
                              plant.acceleration[1] - down * math.sin(plant.yaw))
    return with_plant(gravity)
