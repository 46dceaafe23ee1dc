# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Writing and recovery of bags: other readers, custom data, and what is left after a crash."""

from __future__ import annotations

import errno
import gc
import os
import random
import resource
import shutil
import tracemalloc

from mcap.reader import make_reader
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from smart_tire.bags import (
    Bag, BagWriter, Channel, channel_of, Qos, recover, writer as bag_writer)
from smart_tire.bags.metadata import qos_text
from smart_tire.errors import BagError
from smart_tire.messages import TOPICS
from support.recordings import stream, write_bag, write_with_rosbags
import yaml


def metadata(bag):
    """Return the content of metadata.yaml."""
    return yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']


def test_the_bag_has_the_layout_of_rosbag2(tmp_path):
    events = stream(0.5)
    bag = write_bag(tmp_path / 'bag', events)
    assert sorted(path.name for path in bag.iterdir()) == ['bag_0.mcap', 'metadata.yaml']
    with (bag / 'bag_0.mcap').open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
        assert summary.statistics.message_count == len(events)
        assert {schema.encoding for schema in summary.schemas.values()} == {'ros2msg'}
        assert all('float64[] velocity' in schema.data.decode()
                   for schema in summary.schemas.values() if 'JointState' in schema.name)
        assert {channel.message_encoding for channel in summary.channels.values()} == {'cdr'}
        assert all(channel.metadata['topic_type_hash'].startswith('RIHS01_')
                   for channel in summary.channels.values())
        embedded = {item.name: item.metadata for item in reader.iter_metadata()}
        times = [message.log_time for _, _, message in reader.iter_messages()]
    assert times == [event[0] for event in events]
    content = metadata(bag)
    assert yaml.safe_load(embedded['rosbag2']['serialized_metadata']) == content
    assert (content['storage_identifier'], content['message_count']) == ('mcap', len(events))
    counts = {topic['topic_metadata']['name']: topic['message_count']
              for topic in content['topics_with_message_count']}
    assert counts == {'/imu/data': 50, '/wheel_states': 8, '/tire_samples': 400, '/odom': 62}


def test_offered_qos_profiles_are_stored(tmp_path):
    latched = Qos('reliable', 'transient_local', 1)
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(channel_of('/path', 'nav_msgs/msg/Path', (latched,)))
    topic, = metadata(tmp_path / 'bag')['topics_with_message_count']
    with Bag(tmp_path / 'bag') as bag:
        assert (yaml.safe_load(bag.topics['/path'].channel.qos) == yaml.safe_load(
            qos_text([latched])) == topic['topic_metadata']['offered_qos_profiles'])


def test_a_bag_without_messages_is_valid(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(channel_of('odom', 'nav_msgs/msg/Odometry'))
    with Bag(tmp_path / 'bag') as bag:
        assert list(bag.raw()) == []
        assert bag.topics['/odom'].messages == 0
        assert bag.span_ns == (0, 0)
        assert not bag.warnings
    assert metadata(tmp_path / 'bag')['duration']['nanoseconds'] == 0


def test_a_copy_made_at_any_time_lacks_at_most_half_a_second(tmp_path):
    events = stream(3.0)
    with BagWriter(tmp_path / 'bag') as writer:
        for number, (receive_ns, topic, sample) in enumerate(events):
            writer.write_sample(topic, receive_ns, sample)
            if number % 700 == 699:
                copy = tmp_path / f'copy_{number}'
                shutil.copytree(tmp_path / 'bag', copy)
                with Bag(copy) as bag:
                    read = list(bag.samples(TOPICS))
                    assert bag.losses.lines()
                assert read == events[:len(read)]
                assert events[len(read)][0] > receive_ns - 500_000_000


def test_a_full_disk_is_a_bag_error(tmp_path):
    writer = BagWriter(tmp_path / 'bag')
    writer.add_topic(Channel('/a', 'strange_msgs/msg/Thing'))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with pytest.raises(BagError, match='bag: cannot be written'):
            writer.write('/a', 10**18, random.Random(1).randbytes(20_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    writer.close()


@pytest.fixture
def broken(tmp_path):
    """Return a bag without metadata whose file is truncated."""
    path = write_bag(tmp_path / 'broken', stream(2.0))
    file = path / 'broken_0.mcap'
    file.write_bytes(file.read_bytes()[:-60_000])
    (path / 'metadata.yaml').unlink()
    return path


def test_all_readable_messages_are_recovered(tmp_path, broken):
    result = recover(broken, tmp_path / 'whole')
    with Bag(broken) as before, Bag(tmp_path / 'whole') as after:
        left = list(before.samples(TOPICS))
        assert list(after.samples(TOPICS)) == left == stream(2.0)[:len(left)]
        assert not after.warnings
        assert result.warnings == before.warnings
        assert result.losses == before.losses.lines()
        assert result.counts == {name: topic.messages for name, topic in after.topics.items()}
    assert len(left) > 500
    assert 'truncated' in result.losses[0]
    assert any('metadata.yaml' in warning for warning in result.warnings)


def test_missing_definitions_are_added(tmp_path):
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        writer.add_connection('/odom', 'nav_msgs/msg/Odometry', msgdef='', rihs01='RIHS01_0')
    recover(tmp_path / 'bag', tmp_path / 'whole')
    with Bag(tmp_path / 'whole') as bag:
        channel = bag.topics['/odom'].channel
        assert 'geometry_msgs/PoseWithCovariance pose' in channel.definition
        assert channel.definition_encoding == 'ros2msg'


def test_an_existing_folder_is_not_overwritten(tmp_path, broken):
    with pytest.raises(BagError, match='File exists'):
        recover(broken, broken)


@pytest.mark.parametrize('storage', ['mcap', 'db3'])
def test_no_more_is_recovered_than_a_recording_of_this_size_may_have(
        tmp_path, monkeypatch, storage):
    write = write_bag if storage == 'mcap' else write_with_rosbags
    path = write(tmp_path / 'bag', stream(1.0))
    with Bag(path) as bag:
        sizes = [len(data) for _, _, data in bag.raw()]
        assert bag.max_content == 1 << 30
        bag._opened.size = 1 << 40
        assert bag.max_content == 1000 << 40
    for limit, count in ((sum(sizes), len(sizes)), (sum(sizes[:70]), 70), (sizes[0] - 1, 0)):
        monkeypatch.setattr(Bag, 'max_content', limit)
        result = recover(path, tmp_path / f'{count}')
        assert sum(result.counts.values()) == count
        assert [line.partition(': ')[2] for line in result.losses] == (
            [] if count == len(sizes) else
            [f'only the first {limit / 1e6:.0f} MB of messages are recovered'])


def test_recovery_writes_the_metadata_at_begin_and_end(tmp_path, monkeypatch):
    keys = {f'key {number}': 'text' for number in range(20)}
    with BagWriter(tmp_path / 'bag', custom_data=keys) as writer:
        for number in range(30):
            writer.add_topic(channel_of(f'/{number}', 'a_msgs/msg/A'))
            writer.write(f'/{number}', 10**10 * number, b'x')
    written = []
    monkeypatch.setattr(bag_writer, 'metadata_text', lambda contents: written.append(1) or '')
    monkeypatch.setattr(bag_writer, 'write_metadata', lambda *_: written.append(2))
    assert sum(recover(tmp_path / 'bag', tmp_path / 'copy').counts.values()) == 30
    assert written == [2, 1, 1, 2]  # the record is at the begin for readers of a part of the file


def test_a_full_disk_ends_the_recovery_with_the_folder(tmp_path, monkeypatch):
    path = write_bag(tmp_path / 'bag', stream(1.0))

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(bag_writer.McapWriter, 'add_message', full)
    with pytest.raises(BagError, match=r'copy: cannot be written \(No space left on device\)'):
        recover(path, tmp_path / 'copy')


@pytest.mark.parametrize(('limit', 'least'), [
    ({'max_duration': 0.2}, 4), ({'max_size': 20_000.0}, 2), ({}, 1)])
def test_a_bag_in_several_files_has_the_same_messages(limit, least, tmp_path):
    events = stream(1.0)
    with BagWriter(tmp_path / 'bag', custom_data={'key': 'text'}, **limit) as writer:
        for receive_ns, topic, sample in events:
            writer.write_sample(topic, receive_ns, sample)
    count = len(list((tmp_path / 'bag').glob('*.mcap')))
    names = [f'bag_{number}.mcap' for number in range(count)]
    assert count >= least and (limit or count == 1)
    with Bag(tmp_path / 'bag') as bag, AnyReader([tmp_path / 'bag']) as reader:
        assert list(bag.samples(TOPICS)) == events
        assert not bag.warnings and not bag.losses.lines()
        assert bag.custom_data['key'] == 'text'
        assert [(time, bytes(data)) for _, time, data in reader.messages()] == [
            (time, data) for time, _, data in bag.raw()]
    found = metadata(tmp_path / 'bag')
    assert found['relative_file_paths'] == names == [file['path'] for file in found['files']]
    assert sum(file['message_count'] for file in found['files']) == found['message_count']
    spans = [(file['starting_time']['nanoseconds_since_epoch'], file['duration']['nanoseconds'])
             for file in found['files']]
    assert spans[0][0] == found['starting_time']['nanoseconds_since_epoch'] == events[0][0]
    assert sum(spans[-1]) == events[-1][0] == events[0][0] + found['duration']['nanoseconds']
    assert all(duration < limit.get('max_duration', 2.0) * 1e9 for _, duration in spans)
    for name in names:  # each can be read alone
        with Bag(tmp_path / 'bag' / name) as part:
            assert part.custom_data['key'] == 'text'
            assert list(part.raw())


def test_the_memory_of_a_recording_in_several_files_is_bounded(tmp_path):
    grown = {}
    for limit in (5.0, 1e9):  # s
        tracemalloc.start()
        with BagWriter(tmp_path / f'{limit}', max_duration=limit) as writer:
            writer.add_topic(channel_of('odom', 'nav_msgs/msg/Odometry'))
            for number in range(400):
                writer.write('/odom', number * 100_000_000, bytes(10))
                writer.flush()
                if number == 140:
                    before, _ = tracemalloc.get_traced_memory()
            gc.collect()
            grown[limit] = tracemalloc.get_traced_memory()[0] - before
        tracemalloc.stop()
    assert grown[5.0] < 0.2 * grown[1e9]


def test_chunks_end_after_150_milliseconds_metadata_is_written_every_five_seconds(tmp_path):
    start, file = 10**18, tmp_path / 'a' / 'bag' / 'bag_0.mcap'
    with BagWriter(tmp_path / 'a' / 'bag') as writer:  # folders are made
        writer.add_topic(channel_of('/odom', 'nav_msgs/msg/Odometry'))
        writer.write('/odom', start, b'0')  # the first one is written at once
        written, counts = [], []
        for ns in (149_999_999, 150_000_000, 299_999_999, 300_000_000, 300_000_001, 149_999_999,
                   4_999_999_999, 5_000_000_000, 9_999_999_999, 10_000_000_000, 4_000_000_000):
            size = file.stat().st_size
            writer.write('/odom', start + ns, b'x')
            written.append(file.stat().st_size > size)
            counts.append(metadata(tmp_path / 'a' / 'bag')['message_count'])
    assert written == [False, True, False, True, False, True, True, False, True, False, True]
    assert counts == [1, 1, 1, 1, 1, 1, 1, 9, 9, 11, 12]
    assert metadata(tmp_path / 'a' / 'bag')['duration']['nanoseconds'] == 10_000_000_000


def test_a_file_has_at_least_one_message_and_ends_at_its_duration(tmp_path):
    for name, limit in (('size', {'max_size': 1}), ('duration', {'max_duration': 2.0})):
        with BagWriter(tmp_path / name, **limit) as writer:
            writer.add_topic(channel_of('/a', 'a_msgs/msg/A'))
            for second in (0, 1.999_999_999, 2, 3, 4):
                writer.write('/a', round(second * 1e9), bytes(3))
                writer.flush()
    files = {name: [file['message_count'] for file in metadata(tmp_path / name)['files']]
             for name in ('size', 'duration')}
    assert files == {'size': [1] * 5, 'duration': [2, 2, 1]}
    for name in files:
        with Bag(tmp_path / name) as bag:
            assert len(list(bag.raw())) == 5 == bag.topics['/a'].messages


def test_a_topic_is_registered_once(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        assert not writer.has_topic('/a')
        for kind in 'AB':
            writer.add_topic(channel_of('a', f'a_msgs/msg/{kind}'))
        assert writer.has_topic('/a')
        writer.write('/a', 5, b'x')
        assert writer.counts == {'/a': 1}
    with Bag(tmp_path / 'bag') as bag:
        assert bag.types == {'/a': 'a_msgs/msg/A'}


def test_errors_name_the_folder(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(BagError, match=r'file/bag: cannot be written \(Not a directory\)'):
        BagWriter(tmp_path / 'file' / 'bag')
    writer = BagWriter(tmp_path / 'bag')
    shutil.rmtree(tmp_path / 'bag')
    with pytest.raises(BagError, match=r'bag: cannot be written \(No such file or directory\)'):
        writer.set_custom_data('key', 'text')
    with pytest.raises(BagError):
        writer.close()
    writer.close()  # has no effect


def test_known_definitions_of_a_bag_are_kept_unknown_ones_left_out(tmp_path):
    own = Channel('/odom', 'nav_msgs/msg/Odometry', 'cdr', 'own text', 'own', 'qos: 1', 'RIHS01_1')
    strange = Channel('/a', 'a_msgs/msg/A')
    bare = Channel('/imu', 'sensor_msgs/msg/Imu', qos='qos: 2')
    with BagWriter(tmp_path / 'bag') as writer:
        for channel in (own, strange, bare):
            writer.add_topic(channel)
            writer.write(channel.topic, 5, b'x')
    result = recover(tmp_path / 'bag', tmp_path / 'copy')
    assert result.counts == {'/odom': 1, '/a': 1, '/imu': 1}
    assert result.span_ns == (5, 5)
    with Bag(tmp_path / 'copy') as bag:
        found = {name: (topic.channel.definition, topic.channel.definition_encoding,
                        topic.channel.qos, topic.channel.type_hash)
                 for name, topic in bag.topics.items()}
    known = channel_of('/imu', 'sensor_msgs/msg/Imu')
    assert found == {'/odom': ('own text', 'own', 'qos: 1', 'RIHS01_1'), '/a': ('', '', '', ''),
                     '/imu': (known.definition, 'ros2msg', 'qos: 2', known.type_hash)}


TEXT = '/**:\n  ros__parameters:\n    name: "ä: {x}"\n'


def custom_data(path):
    with Bag(path) as bag:
        return bag.custom_data


def test_custom_data_is_written_as_rosbag2_does(tmp_path):
    with BagWriter(tmp_path / 'bag', custom_data={'operator': 'me'}) as writer:
        writer.set_custom_data('params', TEXT)
    entry = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())[
        'rosbag2_bagfile_information']
    assert entry['custom_data'] == {'operator': 'me', 'params': TEXT}
    assert custom_data(tmp_path / 'bag') == entry['custom_data']
    assert custom_data(tmp_path / 'bag' / 'bag_0.mcap') == entry['custom_data']


def test_without_custom_data_the_entry_is_that_of_rosbag2(tmp_path):
    with BagWriter(tmp_path / 'bag'):
        pass
    assert 'custom_data: null' in (tmp_path / 'bag' / 'metadata.yaml').read_text()
    assert custom_data(tmp_path / 'bag') == {}


def test_custom_data_is_on_the_disk_at_once_and_the_latest_wins(tmp_path):
    writer = BagWriter(tmp_path / 'bag')
    for text in ('old', TEXT):
        writer.set_custom_data('params', text)
        for path in (tmp_path / 'bag', tmp_path / 'bag' / 'bag_0.mcap'):
            assert custom_data(path) == {'params': text}
    size = (tmp_path / 'bag' / 'bag_0.mcap').stat().st_size
    writer.set_custom_data('params', TEXT)
    assert (tmp_path / 'bag' / 'bag_0.mcap').stat().st_size == size  # no change, no record
    writer.close()
