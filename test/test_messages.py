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

"""Samples to messages and back: namespaces, rosbags and rclpy messages."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
import math
import re
from types import SimpleNamespace
from typing import get_args

from hypothesis import given, strategies as st
import pytest
from smart_tire.bags.cdr import empty, Encoder, typestore
from smart_tire.errors import MessageError
from smart_tire.messages import (
    find_topic, stamp_of, topic_of, TOPICS, transform_to_msg, velocity_from_twist, wheels_from_msg)
from smart_tire.messages.joint_state import (
    friction_from_msg, ground_state_from_msg, ground_state_to_msg, motor_command_from_msg,
    tire_from_msg, tire_to_msg, wheel_slip_from_msg, wheel_slip_to_msg, wheels_to_msg)
from smart_tire.messages.odometry_imu import (
    imu_from_msg, imu_to_msg, odometry_from_msg, odometry_to_msg, velocity_from_msg)
from smart_tire.samples import (
    BatterySample, Friction, FRICTION_QUANTITIES, GoalPose, GroundState, Icr, ImuSample,
    MotorCommand, NAN, Odometry, PathProgress, PlannedPath, Sample, TireSample, VelocityCommand,
    WheelCommand, WHEELS, WheelSample, WheelSlip)
from smart_tire.uncertain import Uncertain, UNKNOWN

STAMP = 1_700_000_000_123_456_789
JOINTS = 'sensor_msgs/msg/JointState'
FOUR = (1.5, -2.25, 3.0, 0.125)
COVARIANCE = tuple(0.5 * number for number in range(36))
SAMPLES = [
    ImuSample(STAMP, (0.1, -0.2, 9.81), (0.01, 0.02, -0.5), (0.0, 0.6, 0.0, 0.8)),
    ImuSample(STAMP, (0.1, -0.2, 9.81), (0.01, 0.02, -0.5)),
    WheelSample(STAMP, FOUR, (10.0, 20.0, 30.0, 40.0), (0.5, -0.5, 1.0, 0.0)),
    WheelSample(STAMP, FOUR),
    TireSample(STAMP, 'rear_left', (1.65, 2.5)),
    TireSample(STAMP, 'front_right', (0.0,)),
    BatterySample(STAMP, 'front_left', 3.75),
    VelocityCommand(STAMP, 0.8, -0.25),
    WheelCommand(STAMP, FOUR),
    MotorCommand(STAMP, (0.5, -0.25, 1.0, -1.0)),
    Odometry(STAMP, (1.0, 2.0, 0.0), (0.0, 0.0, 0.6, 0.8), (0.5, 0.0, 0.0), (0.0, 0.0, 0.25),
             COVARIANCE, COVARIANCE[::-1]),
    WheelSlip(STAMP, (0.1, -1.0, 0.0, 1.0), FOUR, (0.01, 0.02, 1.0, math.inf)),
    Icr(STAMP, 0.02, -1.5),
    GroundState(STAMP, Uncertain(25.0, 1.5), Uncertain(0.05, math.inf),
                *(Uncertain(0.1 * k, 0.01) for k in range(5)), -0.9),
    Friction(STAMP, 'rear_right', **dict.fromkeys(FRICTION_QUANTITIES, Uncertain(0.5, math.inf))),
    PlannedPath(STAMP, 'odom', ((1.0, -2.5, 0.0), (1.5, 0.25, NAN))),
    GoalPose(STAMP, 'odom', (1.0, -2.5, 0.0)),
    PathProgress(STAMP, 2.5, -0.125, 1),
]


def as_namespace(type_name):
    """Return a new message as a namespace of lists and numbers."""
    return empty(type_name)


def as_rosbags(type_name):
    """Return a new message as rosbags decodes it, with numpy arrays."""
    return typestore().deserialize_cdr(Encoder(type_name)(empty(type_name)), type_name)


def as_rclpy(type_name):
    """Return a new message of rclpy."""
    package, kind, name = type_name.split('/')
    try:
        return getattr(import_module(f'{package}.{kind}'), name)()
    except ModuleNotFoundError:
        pytest.skip(f'{package} is not installed')


every_kind = pytest.mark.parametrize('new', [as_namespace, as_rosbags, as_rclpy])


def joints(**fields):
    """Return a JointState with these fields; its default frame is front_right."""
    msg = empty(JOINTS)
    msg.header.frame_id = 'front_right'
    vars(msg).update(fields)
    return msg


@every_kind
@pytest.mark.parametrize('sample', SAMPLES, ids=lambda sample: type(sample).__name__)
def test_samples_survive_conversion_to_a_message_and_back(new, sample):
    topic = TOPICS[topic_of(sample)]
    assert topic.from_msg(topic.to_msg(new(topic.type), sample)) == sample


@pytest.mark.parametrize('name', TOPICS)
def test_every_topic_converts_its_sample_with_its_frame(name):
    topic = TOPICS[name]
    sample = next(sample for sample in SAMPLES if isinstance(sample, topic.sample))
    msg = topic.to_msg(empty(topic.type), sample)
    assert msg.header.frame_id == (topic.frame or sample.wheel)
    assert topic.from_msg(msg) == sample


def test_every_sample_has_a_topic():
    assert {TOPICS[topic_of(sample)].sample for sample in SAMPLES} == set(get_args(Sample))


@every_kind
def test_a_message_can_be_reused(new):
    msg = new('sensor_msgs/msg/Imu')
    for sample in (SAMPLES[1], SAMPLES[0], SAMPLES[1], SAMPLES[0]):
        assert imu_from_msg(imu_to_msg(msg, sample)) == sample
    msg = new(JOINTS)
    for sample in (SAMPLES[2], SAMPLES[3], SAMPLES[2]):
        assert wheels_from_msg(wheels_to_msg(msg, sample)) == sample


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_timestamps_are_exact_to_the_nanosecond(stamp_ns):
    assert stamp_of(tire_to_msg(empty(JOINTS), TireSample(stamp_ns, 'rear_left', (1.0,)))) \
        == stamp_ns


@given(st.permutations(['rear_right', 'arm', 'front_left', 'rear_left', 'front_right', 'lamp']))
def test_wheels_are_found_by_name_in_any_order_among_other_joints(names):
    speeds = {'front_left': 1.0, 'front_right': 2.0, 'rear_left': 3.0, 'rear_right': 4.0}
    velocity = [speeds.get(name, math.nan) for name in names]  # any value for other joints
    assert wheels_from_msg(joints(name=names, velocity=velocity)).velocity == (1.0, 2.0, 3.0, 4.0)


def test_films_are_found_by_number_in_any_order_among_other_joints():
    msg = joints(name=['front_right_pvdf_2', 'thermometer', 'front_right_pvdf_1'],
                 position=[2.0, 40.0, 1.0])
    assert tire_from_msg(msg).volts == (1.0, 2.0)


def wheel_joints(**fields):
    """Return valid wheel states except for ``fields``."""
    return joints(**{'name': ['front_left', 'front_right', 'rear_left', 'rear_right'],
                     'velocity': [1.0, 2.0, 3.0, 4.0], **fields})


@pytest.mark.parametrize(('fields', 'named'), [
    ({'velocity': []}, 'velocity'),
    ({'velocity': [1.0, 2.0, 3.0]}, 'velocity'),
    ({'velocity': [1.0, 2.0, 3.0, math.nan]}, 'velocity'),
    ({'position': [1.0, 2.0]}, 'position'),
    ({'position': [1.0, math.inf, 3.0, 4.0]}, 'position'),
    ({'velocity': [math.nan] * 4}, 'velocity'),
    ({'name': ['front_left', 'front_right', 'rear_left', 'left_rear']}, 'name'),
    ({'name': ['front_left', 'front_right', 'rear_left', 'rear_left']}, 'name'),
    ({'name': []}, 'name'),
])
def test_invalid_wheel_states_are_refused_by_field(fields, named):
    with pytest.raises(MessageError, match=f'^wheel_states: {named} '):
        wheels_from_msg(wheel_joints(**fields))


@pytest.mark.parametrize(('fields', 'named'), [
    ({'position': [1.0, math.nan]}, 'position'),
    ({'position': [1.0]}, 'position'),
    ({'name': ['front_right_pvdf_2', 'front_right_pvdf_3']}, 'name'),
    ({'name': ['front_right_pvdf_1', 'front_right_pvdf_1']}, 'name'),
    ({'name': ['rear_left_pvdf_1', 'rear_left_pvdf_2']}, 'name'),
    ({'name': ['front_right_pvdf_1', 'front_right_pvdf_x']}, 'name'),
])
def test_invalid_tire_samples_are_refused_by_field(fields, named):
    right = {'name': ['front_right_pvdf_1', 'front_right_pvdf_2'], 'position': [1.0, 2.0]}
    assert tire_from_msg(joints(**right)).volts == (1.0, 2.0)
    with pytest.raises(MessageError, match=f'^tire_samples: {named} '):
        tire_from_msg(joints(**{**right, **fields}))


def test_an_unknown_wheel_is_refused_by_name():
    msg = tire_to_msg(empty(JOINTS), TireSample(STAMP, 'rear_left', (1.0, 2.0)))
    msg.header.frame_id = 'spare_wheel'
    with pytest.raises(MessageError, match="tire_samples: header.frame_id is 'spare_wheel'"):
        tire_from_msg(msg)


@pytest.mark.parametrize(('sample', 'path'), [
    (SAMPLES[1], 'linear_acceleration.y'),
    (SAMPLES[1], 'angular_velocity.z'),
    (SAMPLES[10], 'pose.pose.position.x'),
    (SAMPLES[10], 'twist.twist.angular.z'),
    (SAMPLES[7], 'twist.linear.x'),
    (SAMPLES[12], 'point.x'),
    (SAMPLES[6], 'voltage'),
])
@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_a_number_that_is_not_finite_is_refused_by_topic_and_field(sample, path, value):
    topic = TOPICS[topic_of(sample)]
    msg = topic.to_msg(empty(topic.type), sample)
    *owners, leaf = path.split('.')
    owner = msg
    for name in owners:
        owner = getattr(owner, name)
    setattr(owner, leaf, value)
    with pytest.raises(MessageError, match=rf'^{topic.name}: {owners[0] if owners else leaf}'):
        topic.from_msg(msg)


def test_a_covariance_of_the_wrong_size_is_refused():
    msg = odometry_to_msg(empty('nav_msgs/msg/Odometry'), SAMPLES[10])
    msg.twist.covariance = msg.twist.covariance[:35]
    with pytest.raises(MessageError, match='^odom: twist.covariance'):
        odometry_from_msg(msg)


def test_invalid_ground_truth_is_refused_under_its_own_name():
    topic = TOPICS['ground_truth/odom']
    msg = topic.to_msg(empty(topic.type), SAMPLES[10])
    msg.pose.pose.position.x = math.nan
    with pytest.raises(MessageError, match='^ground_truth/odom: '):
        topic.from_msg(msg)


@every_kind
@pytest.mark.parametrize(('field', 'unknown'), [
    ('position', (math.nan,) * 4), ('position', (1.0, math.nan, 3.0, 4.0)),
    ('effort', (math.nan,) * 4)])
def test_nan_in_an_optional_wheel_field_makes_only_that_field_none(new, field, unknown):
    msg = wheels_to_msg(new(JOINTS), SAMPLES[2])
    setattr(msg, field, unknown)
    assert wheels_from_msg(msg) == replace(SAMPLES[2], **{field: None})


@every_kind
def test_the_torque_of_one_wheel_may_be_missing(new):
    msg = wheels_to_msg(new(JOINTS), SAMPLES[2])
    msg.effort = (1.0, math.nan, 3.0, 4.0)
    effort = wheels_from_msg(msg).effort
    assert effort is not None and math.isnan(effort[1])
    assert (effort[0], *effort[2:]) == (1.0, 3.0, 4.0)


def test_an_infinite_torque_is_refused():
    with pytest.raises(MessageError, match='^wheel_states: effort'):
        wheels_from_msg(wheel_joints(velocity=[1.0] * 4, effort=[1.0, math.inf, 3.0, 4.0]))


@pytest.mark.parametrize(('sample', 'field', 'limit'), [
    (SAMPLES[1], 'linear_acceleration', r'1000 m/s2'),
    (SAMPLES[1], 'angular_velocity', r'100 rad/s'),
])
@pytest.mark.parametrize('value', [1001.0, -1e300])
def test_implausible_imu_values_are_refused_with_value_and_limit(
        sample, field, limit, value):
    msg = imu_to_msg(empty('sensor_msgs/msg/Imu'), sample)
    getattr(msg, field).y = value
    found = re.escape(str(value))
    with pytest.raises(MessageError, match=f'^imu/data: {field} is .*{found}.*most {limit}'):
        imu_from_msg(msg)


@pytest.mark.parametrize('value', [1001.0, -1e300])
def test_implausible_wheel_speeds_are_refused_with_value_and_limit(value):
    found = re.escape(str(value))
    with pytest.raises(MessageError, match=f'^wheel_states: velocity is .*{found}.*1000 rad/s'):
        wheels_from_msg(wheel_joints(velocity=[1.0, value, 3.0, 4.0]))


@pytest.mark.parametrize('orientation', [
    None, (0.0, 0.0, 0.0, 0.0), (math.nan,) * 4, (0.0, math.nan, 0.0, 1.0)])
def test_an_orientation_that_is_not_measured_is_none(orientation):
    msg = imu_to_msg(empty('sensor_msgs/msg/Imu'), SAMPLES[0])
    if orientation is None:
        msg.orientation_covariance = [-1.0, *[0.0] * 8]
    else:
        msg.orientation.x, msg.orientation.y, msg.orientation.z, msg.orientation.w = orientation
    assert imu_from_msg(msg).orientation is None


def test_an_infinite_orientation_is_refused():
    msg = imu_to_msg(empty('sensor_msgs/msg/Imu'), SAMPLES[0])
    msg.orientation.w = math.inf
    with pytest.raises(MessageError, match='^imu/data: orientation'):
        imu_from_msg(msg)


@every_kind
def test_a_slip_ratio_may_be_nan_but_not_its_sigma(new):
    slip = WheelSlip(STAMP, (math.nan, 0.1, 0.2, 0.3), FOUR, (1.0, 0.1, 0.1, 0.1))
    msg = wheel_slip_to_msg(new(JOINTS), slip)
    assert [math.isnan(ratio) for ratio in wheel_slip_from_msg(msg).ratio] == [True, *[False] * 3]
    msg.effort = [1.0, 0.1, math.nan, 0.1]
    with pytest.raises(MessageError, match='^wheel_slip: effort'):
        wheel_slip_from_msg(msg)


def test_the_ground_state_is_found_by_name_in_any_order_among_other_quantities():
    sample = next(sample for sample in SAMPLES if isinstance(sample, GroundState))
    msg = ground_state_to_msg(joints(), sample)
    assert list(msg.effort)[-1] == 0.0  # a correlation has no standard deviation
    for field in ('name', 'position', 'effort'):
        other = 'other' if field == 'name' else 5.0
        setattr(msg, field, [other, *reversed(getattr(msg, field))])
    assert ground_state_from_msg(msg) == sample


@pytest.mark.parametrize(('change', 'named'), [
    ({'name': ['stiffness'] * 8}, 'name'), ({'name': ['other'] * 8}, 'name'),
    ({'position': [1.0] * 7}, 'position'), ({'effort': [math.nan] * 8}, 'effort')])
def test_an_invalid_ground_state_is_refused_by_field(change, named):
    msg = ground_state_to_msg(joints(), next(
        sample for sample in SAMPLES if isinstance(sample, GroundState)))
    for field, value in change.items():
        setattr(msg, field, value)
    with pytest.raises(MessageError, match=f'^ground_state: {named} '):
        ground_state_from_msg(msg)


def test_missing_quantities_of_the_ground_are_unknown():
    ground = ground_state_from_msg(joints(
        name=['stiffness', 'other'], position=[50.0, 5.0], effort=[2.0, math.nan]))
    assert ground == GroundState(ground.stamp_ns, Uncertain(50.0, 2.0))
    assert ground.friction_coefficient.sigma == math.inf
    assert ground.stiffness_friction_correlation == 0.0


def test_missing_friction_quantities_are_unknown():
    msg = joints(name=['adhesion_ratio', 'other'], position=[0.7, 5.0], effort=[0.1, 1.0])
    friction = friction_from_msg(msg)
    assert friction.adhesion_ratio.value == 0.7
    assert friction.adhesion_ratio.sigma == 0.1
    assert all(friction.quantity(name) == UNKNOWN for name in FRICTION_QUANTITIES
               if name != 'adhesion_ratio')


def test_friction_without_any_quantity_is_refused():
    with pytest.raises(MessageError, match='^tire_friction: name '):
        friction_from_msg(joints(name=['other'], position=[5.0], effort=[1.0]))


def test_the_transform_equals_the_pose():
    msg = transform_to_msg(empty('geometry_msgs/msg/TransformStamped'), SAMPLES[10])
    assert (msg.header.frame_id, msg.child_frame_id) == ('odom', 'base_link')
    assert (msg.transform.translation.x, msg.transform.translation.y) == (1.0, 2.0)
    assert (msg.transform.rotation.z, msg.transform.rotation.w) == (0.6, 0.8)


@pytest.mark.parametrize(('name', 'meant'), [
    ('imu/data', 'imu/data'),
    ('/imu/data', 'imu/data'),
    ('/field/robot_1/imu/data', 'imu/data'),
    ('/robot_1/odom', 'odom'),
    ('/robot_1/ground_truth/odom', 'ground_truth/odom'),
    ('overhead/wheel_slip', 'overhead/wheel_slip'),
])
def test_topics_are_found_in_any_namespace(name, meant):
    assert find_topic(name) is TOPICS[meant]


@pytest.mark.parametrize('name', ['/imu', '/data', '/imu/data_raw', '/my_odom', '/', ''])
def test_similar_names_are_not_topics_of_the_table(name):
    assert find_topic(name) is None


HEADER = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0), frame_id='base_link')


@pytest.mark.parametrize('duty', [1.0001, -1.0001, 1e308])
def test_a_duty_beyond_1_is_refused(duty):
    with pytest.raises(MessageError, match='motor_commands: effort .*magnitudes of at most 1'):
        motor_command_from_msg(SimpleNamespace(
            header=HEADER, name=list(WHEELS), effort=[0.0, 0.0, 0.0, duty]))


@pytest.mark.parametrize(('linear', 'angular', 'text'), [
    (100.1, 0.0, 'twist.linear is .*at most 100 m/s'), (1e308, 0.0, 'twist.linear'),
    (-100.1, 0.0, 'twist.linear'), (0.0, 100.1, 'twist.angular is .*at most 100 rad/s'),
    (math.inf, 0.0, 'finite'), (0.0, math.nan, 'finite')])
def test_an_implausible_velocity_is_refused(linear, angular, text):
    message = SimpleNamespace(header=HEADER, twist=SimpleNamespace(
        linear=SimpleNamespace(x=linear, y=0.0, z=0.0),
        angular=SimpleNamespace(x=0.0, y=0.0, z=angular)))
    with pytest.raises(MessageError, match=text):
        velocity_from_msg(message)
    with pytest.raises(MessageError, match=text.removeprefix('twist.')):
        velocity_from_twist(message.twist)
    message.twist.linear.x, message.twist.angular.z = 100.0, -100.0
    assert velocity_from_msg(message).v_x == 100.0
    assert velocity_from_twist(message.twist) == VelocityCommand(0, 100.0, -100.0)
