# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameter files for other robots, and the messages of their joint_state_broadcaster."""

from __future__ import annotations

from itertools import product
from math import isnan, nan
from pathlib import Path
import re
from types import SimpleNamespace

import numpy as np
import pytest
from smart_tire import load_params
from smart_tire.errors import MessageError
from smart_tire.messages import wheels_from_msg
from smart_tire.messages.joint_names import OtherJointsError
from smart_tire.parameters import load_robot, NODE_PARAMS, RobotParams, specs
from smart_tire.parameters.files import load_files, misspelled
from smart_tire.parameters.spec import known_names
from smart_tire.parameters.urdf_writer import rigid_bodies
from smart_tire.samples import WHEELS

FOLDER = Path(__file__).resolve().parents[1] / 'config' / 'platforms'
FILES = {path.stem: path for path in sorted(FOLDER.glob('*'))}
GRAVITY = 9.81  # m/s2
# From the URDF of the maker, body fixed in base_link: mass [kg], center of mass [m] above the
# axles and moment of inertia about z [kg m2] of the parts between the wheels; then those of a
# wheel: mass, moment about z, and position of the front left one [m].
LINKS = {
    'husky': ([(46.034, (0.0, 0.0, 0.062 - 0.03282), 2.0296)],
              (2.637, 0.02467, (0.512 / 2, 0.555 / 2))),
    'jackal': ([(16.523, (0.012, 0.002, 0.067 - 0.0345), 0.4485)],
               (0.477, 0.0013, (0.262 / 2, 0.37559 / 2))),
    'warthog': ([(100.0, (0.0, 0.0, 0.012977), 100.0 / 12 * (1.35**2 + 0.70**2)),
                 *((50.0, (0.0, side * (0.56821 - 0.05), 0.197 + 0.012977),
                    50.0 / 12 * (1.34**2 + 0.28**2)) for side in (1, -1))],
                (15.0, 15.0 / 12 * (3 * 0.3**2 + 0.25**2), (0.457367, 0.56821)))}
# Those without mass and inertia of all links: names of the joints of the wheels, by speed below
JOINTS = {
    'leo': {'wheel_FL_joint': 1.0, 'wheel_RL_joint': 3.0, 'wheel_FR_joint': 2.0,
            'wheel_RR_joint': 4.0},
    'turtlebot4': {'left_wheel_joint': 1.0, 'right_wheel_joint': 2.0}}
SPEEDS = {'front_left': 1.0, 'front_right': 2.0, 'rear_left': 1.0, 'rear_right': 2.0}  # rad/s

every_platform = pytest.mark.parametrize('name', FILES)
of_clearpath = pytest.mark.parametrize('name', LINKS)


def test_these_are_the_platforms():
    assert {path.suffix for path in FILES.values()} == {'.yaml'}
    assert FILES.keys() == {*LINKS, *JOINTS}


@every_platform
def test_the_nodes_of_the_package_read_the_file_without_a_warning(name):
    robot = load_robot([FILES[name]])
    assert load_params(FILES[name]).robot == robot
    assert not list(misspelled(FILES[name], NODE_PARAMS))
    known = known_names([*NODE_PARAMS.values(), RobotParams])
    own = load_files([FILES[name]], 'slip_estimator', known,
                     known_names([NODE_PARAMS['slip_estimator']]))
    # robot_state_publisher and ekf_node of the base publish these frames
    assert own['publish_imu_tf'] is own['publish_tf'] is robot.publish_tf is False
    assert robot.film.wheels == ()


@every_platform
def test_every_parameter_has_its_unit_and_its_origin(name):
    units = {one.name.rpartition('.')[2]: one.unit
             for one in specs(NODE_PARAMS['slip_estimator']).values()}
    above = ''
    for line in FILES[name].read_text(encoding='utf-8').splitlines():
        key, _, comment = (part.strip() for part in line.partition('#'))
        if re.fullmatch(r'\w+: \S.*', key):
            comment, unit = comment or above, units[key.partition(':')[0]]
            assert unit == '-' or comment.startswith(f'{unit}, '), line
            assert re.search(r'\[[DUH]\]|assumed|the base|as delivered', comment), line
        above = f'{above} {comment}'.strip() if comment and not key else ''


@of_clearpath
def test_mass_center_and_inertia_are_the_sum_of_the_links_of_the_maker(name):
    robot, (parts, (mass, inertia, corner)) = load_robot([FILES[name]]), LINKS[name]
    bodies = [*parts, *((mass, (x * corner[0], y * corner[1], 0.0), inertia)
                        for x, y in product((1, -1), repeat=2))]
    masses = np.array([body[0] for body in bodies])
    places = np.array([body[1] for body in bodies])
    center = masses @ places / masses.sum()
    yaw_inertia = sum(body[2] for body in bodies) + masses @ np.sum(
        (places - center)[:, :2]**2, axis=1)
    assert robot.mass == pytest.approx(masses.sum(), rel=3e-3)  # of three digits
    assert robot.center_of_mass == pytest.approx(center, abs=6e-4)
    assert robot.yaw_inertia == pytest.approx(yaw_inertia, rel=3e-3)
    assert (0.5 * robot.wheelbase, 0.5 * robot.track_width) == pytest.approx(corner, abs=6e-4)


@every_platform
def test_the_robot_is_plausible(name):
    robot = load_robot([FILES[name]])
    diagonal = np.hypot(robot.wheelbase, robot.track_width)
    two_wheels = name == 'turtlebot4'
    assert two_wheels or 2.0 * robot.wheel_radius < robot.wheelbase  # wheels do not overlap
    assert 0.2 < np.sqrt(robot.yaw_inertia / robot.mass) / diagonal < 0.6
    assert abs(robot.imu.position[0]) + robot.imu.position_sigma < 1.5 * diagonal
    assert 0.0 < robot.center_of_mass[2] < robot.wheel_radius
    paper = RobotParams()
    load, of_paper = (0.25 * GRAVITY * one.mass for one in (robot, paper))
    assert robot.tire.longitudinal_stiffness / load == pytest.approx(
        paper.tire.longitudinal_stiffness / of_paper, rel=0.01)
    chassis, _ = rigid_bodies(robot)
    assert min(chassis.inertia) > 0.0


def joint_states(names, *, velocity=(), position=()):
    """
    Return a message of joint_state_broadcaster with the joints ``names``.

    It has position, velocity and effort for each; NaN where the hardware has no interface, or has
    not been read yet.
    """
    velocities, positions = ([dict(given).get(name, nan) for name in names]
                             for given in (velocity, position))
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=10, nanosec=0), frame_id=''),
        name=list(names), position=positions, velocity=velocities, effort=[nan] * len(names))


WHEEL_JOINTS = {f'{wheel}_wheel_joint': speed for wheel, speed in SPEEDS.items()}
# an arm and a gripper on the robot; passive joints of the suspension; alphabetical, as published
ALL_JOINTS = sorted([*WHEEL_JOINTS, 'arm_0_shoulder_pan_joint', 'arm_0_gripper_finger_joint',
                     'left_diff_unit_joint', 'right_diff_unit_joint'])


@of_clearpath
@pytest.mark.parametrize('names', [sorted(WHEEL_JOINTS), ALL_JOINTS, ALL_JOINTS[::-1]])
def test_the_wheels_of_joint_state_broadcaster_are_read_and_other_joints_ignored(name, names):
    joints = load_robot([FILES[name]]).joints
    sample = wheels_from_msg(joint_states(names, velocity=WHEEL_JOINTS, position=WHEEL_JOINTS),
                             joints=joints)
    assert sample.velocity == sample.position == tuple(SPEEDS[wheel] for wheel in WHEELS)
    assert sample.effort is None  # no torque is measured
    assert joints.encoders_per_side == 1


@pytest.mark.parametrize('name', JOINTS)
def test_the_wheels_of_other_makers_are_those_of_their_names(name):
    joints, speeds = load_robot([FILES[name]]).joints, JOINTS[name]
    sample = wheels_from_msg(joint_states(
        [*speeds, 'rocker_L_joint'], velocity=speeds, position=speeds), joints=joints)
    assert sample.velocity == sample.position == (
        (1.0, 2.0, 3.0, 4.0) if name == 'leo' else (1.0, 2.0, 1.0, 2.0))
    assert joints.encoders_per_side == (2 if name == 'leo' else 1)


@pytest.mark.parametrize('names', [sorted(WHEEL_JOINTS), ALL_JOINTS])
def test_the_wheels_are_recognized_without_parameters(names):
    sample = wheels_from_msg(joint_states(names, velocity=WHEEL_JOINTS))
    assert sample.velocity == tuple(SPEEDS[wheel] for wheel in WHEELS)
    assert sample.position is sample.effort is None  # only velocities are measured


@of_clearpath
def test_hardware_that_has_not_been_read_and_other_publishers_give_no_sample(name):
    joints = load_robot([FILES[name]]).joints
    assert all(map(isnan, joint_states(ALL_JOINTS).velocity))
    with pytest.raises(MessageError, match='velocity'):
        wheels_from_msg(joint_states(ALL_JOINTS), joints=joints)
    with pytest.raises(OtherJointsError):  # ignored silently: joint_states of an arm
        wheels_from_msg(joint_states(['arm_0_shoulder_pan_joint']), joints=joints)
