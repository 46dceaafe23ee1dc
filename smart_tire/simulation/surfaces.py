"""The ground under the simulated robot."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.simulation import GroundParams, Rectangle


@dataclass(frozen=True, slots=True)
class Surface:
    """What a wheel feels of the ground."""

    name: str
    friction: float   # -, mu
    stiffness: float  # N, C_x of a tire here
    drag: float       # -, rolling drag over load


class Ground:
    """Surfaces by position: a base, and rectangles on it of which the last one counts."""

    def __init__(self, params: GroundParams) -> None:
        columns = (params.names, params.friction, params.stiffness, params.drag)
        self.surfaces = {row[0]: Surface(*row) for row in zip(*columns)}
        self._base = self.surfaces[params.base]
        self._patches: list[tuple[Surface, Rectangle]] = [
            (self.surfaces[name], corners) for name, corners in reversed(params.rectangles())]

    def at(self, x: float, y: float) -> Surface:
        """Return the surface at a point [m] of the world."""
        for surface, (x_from, y_from, x_to, y_to) in self._patches:
            if x_from <= x <= x_to and y_from <= y <= y_to:
                return surface
        return self._base
