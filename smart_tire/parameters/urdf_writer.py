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
Writes the robot description (URDF) from the parameters of the robot.

``python -m smart_tire.parameters.urdf_writer FILE [--params FILE ...]`` writes it; a test checks
that ``urdf/smart_tire.urdf``, the robot with the default parameters, is current.

The joints of the wheels have the names in ``wheel_states``, so that robot_state_publisher can
subscribe to it in place of ``joint_states``. The root link has no inertia, which KDL does not
support.
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Iterable
import math
from pathlib import Path
from xml.etree.ElementTree import Element, indent, SubElement, tostring

from smart_tire.errors import ParameterError
from smart_tire.parameters import load_robot
from smart_tire.parameters.calibration_file import write_text
from smart_tire.parameters.rigid_bodies import (
    chassis_size, rigid_bodies, RigidBody, tire_width, wheel_centers)
from smart_tire.parameters.robot import RobotParams

ORIGIN = (0.0, 0.0, 0.0)
AXLE = (0.0, 1.0, 0.0)                   # direction; a positive angle rolls the robot forward
ALONG_AXLE = (0.5 * math.pi, 0.0, 0.0)   # rad, turns the axis of a cylinder from z to y
IMU_SIZE = (0.03, 0.03, 0.01)            # m
SPOKE_SIZE = (1.6, 1.04, 0.2)            # of wheel radius, tire width and wheel radius
FILM_THICKNESS = 0.002                   # m, drawn; the film itself is thinner
COLORS = {  # red, green, blue, alpha
    'chassis': (0.55, 0.6, 0.65, 1.0), 'tire': (0.12, 0.12, 0.12, 1.0),
    'spoke': (0.75, 0.75, 0.75, 1.0), 'film': (1.0, 0.55, 0.0, 1.0), 'imu': (0.1, 0.45, 0.8, 1.0)}
HEADER = '<?xml version="1.0"?>\n<!-- Written from the parameters of the robot by "make config" ' \
    'or smart_tire.parameters.urdf_writer. -->\n'


def urdf_text(robot: RobotParams) -> str:
    """Return the URDF of ``robot``."""
    root = Element('robot', name='smart_tire')
    for name, color in COLORS.items():
        SubElement(SubElement(root, 'material', name=name), 'color', rgba=_text(color))
    SubElement(root, 'link', name='base_link')
    _add_link(root, 'base_footprint', (0.0, 0.0, -robot.wheel_radius))
    chassis, wheels = rigid_bodies(robot)
    _add_chassis(root, robot, chassis)
    imu = _add_link(root, 'imu_link', robot.imu.position, robot.imu.rotation)
    _add_box(imu, 'visual', IMU_SIZE, material='imu')
    for wheel, body in wheels.items():
        _add_wheel(root, robot, wheel, body)
    indent(root)
    return HEADER + tostring(root, encoding='unicode') + '\n'


def _add_link(root: Element, name: str, position: Iterable[float],
              rotation: Iterable[float] = ORIGIN) -> Element:
    """Add a link that is fixed to ``base_link`` at ``position`` [m], ``rotation`` [rad]."""
    link = SubElement(root, 'link', name=name)
    _add_joint(root, f'{name}_joint', 'fixed', name, position, rotation)
    return link


def _add_joint(root: Element, name: str, kind: str, child: str, position: Iterable[float],
               rotation: Iterable[float] = ORIGIN) -> Element:
    joint = SubElement(root, 'joint', name=name, type=kind)
    SubElement(joint, 'parent', link='base_link')
    SubElement(joint, 'child', link=child)
    _add_origin(joint, position, rotation)
    return joint


def _add_chassis(root: Element, robot: RobotParams, body: RigidBody) -> None:
    link = _add_link(root, 'chassis_link', ORIGIN)
    for kind, material in (('visual', 'chassis'), ('collision', '')):
        _add_box(link, kind, chassis_size(robot), material=material)
    _add_inertial(link, body, body.center)


def _add_wheel(root: Element, robot: RobotParams, wheel: str, body: RigidBody) -> None:
    link = SubElement(root, 'link', name=f'{wheel}_wheel')
    radius, width = robot.wheel_radius, tire_width(robot)
    for kind, material in (('visual', 'tire'), ('collision', '')):
        shape = _add_shape(link, kind, ORIGIN, ALONG_AXLE, material)
        SubElement(shape, 'cylinder', radius=_text([radius]), length=_text([width]))
    sides = (radius * SPOKE_SIZE[0], width * SPOKE_SIZE[1], radius * SPOKE_SIZE[2])
    _add_box(link, 'visual', sides, material='spoke')  # shows that the wheel turns
    if wheel in robot.film.wheels:
        _add_films(link, robot, wheel)
    _add_inertial(link, body, ORIGIN)
    joint = _add_joint(root, wheel, 'continuous', link.get('name', ''),
                       wheel_centers(robot)[wheel])
    SubElement(joint, 'axis', xyz=_text(AXLE))


def _add_films(link: Element, robot: RobotParams, wheel: str) -> None:
    """
    Add the films on the tread of a wheel, with the names in ``tire_samples``.

    Their mounting angle is not a parameter: at wheel angle 0, position 0 is drawn at the lowest
    point. Film 1 enters the contact patch first, so the others are further forward.
    """
    radius, film = robot.wheel_radius, robot.film
    for number, center in enumerate(film.centers, 1):
        angle = center / radius
        position = (radius * math.sin(angle), 0.0, -radius * math.cos(angle))
        _add_box(link, 'visual', (film.length, film.width, FILM_THICKNESS), position,
                 (0.0, -angle, 0.0), material='film', name=f'{wheel}_pvdf_{number}')


def _add_box(link: Element, kind: str, size: Iterable[float], position: Iterable[float] = ORIGIN,
             rotation: Iterable[float] = ORIGIN, *, material: str, **attributes: str) -> None:
    geometry = _add_shape(link, kind, position, rotation, material, **attributes)
    SubElement(geometry, 'box', size=_text(size))


def _add_shape(link: Element, kind: str, position: Iterable[float], rotation: Iterable[float],
               material: str, **attributes: str) -> Element:
    """Add a visual or collision element; return its geometry."""
    shape = SubElement(link, kind, attributes)
    _add_origin(shape, position, rotation)
    geometry = SubElement(shape, 'geometry')
    if material:
        SubElement(shape, 'material', name=material)
    return geometry


def _add_inertial(link: Element, body: RigidBody, center: Iterable[float]) -> None:
    inertial = SubElement(link, 'inertial')
    _add_origin(inertial, center, ORIGIN)
    SubElement(inertial, 'mass', value=_text([body.mass]))
    x, y, z = body.inertia
    SubElement(inertial, 'inertia', ixx=_text([x]), ixy='0', ixz='0', iyy=_text([y]), iyz='0',
               izz=_text([z]))


def _add_origin(parent: Element, position: Iterable[float], rotation: Iterable[float]) -> None:
    SubElement(parent, 'origin', xyz=_text(position), rpy=_text(rotation))


def _text(numbers: Iterable[float]) -> str:
    return ' '.join(f'{number + 0.0:.9g}' for number in numbers)  # + 0.0: no negative zero


def main() -> None:
    """Write the description of the robot with the parameters in the given files."""
    parser = ArgumentParser(prog='urdf_writer', description='Write the URDF of a robot.')
    parser.add_argument('file', type=Path, help='URDF to write')
    parser.add_argument('--params', type=Path, nargs='+', default=[], metavar='FILE',
                        help='parameter files; later ones win')
    arguments = parser.parse_args()
    try:
        write_text(arguments.file, urdf_text(load_robot(arguments.params)))
    except ParameterError as error:
        parser.error(str(error))


if __name__ == '__main__':
    main()
