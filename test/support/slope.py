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

"""Robot on a slope: the plant of the simulator with the force of gravity along the ground."""

from __future__ import annotations

import math

from smart_tire.models.constants import GRAVITY
from smart_tire.simulation.plant import Plant


def sloped_plant(slope):
    """Return the class of a plant on ground that rises along x by ``slope`` [rad]."""
    class SlopedPlant(Plant):
        """Loads follow from the forces of the tires; that they add up to cos(slope) is left."""

        def _step_body(self):
            of_tires, along = self.acceleration, -GRAVITY * math.sin(slope)
            self.acceleration = (of_tires[0] + along * math.cos(self.yaw),
                                 of_tires[1] - along * math.sin(self.yaw))
            super()._step_body()
            self.acceleration = of_tires

    return SlopedPlant
