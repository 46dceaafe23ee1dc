# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Joints of a JointState message as wheels."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from smart_tire.errors import MessageError, ParameterError
from smart_tire.messages import OtherJointsError, resolved_joints, wheels_from_msg
from smart_tire.messages.joint_names import recognized_joints
from smart_tire.messages.joint_state import wheel_slip_from_msg
from smart_tire.parameters import build, JointParams, RobotParams, WheelControllerParams
from smart_tire.parameters.tuning import SlipEstimatorParams
from smart_tire.samples import WHEELS

STAMP = SimpleNamespace(sec=1, nanosec=5)
NAN = math.nan


def joint_state(velocity, position=(), effort=()):
    """Return a JointState from ``velocity`` (name -> rad/s) and values in the same order."""
    return SimpleNamespace(header=SimpleNamespace(stamp=STAMP), name=list(velocity),
                           velocity=list(velocity.values()), position=list(position),
                           effort=list(effort))


@pytest.mark.parametrize('names', [
    WHEELS,
    ['front_left_wheel', 'front_right_wheel', 'rear_left_wheel', 'rear_right_wheel'],
    ['wheel_left_front_joint', 'wheel_right_front_joint', 'wheel_left_rear_joint',
     'wheel_right_rear_joint'],
    ['frontLeftWheel', 'frontRightWheel', 'backLeftWheel', 'backRightWheel'],
    ['fl_wheel_joint', 'fr_wheel_joint', 'rl_wheel_joint', 'rr_wheel_joint'],
    ['wheel_FL', 'wheel_FR', 'wheel_BL', 'wheel_BR'],
    ['front_left_motor', 'front_right_motor', 'rear_left_motor', 'rear_right_motor']])
def test_the_four_wheels_are_recognized_among_other_joints(names):
    others = ['arm_left_1_joint', 'front_left_steering_joint', 'gripper', 'front_caster_wheel']
    assert recognized_joints([*others, *reversed(names)]).names == tuple(names)


@pytest.mark.parametrize('left, right', [
    ('left', 'right'), ('wheel_left_joint', 'wheel_right_joint'), ('left_wheel', 'right_wheel'),
    ('drivewhl_l_joint', 'drivewhl_r_joint')])
def test_the_wheels_of_a_two_wheel_drive_are_recognized(left, right):
    names = ['caster_back_left_joint', right, 'head_left_joint', left]
    assert recognized_joints(names).names == (left, right, left, right)


@pytest.mark.parametrize('names', [
    ['wheel_1', 'wheel_2', 'wheel_3', 'wheel_4'],
    ['left_wheel'],
    ['left_hand', 'right_hand'],
    ['left_shoulder', 'right_shoulder'],
    ['rear_left_wheel', 'rear_right_wheel'],                    # an unpowered front axle
    ['left_wheel', 'right_wheel', 'rear_wheel'],
    ['left_wheel', 'right_wheel', 'left_wheel_2', 'right_wheel_2'],
    [*WHEELS[:3]],
    [*(f'{wheel}_wheel' for wheel in WHEELS), 'mid_left_wheel', 'mid_right_wheel'],
    [*(f'{wheel}_wheel' for wheel in WHEELS), 'front_left_wheel_2']])
def test_names_with_another_possible_reading_are_not_recognized(names):
    assert recognized_joints(names) is None


def test_given_joints_are_read_by_name_sign_and_share_of_the_torque():
    joints = JointParams(left='L', right='R', inverted=('R',))
    msg = joint_state({'R': -3.0, 'arm': 9.0, 'L': 2.0}, (-30.0, 1.0, 20.0), (-6.0, 1.0, 4.0))
    sample = wheels_from_msg(msg, joints=joints)
    assert sample.velocity == (2.0, 3.0, 2.0, 3.0)
    assert sample.position == (20.0, 30.0, 20.0, 30.0)
    assert sample.effort == (2.0, 3.0, 2.0, 3.0)  # one motor drives both wheels of a side
    assert sample.stamp_ns == 1_000_000_005


def test_a_wheel_without_joint_is_not_measured():
    joints = JointParams(front_left='a', front_right='b', rear_left='', rear_right='d')
    msg = joint_state({'a': 1.0, 'b': 2.0, 'd': 4.0}, (1.0, 2.0, 4.0), (1.0, NAN, 4.0))
    sample = wheels_from_msg(msg, joints=joints)
    for values in (sample.velocity, sample.position):
        assert values[:2] == (1.0, 2.0) and math.isnan(values[2]) and values[3] == 4.0
    assert sample.effort[0] == 1.0 and all(map(math.isnan, sample.effort[1:3]))
    assert wheels_from_msg(replace_field(msg, 'position', [1.0, NAN, 4.0]),
                           joints=joints).position is None
    with pytest.raises(MessageError, match='velocity'):
        wheels_from_msg(replace_field(msg, 'velocity', [1.0, NAN, 4.0]), joints=joints)
    with pytest.raises(MessageError, match='at most 1000 rad/s'):
        wheels_from_msg(replace_field(msg, 'velocity', [1.0, 2e3, 4.0]), joints=joints)


def replace_field(msg, name, values):
    return SimpleNamespace(**{**vars(msg), name: values})


def test_a_message_of_other_joints_is_distinguished_from_an_incomplete_one():
    joints = JointParams(left='L', right='R')
    with pytest.raises(OtherJointsError):
        wheels_from_msg(joint_state({'arm': 1.0}), joints=joints)
    with pytest.raises(MessageError, match='expected each of L, R once') as raised:
        wheels_from_msg(joint_state({'arm': 1.0, 'L': 1.0}), joints=joints)
    assert not isinstance(raised.value, OtherJointsError)


def test_standard_names_are_understood_with_any_joints():
    """The drivers of this package and its simulator always publish them."""
    joints = JointParams(front_left='a', front_right='b', rear_left='', rear_right='d',
                         inverted=('a',))
    msg = joint_state(dict(zip(WHEELS, (1.0, 2.0, 3.0, 4.0))))
    for recognize in (True, False):
        sample = wheels_from_msg(msg, joints=joints, recognize=recognize)
        assert sample.velocity[:2] == (1.0, 2.0) and math.isnan(sample.velocity[2])


def test_joints_are_recognized_only_if_none_are_given_and_recognition_is_wanted():
    msg = joint_state({'left_wheel': 1.0, 'right_wheel': 2.0})
    assert wheels_from_msg(msg).velocity == (1.0, 2.0, 1.0, 2.0)
    with pytest.raises(MessageError, match='parameters joints'):
        wheels_from_msg(msg, recognize=False)
    with pytest.raises(MessageError):
        wheels_from_msg(msg, joints=JointParams(left='l', right='right_wheel'))
    inverted = JointParams(inverted=('right_wheel',))
    assert wheels_from_msg(msg, joints=inverted).velocity == (1.0, -2.0, 1.0, -2.0)
    assert resolved_joints(msg.name, JointParams(inverted=('other',))).is_standard


@pytest.mark.parametrize('values, message', [
    ({'joints.left': 'l', 'joints.front_left': 'x'}, 'leave out joints.front_left'),
    ({'joints.front_left': '', 'joints.rear_left': ''}, 'one wheel of the left side'),
    ({'joints.left': 'x', 'joints.right': 'x'}, 'x is on both sides'),
    ({'joints.left': 'l', 'joints.right': 'r', 'joints.inverted': ['x']}, 'x is not the joint'),
    ({'joints.front_right': ''}, 'film.wheels: front_right is not measured')])
def test_contradicting_joints_are_refused(values, message):
    with pytest.raises(ParameterError, match=message):
        build(RobotParams, values)


def test_one_side_may_have_one_joint_and_the_other_two():
    joints = build(RobotParams, {'joints.left': 'l'}).joints
    assert joints.names == ('l', 'front_right', 'l', 'rear_right')
    assert (joints.encoders_per_side, JointParams().encoders_per_side) == (1, 2)


def test_forces_and_control_need_all_wheels():
    values = {'joints.rear_left': ''}
    with pytest.raises(ParameterError, match='cannot be controlled'):
        build(WheelControllerParams, values)
    with pytest.raises(ParameterError, match='force_balance'):
        build(SlipEstimatorParams, {**values, 'force_balance': 'on'})
    assert not all(build(SlipEstimatorParams, values).robot.joints.measured)


def test_the_slip_velocity_is_unknown_only_together_with_the_slip():
    msg = joint_state(dict(zip(WHEELS, (NAN, 0.1, 0.1, 0.1))), (NAN, 0.0, NAN, 0.0), (1.0,) * 4)
    slip = wheel_slip_from_msg(msg)
    assert math.isnan(slip.slip_velocity[0]) and slip.slip_velocity[2] == 0.1
    with pytest.raises(MessageError, match='velocity'):
        wheel_slip_from_msg(replace_field(msg, 'position', [0.0] * 4))
