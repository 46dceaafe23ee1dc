# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags of users: namespaces, several files, invalid messages, and paths that are not bags."""

from __future__ import annotations

from dataclasses import replace
import math
import sqlite3

import pytest
from smart_tire.bags import Bag, BagWriter, channel_of
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.estimation.streams import INPUTS
from smart_tire.messages import TOPICS
from smart_tire.samples import ImuSample, WheelSample
from support.real_recordings import real_recording
from support.recordings import START_NS, stream, write_bag, write_with_rosbags


def write_raw(path, messages):
    """Write (receive_ns, topic, type, bytes) into a bag and return its path."""
    with BagWriter(path) as writer:
        for receive_ns, topic, type_name, data in messages:
            writer.add_topic(channel_of(topic, type_name))
            writer.write('/' + topic.lstrip('/'), receive_ns, data)
    return path


def imu_bytes(number=0):
    """Return the bytes of an IMU message with ``number`` as acceleration."""
    topic = TOPICS['imu/data']
    sample = ImuSample(START_NS, (float(number), 0.0, 9.81), (0.0, 0.0, 0.0))
    return Encoder(topic.type)(topic.to_msg(empty(topic.type), sample))


IMU = TOPICS['imu/data'].type


@pytest.mark.parametrize('name', ['imu/data', '/imu/data', '/field/robot_1/imu/data'])
def test_a_topic_is_found_with_or_without_namespace(tmp_path, name):
    with Bag(write_raw(tmp_path / 'bag', [(5, name, IMU, imu_bytes())])) as bag:
        assert bag.match(INPUTS) == {'imu/data': '/' + name.lstrip('/')}
        assert [(ns, topic) for ns, topic, _ in bag.samples(INPUTS)] == [(5, 'imu/data')]


def test_topics_of_two_robots_are_never_mixed(tmp_path):
    joints = TOPICS['wheel_states']
    wheels = Encoder(joints.type)(joints.to_msg(
        empty(joints.type), WheelSample(START_NS, (1.0, 2.0, 3.0, 4.0))))
    messages = [(1, '/a/imu/data', IMU, imu_bytes(1)),
                (2, '/robot_b/imu/data', IMU, imu_bytes(2)),
                (3, '/robot_b/wheel_states', joints.type, wheels)]
    with Bag(write_raw(tmp_path / 'bag', messages)) as bag:
        assert bag.match(INPUTS) == {'imu/data': '/robot_b/imu/data',
                                     'wheel_states': '/robot_b/wheel_states'}
        assert [ns for ns, _, _ in bag.samples(INPUTS)] == [2, 3]


def test_a_standard_name_with_another_type_is_skipped_and_reported(tmp_path):
    messages = [(1, '/imu/data', 'geometry_msgs/msg/Twist', bytes(52))]
    with Bag(write_raw(tmp_path / 'bag', messages)) as bag:
        assert bag.match(INPUTS) == {}
        assert list(bag.samples(INPUTS)) == []
        assert bag.type_mismatches() == ['/imu/data is geometry_msgs/msg/Twist']


def test_invalid_messages_are_counted_and_valid_ones_are_kept(tmp_path):
    topic = TOPICS['imu/data']
    nan = Encoder(IMU)(topic.to_msg(
        empty(IMU), ImuSample(START_NS, (math.nan, 0.0, 0.0), (0.0, 0.0, 0.0))))
    bad = [nan, b'', b'\x00\x01\x00\x00', imu_bytes()[:100], b'\x00\x09\x00\x00' + bytes(400)]
    messages = []
    for number, data in enumerate(bad):
        messages += [(2 * number, '/imu/data', IMU, imu_bytes(number)),
                     (2 * number + 1, '/imu/data', IMU, data)]
    with Bag(write_raw(tmp_path / 'bag', messages)) as bag:
        samples = [sample for _, _, sample in bag.samples(INPUTS)]
        assert [sample.acceleration[0] for sample in samples] == [0.0, 1.0, 2.0, 3.0, 4.0]
        assert bag.faults.rejected == {'imu/data': len(bad)}
        assert 'linear_acceleration' in bag.faults.reasons['imu/data']


def test_invalid_metadata_is_ignored_with_a_warning(tmp_path):
    events = stream(0.3)
    path = write_bag(tmp_path / 'bag', events)
    (path / 'metadata.yaml').write_text('\x00')
    with Bag(path) as bag:
        assert list(bag.samples(TOPICS)) == events
        assert any('metadata.yaml' in warning for warning in bag.warnings)


def joints_bytes(*names):
    """Return the bytes of a JointState message with joints that turn."""
    msg = empty(JOINTS)
    msg.name, msg.velocity = list(names), [1.0] * len(names)
    return Encoder(JOINTS)(msg)


JOINTS = TOPICS['wheel_states'].type


@pytest.mark.parametrize('others', [99, 100])
def test_wheels_are_searched_for_in_a_hundred_messages(tmp_path, others):
    messages = [(ns, '/joints', JOINTS, joints_bytes('arm')) for ns in range(others)] + [
        (200, '/joints', JOINTS, joints_bytes('left_wheel', 'right_wheel'))]
    with Bag(write_raw(tmp_path / 'bag', messages)) as bag:
        assert bag.match(['wheel_states']) == (
            {'wheel_states': '/joints'} if others < 100 else {})


@pytest.mark.parametrize(('count', 'expected'), [(2501, [0.0, 0.4, 0.8]), (1, [0.0])])
def test_the_progress_of_a_recording_is_reported(tmp_path, count, expected):
    messages = [(10**18 + 10 * number, '/imu/data', IMU, imu_bytes()) for number in range(count)]
    shares = []
    with Bag(write_raw(tmp_path / 'bag', messages)) as bag:
        recording = bag.recording(['imu/data'], shares.append)
    assert shares == expected
    assert len(recording.stream(ImuSample)) == count


def test_a_timestamp_of_zero_is_replaced_if_wanted(tmp_path):
    topic = TOPICS['imu/data']
    data = Encoder(IMU)(topic.to_msg(empty(IMU), ImuSample(0, (0.0,) * 3, (0.0,) * 3)))
    with Bag(write_raw(tmp_path / 'bag', [(7 * 10**9, '/imu/data', IMU, data)])) as bag:
        assert bag.clock_offset('imu/data', '/imu/data') == 0.0
        (_, _, as_it_is), = bag.samples(['imu/data'], restamp=False)
        assert (as_it_is.stamp_ns, bag.notes) == (0, [])
        (_, _, replaced), = bag.samples(['imu/data'])
        assert replaced.stamp_ns == 7 * 10**9
        assert bag.notes == ['imu/data: header.stamp is zero, the time of reception is used '
                             'instead']
        assert bag.clock_offset('odom', '/odom') is None
    late = [(START_NS + 3 * 10**9, '/imu/data', IMU, imu_bytes())]
    with Bag(write_raw(tmp_path / 'late', late)) as bag:
        assert bag.clock_offset('imu/data', '/imu/data') == 3.0


def status_bytes(name):
    """Return the bytes of a DiagnosticArray with one status."""
    kind = 'diagnostic_msgs/msg/DiagnosticArray'
    msg, status = empty(kind), empty('diagnostic_msgs/msg/DiagnosticStatus')
    msg.header.stamp.sec, status.name, status.level = 5, name, 1
    msg.status = [status]
    return Encoder(kind)(msg)


def test_the_statuses_are_those_of_all_topics_of_diagnostics(tmp_path):
    kind = 'diagnostic_msgs/msg/DiagnosticArray'
    messages = [(1, '/diagnostics', kind, status_bytes('a')),
                (2, '/r1/diagnostics', kind, status_bytes('b')),
                (3, '/diagnostics', kind, b'\0\1\0\0'),
                (4, '/other', kind, status_bytes('c')),
                (5, '/r2/diagnostics', IMU, imu_bytes())]
    with Bag(write_raw(tmp_path / 'bag', messages)) as bag:
        assert [(ns, status.name) for ns, status in bag.statuses()] == [
            (5 * 10**9, 'a'), (5 * 10**9, 'b')]
        assert bag.faults.rejected == {'/diagnostics': 1}
    with Bag(write_raw(tmp_path / 'none', messages[3:])) as bag:
        assert list(bag.statuses()) == []


def test_messages_in_another_encoding_have_another_type(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(replace(channel_of('/imu/data', IMU), encoding='json'))
        writer.write('/imu/data', 5, b'{}')
    with Bag(tmp_path / 'bag') as bag:
        assert bag.types == {'/imu/data': f'{IMU} in json'}
        assert bag.match(['imu/data']) == {}
        assert bag.type_mismatches() == [f'/imu/data is {IMU} in json']


@pytest.mark.parametrize('invalid', [{3: 2 ** 63 - 1}, {3: -1000}, {0: -1000, 3: 2 ** 62},
                                     dict.fromkeys(range(20), 0)], ids=str)
def test_stamps_replace_invalid_times_of_reception(tmp_path, invalid):
    """One time would be the whole span of the bag, and the place of its message."""
    imu = [sample for _, topic, sample in stream() if topic == 'imu/data'][:20]
    path = write_with_rosbags(tmp_path / 'bag', [
        (one.stamp_ns + 5, 'imu/data', one) for one in imu])
    with sqlite3.connect(next(path.glob('*.db3'))) as database:
        for k, time_ns in invalid.items():
            database.execute('UPDATE messages SET timestamp = ? WHERE id = ?', (time_ns, k + 1))
    database.close()
    with Bag(path) as bag:
        read = list(bag.samples(['imu/data']))
        assert [sample for _, _, sample in read] == imu
        assert [received for received, _, _ in read] == [
            one.stamp_ns + 5 * (k not in invalid) for k, one in enumerate(imu)]
        assert bag.span_ns == (read[0][0], read[-1][0])
        warning, = bag.warnings
        assert warning.startswith('invalid times of reception (') and bag.losses.lines() == []


@pytest.mark.parametrize('stamped_s', [0, 20])
def test_the_first_times_of_a_recorder_without_clock_are_not_valid(tmp_path, stamped_s):
    """Those of a simulation that begins at 0 are."""
    imu = [replace(sample, stamp_ns=stamped_s * 10**9 + k * 10**7) for k, sample in enumerate(
        [sample for _, topic, sample in stream() if topic == 'imu/data'][:20])]
    path = write_bag(tmp_path / 'bag', [
        ((one.stamp_ns + 5) * (k > 7), 'imu/data', one) for k, one in enumerate(imu)])
    with Bag(path) as bag:
        received = [one for one, _, _ in bag.samples(['imu/data'])]
        assert received[8:] == [one.stamp_ns + 5 for one in imu[8:]]
        assert received[:8] == [one.stamp_ns * bool(stamped_s) for one in imu[:8]]
        assert [line for line in bag.warnings if 'before it received /clock' in line] == [
            'invalid times of reception (0, of a recorder with use_sim_time before it received '
            '/clock): those of header.stamp are used'] * bool(stamped_s)


def test_the_latest_times_of_reception_are_valid(tmp_path):
    imu = [sample for _, topic, sample in stream() if topic == 'imu/data'][:20]
    path = write_bag(tmp_path / 'bag', [
        (2 ** 62 - 20 + k, 'imu/data', one) for k, one in enumerate(imu)])
    with Bag(path) as bag:
        assert bag.span_ns == (2 ** 62 - 20, 2 ** 62 - 1)
        assert next(bag.raw())[0] == 2 ** 62 - 20 and not bag.warnings


def test_the_latest_metadata_counts_and_that_of_the_folder_most(tmp_path):
    events = stream(0.2)
    path = tmp_path / 'bag'
    with BagWriter(path, ros_distro='jazzy', custom_data={'a': '1', 'b': '2'}) as writer:
        for receive_ns, topic, sample in events:
            writer.write_sample(topic, receive_ns, sample)
    with Bag(path) as bag:
        assert bag.ros_distro == 'jazzy'
    text = (path / 'metadata.yaml').read_text()
    (path / 'metadata.yaml').write_text(
        text.replace('jazzy', 'kilted').replace("a: '1'", "a: '3'"))
    with Bag(path) as bag:
        assert bag.ros_distro == 'kilted'
        assert bag.custom_data == {'a': '3', 'b': '2'}
        assert bag.parameters == ''
    (path / 'metadata.yaml').write_text(text.replace('jazzy', "''"))
    with Bag(path) as bag:
        assert bag.ros_distro == 'jazzy'  # of the file


@pytest.mark.parametrize(('name', 'counts'), [
    ('warthog_asphalt', {'imu/data': 8746, 'wheel_states': 2246, 'ground_truth/odom': 4164}),
    ('husky_rectangle', {'imu/data': 4875, 'wheel_states': 488, 'ground_truth/odom': 1948})])
def test_recordings_of_real_robots_are_read(name, counts):
    with Bag(real_recording(name)) as bag:
        read = dict.fromkeys(counts, 0)
        for _, topic, sample in bag.samples(TOPICS):
            read[topic] += 1
            if topic == 'wheel_states':
                assert sample.position is None
        assert read == counts
        assert not bag.warnings
        assert not bag.faults.rejected
