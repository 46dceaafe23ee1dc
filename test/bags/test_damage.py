# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Damaged files: only the damaged chunk or page is lost, no message is wrong, losses are noted."""

from __future__ import annotations

from itertools import count, product
import logging
import sqlite3

from hypothesis import given, settings, strategies as st
from mcap.writer import CompressionType, Writer
import pytest
from smart_tire.bags import Bag, BagWriter, channel_of, recover
from smart_tire.bags.mcap_file import McapFile
from smart_tire.errors import BagError
from support.recordings import stream, write_bag

NUMBERS = count()
CHUNKS, CHUNK_MESSAGES = 8, 50
FLIP_OR_CUT = st.tuples(st.booleans(), st.integers(0, 10**9))


class Whole:
    """Content of a file and its messages, without a representation of a megabyte."""

    def __init__(self, data, messages):
        self.data, self.messages = data, messages


def changed(data, how):
    """Return ``data`` cut, or with one bit changed."""
    cut, where = how
    if cut:
        return data[:where % len(data)]
    changed = bytearray(data)
    changed[where // 8 % len(data)] ^= 1 << where % 8
    return bytes(changed)


def read(path):
    """Return the messages and the losses of a bag."""
    with Bag(path) as bag:
        counted = sum(topic.messages for topic in bag.topics.values())
        found = [(ns, channel.topic, data) for ns, channel, data in bag.raw()]
        return found, bag.losses, counted


def numbered(path, **options):
    """Write an MCAP file of ``CHUNKS`` chunks or, without chunks, of as many messages."""
    with path.open('wb') as file:
        writer = Writer(file, **options)
        writer.start('ros2')
        channel = writer.register_channel('/a', 'cdr', writer.register_schema('a', 'ros2msg', b''))
        for number in range(CHUNKS * CHUNK_MESSAGES):
            writer.add_message(channel, number, b'\0\1\0\0%08d' % number * 3, number)
            if number % CHUNK_MESSAGES == CHUNK_MESSAGES - 1:
                writer.flush()
        writer.finish()
    return path.read_bytes()


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('damage')


@pytest.fixture(scope='module')
def mcap(folder):
    """Return the bytes of a file of several chunks, and its messages."""
    bag = write_bag(folder / 'mcap', stream(1.0))
    return Whole((bag / 'mcap_0.mcap').read_bytes(), read(bag)[0])


@pytest.fixture(scope='module')
def database(folder):
    """Return the bytes of an sqlite3 file with small and large messages, and its messages."""
    path = folder / 'whole.db3'
    with sqlite3.connect(path) as connection:
        connection.executescript("""
            CREATE TABLE topics(
                id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
                serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
            CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
                                  timestamp INTEGER NOT NULL, data BLOB NOT NULL);
            CREATE INDEX timestamp_idx ON messages (timestamp ASC);
            INSERT INTO topics VALUES (1, '/a', 'a_msgs/msg/A', 'cdr', '- depth: 7');
            INSERT INTO topics VALUES (300, '/b', 'a_msgs/msg/B', 'cdr', '');""")
        connection.executemany(
            'INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)',
            [((1, 300)[number % 2], 10**18 + 70 * number,
              b'%06d' % number * (1500 if number % 40 == 7 else 1 + number % 7))
             for number in range(400)])
    connection.close()
    return Whole(path.read_bytes(), read(path)[0])


@settings(max_examples=150, deadline=None)
@given(how=FLIP_OR_CUT)
def test_a_change_of_an_mcap_file_costs_at_most_a_chunk(folder, mcap, how):
    data, whole = mcap.data, mcap.messages
    path = folder / f'{next(NUMBERS)}.mcap'
    path.write_bytes(changed(data, how))
    try:
        found, losses, _ = read(path)
    except BagError:
        assert how[0] and how[1] % len(data) < 1000
        return
    finally:
        path.unlink()
    if how[0]:
        assert found == whole[:len(found)]
    else:
        lost = sorted(set(whole) - set(found))
        assert len(found) == len(whole) - len(lost)
        assert found == [message for message in whole if message not in lost]
        assert not lost or lost[-1][0] - lost[0][0] < 300_000_000  # one chunk
    assert bool(losses.lines()) >= (len(found) < len(whole))


@settings(max_examples=150, deadline=None)
@given(how=FLIP_OR_CUT)
def test_a_change_of_a_database_costs_at_most_a_page(folder, database, how):
    data, whole = database.data, database.messages
    path = folder / f'{next(NUMBERS)}.db3'
    path.write_bytes(changed(data, how))
    try:
        found, losses, counted = read(path)
    except BagError:
        assert how[0] and how[1] % len(data) < 3 * 4096 or how[1] // 8 % len(data) < 3 * 4096
        return
    finally:
        path.unlink()
    assert counted == len(found) <= len(whole)
    assert found == sorted(found, key=lambda message: message[0])
    assert bool(losses.lines()) >= (len(found) < len(whole))
    page = how[1] // 8 % len(data) // 4096  # sqlite has no checksums: a bit of data may be wrong
    if how[0]:
        assert set(found) <= set(whole)
    elif page > 1:  # that of the names of the topics
        assert len(set(found) - set(whole)) <= 1
        assert len(whole) - len(found) <= 200


def chunk_starts(path):
    """Return the offsets of the chunks of an MCAP file."""
    file = McapFile(path)
    starts = [block.offset for block in file._blocks]
    file.close()
    return starts


@pytest.mark.parametrize('indexed', [True, False])
@pytest.mark.parametrize('compression', [CompressionType.ZSTD, CompressionType.NONE])
def test_a_damaged_chunk_length_costs_at_most_that_chunk(folder, compression, indexed):
    path, complete = folder / 'length.mcap', list(range(CHUNKS * CHUNK_MESSAGES))
    data = numbered(path, compression=compression)[:None if indexed else -30]
    starts = chunk_starts(path)
    for chunk in (0, 3, CHUNKS - 1)[0 if indexed else 1:]:
        left = [one for one in complete if one // CHUNK_MESSAGES != chunk]
        for where, bit in product((0, 1, 2, 5, 8), range(8)):  # opcode and length of the record
            path.write_bytes(changed(data, (False, 8 * (starts[chunk] + where) + bit)))
            found, losses, _ = read(path)
            numbers = [ns for ns, _, _ in found]
            assert numbers == complete or not indexed and numbers == left
            assert losses.lines() or numbers == complete


@pytest.mark.parametrize('what', [b'', b'\0' * 4096, bytes(range(256)) * 3])
def test_a_gap_without_index_costs_the_chunks_in_it(folder, what):
    path = folder / 'gap.mcap'
    data = numbered(path)
    starts = chunk_starts(path)
    path.write_bytes(data[:starts[2] + 20] + what + data[starts[4] - 1:-5])
    found, losses, _ = read(path)
    complete = [*range(2 * CHUNK_MESSAGES), *range(4 * CHUNK_MESSAGES, CHUNKS * CHUNK_MESSAGES)]
    assert [ns for ns, _, _ in found] == complete
    assert losses.lines()


def test_a_message_without_chunk_costs_only_itself(folder):
    path = folder / 'plain.mcap'
    data = numbered(path, use_chunking=False)
    start = data.index(b'\0\1\0\0%08d' % 200) - 31
    assert data[start] == 5
    for where in range(8 * 9):  # opcode and length of the record
        path.write_bytes(changed(data, (False, 8 * start + where)))
        found, losses, _ = read(path)
        assert {ns for ns, _, _ in found} >= set(range(CHUNKS * CHUNK_MESSAGES)) - {200}
        assert losses.lines()


def test_a_cut_database_yields_its_pages(folder, database):
    data, whole = database.data, database.messages
    path = folder / 'cut.db3'
    path.write_bytes(data[:len(data) * 99 // 100])
    found, losses, _ = read(path)
    assert set(found) <= set(whole)
    assert len(found) > 0.9 * len(whole)
    assert 'cut.db3: file is damaged' in losses.lines()[0]
    with Bag(path) as bag:
        assert bag.span_ns == (found[0][0], found[-1][0])
        assert bag.topics['/a'].channel.qos == '- depth: 7'
        assert bag.topics['/b'].channel.type == 'a_msgs/msg/B'


def test_a_row_whose_time_contradicts_the_index_is_left_out(folder, database):
    data, whole = bytearray(database.data), database.messages
    number = 123
    ns, _, content = whole[number]
    place = data.index(ns.to_bytes(8, 'big') + content)
    data[place + 2] ^= 0x10
    path = folder / 'time.db3'
    path.write_bytes(data)
    found, losses, _ = read(path)
    assert found == whole[:number] + whole[number + 1:]
    assert losses.messages == 1


def test_messages_that_metadata_lists_are_missing_without_them(tmp_path):
    events = stream(0.3)
    bag = write_bag(tmp_path / 'bag', events)
    text = (bag / 'metadata.yaml').read_text()
    (bag / 'metadata.yaml').write_text(text.replace(
        f'  message_count: {len(events)}\n', f'  message_count: {len(events) + 9}\n', 1))
    _, losses, _ = read(bag)
    assert losses.lines() == [f'9 messages or more are missing: {len(events) + 9} are listed in '
                              f'metadata.yaml, {len(events)} in the files']


def test_a_closed_bag_with_losses_is_reported(caplog, folder, mcap):
    path = folder / 'reported.mcap'
    path.write_bytes(mcap.data)
    with caplog.at_level(logging.WARNING), Bag(path) as bag:
        list(bag.raw())
    assert not caplog.records
    path.write_bytes(mcap.data[:-20_000])
    with caplog.at_level(logging.WARNING), Bag(path) as bag:
        line, = bag.losses.lines()
    assert caplog.messages == [f'{path}: {line}']


@pytest.mark.parametrize('metadata', [True, False])
def test_recover_keeps_the_distribution(tmp_path, metadata):
    with BagWriter(tmp_path / 'bag', ros_distro='jazzy', custom_data={'a': 'b'}) as writer:
        writer.add_topic(channel_of('/a', 'a_msgs/msg/A'))
        writer.write('/a', 5, b'x')
    if not metadata:
        (tmp_path / 'bag' / 'metadata.yaml').unlink()
    result = recover(tmp_path / 'bag', tmp_path / 'copy')
    assert not result.losses
    assert 'ros_distro: jazzy' in (tmp_path / 'copy' / 'metadata.yaml').read_text()
    with Bag(tmp_path / 'copy') as bag:
        assert (bag.ros_distro, bag.custom_data) == ('jazzy', {'a': 'b'})
