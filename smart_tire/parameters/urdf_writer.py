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
Writes the robot description (URDF) from the parameters of the robot.

``python -m smart_tire.parameters.urdf_writer FILE [--params FILE ...]`` writes it; a test checks
that ``urdf/smart_tire.urdf``, the robot with the default parameters, is current.

The joints of the wheels have the names in ``wheel_states``, so that robot_state_publisher can
subscribe to it in place of ``joint_states``. The root is ``base_link``, of which the pose is
estimated. It has no inertia, because KDL supports none there and robot_state_publisher would warn:
``chassis_link``, fixed to it, has. Gazebo merges the two; ``--inertia-in-base`` is for simulators
that do not.

The parameters give mass, center of mass and yaw inertia of the whole robot. The mass of a wheel
and the size of the chassis are not parameters: they are assumed here. The bodies together have the
parameters of the robot, and each is physically possible: its moments of inertia are positive and
satisfy the triangle inequality.
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
import math
from pathlib import Path

from smart_tire.errors import ParameterError
from smart_tire.parameters import load_robot
from smart_tire.parameters.robot import RobotParams
from smart_tire.paths import write_text
from smart_tire.samples import LEFT, Vector3, WHEELS
from smart_tire.yaml_text import load_own

SPOKE_SIZE = (1.6, 1.04, 0.2)            # of wheel radius, tire width and wheel radius
FILM_THICKNESS = 0.002                   # m, drawn; the film itself is thinner
FRONT = (0, 1)                 # indices into WHEELS
WHEEL_MASS_SHARE = 0.1         # of the mass of the robot, per wheel
MAX_WHEELS_YAW_SHARE = 0.75    # of the yaw inertia of the robot, all wheels together
MAX_TIRE_WIDTH_SHARE = 0.5     # of the track, so that there is space for a chassis
CHASSIS_WIDTH_SHARE = 0.9      # of the space between the tires


def urdf_text(robot: RobotParams, *, inertia_in_base: bool = False) -> str:
    """Return the URDF of ``robot``; with ``inertia_in_base`` the chassis is the root link."""
    templates = load_own(
        Path(__file__).with_name('urdf_templates.yaml').read_text(encoding='utf-8'))
    chassis, bodies = rigid_bodies(robot)
    radius, width = robot.wheel_radius, tire_width(robot)
    wheels = [templates['wheel'].format(
        **_inertial(body), name=wheel, center=_text(body.center), radius=_text([radius]),
        width=_text([width]), spoke=_text(
            map(math.prod, zip(SPOKE_SIZE, (radius, width, radius)))),
        films=''.join(templates['film'].format(**film) for film in _films(robot, wheel)))
        for wheel, body in bodies.items()]
    base = templates['chassis'].format(
        **_inertial(chassis), center=_text(chassis.center), size=_text(chassis_size(robot)),
        name='base_link' if inertia_in_base else 'chassis_link')
    text: str = templates['robot'].format(
        chassis=base if inertia_in_base else templates['root'] + base,
        ground=_text([-radius]), imu_position=_text(robot.imu.position),
        imu_rotation=_text(robot.imu.rotation), wheels=''.join(wheels))
    return text.replace('"base_link"', f'"{robot.base_frame}"')


def _films(robot: RobotParams, wheel: str) -> Iterator[dict[str, str]]:
    """
    Yield the films on the tread of a wheel, with the names in ``tire_samples``.

    Their mounting angle is not a parameter: at wheel angle 0, position 0 is drawn at the lowest
    point. Film 1 enters the contact patch first, so the others are further forward.
    """
    radius, film = robot.wheel_radius, robot.film
    for number, center in enumerate(film.centers if wheel in film.wheels else (), 1):
        angle = center / radius
        yield {'name': f'{wheel}_pvdf_{number}', 'pitch': _text([-angle]),
               'position': _text([radius * math.sin(angle), 0.0, -radius * math.cos(angle)]),
               'size': _text([film.length, film.width, FILM_THICKNESS])}


def _inertial(body: RigidBody) -> dict[str, str]:
    x, y, z = body.inertia
    return {'mass': _text([body.mass]), 'ixx': _text([x]), 'iyy': _text([y]), 'izz': _text([z])}


def _text(numbers: Iterable[float]) -> str:
    return ' '.join(f'{number + 0.0:.9g}' for number in numbers)  # + 0.0: no negative zero


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


def main() -> None:
    """Write the description of the robot with the parameters in the given files."""
    parser = ArgumentParser(prog='urdf_writer', description='Write the URDF of a robot.')
    parser.add_argument('file', type=Path, help='URDF to write')
    parser.add_argument('--params', type=Path, nargs='+', default=[], metavar='FILE',
                        help='parameter files; later ones win')
    parser.add_argument('--inertia-in-base', action='store_true',
                        help='give base_link the inertia of the chassis, for simulators that do '
                             'not merge links at fixed joints')
    arguments = parser.parse_args()
    try:
        write_text(arguments.file, urdf_text(load_robot(arguments.params),
                                             inertia_in_base=arguments.inertia_in_base))
    except ParameterError as error:
        parser.error(str(error))


if __name__ == '__main__':
    main()
