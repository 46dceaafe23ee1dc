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

"""Surfaces that the simulated robot drives on."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.simulation import GroundParams, PatchParams


@dataclass(frozen=True, slots=True)
class Surface:
    """Properties of one surface."""

    name: str
    friction: float   # -, mu
    stiffness: float  # N, C_x of a tire on it
    drag: float       # -, rolling drag over load


class SurfaceMap:
    """Surface by position: a base surface and rectangles on it, of which the last one applies."""

    def __init__(self, params: GroundParams) -> None:
        columns = (params.names, params.friction, params.stiffness, params.drag)
        self.surfaces = {row[0]: Surface(*row) for row in zip(*columns)}
        self._base = self.surfaces[params.base]
        self._patches: list[tuple[Surface, PatchParams]] = [
            (self.surfaces[patch.surface], patch) for patch in reversed(params.patches)]

    def at(self, x: float, y: float) -> Surface:
        """Return the surface at a point [m] in the world frame."""
        for surface, patch in self._patches:
            if patch.x[0] <= x <= patch.x[1] and patch.y[0] <= y <= patch.y[1]:
                return surface
        return self._base
