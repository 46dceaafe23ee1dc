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
Rigid bodies of the robot, for its description: chassis and wheels.

The parameters give mass, center of mass and yaw inertia of the whole robot. The mass of a wheel
and the size of the chassis are not parameters: they are assumed here. The bodies together have the
parameters of the robot, and each is physically possible: its moments of inertia are positive and
satisfy the triangle inequality.
"""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import LEFT, Vector3, WHEELS

FRONT = (0, 1)                 # indices into WHEELS
WHEEL_MASS_SHARE = 0.1         # of the mass of the robot, per wheel
MAX_WHEELS_YAW_SHARE = 0.75    # of the yaw inertia of the robot, all wheels together
MAX_TIRE_WIDTH_SHARE = 0.5     # of the track, so that there is space for a chassis
CHASSIS_WIDTH_SHARE = 0.9      # of the space between the tires


@dataclass(frozen=True)
class RigidBody:
    """A body whose principal axes are those of ``base_link``."""

    mass: float        # kg
    center: Vector3    # m, center of mass, in base_link
    inertia: Vector3   # kg m2, about x, y and z through the center of mass


def tire_width(robot: RobotParams) -> float:
    """Return the width of a tire [m]: that of its contact patch, at most half of the track."""
    return min(robot.tire.contact_width, MAX_TIRE_WIDTH_SHARE * robot.track_width)


def chassis_size(robot: RobotParams) -> Vector3:
    """Return length, width and height [m] of the box between the tires, centered on the axles."""
    inside = robot.track_width - tire_width(robot)
    return (robot.wheelbase + robot.wheel_radius, CHASSIS_WIDTH_SHARE * inside,
            robot.wheel_radius)


def wheel_centers(robot: RobotParams) -> dict[str, Vector3]:
    """Return wheel -> position of its center [m] in ``base_link``."""
    x, y = 0.5 * robot.wheelbase, 0.5 * robot.track_width
    return {wheel: (x if index in FRONT else -x, y if index in LEFT else -y, 0.0)
            for index, wheel in enumerate(WHEELS)}


def rigid_bodies(robot: RobotParams) -> tuple[RigidBody, dict[str, RigidBody]]:
    """Return the chassis, and wheel -> its body; together they are the robot."""
    mass = _wheel_mass(robot)
    # A ring is the wheel of the largest inertia. URDF has no place for that of rotor and gear.
    spin = min(robot.motor.inertia, mass * robot.wheel_radius**2)
    moments = (0.5 * spin, spin, 0.5 * spin)  # thin disk or ring
    wheels = {wheel: RigidBody(mass, center, moments)
              for wheel, center in wheel_centers(robot).items()}
    return _chassis(robot, list(wheels.values())), wheels


def _wheel_mass(robot: RobotParams) -> float:
    """Return the mass of a wheel [kg], limited so that yaw inertia is left for the chassis."""
    x, y, _ = robot.center_of_mass
    chassis_share = 1.0 - len(WHEELS) * WHEEL_MASS_SHARE
    # Upper bounds of the squared radii of gyration about the center of mass: position of the
    # wheels and of the chassis that balances them, and the wheel itself.
    squared = (0.25 * (robot.wheelbase**2 + robot.track_width**2)
               + (x**2 + y**2) / chassis_share + 0.5 * robot.wheel_radius**2)
    allowed = MAX_WHEELS_YAW_SHARE * robot.yaw_inertia / (len(WHEELS) * squared)
    return min(WHEEL_MASS_SHARE * robot.mass, allowed)


def _chassis(robot: RobotParams, wheels: list[RigidBody]) -> RigidBody:
    """Return what the robot has in addition to its wheels, as a homogeneous box."""
    mass = robot.mass - sum(wheel.mass for wheel in wheels)
    x, y, z = robot.center_of_mass  # the moments of the wheels about base_link cancel
    center = (x * robot.mass / mass, y * robot.mass / mass, z * robot.mass / mass)
    yaw_inertia = robot.yaw_inertia - _yaw_inertia(wheels, x, y) \
        - mass * ((center[0] - x)**2 + (center[1] - y)**2)
    length, width, height = (side**2 for side in chassis_size(robot))
    scale = yaw_inertia / (length + width)
    return RigidBody(mass, center, (scale * (width + height), scale * (length + height),
                                    yaw_inertia))


def _yaw_inertia(bodies: list[RigidBody], x: float, y: float) -> float:
    """Return the moment of inertia [kg m2] of ``bodies`` about the vertical axis at (x, y)."""
    return sum(body.inertia[2] + body.mass * ((body.center[0] - x)**2 + (body.center[1] - y)**2)
               for body in bodies)
