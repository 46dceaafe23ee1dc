# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
A plant that differs from the models of the estimators in its tires, its terrain and its loads.

Its equations are those of ``Plant``, with ``Traits`` that are drawn for every robot:

- C_y differs from C_x: force and adhesion follow the slip (s_x, ratio s_y).
- The friction falls with the normalized slip t = C_x |s| / (3 mu F_z) from an onset on, so
  that the force falls after its peak: mu (1 - fall x^2 / (1 + x^2)), x = (t - onset) / width.
  This sliding friction is that of the films and of the ground truth.
- The force follows the slip after a relaxation length: ds'/dt = (s - s') |r w| / length. The films
  feel the slip without delay, as those of the simulator do.
- The rolling resistance acts along the velocity of a wheel with the lateral share, and along its
  heading with the remaining share.
- Gravity along the slopes of rolling hills acts on the body; ``terrain.on_slopes`` adds what the
  IMU measures of it.
- Each tire has a stiffness of its own; pushes act on the body, and lifted wheels have no load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from benchmarks.terrain import rolling_hills, Terrain
import numpy as np
from smart_tire.models.vehicle.drive import DRY_FRICTION_SPEED
from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.simulation import DriveParams
from smart_tire.samples import Four, GRAVITY
from smart_tire.simulation.plant import (
    LOAD_TRANSFER_TIME, NOMINAL, Plant, Surface, SurfaceMap, TIME_STEP)

FALL_BEGIN, FALL_WIDTH = 0.8, 1.2  # -, normalized slip; assumed: the peak is near t = 1
RELAXATION_SPEED = 0.5  # m/s, minimum: a tire at rest must not oscillate on its relaxation length
TERRAIN_STEPS = 10      # plant steps between two slopes: 8 mm of travel at 0.8 m/s
WAVELENGTHS = 5.0, 30.0  # m, of rolling hills
MIN_LOAD = 0.05         # N, of a lifted wheel: a critical slip of 0 has no adhesion ratio
DIAGONAL = 1.0, -1.0, -1.0, 1.0  # signs of the loads if one wheel is lifted: same sum and moments


@dataclass(frozen=True)
class Push:
    """A constant external force on the body, in body axes."""

    begin: float     # s
    end: float       # s
    force: tuple[float, float]  # N
    torque: float    # N m, about the center of mass


@dataclass(frozen=True)
class Lift:
    """A wheel without load."""

    begin: float  # s
    end: float    # s
    wheel: int    # index in WHEELS


@dataclass(frozen=True)
class Traits:
    """Properties of a drawn robot that ``RobotParams`` does not contain."""

    resistance_share: float = 1.0    # -, lateral share: 0 along the heading, 1 along the velocity
    stiffness_ratio: float = 1.0     # -, C_y / C_x
    fall: float = 0.0                # -, relative loss of friction at large slip
    fall_onset: tuple[float, float] = (FALL_BEGIN, FALL_WIDTH)  # -, normalized slip, and width
    relaxation_length: float = 0.0   # m
    load_transfer_time: float = LOAD_TRANSFER_TIME  # s
    stiffness_scale: Four = NOMINAL  # -, C_x of each tire over that on the surface
    radius_scale: Four = NOMINAL     # -, of each wheel over the nominal one
    slope: float = 0.0               # rad, standard deviation
    terrain_seed: int = 0
    direction: float | None = None   # rad, uphill: a plane of ``slope`` instead of hills
    sides: tuple[str, ...] = ()      # surfaces under the left and the right side; (): by position
    pushes: tuple[Push, ...] = ()
    lifts: tuple[Lift, ...] = ()

    @property
    def terrain(self) -> Terrain:
        """Return the hills, or the plane."""
        if self.direction is not None:
            g_x, g_y = (math.tan(self.slope) * part(self.direction)
                        for part in (math.cos, math.sin))
            return lambda x, y: (np.full_like(x, g_x), np.full_like(y, g_y))
        return rolling_hills(self.slope, WAVELENGTHS, self.terrain_seed)


class DrawnPlant(Plant):
    """
    A plant with ``traits``; ``plant_with`` returns a class for each robot.

    ``wheel_v_y`` is the lateral speed times ``stiffness_ratio``: that of an isotropic tire with
    the same force and adhesion, as films and ground truth need it.
    """

    traits = Traits()

    def __init__(self, robot: RobotParams, drive: DriveParams, surfaces: SurfaceMap,
                 start: Sequence[float] = (0.0, 0.0, 0.0),
                 friction_scale: Sequence[float] = NOMINAL) -> None:
        self._terrain = self.traits.terrain
        self._up = 0.0, 0.0              # x and y of the vertical in body axes
        self._tire_acceleration = 0.0, 0.0  # m/s2, tire forces over mass
        self._slip = [(0.0, 0.0)] * 4    # -, of the tires, delayed by the relaxation length
        self._own: dict[tuple[str, int], Surface] = {}
        super().__init__(robot, drive, surfaces, start, friction_scale)

    def _step_wheel(self, i: int, duty: float) -> tuple[float, float]:
        """Advance wheel ``i`` as in ``Plant``, implicit in its speed; return the force [N]."""
        traits, surface = self.traits, self.surface[i]
        radius, inertia = traits.radius_scale[i] * self._radius, self._inertia
        back_emf, driving = self._back_emf, self._stall * duty
        speed, load = self.wheel_speed[i], self.load[i]
        v_x, v_y = self.wheel_v_x[i], self.wheel_v_y[i]
        rolling, length, follow = radius * speed, traits.relaxation_length, 1.0
        denominator = max(abs(rolling), self.slip_floor)
        if length > 0.0:
            follow = -math.expm1(-TIME_STEP * max(denominator, RELAXATION_SPEED) / length)
        old_x, old_y = self._slip[i]
        kept_x, kept_y = (1.0 - follow) * old_x, (1.0 - follow) * old_y
        scale = follow / denominator
        s_x, s_y = kept_x + scale * (rolling - v_x), kept_y - scale * v_y
        slope = self.tire_slope(math.hypot(s_x, s_y), surface.friction, load, surface.stiffness)
        grip = scale * slope  # N s/m
        dry = self._coulomb[i] + self._axle[i] * load  # N m
        resistance = (back_emf + self._viscous[i]
                      + dry / max(abs(speed), DRY_FRICTION_SPEED / radius))
        new_speed = ((inertia * speed + TIME_STEP * (
            driving + radius * (grip * v_x - slope * kept_x)))
            / (inertia + TIME_STEP * (resistance + radius * radius * grip)))
        self.motor_torque[i] = driving - back_emf * new_speed
        self.wheel_speed[i] = new_speed
        self.wheel_angle[i] += 0.5 * TIME_STEP * (speed + new_speed)
        s_x = kept_x + scale * (radius * new_speed - v_x)
        self._slip[i] = s_x, s_y
        drag_x, drag_y = self._resistance(
            v_x, v_y / traits.stiffness_ratio, surface.drag * load)
        return slope * s_x - drag_x, slope * s_y - drag_y

    def _resistance(self, v_x: float, v_y: float, drag: float) -> tuple[float, float]:
        """Return the rolling resistance [N] of a wheel: along its heading and its velocity."""
        share = self.traits.resistance_share
        along = share * drag / max(math.hypot(v_x, v_y), DRY_FRICTION_SPEED)  # N s/m
        heading = (1.0 - share) * drag / max(abs(v_x), DRY_FRICTION_SPEED)
        return (along + heading) * v_x, along * v_y

    def _step_body(self) -> None:
        """Advance the body with gravity along the slope and pushes, too."""
        robot, time = self._robot, TIME_STEP * self.steps
        a_x, a_y = self._tire_acceleration = self.acceleration
        if self.traits.slope and self.steps % TERRAIN_STEPS == 0:
            self._up = self._vertical()
        a_x -= GRAVITY * self._up[0]
        a_y -= GRAVITY * self._up[1]
        for push in self.traits.pushes:
            if push.begin <= time < push.end:
                a_x += push.force[0] / robot.mass
                a_y += push.force[1] / robot.mass
                self.yaw_acceleration += push.torque / robot.yaw_inertia
        self.acceleration = a_x, a_y
        super()._step_body()

    def _vertical(self) -> tuple[float, float]:
        """Return x and y of the vertical in body axes on the terrain, as ``on_slopes`` does."""
        g_x, g_y = (slope.item() for slope in self._terrain(
            np.array([self.x]), np.array([self.y])))
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        pitch, roll = -math.atan(cos * g_x + sin * g_y), math.atan(cos * g_y - sin * g_x)
        return -math.sin(pitch), math.sin(roll) * math.cos(pitch)

    def _update_wheels(self) -> None:
        """Update wheel velocities, loads and surfaces, with the friction at the present slip."""
        traits = self.traits
        gain = TIME_STEP / (traits.load_transfer_time + TIME_STEP)
        a_x, a_y = self._load_acceleration
        a_x += gain * (self._tire_acceleration[0] - a_x)
        a_y += gain * (self._tire_acceleration[1] - a_y)
        self._load_acceleration = a_x, a_y
        loads = [static + per_x * a_x + per_y * a_y for static, per_x, per_y in self._load_map]
        time = TIME_STEP * self.steps
        for lift in traits.lifts:
            if lift.begin <= time < lift.end:
                warp = loads[lift.wheel] * DIAGONAL[lift.wheel]
                loads = [load - warp * sign for load, sign in zip(loads, DIAGONAL)]
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        v_x, v_y, rate, ratio = self.v_x, self.v_y, self.yaw_rate, traits.stiffness_ratio
        at, sides = self._surfaces.at, traits.sides
        for i, load in enumerate(loads):
            x, y = self._wheel_x[i], self._wheel_y[i]
            self.wheel_v_x[i] = v_x - y * rate
            self.wheel_v_y[i] = ratio * (v_y + x * rate)
            self.load[i] = load if load > MIN_LOAD else MIN_LOAD
            surface = (self._surfaces.surfaces[sides[i % 2]] if sides else
                       at(self.x + cos * x - sin * y, self.y + sin * x + cos * y))
            self.surface[i] = self._sliding(self._of_tire(surface, i), i)

    def _of_tire(self, surface: Surface, i: int) -> Surface:
        """Return ``surface`` with the C_x of tire ``i``."""
        key = surface.name, i
        if key not in self._own:
            self._own[key] = replace(
                surface, stiffness=surface.stiffness * self.traits.stiffness_scale[i])
        return self._own[key]

    def _sliding(self, surface: Surface, i: int) -> Surface:
        """Return ``surface`` with the friction at the slip of tire ``i``."""
        fall, (onset, width), (s_x, s_y) = self.traits.fall, self.traits.fall_onset, self._slip[i]
        if fall <= 0.0:
            return surface
        limit = 3.0 * surface.friction * self.load[i]
        x = (surface.stiffness * math.hypot(s_x, s_y) / limit - onset) / width
        if x <= 0.0:
            return surface
        loss = fall * x * x / (1.0 + x * x)
        return Surface(surface.name, (1.0 - loss) * surface.friction, surface.stiffness,
                       surface.drag)


def plant_with(traits: Traits) -> type[Plant]:
    """Return the class of a plant with ``traits``."""
    return type('DrawnPlant', (DrawnPlant,), {'traits': traits})
