# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reading of sqlite3 files: several schema versions, intact, truncated, and after a crash."""

from __future__ import annotations

import shutil
import sqlite3

import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from smart_tire.bags import Bag
from smart_tire.bags.cdr import empty, Encoder, typestore
from smart_tire.errors import BagError
from smart_tire.estimation.streams import INPUTS
from smart_tire.messages import TOPICS
from support.recordings import stream

# Schema of rosbag2 in Foxy, before QoS profiles and definitions were added.
FOXY = """
    CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
                        serialization_format TEXT NOT NULL);
    CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
                          timestamp INTEGER NOT NULL, data BLOB NOT NULL);
    CREATE INDEX timestamp_idx ON messages (timestamp ASC);
    INSERT INTO topics VALUES (1, '/odom', 'nav_msgs/msg/Odometry', 'cdr');
    """


def write(path, events, version=9, plugin=StoragePlugin.SQLITE3, mode=CompressionMode.NONE):
    """Write ``events`` as rosbags does and return the folder."""
    writer = Writer(path, version=version, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections, encoders = {}, {}
        for receive_ns, name, sample in events:
            topic = TOPICS[name]
            if name not in connections:
                connections[name] = writer.add_connection(
                    '/' + name, topic.type, typestore=typestore())
                encoders[name] = Encoder(topic.type)
            data = encoders[name](topic.to_msg(empty(topic.type), sample))
            writer.write(connections[name], receive_ns, data)
    return path


@pytest.mark.parametrize('mode', [CompressionMode.NONE, CompressionMode.FILE,
                                  CompressionMode.MESSAGE])
@pytest.mark.parametrize('version', [8, 9])
def test_bags_are_read_with_any_compression(tmp_path, version, mode):
    events = stream(0.5)
    with Bag(write(tmp_path / 'bag', events, version, mode=mode)) as bag:
        assert list(bag.samples(TOPICS)) == events
        assert bag.topics['/imu/data'].messages == 50
        assert bag.span_ns == (events[0][0], events[-1][0])
        assert not bag.warnings


@pytest.mark.parametrize('mode', [CompressionMode.NONE, CompressionMode.FILE,
                                  CompressionMode.STORAGE])
def test_mcap_bags_of_rosbags_are_read_with_any_compression(tmp_path, mode):
    events = stream(0.5)
    with Bag(write(tmp_path / 'bag', events, plugin=StoragePlugin.MCAP, mode=mode)) as bag:
        assert list(bag.samples(TOPICS)) == events
        assert not bag.warnings


@pytest.mark.parametrize('mode', [CompressionMode.NONE, CompressionMode.FILE])
def test_a_bag_without_metadata_is_read_with_a_warning(tmp_path, mode):
    events = stream(0.5)
    path = write(tmp_path / 'bag', events, mode=mode)
    (path / 'metadata.yaml').unlink()
    with Bag(path) as bag:
        assert list(bag.samples(INPUTS)) == [event for event in events if event[1] in INPUTS]
        assert any('metadata.yaml is missing' in warning for warning in bag.warnings)


@pytest.mark.parametrize('plugin', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_the_start_of_a_truncated_compressed_file_is_read(tmp_path, plugin):
    events = stream(8.0)
    path = write(tmp_path / 'bag', events, plugin=plugin, mode=CompressionMode.FILE)
    file, = path.glob('*.zstd')
    file.write_bytes(file.read_bytes()[:file.stat().st_size * 2 // 3])
    with Bag(path) as bag:
        read = list(bag.samples(TOPICS))
        assert bag.losses.lines()
    assert 100 < len(read) < len(events)


def test_a_single_file_is_read_as_a_bag(tmp_path):
    events = stream(0.2)
    file, = write(tmp_path / 'bag', events).glob('*.db3')
    with Bag(file) as bag:
        assert list(bag.samples(TOPICS)) == events
        assert not bag.warnings


def test_a_file_without_profiles_and_definitions_is_read(tmp_path):
    event = next(event for event in stream(0.2) if event[1] == 'odom')
    topic = TOPICS['odom']
    path = tmp_path / 'foxy.db3'
    with sqlite3.connect(path) as connection:
        connection.executescript(FOXY)
        data = Encoder(topic.type)(topic.to_msg(empty(topic.type), event[2]))
        connection.execute('INSERT INTO messages VALUES (1, 1, ?, ?)', (event[0], data))
    with Bag(path) as bag:
        assert list(bag.samples(['odom'])) == [event]


def test_a_truncated_file_yields_its_readable_messages(tmp_path):
    events = stream(2.0)
    file, = write(tmp_path / 'bag', events).glob('*.db3')
    data = file.read_bytes()
    lengths = []
    for part in (0.3, 0.6, 0.9):
        cut = tmp_path / f'cut_{part}.db3'
        cut.write_bytes(data[:int(part * len(data))])
        with Bag(cut) as bag:
            read = list(bag.samples(TOPICS))
            assert bag.losses.lines()
            assert sum(topic.messages for topic in bag.topics.values()) == len(read)
        assert read == sorted(read, key=lambda event: event[0])
        assert all(event in events for event in read[::50])
        lengths.append(len(read))
    assert 0 < lengths[0] < lengths[1] < lengths[2] < len(events)


def test_messages_in_the_write_ahead_log_of_a_killed_recorder_are_read(tmp_path):
    events = stream(0.5)
    file, = write(tmp_path / 'bag', events[:-100]).glob('*.db3')
    with Bag(write(tmp_path / 'rest', events[-100:])) as rest:
        late = list(rest.raw())
    connection = sqlite3.connect(file)
    connection.execute('PRAGMA journal_mode=WAL')
    numbers = dict(connection.execute('SELECT name, id FROM topics'))
    connection.executemany('INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)',
                           [(numbers[channel.topic], ns, data) for ns, channel, data in late])
    connection.commit()
    killed = tmp_path / 'killed'
    shutil.copytree(tmp_path / 'bag', killed)  # with the log: the connection is still open
    connection.close()
    with Bag(killed) as bag:
        assert list(bag.samples(TOPICS)) == events


@pytest.mark.parametrize('data', [b'SQLite format 3\x00' + b'\xaa' * 2000,
                                  b'SQLite format 3\x00'])
def test_a_file_that_is_not_sqlite3_is_rejected(tmp_path, data):
    path = tmp_path / 'a.db3'
    path.write_bytes(data)
    with pytest.raises(BagError, match=r'a\.db3: '):
        Bag(path)


def test_a_database_without_bag_tables_is_rejected(tmp_path):
    path = tmp_path / 'a.db3'
    with sqlite3.connect(path) as connection:
        connection.execute('CREATE TABLE recipes(id INTEGER)')
    with pytest.raises(BagError, match='not an sqlite3 bag'):
        Bag(path)
