# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The robot description: links, joints, rigid bodies, and that it follows the parameters."""

from __future__ import annotations

import math
from pathlib import Path
import subprocess
import sys

from hypothesis import given, strategies as st
import numpy as np
import pytest
from smart_tire.messages.film import DEFLECTION_NAMES, FRAME as FILM_FRAME
from smart_tire.messages.joint_state import film_names
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.parameters import build, RobotParams
from smart_tire.parameters.urdf_writer import rigid_bodies, RigidBody, urdf_text
from smart_tire.rotation import matrix
from smart_tire.samples import WHEELS
from urdf_parser_py.urdf import Robot

pytestmark = pytest.mark.processes

FILE = Path(__file__).resolve().parents[1] / 'urdf' / 'smart_tire.urdf'
OTHER = {  # parameters far from the defaults
    'wheel_radius': 0.15, 'track_width': 0.6, 'wheelbase': 0.5, 'mass': 40.0, 'yaw_inertia': 3.0,
    'center_of_mass': [0.03, -0.02, 0.05], 'imu.position': [-0.1, 0.0, 0.2],
    'imu.rotation': [math.pi, 0.0, 0.5], 'film.wheels': ['front_left', 'rear_right'],
    'film.positions': [0.0, 0.03, 0.06], 'film.stretch_gain': [300.0] * 3,
    'film.bending_peak': [0.8] * 3, 'motor.inertia': 0.02, 'tire.contact_width': 0.12}

every_robot = pytest.mark.parametrize('values', [{}, OTHER], ids=['default', 'other'])


def described(values):
    """Return the parameters and the parsed description of a robot."""
    robot = build(RobotParams, values)
    return robot, Robot.from_xml_string(urdf_text(robot).encode())


def joint_of(model, name):
    """Return a joint by its name."""
    joint, = (joint for joint in model.joints if joint.name == name)
    return joint


def pose(model, link):
    """Return position and rotation matrix of a link in base_link, at wheel angles of 0."""
    if link == model.get_root():
        return np.zeros(3), np.eye(3)
    joint, = (joint for joint in model.joints if joint.child == link)
    assert joint.parent == 'base_link'
    return np.array(joint.origin.xyz), matrix(*joint.origin.rpy)


def test_the_file_is_current():
    assert FILE.read_text(encoding='utf-8') == urdf_text(RobotParams()), 'run: make config'


@every_robot
def test_all_links_are_attached_to_base_link(values):
    _, model = described(values)
    assert model.get_root() == 'base_link'
    assert {link.name for link in model.links} == {
        'base_link', 'base_footprint', 'chassis_link', 'imu_link',
        *(f'{wheel}_wheel' for wheel in WHEELS)}
    assert {joint.parent for joint in model.joints} == {'base_link'}


@every_robot
def test_only_the_wheels_move_and_their_joints_have_the_names_in_wheel_states(values):
    _, model = described(values)
    moving = {joint.name: joint for joint in model.joints if joint.type != 'fixed'}
    assert moving.keys() == set(WHEELS)
    for wheel, joint in moving.items():
        assert (joint.type, joint.child) == ('continuous', f'{wheel}_wheel')
        assert joint.axis == [0.0, 1.0, 0.0] and joint.origin.rpy == [0.0, 0.0, 0.0]


@every_robot
def test_wheels_are_at_the_corners_with_x_forward_and_y_left(values):
    robot, model = described(values)
    x, y = 0.5 * robot.wheelbase, 0.5 * robot.track_width
    expected = {'front_left': (x, y), 'front_right': (x, -y), 'rear_left': (-x, y),
                'rear_right': (-x, -y)}
    for wheel, position in expected.items():
        assert pose(model, f'{wheel}_wheel')[0] == pytest.approx([*position, 0.0])
    assert pose(model, 'base_footprint')[0] == pytest.approx([0.0, 0.0, -robot.wheel_radius])


@every_robot
def test_the_imu_is_mounted_as_in_the_parameters(values):
    robot, model = described(values)
    position, rotation = pose(model, 'imu_link')
    assert position == pytest.approx(robot.imu.position)
    assert rotation == pytest.approx(matrix(*robot.imu.rotation), abs=1e-8)


@every_robot
def test_tires_lie_along_the_axle_and_touch_the_ground(values):
    robot, model = described(values)
    for wheel in WHEELS:
        link = model.link_map[f'{wheel}_wheel']
        for shape in (link.visuals[0], link.collisions[0]):
            assert shape.geometry.radius == pytest.approx(robot.wheel_radius)
            assert shape.geometry.length == pytest.approx(robot.tire.contact_width)
            assert abs(matrix(*shape.origin.rpy)[:, 2]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-8)


@every_robot
def test_films_are_drawn_on_instrumented_wheels_only(values):
    robot, model = described(values)
    for wheel in WHEELS:
        names = [shape.name for shape in model.link_map[f'{wheel}_wheel'].visuals if shape.name]
        expected = film_names(wheel, robot.film.count) if wheel in robot.film.wheels else ()
        assert names == list(expected)


@every_robot
def test_a_film_reaches_the_ground_when_the_wheel_has_rolled_its_position(values):
    robot, model = described(values)
    joint = joint_of(model, robot.film.wheels[0])
    films = [shape for shape in model.link_map[joint.child].visuals if shape.name]
    for shape, center in zip(films, robot.film.centers):
        turned = matrix(0.0, center / robot.wheel_radius * joint.axis[1], 0.0)
        lowest = [0.0, 0.0, -robot.wheel_radius]
        assert turned @ shape.origin.xyz == pytest.approx(lowest, abs=1e-8)
        assert turned @ matrix(*shape.origin.rpy) == pytest.approx(np.eye(3), abs=1e-8)
        assert shape.geometry.size[:2] == pytest.approx([robot.film.length, robot.film.width])


def bodies_of(model):
    """Return the rigid bodies of a description, at their position in base_link."""
    bodies = []
    for link in model.links:
        if link.inertial is not None:
            inertia = np.array(link.inertial.inertia.to_matrix())
            assert (inertia == np.diag(np.diag(inertia))).all() and not any(
                link.inertial.origin.rpy)
            center = pose(model, link.name)[0] + link.inertial.origin.xyz
            bodies.append(RigidBody(link.inertial.mass, tuple(center), tuple(np.diag(inertia))))
    return bodies


def assert_is_the_robot(bodies, robot):
    """Check that bodies are possible, and together have the parameters of robot."""
    for body in bodies:
        assert body.mass > 0.0 and min(body.inertia) > 0.0
        assert 2.0 * max(body.inertia) <= sum(body.inertia) * (1.0 + 1e-6)
    mass = sum(body.mass for body in bodies)
    assert mass == pytest.approx(robot.mass, rel=1e-6)
    center = sum(body.mass * np.array(body.center) for body in bodies) / mass
    assert center == pytest.approx(robot.center_of_mass, rel=1e-6, abs=1e-7)
    yaw_inertia = sum(body.inertia[2] + body.mass * np.sum((body.center - center)[:2]**2)
                      for body in bodies)
    assert yaw_inertia == pytest.approx(robot.yaw_inertia, rel=1e-6)


@every_robot
def test_mass_center_and_yaw_inertia_are_those_of_the_robot(values):
    robot, model = described(values)
    bodies = bodies_of(model)
    assert len(bodies) == 1 + len(WHEELS)
    assert_is_the_robot(bodies, robot)
    assert model.link_map['base_link'].inertial is None  # KDL ignores that of a root
    for wheel in WHEELS:
        inertia = model.link_map[f'{wheel}_wheel'].inertial.inertia
        assert inertia.iyy == pytest.approx(robot.motor.inertia)


@every_robot
def test_the_root_has_the_inertia_of_the_chassis_for_simulators_that_merge_no_links(values):
    robot, parts = described(values)
    model = Robot.from_xml_string(urdf_text(robot, inertia_in_base=True).encode())
    assert model.get_root() == 'base_link' and 'chassis_link' not in model.link_map
    assert model.link_map['base_link'].visuals and model.link_map['base_link'].collisions
    assert bodies_of(model) == bodies_of(parts)
    for joint in model.joints:
        assert joint.to_xml_string() == joint_of(parts, joint.name).to_xml_string()
    assert len(model.joints) == len(parts.joints) - 1


@given(mass=st.floats(0.01, 1e3), yaw_inertia=st.floats(1e-4, 1e3),
       center=st.tuples(*[st.floats(-0.5, 0.5)] * 3), track_width=st.floats(0.01, 3.0),
       wheelbase=st.floats(0.01, 3.0), radius=st.floats(0.07, 1.0), spin=st.floats(1e-5, 10.0))
def test_rigid_bodies_are_possible_for_any_robot(
        mass, yaw_inertia, center, track_width, wheelbase, radius, spin):
    robot = build(RobotParams, {
        'mass': mass, 'yaw_inertia': yaw_inertia, 'center_of_mass': center,
        'track_width': track_width, 'wheelbase': wheelbase, 'wheel_radius': radius,
        'motor.inertia': spin})
    chassis, wheels = rigid_bodies(robot)
    assert_is_the_robot([chassis, *wheels.values()], robot)
    for wheel in wheels.values():
        assert wheel.inertia[1] == pytest.approx(min(spin, wheel.mass * radius**2))


def write(*arguments):
    """Run the writer as a program; return its result."""
    return subprocess.run([sys.executable, '-m', 'smart_tire.parameters.urdf_writer', *arguments],
                          capture_output=True, text=True, check=False)


def test_the_program_writes_the_robot_of_the_given_files(tmp_path):
    (tmp_path / 'a.yaml').write_text('/**: {ros__parameters: {wheel_radius: 0.3, mass: 20.0}}')
    (tmp_path / 'b.yaml').write_text('/**: {ros__parameters: {mass: 30.0}}')
    out = tmp_path / 'robot.urdf'
    files = [str(tmp_path / name) for name in ('a.yaml', 'b.yaml')]
    assert write(str(out), '--params', *files).returncode == 0
    expected = build(RobotParams, {'wheel_radius': 0.3, 'mass': 30.0})
    assert out.read_text(encoding='utf-8') == urdf_text(expected)
    assert write(str(out), '--inertia-in-base', '--params', *files).returncode == 0
    assert out.read_text(encoding='utf-8') == urdf_text(expected, inertia_in_base=True)


def test_the_program_refuses_invalid_parameters_in_one_line(tmp_path):
    (tmp_path / 'a.yaml').write_text('/**: {ros__parameters: {mass: -1.0}}')
    result = write(str(tmp_path / 'robot.urdf'), '--params', str(tmp_path / 'a.yaml'))
    assert result.returncode == 2
    assert result.stderr.splitlines()[-1].endswith(
        'parameter mass: -1.0, expected 0.01 to 10000 kg')
    assert not (tmp_path / 'robot.urdf').exists()


def test_the_joint_of_a_film_is_that_of_its_messages():
    film = Robot.from_xml_string(FILE.with_name('film.urdf').read_text(encoding='utf-8'))
    assert film.get_root() == FILM_FRAME
    joint, = film.joints
    assert (joint.name,) == DEFLECTION_NAMES and joint.type == 'prismatic'
    size = film.link_map[FILM_FRAME].visual.geometry.size
    assert size[:2] == [FILMS['25x3'].length, FILMS['25x3'].width]
    assert joint.limit.upper == 0.5 * FILMS['25x3'].length
