# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""MCAP files, made by hand or by other writers: what is read, and what damage is reported."""

from __future__ import annotations

from contextlib import closing
from random import Random
import struct
from zlib import crc32

import lz4.frame
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType, Writer
import pytest
from smart_tire.bags.mcap_file import MAGIC, MAX_RUN_MESSAGES, McapFile
from smart_tire.bags.metadata import MAX_WARNINGS
from smart_tire.errors import BagError
import zstandard

PACKERS = {'': bytes, 'zstd': zstandard.compress, 'lz4': lz4.frame.compress}
COUNT = 6  # messages of a chunk


def text(value):
    """Return a string of a record."""
    return struct.pack('<I', len(value)) + value.encode()


def record(opcode, content):
    """Return a record."""
    return struct.pack('<BQ', opcode, len(content)) + content


def message(ns, data=b'data', channel=1):
    """Return a message record."""
    return record(Opcode.MESSAGE, struct.pack('<HIQQ', channel, 7, ns, ns + 1) + data)


def topic(number=1, name='/a', kind='a/msg/A'):
    """Return the schema and the channel of a topic."""
    stored = text('offered_qos_profiles') + text('qos')
    return record(Opcode.SCHEMA, struct.pack('<H', number) + text(kind) + text('ros2msg') + text(
        'def')) + record(Opcode.CHANNEL, struct.pack('<HH', number, number) + text(name) + text(
            'cdr') + struct.pack('<I', len(stored)) + stored)


def chunk(records, compression='zstd', *, start=0, end=10**6, crc=True, size=None):
    """Return a chunk record."""
    packed = PACKERS[compression](records)
    return record(Opcode.CHUNK, struct.pack(
        '<QQQI', start, end, len(records) if size is None else size, crc32(records) if crc else 0)
        + text(compression) + struct.pack('<Q', len(packed)) + packed)


def block(first, compression='zstd', **options):
    """Return a chunk of ``COUNT`` messages, with their topic, from time ``first`` on."""
    return chunk(topic() + b''.join(message(ns) for ns in range(first, first + COUNT)),
                 compression, start=first, end=first + COUNT - 1, **options)


HEAD = MAGIC + record(Opcode.HEADER, text('ros2') + text('me'))
TAIL = record(Opcode.DATA_END, bytes(4)) + record(Opcode.FOOTER, bytes(20)) + MAGIC


@pytest.fixture
def read(tmp_path):
    """Return a function that reads times and losses of records with a head."""
    def reader(*records, tail=TAIL, topics=None):
        path = tmp_path / 'a.mcap'
        path.write_bytes(HEAD + b''.join(records) + tail)
        with closing(McapFile(path)) as file:
            return [ns for ns, _, _ in file.messages(topics)], file.losses.reasons
    return reader


@pytest.mark.parametrize('compression', PACKERS)
@pytest.mark.parametrize('crc', [True, False])
def test_chunks_without_index_are_read(read, compression, crc):
    records = [block(first, compression, crc=crc) for first in (10, 20, 30)]
    assert read(*records) == ([*range(10, 16), *range(20, 26), *range(30, 36)], [])


def test_messages_have_their_content_and_channels_theirs(tmp_path):
    path = tmp_path / 'a.mcap'
    path.write_bytes(HEAD + topic() + topic(9, '/b', 'b/msg/B') + message(5, b'one') + message(
        6, b'', 9) + message(7, b'three') + TAIL)
    with closing(McapFile(path)) as file:
        found = [(ns, channel.topic, channel.type, data) for ns, channel, data in file.messages()]
        assert found == [(5, '/a', 'a/msg/A', b'one'), (6, '/b', 'b/msg/B', b''),
                         (7, '/a', 'a/msg/A', b'three')]
        assert [(one.encoding, one.definition, one.definition_encoding, one.qos, count)
                for one, count in file.counts().items()] == [
                    ('cdr', 'def', 'ros2msg', 'qos', 2), ('cdr', 'def', 'ros2msg', 'qos', 1)]
        assert file.span() == (5, 7)
        assert [ns for ns, _, _ in file.messages({'/b'})] == [6]
        assert [ns for ns, _, _ in file.messages(())] == []
        assert (file.losses.reasons, file.warnings) == ([], [])


@pytest.mark.parametrize('chunked', [True, False])
def test_any_order_of_times_is_sorted(tmp_path, chunked):
    times = list(range(3 * MAX_RUN_MESSAGES))
    Random(1).shuffle(times)
    parts = [b''.join(map(message, times[begin:begin + 1000]))
             for begin in range(0, len(times), 1000)]
    path = tmp_path / 'a.mcap'
    path.write_bytes(HEAD + topic() + b''.join(
        chunk(part, start=min(some), end=max(some)) if chunked else part
        for number, part in enumerate(parts)
        for some in [times[1000 * number:1000 * number + 1000]]) + TAIL)
    with closing(McapFile(path)) as file:
        assert [ns for ns, _, _ in file.messages()] == sorted(times)
        assert file.span() == (0, len(times) - 1)
        assert not file.losses.reasons


@pytest.mark.parametrize('opcode', [0x80, 0xFF, Opcode.ATTACHMENT, Opcode.STATISTICS])
@pytest.mark.parametrize('compression', [None, ''])
def test_other_records_are_skipped(read, opcode, compression):
    other = record(opcode, b'what')
    parts = [block(10), block(20)] if compression == '' else [topic() + message(10), message(20)]
    complete, _ = read(*parts)
    assert read(other, parts[0], other, other, parts[1], other) == (complete, [])


@pytest.mark.parametrize('opcode', [0, 0x10, 0x7F])
def test_a_record_that_no_version_has_is_damage(read, opcode):
    other = record(opcode, b'what')
    begin = len(HEAD + block(10))
    times = [*range(10, 16), *range(20, 26)]
    assert read(block(10), other, block(20)) == (
        times, [f'a.mcap: {len(other)} bytes at byte {begin} are damaged'])
    begin = len(HEAD + topic() + message(1))
    assert read(topic(), message(1), other, message(2)) == (
        [1, 2], [f'a.mcap: {len(other)} bytes at byte {begin} are damaged'])


@pytest.mark.parametrize('length', range(0, 22))
def test_a_message_record_that_is_too_short_is_damage(read, length):
    short = record(Opcode.MESSAGE, bytes(length))
    times, losses = read(topic(), message(1), short, message(2))
    assert times == [1, 2]
    assert len(losses) == 1


@pytest.mark.parametrize('compression', PACKERS)
def test_a_cut_anywhere_yields_the_chunks_before_it(read, compression):
    parts = [block(10, compression), block(20, compression)]
    complete = [*range(10, 16), *range(20, 26)]
    whole = b''.join(parts)
    for size in range(len(parts[0]), len(whole)):
        times, losses = read(whole[:size], tail=b'')
        assert times == complete[:len(times)]
        assert len(times) >= COUNT
        if not compression:
            known = (size - len(parts[0]) - (49 + len(topic()))) // len(
                message(1))
            assert len(times) == COUNT + max(0, known)
        assert losses[0] == (f'a.mcap: file is truncated: no index, {size - len(parts[0])} bytes '
                             'after the last complete record')
    for zeros in (0, 4096):
        assert read(whole, bytes(zeros), tail=b'') == (complete, [
            f'a.mcap: file is truncated: no index, {zeros} bytes after the last complete record'])


def test_a_cut_without_chunks_yields_the_messages_before_it(read):
    whole = topic() + b''.join(map(message, range(5)))
    for size in range(len(topic()), len(whole)):
        times, (loss,) = read(whole[:size], tail=b'')
        count, rest = divmod(size - len(topic()), len(message(1)))
        assert times == list(range(count))
        assert loss.endswith(f'no index, {rest} bytes after the last complete record')


@pytest.mark.parametrize(('content', 'reason'), [
    (topic() + message(1) + message(2)[:-1], 'last 34 of {} bytes are not a complete record'),
    (topic() + message(1) + b'\x05', 'last 1 of {} bytes are not a complete record'),
    (topic() + message(1) + bytes(100), 'last 100 of {} bytes are not a complete record'),
    (topic() + message(1) + message(2, channel=3) + message(3, channel=4),
     '2 messages of unknown topics'),
    (topic() + message(1 << 63) + message(1) + message((1 << 64) - 2),
     '2 messages with times above 9223372036854775807 ns')])
def test_what_is_wrong_in_a_chunk_is_reported(read, content, reason):
    assert read(chunk(content, start=1, end=2)) == (
        [1], [f'a.mcap: damaged at byte {len(HEAD)}: {reason.format(len(content))}'])


def test_a_chunk_whose_content_differs_from_its_head_is_a_loss(read):
    content = topic() + message(1)
    for damaged in (chunk(content, size=len(content) + 1), chunk(content, '', size=5),
                    chunk(content).replace(struct.pack('<I', crc32(content)), b'oops')):
        times, (loss,) = read(block(10), damaged)
        assert times == list(range(10, 16))
        assert loss.startswith('a.mcap: ')


def test_a_name_of_a_compression_is_short(read):
    for length, expected in ((16, 'compression is zzzz'), (17, ' bytes at byte ')):
        other = record(Opcode.CHUNK, struct.pack('<QQQI', 0, 0, 5, 0) + text('z' * length)
                       + struct.pack('<Q', 5) + b'12345')
        times, (loss,) = read(block(10), other, block(20))
        assert len(times) == 2 * COUNT
        assert expected in loss


def indexed(path, parts=(range(10),) * 8, **options):
    """Write a file of chunks with three topics; return its bytes and where they start."""
    with path.open('wb') as file:
        writer = Writer(file, **options)
        writer.start('ros2')
        channels = [writer.register_channel(name, 'cdr', writer.register_schema(name, '', b''))
                    for name in ('/a', '/b', '/c')]
        writer.add_metadata('other', {'key': 'value'})
        for number, some in enumerate(parts):
            for part in some:
                writer.add_message(channels[min(part // 3, 2)], 100 * number + part, b'12345', 0)
            writer.flush()
        writer.finish()
    with closing(McapFile(path)) as file:
        starts = [one.offset for one in file._blocks]
    return bytearray(path.read_bytes()), starts


ALL = [100 * number + part for number in range(8) for part in range(10)]


def opened(path, data):
    """Write data; return times, losses, warnings and the losses' number of messages."""
    path.write_bytes(data)
    with closing(McapFile(path)) as file:
        counts = sorted((channel.topic, count) for channel, count in file.counts().items())
        return ([ns for ns, _, _ in file.messages()], file.losses.reasons, file.warnings,
                file.losses.messages, counts)


COUNTS = [('/a', 24), ('/b', 24), ('/c', 32)]


@pytest.mark.parametrize('damaged', [0, 1, 4, 5, 8])
def test_the_index_counts_as_long_as_half_of_the_chunks_are_there(tmp_path, damaged):
    data, starts = indexed(tmp_path / 'a.mcap')
    for start in starts[:damaged]:
        data[start] = Opcode.HEADER
    times, _, warnings, _, counts = opened(tmp_path / 'a.mcap', data)
    assert times == ALL
    assert counts == COUNTS
    assert warnings == ([] if damaged <= 4 else
                        ['a.mcap: index is damaged (chunks are not where it says)'])


def test_damage_of_the_summary_loses_no_message(tmp_path):
    data, _ = indexed(tmp_path / 'a.mcap')
    for where in range(8, len(data) - data.rindex(b'12345') - 200, 7):
        damaged = data[:]
        damaged[-where] ^= 0x55
        assert opened(tmp_path / 'a.mcap', damaged)[0] == ALL


@pytest.mark.parametrize('damaged', [0, 1])
def test_an_index_without_checksum_counts_if_all_chunks_are_there(tmp_path, damaged):
    data, starts = indexed(tmp_path / 'a.mcap', enable_crcs=False)
    data[starts[3]] ^= 0x80 * damaged
    times, _, warnings, _, _ = opened(tmp_path / 'a.mcap', data)
    assert times == ALL
    assert bool(warnings) is bool(damaged)


@pytest.mark.parametrize('where', [9, 17])  # start and end of the times
def test_the_times_of_a_chunk_are_those_of_the_index(tmp_path, where):
    data, starts = indexed(tmp_path / 'a.mcap')
    data[starts[2] + where] ^= 0x40
    assert opened(tmp_path / 'a.mcap', data) == (ALL, [], [], 0, COUNTS)


def test_the_messages_of_a_lost_chunk_are_counted_by_the_index(tmp_path):
    data, starts = indexed(tmp_path / 'a.mcap', compression=CompressionType.NONE)
    data[starts[6] + 100] ^= 1
    times, (loss,), warnings, lost, _ = opened(tmp_path / 'a.mcap', data)
    assert times == [ns for ns in ALL if ns // 100 != 6]
    assert loss == f'a.mcap: damaged at byte {starts[6]}: checksum mismatch'
    assert (warnings, lost) == ([], 10)


def test_a_file_whose_index_lacks_a_chunk_is_read_without_it(tmp_path):
    data, starts = indexed(tmp_path / 'a.mcap', enable_crcs=False)
    entry = data.rindex(struct.pack('<Q', starts[6])) - 16 - 9  # after the times of the chunk
    assert data[entry] == Opcode.CHUNK_INDEX
    length, = struct.unpack_from('<Q', data, entry + 1)
    del data[entry:entry + 9 + length]
    times, losses, _, lost, _ = opened(tmp_path / 'a.mcap', data)
    assert (times, losses, lost) == (ALL, [], 0)


def test_messages_of_one_topic_in_chunks_that_overlap_are_in_order(read):
    two = topic() + topic(2, '/b')
    assert read(chunk(two + message(5) + message(20, channel=2), start=5, end=20),
                chunk(two + message(10, channel=2) + message(30), start=10, end=30),
                chunk(two + message(12), start=12, end=12), topics={'/b'}) == ([10, 20], [])


def statistics(data):
    """Return where the content of the statistics begins."""
    at = data.rindex(struct.pack('<BQ', Opcode.STATISTICS, 42 + 4 + 3 * 10)) + 9
    assert data[at] == len(ALL)
    return at


def test_how_many_messages_of_a_chunk_that_is_read_in_part_are_lost_is_unknown(tmp_path):
    path = tmp_path / 'a.mcap'
    path.write_bytes(HEAD + chunk(topic() + message(1) + message(2)[:-1], start=1, end=2) + TAIL)
    with closing(McapFile(path)) as file:
        assert [ns for ns, _, _ in file.messages()] == [1]
        assert file.losses.messages == 0
        assert file.losses.lines()[0].startswith('messages are missing: ')


def test_statistics_of_another_number_of_chunks_are_not_used(tmp_path):
    data, _ = indexed(tmp_path / 'a.mcap', enable_crcs=False)
    at = statistics(data)
    data[at + 22] += 1  # chunks
    data[at] += 5       # messages
    times, losses, warnings, lost, counts = opened(tmp_path / 'a.mcap', data)
    assert (times, warnings, lost, counts) == (ALL, [], 5, COUNTS)
    assert losses == ['a.mcap: 80 of 85 messages in its statistics']


def test_a_damaged_metadata_record_is_a_warning(tmp_path):
    data, _ = indexed(tmp_path / 'a.mcap')
    path = tmp_path / 'a.mcap'
    at = data.index(b'other')
    data[at - 1] = 0xFF  # length of the name
    path.write_bytes(data)
    with closing(McapFile(path)) as file:
        assert file.metadata() == []
        warning, = file.warnings
        assert warning.startswith(f'a.mcap: damaged at byte {at - 13}: ')
        assert [ns for ns, _, _ in file.messages()] == ALL


@pytest.mark.parametrize('scanned', [True, False])
def test_topics_are_selected_with_and_without_index(tmp_path, scanned):
    path = tmp_path / 'a.mcap'
    data, _ = indexed(path)
    path.write_bytes(data[:-20] if scanned else data)
    with closing(McapFile(path)) as file:
        for topics, parts in (({'/a'}, {0, 1, 2}), ({'/b', '/c'}, range(3, 10)), ({'/d'}, ())):
            assert [ns for ns, _, _ in file.messages(topics)] == [
                ns for ns in ALL if ns % 100 in parts]
        assert file.span() == (0, 709)


def test_chunks_without_the_wanted_topics_are_not_read(tmp_path):
    path = tmp_path / 'a.mcap'
    data, starts = indexed(path, parts=[[0, 1], [3]])
    data[starts[1] + 70] ^= 1
    path.write_bytes(data)
    with closing(McapFile(path)) as file:
        assert [ns for ns, _, _ in file.messages({'/a'})] == [0, 1]
        assert not file.losses.reasons
        assert not list(file.messages({'/b'}))
        assert len(file.losses.reasons) == 1


@pytest.mark.parametrize('options', [
    {'use_chunking': False}, {'use_chunking': False, 'index_types': IndexType.NONE},
    {'index_types': IndexType.NONE}, {'compression': CompressionType.LZ4},
    {'compression': CompressionType.NONE}, {'use_statistics': False},
    {'repeat_channels': False}, {'repeat_schemas': False}, {'enable_crcs': False}], ids=str)
def test_files_of_other_writers_are_read(tmp_path, options):
    data, _ = indexed(tmp_path / 'a.mcap', **options)
    assert opened(tmp_path / 'a.mcap', data) == (ALL, [], [], 0, COUNTS)


def test_a_second_type_on_a_topic_is_skipped_with_a_warning(tmp_path):
    path = tmp_path / 'a.mcap'
    path.write_bytes(HEAD + topic() + message(1) + topic(2, kind='a/msg/B') + message(
        2, channel=2) + TAIL)
    with closing(McapFile(path)) as file:
        assert [channel.type for _, channel, _ in file.messages()] == ['a/msg/A']
        assert file.warnings == ['a.mcap: /a has a second type, a/msg/B, which is skipped']


@pytest.mark.parametrize('data', [b'', b'\x89MCAP', b'PK\x03\x04' + bytes(100)])
def test_a_file_that_is_not_mcap_is_rejected(tmp_path, data):
    path = tmp_path / 'a.mcap'
    path.write_bytes(data)
    with pytest.raises(BagError, match=r'a\.mcap: (file is empty|not an MCAP file)'):
        McapFile(path)


def test_an_index_that_lists_records_many_times_reads_them_once(tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        channel = writer.register_channel('/a', 'cdr', writer.register_schema('a', '', b''))
        writer.add_message(channel, 5, b'x', 5)
        writer.flush()
        writer.add_metadata('rosbag2', {'serialized_metadata': 'ros_distro: humble'})
        writer._Writer__chunk_indices *= 100
        writer._Writer__metadata_indexes *= 100
        writer._Writer__statistics.chunk_count = 100
        writer.finish()
    with closing(McapFile(path)) as file:
        assert [ns for ns, _, _ in file.messages()] == [5]
        assert file.warnings == ['a.mcap: index is damaged (chunks overlap)']
        assert [one.ros_distro for one in file.metadata()] == ['humble']
        file._metadata_offsets *= 10_000  # of an index whose chunks are in order
        assert 1 <= len(file.metadata()) < 1000
        assert 'metadata overlap' in file.warnings[-1]


def test_channels_in_the_order_of_their_records_have_their_messages(read):
    assert read(topic(1, '/a') + message(1) + topic(2, '/b') + message(2, channel=2) + message(
        3) + topic(1, '/c') + message(4), topics={'/a', '/c'}) == ([1, 3, 4], [])
    content = topic(1, '/a') + message(1) + topic(2, '/b') + message(2, channel=2) + message(3)
    assert read(chunk(content, start=1, end=3), topics={'/b'}) == ([2], [])
    assert read(chunk(content, start=1, end=3), topics={'/a'}) == ([1, 3], [])
    assert read(chunk(content, start=1, end=3), chunk(message(4, channel=2), start=4, end=4),
                topics={'/b'}) == ([2, 4], [])


def test_no_more_warnings_than_anybody_reads(tmp_path):
    path = tmp_path / 'a.mcap'
    path.write_bytes(HEAD + topic() + message(1) + b''.join(
        topic(number, kind=f'a/msg/B{number}') for number in range(2, 300)) + TAIL)
    with closing(McapFile(path)) as file:
        assert [ns for ns, _, _ in file.messages()] == [1]
        assert len(file.warnings) == MAX_WARNINGS
