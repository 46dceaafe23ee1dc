# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Grounds of the benchmark scenarios: surfaces of a small robot, as fields along its path."""

from __future__ import annotations

from collections.abc import Sequence

from smart_tire.parameters.simulation import PatchParams, SurfaceParams

CONCRETE, SAND, GRAVEL, WET_TILES = 'concrete', 'sand', 'gravel', 'wet_tiles'
SURFACES = {  # mu [-], C_x [N], drag over load [-]
    CONCRETE: (0.47, 52.7, 0.010), SAND: (0.25, 25.0, 0.110), GRAVEL: (0.55, 38.0, 0.045),
    WET_TILES: (0.25, 60.0, 0.010)}
HEAVY_SURFACES = {  # of the robot of 30 kg, whose tires are stiffer
    CONCRETE: (0.47, 400.0, 0.010), SAND: (0.25, 200.0, 0.110)}
FIELD_WIDTH = 100.0  # m, of a field across its direction of travel, x

Surfaces = dict[str, tuple[float, float, float]]


def ground(base: str, surfaces: Surfaces | None = None,
           fields: Sequence[tuple[str, float, float]] = ()) -> SurfaceParams:
    """
    Return the ground with a base surface and ``fields``: surface, begin and end along x [m].

    >>> ground('sand', fields=[('gravel', 5.0, 9.0)]).patches[0].x
    (5.0, 9.0)
    """
    known = SURFACES if surfaces is None else surfaces
    friction, stiffness, drag = zip(*known.values())
    side = 0.5 * FIELD_WIDTH
    return SurfaceParams(
        names=tuple(known), friction=friction, stiffness=stiffness, drag=drag, base=base,
        patches=tuple(PatchParams(name=f'field_{i}', surface=name, x=(begin, end),
                                  y=(-side, side))
                      for i, (name, begin, end) in enumerate(fields, 1)))
