"""Bags that are written: what others read in them, and what stays of one that was cut off."""

from __future__ import annotations

import random
import resource
import shutil
import subprocess
import sys
import textwrap

from mcap.reader import make_reader
import pytest
from rosbags.highlevel import AnyReader
from support.recordings import INPUTS, stream, write_bag
import yaml

from smart_tire.bags import Bag, BagWriter, Channel, channel_of, Qos
from smart_tire.errors import BagError
from smart_tire.messages import TOPICS


def metadata(bag):
    """Return what metadata.yaml says."""
    return yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']


def test_what_is_written_is_read(tmp_path):
    events = stream()
    with Bag(write_bag(tmp_path / 'bag', events)) as bag:
        assert list(bag.samples(TOPICS)) == events
        assert not bag.losses
        assert not bag.rejected


def test_rosbags_reads_it_as_we_do(tmp_path):
    events = stream(0.5)
    with AnyReader([write_bag(tmp_path / 'bag', events)]) as reader:
        read = []
        for connection, receive_ns, data in reader.messages():
            topic = TOPICS[connection.topic.strip('/')]
            msg = reader.deserialize(data, connection.msgtype)
            read.append((receive_ns, topic.name, topic.decode(msg)))
    assert read == events


def test_it_is_laid_out_as_rosbag2_lays_it_out(tmp_path):
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
    assert yaml.safe_load(embedded['rosbag2']['serialized_metadata']) == metadata(bag)


def test_the_metadata_tell_what_is_in_the_bag(tmp_path):
    events = stream(0.5)
    said = metadata(write_bag(tmp_path / 'bag', events))
    assert said['version'] == 9
    assert said['storage_identifier'] == 'mcap'
    assert said['relative_file_paths'] == ['bag_0.mcap']
    assert said['message_count'] == said['files'][0]['message_count'] == len(events)
    assert said['starting_time']['nanoseconds_since_epoch'] == events[0][0]
    assert said['duration']['nanoseconds'] == events[-1][0] - events[0][0]
    counts = {topic['topic_metadata']['name']: topic['message_count']
              for topic in said['topics_with_message_count']}
    assert counts == {'/imu/data': 50, '/wheel_states': 8, '/tire_samples': 400, '/odom': 62}


def test_the_profiles_that_were_offered_are_kept_for_players(tmp_path):
    latched = channel_of('/path', 'nav_msgs/msg/Path', (Qos('reliable', 'transient_local', 1),))
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(latched)
    topic, = metadata(tmp_path / 'bag')['topics_with_message_count']
    profile, = topic['topic_metadata']['offered_qos_profiles']
    assert profile['durability'] == 'transient_local'
    assert profile['reliability'] == 'reliable'
    assert profile['history'] == 'keep_last'
    assert profile['depth'] == 1
    with Bag(tmp_path / 'bag') as bag:
        assert yaml.safe_load(bag.topics['/path'].channel.qos) == [profile]


def test_a_bag_without_messages_is_whole(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(channel_of('odom', 'nav_msgs/msg/Odometry'))
    with Bag(tmp_path / 'bag') as bag:
        assert list(bag.raw()) == []
        assert bag.topics['/odom'].messages == 0
        assert bag.span_ns == (0, 0)
        assert not bag.losses
    assert metadata(tmp_path / 'bag')['duration']['nanoseconds'] == 0


def test_a_topic_of_a_type_that_we_do_not_know_is_kept(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(channel_of('/odd', 'strange_msgs/msg/Thing'))
        writer.write('/odd', 5, b'\x00\x01\x00\x00odd')
    with Bag(tmp_path / 'bag') as bag:
        (receive_ns, channel, data), = bag.raw()
    assert (receive_ns, channel.type, data) == (
        5, 'strange_msgs/msg/Thing', b'\x00\x01\x00\x00odd')


def test_a_bag_is_never_written_over(tmp_path):
    write_bag(tmp_path / 'bag', stream(0.1))
    with pytest.raises(BagError, match='File exists'):
        BagWriter(tmp_path / 'bag')


def test_at_any_instant_a_copy_misses_half_a_second_at_most(tmp_path):
    events = stream(3.0)
    with BagWriter(tmp_path / 'bag') as writer:
        for number, (receive_ns, topic, sample) in enumerate(events):
            writer.write_sample(topic, receive_ns, sample)
            if number % 700 == 699:
                copy = tmp_path / f'copy_{number}'
                shutil.copytree(tmp_path / 'bag', copy)
                with Bag(copy) as bag:
                    read = list(bag.samples(TOPICS))
                    assert bag.losses
                assert read == events[:len(read)]
                assert events[len(read)][0] > receive_ns - 500_000_000


def test_a_writer_that_was_killed_leaves_what_it_had_flushed(tmp_path):
    script = textwrap.dedent(f"""
        import os, signal
        from support.recordings import stream
        from smart_tire.bags import BagWriter
        writer = BagWriter({str(tmp_path / 'bag')!r})
        for receive_ns, topic, sample in stream(1.9):
            writer.write_sample(topic, receive_ns, sample)
        os.kill(os.getpid(), signal.SIGKILL)
        """)
    process = subprocess.run([sys.executable, '-c', script], check=False,
                             env={'PYTHONPATH': ':'.join(filter(None, sys.path))})
    assert process.returncode == -9
    events = stream(1.9)
    with Bag(tmp_path / 'bag') as bag:
        read = list(bag.samples(TOPICS))
        assert read == events[:len(read)]
        assert read[-1][0] >= events[-1][0] - 500_000_000
        assert any('cut off' in loss for loss in bag.losses)


def test_only_wanted_topics_are_read(tmp_path):
    with Bag(write_bag(tmp_path / 'bag', stream(0.5))) as bag:
        assert {topic for _, topic, _ in bag.samples(INPUTS)} == set(INPUTS)
        assert {channel.topic for _, channel, _ in bag.raw(['/odom'])} == {'/odom'}


def test_a_disk_that_takes_no_more_is_a_bag_error(tmp_path):
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
