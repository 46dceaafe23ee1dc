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
Planar dynamics of the skid-steer robot: rigid body, four driven wheels, brush tires, surfaces.

The inner loop uses plain floats: for four wheels the overhead of numpy would dominate a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from math import hypot

from smart_tire.models.tire.brush_tire import force_over_slip
from smart_tire.models.vehicle.drive import DRY_FRICTION_SPEED
from smart_tire.models.vehicle.skid_steer import AXLE_SIGNS, linear_loads, SIDE_SIGNS
from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.simulation import DriveParams, PatchParams, SurfaceParams
from smart_tire.samples import WHEELS

STEP_NS = 1_000_000  # ns
TIME_STEP = 1e-9 * STEP_NS  # s
LOAD_TRANSFER_TIME = 0.02  # s, time constant of load transfer, from vertical tire compliance
NOMINAL = (1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Surface:
    """Properties of one surface."""

    name: str
    friction: float   # -, mu
    stiffness: float  # N, C_x of a tire on it
    drag: float       # -, rolling drag over load


class SurfaceMap:
    """Surface by position: a base surface and rectangles on it, of which the last one applies."""

    def __init__(self, params: SurfaceParams) -> None:
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


class Plant:
    """
    True state of the robot; ``step`` advances it by ``TIME_STEP``.

    Pose and velocity are those of ``base_link``, vectors in body axes, lists in the order of
    ``WHEELS``. The denominator of the slip is at least ``slip_floor`` [m/s], the minimum for
    explicit steps not to overshoot; above it the tire is exact. ``friction_scale`` are the factors
    of the friction of each drive. A subclass may have other tires: ``tire_slope`` is the force
    over the slip, ``lateral_share`` the lateral stiffness over the longitudinal one.
    """

    lateral_share = 1.0

    def __init__(self, robot: RobotParams, drive: DriveParams, surfaces: SurfaceMap,
                 start: Sequence[float] = (0.0, 0.0, 0.0),
                 friction_scale: Sequence[float] = NOMINAL) -> None:
        self._robot, self._drive, self._surfaces = robot, drive, surfaces
        self.steps = 0
        self.start = tuple(start)                       # m, m, rad: odom in the world
        self.x, self.y, self.yaw = start                # m, m, rad: in the world
        self.v_x = self.v_y = self.yaw_rate = 0.0       # m/s, m/s, rad/s
        self.acceleration = (0.0, 0.0)                  # m/s2, of the center of mass over ground
        self.yaw_acceleration = 0.0                     # rad/s2
        self.wheel_speed = [0.0] * 4                    # rad/s
        self.wheel_angle = [0.0] * 4                    # rad
        self.wheel_v_x = [0.0] * 4                      # m/s, of the wheel centers
        self.wheel_v_y = [0.0] * 4                      # m/s
        self.load = [0.0] * 4                           # N
        self.motor_torque = [0.0] * 4                   # N m, at the wheels
        self.surface: list[Surface] = [surfaces.at(self.x, self.y)] * 4
        self._load_acceleration = (0.0, 0.0)            # m/s2, low-pass, for the load transfer
        self._wheel_x = [0.5 * robot.wheelbase * float(end) for end in AXLE_SIGNS]
        self._wheel_y = [0.5 * robot.track_width * float(side) for side in SIDE_SIGNS]
        motor = robot.motor
        self._coulomb = [scale * motor.coulomb_friction for scale in friction_scale]  # N m
        self._axle = [scale * motor.axle_friction * robot.wheel_radius
                      for scale in friction_scale]                                    # m
        self._viscous = [scale * motor.viscous_friction for scale in friction_scale]  # N m s/rad
        self._radius, self._inertia = robot.wheel_radius, motor.inertia               # m, kg m2
        self._stall = drive.stall_torque                                              # N m
        self._back_emf = drive.stall_torque / drive.free_speed                        # N m s/rad
        self._load_map = list(zip(*(values.tolist() for values in linear_loads(robot))))
        self.slip_floor = self._stable_slip_floor()
        self._update_wheels()

    @property
    def time_ns(self) -> int:
        """Return the time since the start [ns]."""
        return self.steps * STEP_NS

    def step(self, duty: Sequence[float]) -> None:
        """Advance by one step with the motor duties [-1, 1]."""
        com_x, com_y, _ = self._robot.center_of_mass
        wheel_x, wheel_y, step_wheel = self._wheel_x, self._wheel_y, self._step_wheel
        sum_x = sum_y = torque = 0.0
        for i in range(len(WHEELS)):
            f_x, f_y = step_wheel(i, duty[i])
            sum_x += f_x
            sum_y += f_y
            torque += (wheel_x[i] - com_x) * f_y - (wheel_y[i] - com_y) * f_x
        self.acceleration = (sum_x / self._robot.mass, sum_y / self._robot.mass)
        self.yaw_acceleration = torque / self._robot.yaw_inertia
        self._step_body()
        self._update_wheels()
        self.steps += 1

    def _step_wheel(self, i: int, duty: float) -> tuple[float, float]:
        """
        Advance wheel ``i`` and return the force [N] of the surface on it.

        Implicit in the wheel speed: the slip stiffness of the tire makes the equation of a light
        wheel stiff.
        """
        radius, inertia, back_emf = self._radius, self._inertia, self._back_emf
        surface, speed, load = self.surface[i], self.wheel_speed[i], self.load[i]
        v_x, v_y, driving = self.wheel_v_x[i], self.wheel_v_y[i], self._stall * duty
        rolling, floor, slowest = radius * speed, self.slip_floor, DRY_FRICTION_SPEED / radius
        # conditions: calls of max would be a fifth of the time of a step
        size = rolling if rolling >= 0.0 else -rolling
        scale = 1.0 / (size if size > floor else floor)
        share = self.lateral_share
        slip = hypot(rolling - v_x, share * v_y) * scale
        grip = scale * self.tire_slope(slip, surface.friction, load, surface.stiffness)  # N s/m
        dry = self._coulomb[i] + self._axle[i] * load  # N m
        size = speed if speed >= 0.0 else -speed
        resistance = back_emf + self._viscous[i] + dry / (size if size > slowest else slowest)
        new_speed = ((inertia * speed + TIME_STEP * (driving + radius * grip * v_x))
                     / (inertia + TIME_STEP * (resistance + radius * radius * grip)))
        self.motor_torque[i] = driving - back_emf * new_speed
        self.wheel_speed[i] = new_speed
        self.wheel_angle[i] += 0.5 * TIME_STEP * (speed + new_speed)
        size = hypot(v_x, v_y)
        drag = surface.drag * load / (
            size if size > DRY_FRICTION_SPEED else DRY_FRICTION_SPEED)  # N s/m
        return grip * (radius * new_speed - v_x) - drag * v_x, -(share * grip + drag) * v_y

    @staticmethod
    def tire_slope(total_slip: float, mu: float, load: float, stiffness: float) -> float:
        """Return the force of a brush tire divided by the slip [N]."""
        return force_over_slip(total_slip, stiffness, mu * load)

    def _step_body(self) -> None:
        """Advance velocity and pose of the body; exact without forces."""
        com_x, com_y, _ = self._robot.center_of_mass
        old_x, old_y, old_rate = self.v_x, self.v_y, self.yaw_rate
        new_x = old_x - old_rate * com_y + TIME_STEP * self.acceleration[0]
        new_y = old_y + old_rate * com_x + TIME_STEP * self.acceleration[1]
        self.yaw_rate += TIME_STEP * self.yaw_acceleration
        rotation = 0.5 * TIME_STEP * (old_rate + self.yaw_rate)
        cos, sin = math.cos(rotation), math.sin(rotation)
        self.v_x = cos * new_x + sin * new_y + self.yaw_rate * com_y
        self.v_y = cos * new_y - sin * new_x - self.yaw_rate * com_x
        mean_yaw = self.yaw + 0.5 * rotation
        cos, sin = 0.5 * TIME_STEP * math.cos(mean_yaw), 0.5 * TIME_STEP * math.sin(mean_yaw)
        self.x += cos * (old_x + self.v_x) - sin * (old_y + self.v_y)
        self.y += sin * (old_x + self.v_x) + cos * (old_y + self.v_y)
        self.yaw += rotation

    def _update_wheels(self) -> None:
        """Update wheel velocities, surfaces and loads from the state of the body."""
        gain = TIME_STEP / (LOAD_TRANSFER_TIME + TIME_STEP)
        a_x, a_y = self._load_acceleration
        a_x += gain * (self.acceleration[0] - a_x)
        a_y += gain * (self.acceleration[1] - a_y)
        self._load_acceleration = (a_x, a_y)
        cos, sin, at = math.cos(self.yaw), math.sin(self.yaw), self._surfaces.at
        v_x, v_y, rate, base_x, base_y = self.v_x, self.v_y, self.yaw_rate, self.x, self.y
        wheel_v_x, wheel_v_y, surface, loads = (
            self.wheel_v_x, self.wheel_v_y, self.surface, self.load)
        for i, (x, y, (static, per_x, per_y)) in enumerate(zip(
                self._wheel_x, self._wheel_y, self._load_map)):
            wheel_v_x[i] = v_x - y * rate
            wheel_v_y[i] = v_y + x * rate
            surface[i] = at(base_x + cos * x - sin * y, base_y + sin * x + cos * y)
            load = static + per_x * a_x + per_y * a_y
            loads[i] = load if load > 0.0 else 0.0

    def _stable_slip_floor(self) -> float:
        """Return the denominator [m/s] at which one step cancels the slip of the fastest mode."""
        robot = self._robot
        stiffness = max(surface.stiffness for surface in self._surfaces.surfaces.values())
        com_x, com_y, _ = robot.center_of_mass
        arms = sum((x - com_x)**2 + (y - com_y)**2 for x, y in zip(self._wheel_x, self._wheel_y))
        return TIME_STEP * stiffness * (4.0 / robot.mass + arms / robot.yaw_inertia)
