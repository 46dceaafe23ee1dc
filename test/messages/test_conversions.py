# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Samples to messages and back: namespaces, rosbags and rclpy messages."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from importlib import import_module
import math
import re
from types import SimpleNamespace
from typing import get_args

from hypothesis import given, strategies as st
import numpy as np
import pytest
from smart_tire.bags.cdr import empty, Encoder, typestore
from smart_tire.errors import MessageError
from smart_tire.messages import (
    find_topic, imu_from_msg, imu_to_msg, NodeStatus, stamp_of, statuses_from_msg, topic_of,
    TOPICS, transform_to_msg, velocity_from_twist)
from smart_tire.messages.header import set_header
from smart_tire.samples import (
    FRICTION_QUANTITIES, GroundState, ImuSample, Sample, TireSamples, VelocityCommand, WHEELS,
    WheelSample)
from smart_tire.uncertain import Uncertain, UNKNOWN
from support.samples import COVARIANCE, FOUR, SAMPLES, STAMP

JOINTS = 'sensor_msgs/msg/JointState'


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


def changed(name, new=as_namespace, /, **fields):
    """Return the message of the first sample of a topic with ``fields`` (a__b: a.b) changed."""
    topic = TOPICS[name]
    sample = next(sample for sample in SAMPLES if isinstance(sample, topic.sample))
    msg = topic.to_msg(new(topic.type), sample)
    for path, value in fields.items():
        *owners, leaf = path.split('__')
        owner = msg
        for part in owners:
            owner = getattr(owner, part)
        setattr(owner, leaf, value)
    return msg


def read(name, new=as_namespace, /, **fields):
    """Return the sample in a changed message."""
    return TOPICS[name].from_msg(changed(name, new, **fields))


@every_kind
@pytest.mark.parametrize('sample', SAMPLES, ids=lambda sample: type(sample).__name__)
def test_samples_survive_conversion_to_a_message_and_back(new, sample):
    topic = TOPICS[topic_of(sample)]
    msg = topic.to_msg(new(topic.type), sample)
    assert topic.from_msg(msg) == sample
    for other in SAMPLES:  # a message can be reused
        if isinstance(other, topic.sample):
            assert topic.from_msg(topic.to_msg(msg, other)) == other


@pytest.mark.parametrize('name', TOPICS)
def test_every_topic_converts_its_sample_with_its_frame(name):
    msg, sample = changed(name), read(name)
    assert isinstance(sample, TOPICS[name].sample)
    assert msg.header.frame_id == (TOPICS[name].frame or sample.wheel)


def test_every_sample_has_a_topic():
    assert {TOPICS[topic_of(sample)].sample for sample in SAMPLES} \
        == set(get_args(Sample)) - {TireSamples}  # whose topic is a typed one


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_timestamps_are_exact_to_the_nanosecond(stamp_ns):
    msg = empty(JOINTS)
    set_header(msg, stamp_ns, 'rear_left')
    assert stamp_of(msg) == stamp_ns


@given(st.permutations(['rear_right', 'arm', 'front_left', 'rear_left', 'front_right', 'lamp']))
def test_wheels_are_found_by_name_in_any_order_among_other_joints(names):
    speeds = dict(zip(WHEELS, FOUR))
    velocity = [speeds.get(name, math.nan) for name in names]  # any value for other joints
    found = read('wheel_states', name=names, velocity=velocity, position=[], effort=[])
    assert found == WheelSample(STAMP, FOUR)


def test_films_are_found_by_number_in_any_order_among_other_joints():
    names = ['rear_left_pvdf_2', 'thermometer', 'rear_left_pvdf_1']
    assert read('tire_samples', name=names, position=[2.0, 40.0, 1.0]).volts == (1.0, 2.0)


@pytest.mark.parametrize(('name', 'fields', 'named'), [
    ('wheel_states', {'velocity': []}, 'velocity '),
    ('wheel_states', {'velocity': [1.0, 2.0, 3.0]}, 'velocity '),
    ('wheel_states', {'velocity': [1.0, 2.0, 3.0, math.nan]}, 'velocity '),
    ('wheel_states', {'velocity': [math.nan] * 4}, 'velocity '),
    ('wheel_states', {'velocity': [1.0, 1001.0, 3.0, 4.0]}, 'velocity is .*1001.*1000 rad/s'),
    ('wheel_states', {'velocity': [1.0, 2.0, 3.0, -1e300]}, 'velocity is .*1000 rad/s'),
    ('wheel_states', {'position': [1.0, 2.0]}, 'position '),
    ('wheel_states', {'position': [1.0, math.inf, 3.0, 4.0]}, 'position '),
    ('wheel_states', {'effort': [1.0, math.inf, 3.0, 4.0]}, 'effort '),
    ('wheel_states', {'name': [*WHEELS[:3], 'left_rear']}, 'name '),
    ('wheel_states', {'name': [*WHEELS[:3], 'rear_left']}, 'name '),
    ('wheel_states', {'name': []}, 'name '),
    ('tire_samples', {'position': [1.0, math.nan]}, 'position '),
    ('tire_samples', {'position': [1.0, -1001.0]}, 'position '),
    ('tire_samples', {'position': [1.0]}, 'position '),
    ('tire_samples', {'name': ['rear_left_pvdf_2', 'rear_left_pvdf_3']}, 'name '),
    ('tire_samples', {'name': ['rear_left_pvdf_1', 'rear_left_pvdf_1']}, 'name '),
    ('tire_samples', {'name': ['rear_right_pvdf_1', 'rear_right_pvdf_2']}, 'name '),
    ('tire_samples', {'name': ['rear_left_pvdf_1', 'rear_left_pvdf_x']}, 'name '),
    ('tire_samples', {'header__frame_id': 'spare'}, "header.frame_id is 'spare'"),
    ('tire_battery', {'header__frame_id': 'spare'}, "header.frame_id is 'spare'"),
    ('imu/data', {'linear_acceleration__y': 1001.0}, 'linear_acc.* is .*1001.*most 1000 m/s2'),
    ('imu/data', {'linear_acceleration__z': -1e300}, 'linear_acceleration is .*most 1000 m/s2'),
    ('imu/data', {'angular_velocity__y': 101.0}, 'angular_velocity is .*101.*most 100 rad/s'),
    ('imu/data', {'orientation__w': math.inf}, 'orientation '),
    ('odom', {'twist__covariance': COVARIANCE[:35]}, 'twist.covariance '),
    ('odom', {'pose__covariance': (*COVARIANCE[:35], math.nan)}, 'pose.covariance '),
    ('ground_truth/odom', {'pose__pose__position__x': math.nan}, 'pose.pose.position '),
    ('wheel_slip', {'effort': [1.0, 0.1, math.nan, 0.1]}, 'effort '),
    ('ground_state', {'name': ['stiffness'] * 8}, 'name '),
    ('ground_state', {'name': ['other'] * 8}, 'name '),
    ('ground_state', {'position': [1.0] * 7}, 'position '),
    ('ground_state', {'effort': [math.nan] * 8}, 'effort '),
    ('tire_friction', {'name': ['other'], 'position': [5.0], 'effort': [1.0]}, 'name '),
    ('wheel_commands', {'velocity': [0.0, 0.0, 0.0, math.inf]}, 'velocity .*finite'),
    ('motor_commands', {'effort': [0.0, math.nan, 0.0, 0.0]}, 'effort .*finite'),
    ('motor_commands', {'effort': [0.0, 0.0, 0.0, 1.0001]}, 'effort .*magnitudes of at most 1'),
    ('motor_commands', {'effort': [-1.0001, 0.0, 0.0, 0.0]}, 'effort .*magnitudes of at most 1'),
    ('cmd_vel', {'twist__linear__x': 100.1}, 'twist.linear is .*at most 100 m/s'),
    ('cmd_vel', {'twist__linear__x': -100.1}, 'twist.linear is .*at most 100 m/s'),
    ('cmd_vel', {'twist__angular__z': 100.1}, 'twist.angular is .*at most 100 rad/s')])
def test_a_message_that_is_not_allowed_is_refused_by_topic_and_field(name, fields, named):
    with pytest.raises(MessageError, match=f'^{re.escape(name)}: {named}'):
        read(name, **fields)


@pytest.mark.parametrize(('name', 'path'), [
    ('imu/data', 'linear_acceleration.y'), ('imu/data', 'angular_velocity.z'),
    ('odom', 'pose.pose.position.x'), ('odom', 'twist.twist.angular.z'),
    ('odom', 'pose.pose.orientation.w'), ('cmd_vel', 'twist.linear.x'),
    ('cmd_vel', 'twist.angular.z'), ('icr', 'point.x'), ('tire_battery', 'voltage')])
@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_a_number_that_is_not_finite_is_refused_by_topic_and_field(name, path, value):
    with pytest.raises(MessageError, match=f'^{name}: {path.split(".")[0]}'):
        read(name, **{path.replace('.', '__'): value})


@pytest.mark.parametrize('limit', [1.0, -1.0])
def test_the_largest_values_are_accepted(limit):
    assert read('motor_commands', effort=[limit] * 4).duty == (limit,) * 4
    assert read('wheel_states', velocity=[1e3 * limit] * 4).velocity == (1e3 * limit,) * 4
    message = changed('cmd_vel', twist__linear__x=100.0 * limit, twist__angular__z=100.0 * limit)
    assert velocity_from_twist(message.twist) == VelocityCommand(0, 100.0 * limit, 100.0 * limit)
    assert TOPICS['cmd_vel'].from_msg(message).v_x == 100.0 * limit


@pytest.mark.parametrize('field', ['linear', 'angular'])
def test_a_velocity_without_stamp_is_checked_too(field):
    for value in (100.1, math.nan):
        message = changed('cmd_vel', **{f'twist__{field}__{"x" if field == "linear" else "z"}':
                                        value})
        with pytest.raises(MessageError, match=f'^cmd_vel: {field} '):
            velocity_from_twist(message.twist)


@every_kind
@pytest.mark.parametrize(('field', 'unknown'), [
    ('position', (math.nan,) * 4), ('position', (1.0, math.nan, 3.0, 4.0)),
    ('effort', (math.nan,) * 4)])
def test_nan_in_an_optional_wheel_field_makes_only_that_field_none(new, field, unknown):
    assert read('wheel_states', new, **{field: unknown}) == replace(SAMPLES[2], **{field: None})


@every_kind
def test_the_torque_of_one_wheel_may_be_missing(new):
    effort = read('wheel_states', new, effort=(1.0, math.nan, 3.0, 4.0)).effort
    assert effort is not None and math.isnan(effort[1])
    assert (effort[0], *effort[2:]) == (1.0, 3.0, 4.0)


@pytest.mark.parametrize('fields', [
    {'orientation_covariance': [-1.0, *[0.0] * 8]},
    *({f'orientation__{axis}': value for axis, value in zip('xyzw', orientation)}
      for orientation in ((0.0,) * 4, (math.nan,) * 4, (0.0, math.nan, 0.0, 1.0)))])
def test_an_orientation_that_is_not_measured_is_none(fields):
    assert read('imu/data', **fields).orientation is None


IMU = next(sample for sample in SAMPLES if isinstance(sample, ImuSample))


@pytest.mark.parametrize('field', ['angular_velocity', 'linear_acceleration'])
@pytest.mark.parametrize('vector, covariance, measured', [
    (0.0, -1.0, False), (0.0, 0.0, True), (0.1, -1.0, True)])
def test_a_rate_or_acceleration_that_is_not_measured_is_refused(
        field, vector, covariance, measured):
    msg = TOPICS['imu/data'].to_msg(empty('sensor_msgs/msg/Imu'), IMU)
    part = getattr(msg, field)
    part.x, part.y, part.z = 0.0, 0.0, vector
    setattr(msg, f'{field}_covariance', [covariance, *[0.0] * 8])
    if measured:
        contradictions = Counter()
        assert imu_from_msg(msg, contradictions).stamp_ns == IMU.stamp_ns
        assert contradictions == ({field: 1} if covariance else {})
    else:
        with pytest.raises(MessageError, match=f'{field} is not measured'):
            TOPICS['imu/data'].from_msg(msg)


@pytest.mark.parametrize('nanosec, valid', [(999_999_999, True), (1_000_000_000, False)])
def test_more_nanoseconds_than_a_second_has_are_refused(nanosec, valid):
    msg = TOPICS['imu/data'].to_msg(empty('sensor_msgs/msg/Imu'), IMU)
    msg.header.stamp.sec, msg.header.stamp.nanosec = 5, nanosec
    if valid:
        assert TOPICS['imu/data'].from_msg(msg).stamp_ns == 5_999_999_999
    else:
        with pytest.raises(MessageError, match='header.stamp.nanosec is 1e9 or more'):
            TOPICS['imu/data'].from_msg(msg)


def test_noise_of_the_imu_is_a_covariance_and_unknown_noise_is_zero():
    sample = next(sample for sample in SAMPLES if isinstance(sample, ImuSample))
    msg = imu_to_msg(empty('sensor_msgs/msg/Imu'), sample, gyro_noise=0.1, accel_noise=0.2)
    assert list(msg.angular_velocity_covariance) == pytest.approx(np.ravel(0.01 * np.eye(3)))
    assert list(msg.linear_acceleration_covariance) == pytest.approx(np.ravel(0.04 * np.eye(3)))
    imu_to_msg(msg, sample)  # a message that is used again
    assert not any(msg.angular_velocity_covariance) and not any(msg.linear_acceleration_covariance)


@every_kind
def test_a_slip_ratio_may_be_nan(new):
    slip = read('wheel_slip', new, position=[math.nan, 0.1, 0.2, 0.3])
    assert [math.isnan(ratio) for ratio in slip.ratio] == [True, *[False] * 3]


def test_the_ground_state_is_found_by_name_in_any_order_among_other_quantities():
    msg = changed('ground_state')
    assert list(msg.effort)[-1] == 0.0  # a correlation has no standard deviation
    assert TOPICS['ground_state'].from_msg(msg) == read(
        'ground_state', name=['other', *reversed(msg.name)],
        position=[5.0, *reversed(msg.position)], effort=[5.0, *reversed(msg.effort)])


def test_missing_quantities_are_unknown():
    ground = read('ground_state', name=['stiffness', 'other'], position=[50.0, 5.0],
                  effort=[2.0, math.nan])
    assert ground == GroundState(STAMP, Uncertain(50.0, 2.0))
    assert ground.friction_coefficient.sigma == math.inf
    friction = read('tire_friction', name=['adhesion_ratio', 'other'], position=[0.7, 5.0],
                    effort=[0.1, 1.0])
    assert friction.adhesion_ratio == Uncertain(0.7, 0.1)
    assert all(friction.quantity(name) == UNKNOWN for name in FRICTION_QUANTITIES
               if name != 'adhesion_ratio')


def test_the_transform_equals_the_pose():
    msg = transform_to_msg(empty('geometry_msgs/msg/TransformStamped'), SAMPLES[10])
    assert (msg.header.frame_id, msg.child_frame_id) == ('odom', 'base_link')
    assert (msg.transform.translation.x, msg.transform.translation.y) == (1.0, 2.0)
    assert (msg.transform.rotation.z, msg.transform.rotation.w) == (0.6, 0.8)


@pytest.mark.parametrize('prefix', ['', '/', '/robot_1/', '/field/robot_1/'])
@pytest.mark.parametrize('name', TOPICS)
def test_topics_are_found_in_any_namespace(name, prefix):
    assert find_topic(prefix + name) is TOPICS[name]


@pytest.mark.parametrize('name', ['/imu', '/data', '/imu/data_raw', '/my_odom', '/', ''])
def test_similar_names_are_not_topics_of_the_table(name):
    assert find_topic(name) is None


@pytest.mark.parametrize('level', [2, b'\x02'])  # rclpy has a byte
def test_the_statuses_of_nodes_are_read(level):
    value = SimpleNamespace(key='frames_ok', value='7')
    msg = SimpleNamespace(status=[SimpleNamespace(
        name='imu_driver', level=level, message='lost', values=[value])])
    assert statuses_from_msg(msg) == [NodeStatus('imu_driver', 2, 'lost', {'frames_ok': '7'})]
