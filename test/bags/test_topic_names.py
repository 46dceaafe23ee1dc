# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Standard topics under other names in a bag."""

from __future__ import annotations

from dataclasses import replace

import pytest
from smart_tire.bags import Bag, BagWriter, check_inputs, TopicNames
from smart_tire.bags.topic_names import match_by_name
from smart_tire.errors import BagError, ParameterError
from smart_tire.messages import TOPICS
from smart_tire.parameters import JointParams
from smart_tire.samples import WHEELS
from support.foreign import add_messages, Foreign, IMU, JOINTS
from support.recordings import START_NS, stream

INPUTS = 'imu/data', 'wheel_states'


def named(*names):
    """Return a function that sets the joints of a message."""
    def change(msg):
        msg.name, msg.velocity = list(names), [0.0] * len(names)
    return change


def bag_of(path, *topics):
    """Write a bag of (topic, type, joint names) with two messages each."""
    with BagWriter(path) as writer:
        for name, kind, joints in topics:
            add_messages(writer, name, kind, 2, named(*joints) if joints else lambda msg: None)
    return path


def test_rules_have_the_order_of_ros_remapping():
    names = TopicNames.parse(['/imu/data:=/mti30/imu', 'odom:=pose', 'odom:=pose'])
    assert names.remap == {'imu/data': '/mti30/imu', 'odom': 'pose'}
    for rules in (['imu/data:=/a', 'imu/data:=/b'], [':=/a'], ['imu/data:='], ['/mti30/imu']):
        with pytest.raises(ParameterError):
            TopicNames.parse(rules)


def test_a_selected_topic_takes_precedence_and_is_not_used_twice(tmp_path):
    bag = bag_of(tmp_path / 'bag', ('/imu/data', IMU, ()), ('/other/imu/data', IMU, ()))
    with Bag(bag, TopicNames({'imu/data': 'other/imu/data'})) as opened:
        assert opened.match(['imu/data']) == {'imu/data': '/other/imu/data'}
    with Bag(bag) as opened:
        assert opened.match(['imu/data']) == {'imu/data': '/imu/data'}
    odometry = Foreign({'odom': 'imu/pose'}).write(tmp_path / 'odom', stream(0.1))
    names = TopicNames({'ground_truth/odom': '/imu/pose'})
    with Bag(odometry, names) as opened:
        assert opened.match(['odom', 'ground_truth/odom']) == {'ground_truth/odom': '/imu/pose'}
        sample, *_ = opened.samples(['ground_truth/odom'])
        assert sample[1] == 'ground_truth/odom'


def test_only_the_inputs_are_recognized_by_type(tmp_path):
    odometry = Foreign({'odom': 'pose', 'tire_samples': 'films'}).write(
        tmp_path / 'bag', stream(0.1))
    with Bag(odometry) as opened:
        assert opened.match(['odom', 'tire_samples', 'ground_truth/odom']) == {}


def test_an_imu_is_recognized_if_it_is_the_only_one_with_messages(tmp_path):
    bag = tmp_path / 'bag'
    with BagWriter(bag) as writer:
        add_messages(writer, '/silent', IMU, 0)
        add_messages(writer, '/imu', IMU, 1)
    with Bag(bag) as opened:
        assert opened.match(INPUTS) == {'imu/data': '/imu'}
        assert opened.match(INPUTS) and len(opened.notes) == 1
    bag_of(tmp_path / 'two', ('/imu', IMU, ()), ('/imu2', IMU, ()))
    with Bag(tmp_path / 'two') as opened:
        assert opened.match(INPUTS) == {} and opened.notes == []


def test_the_topic_with_joints_of_wheels_is_wheel_states(tmp_path):
    bag = bag_of(tmp_path / 'bag', ('/arm/joint_states', JOINTS, ('shoulder', 'elbow')),
                 ('/base/joint_states', JOINTS, ('left_wheel', 'right_wheel')),
                 ('/wheel_slip', JOINTS, WHEELS), ('/motor_commands', JOINTS, WHEELS))
    with Bag(bag) as opened:
        assert opened.match(INPUTS) == {'wheel_states': '/base/joint_states'}
    with Bag(bag, joints=JointParams(left='elbow', right='shoulder')) as opened:
        assert opened.match(INPUTS) == {'wheel_states': '/arm/joint_states'}
    with Bag(bag, joints=JointParams(left='a', right='b')) as opened:
        assert opened.match(INPUTS) == {}
        with pytest.raises(BagError, match='/arm/joint_states: shoulder, elbow'):
            check_inputs(opened, INPUTS)


@pytest.mark.parametrize('standard, kind, joints', [
    ('wheel_states', JOINTS, WHEELS), ('imu/data', IMU, ())])
def test_two_topics_that_may_be_an_input_are_a_choice(tmp_path, standard, kind, joints):
    bag = bag_of(tmp_path / 'bag', ('/a', kind, joints), ('/b', kind, joints))
    with Bag(bag) as opened, pytest.raises(BagError) as raised:
        check_inputs(opened, [standard])
    assert [line.split()[:2] for line in str(raised.value).splitlines()[1:]] == [
        ['--remap', f'{standard}:=/a'], ['--remap', f'{standard}:=/b']]
    with Bag(bag, TopicNames({standard: '/b'})) as opened:
        check_inputs(opened, [standard])


def test_the_choice_is_a_table_with_the_number_of_messages(tmp_path):
    bag = bag_of(tmp_path / 'bag', ('/imu', IMU, ()), ('/longer_name', IMU, ()),
                 ('/odom', TOPICS['odom'].type, ()))
    with Bag(bag) as opened, pytest.raises(BagError) as raised:
        check_inputs(opened, [*INPUTS, 'odom'])
    assert str(raised.value) == (
        f'{bag}: 2 topics may be imu/data; select one:\n'
        f'  --remap imu/data:=/imu          {IMU}, 2 messages\n'
        f'  --remap imu/data:=/longer_name  {IMU}, 2 messages')


def test_rules_that_cannot_be_followed_are_refused(tmp_path):
    with pytest.raises(ParameterError, match='^--remap pose:=/a: pose is not a standard topic, '
                                             'expected one of .*imu/data'):
        TopicNames({'pose': '/a'})
    with pytest.raises(ParameterError, match='^--remap odom:=b: odom is already a$'):
        TopicNames.parse(['odom:=a', 'odom:=b'])
    with pytest.raises(ParameterError, match='^--remap /: expected STANDARD:=NAME'):
        TopicNames.parse(['/'])
    bag = bag_of(tmp_path / 'bag', ('/imu', IMU, ()))
    for rule, message in (('imu/data:=/a', '--remap imu/data:=/a: the bag has no /a; its topics: '
                                           '/imu'),
                          ('odom:=imu/', f'--remap odom:=/imu: /imu is {IMU}, expected '
                                         f'{TOPICS["odom"].type}')):
        with Bag(bag, TopicNames.parse([rule])) as opened, pytest.raises(BagError) as raised:
            opened.match(['imu/data', 'odom'])
        assert str(raised.value) == message
    with BagWriter(tmp_path / 'none'):
        pass
    with Bag(tmp_path / 'none', TopicNames({'odom': '/a'})) as opened, pytest.raises(
            BagError, match='its topics: none'):
        opened.match(['odom'])


def test_the_namespace_with_most_topics_counts_then_the_shortest_then_the_first():
    types = {f'/{name}': TOPICS[name.split('/', 1)[1]].type for name in (
        'b/imu/data', 'a/imu/data', 'long/imu/data', 'long/odom', 'a/odom', 'b/odom')}
    assert match_by_name(['imu/data', 'odom', 'wheel_states'], types) == {
        'imu/data': '/a/imu/data', 'odom': '/a/odom'}
    types['/long/wheel_states'] = JOINTS
    assert match_by_name(['imu/data', 'odom', 'wheel_states'], types) == {
        'imu/data': '/long/imu/data', 'odom': '/long/odom', 'wheel_states': '/long/wheel_states'}
    assert match_by_name(['odom'], {'/odom': IMU}) == {}


@pytest.mark.parametrize(('late', 'refused'), [(30.0, False), (30.001, True)])
def test_clocks_differ_by_more_than_30_s(tmp_path, late, refused):
    events = [(ns + round(late * 1e9) * (topic == 'imu/data') - 2 * (topic != 'imu/data') * 10**6,
               topic, replace(sample, stamp_ns=ns - 2 * 10**6 * (topic != 'imu/data')))
              for ns, topic, sample in stream(0.2) if topic in INPUTS]
    with Bag(Foreign().write(tmp_path / 'bag', events)) as bag:
        if refused:
            with pytest.raises(BagError, match='timestamps are of different clocks'):
                check_inputs(bag, INPUTS)
        else:
            check_inputs(bag, INPUTS)
            assert bag.clock_offset('imu/data', '/imu/data') == pytest.approx(late, abs=2e-3)


def test_messages_of_other_joints_on_the_same_topic_are_ignored(tmp_path):
    bag = tmp_path / 'bag'
    with BagWriter(bag) as writer:
        add_messages(writer, '/joint_states', JOINTS, 3, named('arm'))
        add_messages(writer, '/joint_states', JOINTS, 4, named('left_wheel', 'right_wheel'))
        add_messages(writer, '/joint_states', JOINTS, 5, named('left_wheel'))  # incomplete
    with Bag(bag) as opened:
        assert len(list(opened.samples(INPUTS))) == 4
        assert opened.faults.rejected == {'wheel_states': 5}


def test_wheel_states_of_unknown_joints_show_the_parameters_to_give(tmp_path):
    bag = bag_of(tmp_path / 'bag', ('/wheel_states', JOINTS, ('m1', 'm2')))
    with Bag(bag) as opened:
        with pytest.raises(BagError, match='(?s)/wheel_states: m1, m2.*joints:.*left: NAME'):
            check_inputs(opened, INPUTS)
        assert list(opened.samples(INPUTS)) == [] and opened.faults.rejected == {'wheel_states': 2}


def test_timestamps_of_different_clocks_are_refused(tmp_path):
    since_boot = [(ns, topic, replace(sample, stamp_ns=sample.stamp_ns - START_NS + 10**9)
                   if topic == 'imu/data' else sample) for ns, topic, sample in stream(0.2)]
    with Bag(Foreign().write(tmp_path / 'bag', since_boot)) as bag:
        with pytest.raises(BagError, match=r'1\.7e\+09 s before reception on imu/data, '
                                           r'0\.00\d+ s before reception on wheel_states'):
            check_inputs(bag, INPUTS)
        check_inputs(bag, ['wheel_states'])
